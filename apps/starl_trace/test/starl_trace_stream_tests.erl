%% The messages of a run from its news: here of runs whose time does not begin at 0.
-module(starl_trace_stream_tests).
-include_lib("eunit/include/eunit.hrl").

%% Since 1970, us: the time of a robot on its own.
-define(LATE_US, 1795451471512345).

%% A robot that records itself told, with the first event, a sample for each second since 1970: its
%% recorder took all the memory of its computer and never came to an end.
late_robot_test() ->
    {[{scenario, ?LATE_US, _}], Begun} = news({begun, facts()}, starl_trace_stream:new()),
    {Started, Up} = news({started, ?LATE_US, 1, [app]}, Begun),
    ?assertEqual([], Started),
    {Events, Heard} = news({judged, [{?LATE_US + 100, 1, app, step}], []}, Up),
    ?assertEqual([{trace, ?LATE_US + 100, {1, app, step}}], Events),
    {Places, _} = news({seen, ?LATE_US + 200, 1, {1.0, 2.0, 0.0}}, Heard),
    ?assertMatch([{poses, _, #{robots := [{1, {1.0, 2.0, 0.0}, none, unknown}]}}], Places).

%% The first figures come when a second is over, not before the beginning.
times_never_go_back_test() ->
    {Head, Begun} = news({begun, facts()}, starl_trace_stream:new()),
    Trace = [{?LATE_US + N * 300000, 1, app, step} || N <- lists:seq(0, 9)],
    {Messages, _} = news({judged, Trace, []}, Begun),
    Times = [T || {_, T, _} <- Head ++ Messages],
    ?assertEqual(lists:sort(Times), Times),
    ?assertMatch([_, _, _], [T || {metrics, T, _} <- Messages]).

%% Reading it took as long as writing it.
late_recording_test() ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    File = filename:join("/tmp", "starl_late_" ++ os:getpid() ++ "_" ++ Unique ++ ".mcap"),
    {ok, Recorder} = starl_trace_recorder:start_link(File, live),
    Observer = starl_trace_recorder:observer(Recorder),
    ok = starl_observer:tell({begun, facts()}, Observer),
    ok = starl_observer:tell({judged, [{?LATE_US + 100, 1, app, step}], []}, Observer),
    {ok, #{until_us := Until}} = starl_trace_recorder:close(Recorder),
    ?assertEqual(?LATE_US + 100, Until),
    {ok, Read, closed} = starl_trace_reader:fold(fun(M, All) -> [M | All] end, [], File),
    ?assertMatch([{trace, _, {1, app, step}}, {scenario, _, _}], Read),
    {ok, Cursor} = starl_trace_reader:start(File, ?LATE_US + 50),
    ?assertMatch(
        {ok, [{scenario, _, _}, {trace, _, {1, app, step}}], _}, starl_trace_reader:next(Cursor)
    ),
    ok = starl_trace_reader:stop(Cursor),
    ok = file:delete(File).

news(News, Stream) -> starl_trace_stream:news(News, Stream).

facts() ->
    #{
        kind => live,
        app => loop,
        scenario => #{app => loop},
        robots => [{1, {0.0, 0.0, 0.0}}],
        monitors => [],
        waypoints => #{},
        machines => #{app => starl_app_proc},
        epoch_us => 0,
        begun_us => ?LATE_US,
        told_by => [1]
    }.
