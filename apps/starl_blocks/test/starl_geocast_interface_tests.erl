%% What the geocast's interface asks its machine, and what it makes of the answers.
-module(starl_geocast_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-export([init/2, step/2]).

-define(AREA, {circle, {0.0, 0.0}, 1000.0}).

%% The application: its state is a function.
init(_Robot, Fun) -> Fun.

step(Robot, Fun) -> {done, Fun(Robot)}.

%% The actions of the function until it waits or ends, and its process.
begun(Fun) ->
    {ok, Pid} = starl_app_proc:start_link(#{
        robot => 1,
        handle => starl:robot(1, [1, 2]),
        module => ?MODULE,
        args => Fun,
        driver => self()
    }),
    receive
        {starl_attach, 1, app, Pid} -> ok
    end,
    Random = rand:seed_s(exsss, 1),
    Pid ! {starl_boot, #{now => 0, random => Random, incarnation => 1, stored => none}},
    {done(), Pid}.

done() ->
    receive
        {starl_done, 1, _Pid, Actions} -> Actions
    end.

stop(Pid) ->
    unlink(Pid),
    exit(Pid, kill).

%% What is asked by these options, and what comes of the event that follows.
sent(Options, Event) ->
    {[{call, geocast, Request, Tag}], Pid} = begun(fun(Robot) ->
        starl_geocast:send(Robot, ?AREA, news, hello, Options)
    end),
    {Type, Content} = Event(Tag),
    Pid ! {starl_step, Type, Content, #{now => 0, robot => 1}},
    Result = result(done(), Pid),
    stop(Pid),
    {Request, Result}.

%% It may wait a moment for the machine that crashed.
result([{done, Result}], _Pid) ->
    Result;
result([{{timeout, Tag}, _Us, call}], Pid) ->
    Pid ! {starl_step, {timeout, Tag}, call, #{now => 0, robot => 1}},
    result(done(), Pid).

answers(Answer) -> fun(Tag) -> {{reply, Tag}, Answer} end.

restarts() -> fun(_Tag) -> {info, {restarted, geocast}} end.

%% Five seconds and 32 hops, unless the options say otherwise.
send_test() ->
    Request = {send, ?AREA, news, hello, 5000000, 32},
    ?assertEqual({Request, ok}, sent(#{}, answers(ok))),
    ?assertEqual({Request, {error, full}}, sent(#{}, answers({error, full}))),
    ?assertEqual({Request, {error, restarted}}, sent(#{}, restarts())),
    Other = {send, ?AREA, news, hello, 7000, 3},
    ?assertEqual({Other, ok}, sent(#{lifetime_ms => 7, hops => 3}, answers(ok))).

listen_test() ->
    {Actions, Pid} = begun(fun(Robot) -> starl_geocast:listen(Robot, news) end),
    ?assertEqual([{cast, geocast, {listen, news, app}}, {done, ok}], Actions),
    stop(Pid).

blocks_test() ->
    ?assertEqual([{geocast, starl_geocast_flood, #{}}], starl_geocast:machines(#{})),
    ?assertEqual(
        [{geocast, starl_geocast_flood, #{limit => 7}}], starl_geocast:machines(#{limit => 7})
    ).

%% What is no area, type or option is the caller's mistake, told by its name.
mistakes_test() ->
    Robot = starl:robot(1, [1, 2]),
    Send = fun(Area, Type, Options) -> starl_geocast:send(Robot, Area, Type, hello, Options) end,
    [
        ?assertError(
            {bad_argument, #{function := {starl_geocast, send, 5}, argument := Argument}},
            Send(Area, Type, Options)
        )
     || {Argument, Area, Type, Options} <- [
            {'Area', {circle, {0.0, 0.0}, -1.0}, news, #{}},
            {'Area', here, news, #{}},
            {'Type', ?AREA, "news", #{}},
            {'Options', ?AREA, news, []},
            {'Options', ?AREA, news, #{other => 1}},
            {lifetime_ms, ?AREA, news, #{lifetime_ms => 0}},
            {lifetime_ms, ?AREA, news, #{lifetime_ms => 86400001}},
            {lifetime_ms, ?AREA, news, #{lifetime_ms => infinity}},
            {hops, ?AREA, news, #{hops => 0}},
            {hops, ?AREA, news, #{hops => 1.0}}
        ]
    ],
    ?assertError(
        {bad_argument, #{function := {starl_geocast, listen, 2}, argument := 'Type'}},
        starl_geocast:listen(Robot, "news")
    ).
