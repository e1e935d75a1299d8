%% What the judge of a recording knows before it judges. A monitor, too: it accuses a robot of `touched', unless it knows
%% of a pause of robot 1 at that time.
%%
%% Holds: A robot without power excuses what it explains, in a recording without a schedule, and
%% nothing before and behind it
%% Red: 961f67c9, run: 15 of 36 sound fleets accused
-module(starl_trace_judge_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_monitor).

-export([init/1, step/2, broken/2, finish/2]).

init(#{}) -> [].

step({T, Robot, app, touched}, Pauses) ->
    case [From || {From, To} <- Pauses, From =< T, T =< To] of
        %% once told, it is known
        [] -> {violation, violation(T, Robot), [{T, T + 100} | Pauses]};
        _ -> {ok, Pauses}
    end;
step(_Event, Pauses) ->
    {ok, Pauses}.

violation(T, Robot) ->
    #{contract => test, what => touched, at_us => T, robots => [Robot], details => #{}}.

broken({1, From, To, Why}, Pauses) when Why =:= pause; Why =:= fault -> [{From, To} | Pauses];
broken({_, _, _, _}, Pauses) -> Pauses.

finish(_End, _Pauses) -> {ok, #{}}.

%% What a computer that was late explains is excused, though another robot's fact comes before it tells of that: however
%% long it stood still, as the judge of a live run waits for it, in whatever second of the recording.
%% Holds: A recording excuses what its run excused, however long a computer stood still
%% Red: 961f67c9, run: 4 false violations
a_late_computer_is_excused_test() ->
    File = filename:join("/tmp", "starl-trace-judge-" ++ os:getpid() ++ ".mcap"),
    Found = fun(T, From, Told) ->
        %% something happens in each second
        Facts = lists:keysort(1, [
            {T, 2, app, touched},
            {Told, 1, robot, {late, From, Told}}
            | [{S * 1_000_000 + 500_000, 1, app, goes_on} || S <- lists:seq(0, 25)]
        ]),
        ok = starl_trace_ct:recorded(File, news([{judged, [Fact], []} || Fact <- Facts])),
        {ok, #{violations := Violations}} = starl_trace_judge:file(File),
        [At || #{at_us := At} <- Violations]
    end,
    Told = [
        {T, T + Later}
     || T <- [700_000, 1_000_000, 1_999_999],
        Later <- [1, 600_000, 1_500_000, 4_000_000, 20_000_000]
    ],
    try
        [?assertEqual({T, []}, {T, Found(T, T, L)}) || {T, L} <- Told],
        [?assertEqual([T], Found(T, T + 1, L)) || {T, L} <- Told]
    after
        file:delete(File)
    end.

%% A fault whose end nobody knows yet excuses as long as it lasts, from its beginning on; monitors are told of it
%% before they judge.
a_lasting_fault_is_excused_test() ->
    File = filename:join("/tmp", "starl-trace-judge-lasts-" ++ os:getpid() ++ ".mcap"),
    Fault = {f, 1000, forever, reach, 1, #{}},
    Touched = fun(T) -> {judged, [{T, 2, app, touched}], []} end,
    ok = starl_trace_ct:recorded(
        File,
        news(
            [Touched(900_000), {fault, 1_000_000, {began, Fault}}] ++
                [Touched(T * 1_000_000) || T <- [2, 9, 16, 23]] ++
                [{fault, 24_000_000, {ended, setelement(3, Fault, 24000)}}] ++
                [Touched(T * 1_000_000) || T <- [40, 41]]
        )
    ),
    try
        {ok, #{violations := Violations}} = starl_trace_judge:file(File),
        ?assertEqual([900_000, 40_000_000, 41_000_000], [At || #{at_us := At} <- Violations])
    after
        file:delete(File)
    end.

%% A robot without power excuses what happens until it is up again, in a recording that has no schedule; and nothing
%% before and behind that. Nothing is owed before a recording begins.
a_robot_that_is_down_is_excused_test() ->
    File = filename:join("/tmp", "starl-trace-judge-down-" ++ os:getpid() ++ ".mcap"),
    Fact = fun(T, Robot, Machine, What) -> {judged, [{T * 100_000, Robot, Machine, What}], []} end,
    Touched = fun(T) -> Fact(T, 2, app, touched) end,
    ok = starl_trace_ct:recorded(
        File,
        news(
            [Touched(9), Fact(10, 1, robot, down), Fact(10, 1, app, crashed)] ++
                [Touched(T) || T <- [20, 90, 160, 230]] ++
                [Fact(240, 1, robot, up)] ++
                [Touched(T) || T <- [400, 410]]
        )
    ),
    try
        {ok, #{violations := Violations}} = starl_trace_judge:file(File),
        ?assertEqual([900_000, 40_000_000, 41_000_000], [At || #{at_us := At} <- Violations])
    after
        file:delete(File)
    end.

%% What happens while a robot is halted waits until it is over, which excuses it, and is judged once.
what_waits_for_the_end_of_a_halt_is_judged_once_test() ->
    File = filename:join("/tmp", "starl-trace-judge-halt-" ++ os:getpid() ++ ".mcap"),
    Halt = {f, 1000, forever, pause, 1, #{}},
    Touched = fun(Second) -> {judged, [{Second * 1_000_000, 2, app, touched}], []} end,
    ok = starl_trace_ct:recorded(
        File,
        news(
            [{fault, 1_000_000, {began, Halt}}, Touched(2), Touched(3)] ++
                [{fault, 4_000_000, {ended, setelement(3, Halt, 4000)}}] ++
                [Touched(Second) || Second <- [5, 6, 7]]
        )
    ),
    try
        {ok, #{violations := Violations, events := Events}} = starl_trace_judge:file(File),
        ?assertEqual([5_000_000, 6_000_000, 7_000_000], [At || #{at_us := At} <- Violations]),
        ?assertEqual(5, Events)
    after
        file:delete(File)
    end.

%% A monitor goes on from what it knew when it accused somebody.
a_monitor_goes_on_test() ->
    File = filename:join("/tmp", "starl-trace-judge-on-" ++ os:getpid() ++ ".mcap"),
    Touched = [{judged, [{T, 2, app, touched}], []} || T <- [700_000, 700_100, 700_101]],
    ok = starl_trace_ct:recorded(File, news(Touched)),
    try
        {ok, #{violations := Violations, events := Events}} = starl_trace_judge:file(File),
        ?assertEqual([700_000, 700_101], [At || #{at_us := At} <- Violations]),
        ?assertEqual(3, Events)
    after
        file:delete(File)
    end.

news(News) ->
    Facts = (starl_trace_ct:facts())#{kind := live, monitors := [{?MODULE, #{}}]},
    {Messages, Stream} = lists:mapfoldl(
        fun starl_trace_stream:news/2, starl_trace_stream:new(), [{begun, Facts} | News]
    ),
    {Last, _} = starl_trace_stream:close(Stream),
    lists:append(Messages) ++ Last.
