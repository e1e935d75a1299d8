%% The geocast's contract where the time of day is not known: by the order of events, crashes and
%% the client's window.
-module(starl_geocast_model_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_geocast_model_monitor).
-define(ID, {1, 1, 1}).
-define(LIFE, 10000000).

new() -> ?M:init(#{lifetime_us => ?LIFE, robots => [1, 2], progress => true, grace_us => 0}).

%% What is found in these events, and at their end.
found(Events) ->
    {Found, Last} = lists:foldl(
        fun({Robot, Machine, Event}, {Acc, State}) ->
            case ?M:step({77777, Robot, Machine, Event}, State) of
                {ok, Next} -> {Acc, Next};
                {violation, #{what := What, at_us := At}, Next} -> {Acc ++ [{What, At}], Next}
            end
        end,
        {[], new()},
        Events
    ),
    case ?M:finish(99999, Last) of
        {ok, _} -> Found;
        {{violation, Late}, _} -> Found ++ [{What, At} || #{what := What, at_us := At} <- Late]
    end.

sent() -> {1, geocast, {sent, ?ID, {circle, {0.0, 0.0}, 9.0e6}, ?LIFE, 77}}.
here(Robot) -> {Robot, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}}.
delivered(Robot) -> {Robot, geocast, {delivered, ?ID, 77}}.
over() -> {1, app, {window, over}}.

%% Nothing takes time but a crash and the window: by the order of its events a delivery is in time,
%% or just too late.
times_test() ->
    Begun = [here(1), here(2), sent(), delivered(1)],
    ?assertEqual([], found(Begun ++ [delivered(2)])),
    ?assertEqual([], found(Begun ++ [delivered(2), over()])),
    Late = [here(1), here(2), sent(), over(), delivered(1), delivered(2)],
    ?assertMatch([{not_delivered, ?LIFE} | _], found(Late)),
    %% another word of the client's takes no time
    ?assertEqual([], found([here(1), here(2), sent(), {1, app, {window, begins}}, delivered(1)])).

%% A crash takes a microsecond.
crash_test() ->
    Crashed = {2, geocast, crashed},
    Now = fun(Events) ->
        Last = lists:foldl(
            fun({Robot, Machine, Event}, State) ->
                {ok, Next} = ?M:step({0, Robot, Machine, Event}, State),
                Next
            end,
            new(),
            Events
        ),
        element(1, ?M:timeless(Last))
    end,
    ?assertEqual(
        [0, 1, 2, ?LIFE + 1, ?LIFE + 2],
        [
            Now(Events)
         || Events <- [
                [here(1), sent(), delivered(1), {2, robot, up}],
                [Crashed],
                [Crashed, Crashed],
                [over()],
                [over(), Crashed]
            ]
        ]
    ).

%% The window that the end of the run finds open is none that anything is owed in.
owed_test() ->
    Events = [here(1), here(2), sent(), delivered(1)],
    ?assertEqual([], found(Events)),
    ?assertEqual([{not_delivered, ?LIFE}], found(Events ++ [over()])).

%% What was wrong once is known: it is told once.
told_once_test() ->
    Twice = [here(1), here(2), sent(), delivered(1), delivered(1), delivered(2), over()],
    ?assertEqual([{delivered_twice, 0}], found(Twice)),
    ?assertMatch(
        [{not_delivered, _}],
        found([here(1), here(2), sent(), delivered(1), over(), {2, robot, up}])
    ).

vocabulary_test() ->
    ?assertEqual(
        (starl_geocast_monitor:vocabulary())#{app => [{window, 1}]}, ?M:vocabulary()
    ),
    ?assertEqual([app, geocast, robot], ?M:interests()).
