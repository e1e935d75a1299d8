-module(starl_view_credit_tests).
-include_lib("eunit/include/eunit.hrl").

-define(C, starl_view_credit).

%% One question at a time, and none while the client has too much before it.
asks_test() ->
    {true, Asked} = ?C:may_ask(?C:new(2)),
    ?assertMatch({false, _}, ?C:may_ask(Asked)),
    {true, Again} = ?C:may_ask(?C:answered(Asked)),
    Full = ?C:answered(Again),
    ?assertMatch({false, _}, ?C:may_ask(Full)),
    ?assertMatch({true, _}, ?C:may_ask(?C:handled(Full))).

%% What it claims to have handled beside that gives it no more.
no_credit_for_nothing_test() ->
    Boasting = lists:foldl(fun(_, C) -> ?C:handled(C) end, ?C:new(1), lists:seq(1, 9)),
    {true, Asked} = ?C:may_ask(Boasting),
    ?assertMatch({false, _}, ?C:may_ask(?C:answered(Asked))).

unlimited_test() ->
    Sent = lists:foldl(fun(_, C) -> ?C:answered(C) end, ?C:new(unlimited), lists:seq(1, 100)),
    ?assertMatch({true, _}, ?C:may_ask(Sent)).

mistakes_test() ->
    Bad = lists:foldl(
        fun(_, C) -> element(2, ?C:mistake(C)) end, ?C:new(1), lists:seq(1, 20)
    ),
    ?assertEqual(shut_out, ?C:mistake(Bad)).

commands_test() ->
    Busy = lists:foldl(
        fun(_, C) -> element(2, ?C:command(7, C)) end, ?C:new(1), lists:seq(1, 100)
    ),
    ?assertEqual(too_many, ?C:command(7, Busy)),
    ?assertMatch({ok, _}, ?C:command(8, Busy)).
