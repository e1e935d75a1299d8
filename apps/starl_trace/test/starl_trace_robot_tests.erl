%% A robot's own recording, in several files: what is in them after each kind of end.
-module(starl_trace_robot_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MOST, 440000).

%% A node that is killed in the moment in which a file was full: the next one has no event yet, and what
%% was lost is found by the end of the full one.
killed_in_a_new_file_test() ->
    Dir = dir(),
    Events = [event(N) || N <- lists:seq(1, 300)],
    {ok, Recorder} = starl_trace_robot:start_link(config(Dir, [])),
    ok = told(Events, starl_trace_robot:observer(Recorder)),
    ok = killed(Recorder),
    ?assertMatch([_, _], starl_trace_robot:files(1, Dir)),
    Lost = [event(N) || N <- [301, 302]],
    Config = config(Dir, Events ++ Lost),
    {ok, Next} = starl_trace_robot:start_link(Config#{now := fun() -> 4_000_000 end}),
    {ok, _} = starl_trace_recorder:close(Next),
    [Full, Empty, Third] = starl_trace_robot:files(1, Dir),
    ?assertEqual({Events, closed}, traced(Full)),
    ?assertEqual({[], cut_off}, traced(Empty)),
    ?assertEqual({Lost, closed}, traced(Third)),
    ok = file:del_dir_r(Dir).

%% The clock was set back between two lives: the second has its own times, and what the first had lost
%% stands at its beginning.
a_clock_that_was_set_back_test() ->
    Dir = dir(),
    Events = [event(N) || N <- lists:seq(1, 250)],
    {ok, Recorder} = starl_trace_robot:start_link(config(Dir, [])),
    ok = told(Events, starl_trace_robot:observer(Recorder)),
    ok = killed(Recorder),
    All = Events ++ [event(251)],
    Config = config(Dir, All),
    {ok, Next} = starl_trace_robot:start_link(Config#{now := fun() -> 5000 end}),
    Own = [{Us, 1, app, {step, Us, <<>>}} || Us <- [6000, 7000, 9_000_000]],
    ok = told(Own, starl_trace_robot:observer(Next)),
    {ok, _} = starl_trace_recorder:close(Next),
    Files = starl_trace_robot:files(1, Dir),
    Kept = lists:append([element(1, traced(File)) || File <- lists:droplast(Files)]),
    Lost = [{5000, 1, app, What} || {_, 1, app, What} <- All -- Kept],
    ?assertMatch([_ | _], Lost),
    ?assertEqual({Lost ++ Own, closed}, traced(lists:last(Files))),
    ok = file:del_dir_r(Dir).

%% Much more than may be kept: the latest files are there, whole.
the_latest_are_kept_test_() ->
    {timeout, 60, fun() ->
        Dir = dir(),
        {ok, Recorder} = starl_trace_robot:start_link(config(Dir, [])),
        Observer = starl_trace_robot:observer(Recorder),
        Parts = [[event(300 * P + N) || N <- lists:seq(1, 300)] || P <- lists:seq(1, 20)],
        [ok = told(Part, Observer) || Part <- Parts],
        {ok, _} = starl_trace_recorder:close(Recorder),
        Files = starl_trace_robot:files(1, Dir),
        ?assert(lists:sum([filelib:file_size(File) || File <- Files]) < 2 * ?MOST),
        Kept = lists:append([element(1, traced(File)) || File <- Files]),
        ?assertNotEqual([], Kept),
        ?assertEqual(Kept, lists:nthtail(6000 - length(Kept), lists:append(Parts))),
        ok = file:del_dir_r(Dir)
    end}.

%% A robot's recording says whose it is, and when it begins.
a_recording_says_whose_it_is_test() ->
    Dir = dir(),
    Config = (config(Dir, []))#{most_bytes := none, robot := 7, now := fun() -> 5000 end},
    {ok, Recorder} = starl_trace_robot:start_link(Config),
    {ok, #{file := File}} = starl_trace_recorder:close(Recorder),
    ?assertEqual("robot-7.mcap", filename:basename(File)),
    ?assertMatch(
        {ok, #{scenario := #{told_by := [7], begun_us := 5000}}}, starl_trace_reader:tail(File)
    ),
    ok = file:del_dir_r(Dir).

%% Recordings are in the order of their numbers; a name that is not a robot's own comes first, by its beginning.
files_have_an_order_test() ->
    Order = fun(File, Facts) -> starl_trace_robot:order(File, Facts#{told_by => [3]}) end,
    [
        ?assertEqual({File, {N, 7}}, {File, Order(File, #{begun_us => 7})})
     || {File, N} <- [
            {"a/robot-3.mcap", 1},
            {"robot-3.2.mcap", 2},
            {"robot-3.17.mcap", 17},
            {"robot-3.x.mcap", 0},
            {"robot-3.2.old", 0},
            {"robot-31.mcap", 0},
            {"robot-4.mcap", 0},
            {"mine.mcap", 0}
        ]
    ],
    ?assertEqual({1, 0}, Order("robot-3.mcap", #{})).

%% The next file of the robot has what one that was cut off has not; a next one of another robot, or one that
%% begins with a start, has not.
the_next_file_continues_test() ->
    File = fun(Name, Robot, WasUp) -> {Name, #{told_by => [Robot], was_up => WasUp}} end,
    ?assertEqual(
        ["robot-1.mcap", "robot-1.3.mcap"],
        starl_trace_robot:continued([
            File("robot-1.4.mcap", 1, true),
            File("robot-2.mcap", 2, true),
            File("robot-1.mcap", 1, true),
            File("robot-1.2.mcap", 1, true),
            {"robot-1.3.mcap", #{told_by => [1]}}
        ])
    ).

%% What lacks is named by its name; before a first file of another name, by the robot.
what_lacks_is_named_test() ->
    Lacking = fun(Files) ->
        starl_trace_robot:lacking([
            {Name, #{told_by => [R], begun_us => Begun, was_up => WasUp}}
         || {Name, R, Begun, WasUp} <- Files
        ])
    end,
    ?assertEqual(
        {[], #{}}, Lacking([{"robot-1.mcap", 1, 5, false}, {"robot-1.2.mcap", 1, 6, true}])
    ),
    ?assertEqual(
        {
            ["robot-1.mcap", "robot-1.3.mcap", "robot-1.4.mcap", "robot-2.mcap"],
            #{none => 9, "robot-1.2.mcap" => 7}
        },
        Lacking([
            {"robot-1.5.mcap", 1, 7, false},
            {"robot-2.2.mcap", 2, 9, true},
            {"robot-1.2.mcap", 1, 6, false}
        ])
    ),
    ?assertEqual({[1], #{none => 6}}, Lacking([{"mine.mcap", 1, 6, true}])),
    ?assertEqual({[], #{}}, Lacking([{"mine.mcap", 1, 6, false}, {"robot-1.mcap", 1, 7, true}])).

%% The former recording is gone on with only if it is of the same run, by each fact that tells runs apart.
a_former_recording_of_another_run_is_none_test() ->
    Dir = dir(),
    #{facts := Facts} = Config = (config(Dir, []))#{most_bytes := none},
    {ok, Recorder} = starl_trace_robot:start_link(Config#{facts := Facts#{run => 1}}),
    ok = told([event(1)], starl_trace_robot:observer(Recorder)),
    ok = gen_server:call(Recorder, caught_up),
    Recorder ! flush,
    ok = killed(Recorder),
    [Former] = starl_trace_robot:files(1, Dir),
    WasUp = fun(Changed) ->
        {ok, Next} = starl_trace_robot:start_link(Config#{
            facts := maps:merge(Facts#{run => 1}, Changed)
        }),
        {ok, #{file := File}} = starl_trace_recorder:close(Next),
        {ok, #{scenario := Scenario}} = starl_trace_reader:tail(File),
        ok = file:delete(File),
        maps:get(was_up, Scenario, false)
    end,
    ?assert(WasUp(#{})),
    [
        ?assertEqual({Key, false}, {Key, WasUp(#{Key => Other})})
     || {Key, Other} <- [
            {app, x}, {kind, simulation}, {scenario, #{a => b}}, {epoch_us, 1}, {run, 2}
        ]
    ],
    ?assertMatch({ok, _}, file:read_file_info(Former)),
    ok = file:del_dir_r(Dir).

%% More than a file is to hold.
told(Events, Observer) ->
    starl_observer:tell({judged, Events, []}, Observer).

killed(Recorder) ->
    true = unlink(Recorder),
    ok = gen_server:call(Recorder, caught_up),
    Monitor = erlang:monitor(process, Recorder),
    true = exit(Recorder, kill),
    receive
        {'DOWN', Monitor, process, _, _} -> ok
    end.

traced(File) ->
    {ok, Trace, Ended} = starl_trace_reader:fold(
        fun
            ({trace, At, {Robot, Machine, Event}}, All) -> [{At, Robot, Machine, Event} | All];
            (_, All) -> All
        end,
        [],
        File
    ),
    {lists:reverse(Trace), Ended}.

%% Nothing that could be packed.
event(N) ->
    Bytes = [crypto:hash(sha512, integer_to_binary(10 * N + I)) || I <- lists:seq(1, 8)],
    {10000 * N, 1, app, {step, N, iolist_to_binary(Bytes)}}.

config(Dir, Before) ->
    #{
        robot => 1,
        now => fun() -> 0 end,
        before => Before,
        dir => Dir,
        most_bytes => ?MOST,
        facts => #{
            kind => live,
            app => loop,
            scenario => #{},
            robots => [{1, {0.0, 0.0, 0.0}}],
            monitors => [],
            waypoints => #{},
            machines => #{app => starl_app_proc},
            epoch_us => 0
        }
    }.

dir() ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    filename:join("/tmp", "starl_robot_" ++ os:getpid() ++ "_" ++ Unique).
