%% Who is at work for too long: a machine is killed, an application is logged.
-module(starl_live_watch_tests).
-include_lib("eunit/include/eunit.hrl").

%% What becomes of a robot at these watches, of which each tells its turn and who is at work, and of the log.
watched(Looks) ->
    Self = self(),
    Reports = starl_live_log_ct:reports(fun() ->
        {Dos, _} = lists:mapfoldl(
            fun(Look, Watch) -> starl_live_watch:look(Look, [], Watch) end,
            starl_live_watch:new(),
            Looks
        ),
        Self ! {dos, Dos}
    end),
    receive
        {dos, Dos} -> {Dos, [{Level, Report} || {Level, Report, _} <- Reports]}
    end.

%% A machine that is at work in one turn from one watch to the next is killed, and that is logged; then it has
%% its time anew.
a_machine_that_hangs_is_killed_test_() ->
    Killed = {error, #{what => no_answer, machine => sap}},
    [
        ?_assertEqual({Dos, Reports}, watched(Looks))
     || {Dos, Reports, Looks} <- [
            {[ok, kill], [Killed], [{7, sap}, {7, sap}]},
            {[ok, kill, ok, kill], [Killed, Killed], lists:duplicate(4, {7, sap})},
            {[ok, ok, kill], [Killed], [{7, sap}, {8, sap}, {8, sap}]},
            {[ok, ok, ok], [], [{7, sap}, {7, none}, {7, sap}]},
            {[ok, ok, ok], [], [{7, none}, {7, none}, {7, none}]}
        ]
    ].

%% One line of a step that takes 10 s, that is three watches, with its machine; the gauge counts on. A process
%% that has answered has its time anew.
a_long_step_is_logged_once_test() ->
    Pid = spawn_link(fun() ->
        receive
            ends -> ok
        end
    end),
    Looks = fun(N, Watch) ->
        lists:foldl(
            fun(_, W) ->
                {ok, Next} = starl_live_watch:look({0, none}, [{Pid, app}], W),
                Next
            end,
            Watch,
            lists:seq(1, N)
        )
    end,
    Watches = fun(N, Watch) ->
        Self = self(),
        Reports = starl_live_log_ct:reports(fun() -> Self ! {watched, Looks(N, Watch)} end),
        receive
            {watched, Next} -> {Next, Reports}
        end
    end,
    {Two, []} = Watches(2, starl_live_watch:new()),
    ?assertEqual(5, starl_live_watch:longest_s(Two)),
    {Three, [{Level, Report, _} = Long]} = Watches(1, Two),
    ?assertEqual(10, starl_live_watch:longest_s(Three)),
    ?assertMatch({error, #{what := long_step, machine := app}}, {Level, Report}),
    ?assertMatch(
        {match, _},
        re:run(
            starl_live_log_ct:words(Long),
            "^in one step for 10 s at starl_live_watch_tests.erl:[0-9]+; an endless loop\\?$"
        )
    ),
    {Many, []} = Watches(5, Three),
    ?assertEqual(35, starl_live_watch:longest_s(Many)),
    %% another process that answers changes nothing
    ?assertEqual(35, starl_live_watch:longest_s(starl_live_watch:answered(self(), Many))),
    Anew = starl_live_watch:answered(Pid, Many),
    ?assertEqual(0, starl_live_watch:longest_s(Anew)),
    {_, [_]} = Watches(3, Anew),
    %% one that is not at work any more is forgotten
    {ok, Idle} = starl_live_watch:look({0, none}, [], Many),
    ?assertEqual(0, starl_live_watch:longest_s(Idle)),
    %% of one that is gone meanwhile nobody knows the place
    unlink(Pid),
    Monitor = monitor(process, Pid),
    Pid ! ends,
    receive
        {'DOWN', Monitor, process, Pid, _} -> ok
    end,
    {Gone3, [Gone]} = Watches(3, starl_live_watch:new()),
    ?assertEqual(5000, starl_live_watch:longest_s(Looks(998, Gone3))),
    ?assertEqual("in one step for 10 s", starl_live_log_ct:words(Gone)),
    ?assertEqual(5000, starl_live_watch:period_ms()).
