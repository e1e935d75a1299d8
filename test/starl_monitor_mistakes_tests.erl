%% Mistakes in monitors of users: each is one line with its place, and no verdict is lost by it.
%%
%% Holds: A mistake in a monitor is one line with file and line, and costs no verdict: 24 mistakes,
%% in virtual time, in real time and on nodes
%% Red: 4790147; told by 6439861: *complete*, or a raw error without results
-module(starl_monitor_mistakes_tests).
-include_lib("eunit/include/eunit.hrl").

%% The monitor that is right: it wants what the application traces, objects to the number 3, and counts.
-define(RIGHT, [
    {behaviour, "-behaviour(starl_monitor).\n-export([init/1, interests/0, step/2, finish/2]).\n"},
    {init, "init(#{start := N}) -> N.\n"},
    {interests, "interests() -> [app].\n"},
    {step,
        "step({At, Robot, app, {says, 3}}, N) -> {violation, v(At, Robot), N + 1};\n"
        "step(_Event, N) -> {ok, N + 1}.\n"},
    {finish, "finish(_End, N) -> {ok, #{seen => N}}.\n"},
    {v,
        "v(At, Robot) -> #{contract => mine, what => three, at_us => At, robots => [Robot],\n"
        "    details => #{}}.\n"}
]).

%% What is written in the place of what is right, when it shows, and the line: `start' are mistakes
%% that keep the run from beginning; of the others, `early' come before the number 3 is said.
cases() ->
    [
        {start, [{interests, "interests() -> [ap].\n"}],
            "mine.erl:5: interests/0: there is no machine ap in this run (did you mean app?)"},
        {start, [{interests, "interests() -> app.\n"}],
            "mine.erl:5: interests/0 returned app; expected: all or a list of machines"},
        {start, [{interests, "interests() -> [app | sap].\n"}],
            "mine.erl:5: interests/0 returned [app|sap]; expected: all or a list of machines"},
        {start, [{interests, "interests() -> error(no).\n"}], "mine.erl:5: interests/0: "},
        {start, [{init, "init(#{begin_at := N}) -> N.\n"}], "mine.erl:4: init/1: "},
        {start,
            [{finish, ""}, {behaviour, "-behaviour(starl_monitor).\n-export([init/1, step/2]).\n"}],
            "mine.erl:2: finish/2 is missing; a monitor exports init/1, step/2 and finish/2"},
        {start, [{behaviour, "-behaviour(starl_monitor).\n-export([init/1, finish/2, v/2]).\n"}],
            "mine.erl:6: step/2 is not exported"},
        {start,
            [
                {behaviour,
                    "-behaviour(starl_monitor).\n"
                    "-export([init/1, step/2, finish/2, vocabulary/0]).\n"},
                {interests, "vocabulary() -> [{app, says}].\n"}
            ],
            "mine.erl:5: vocabulary/0 returned [{app,says}]; expected: #{Machine => [{Event, Size}]}"},
        {start,
            [
                {behaviour,
                    "-behaviour(starl_monitor).\n-export([init/1, step/2, finish/2, context/2]).\n"},
                {interests, "context(#{until := At}, Config) -> Config#{at => At}.\n"}
            ],
            "mine.erl:5: context/2: "},
        {early, [{step, "step(_Event, N) -> N + 1.\n"}],
            "mine.erl:6: step/2 returned 1; expected: {ok, State} or {violation, Violation, State}"},
        {early,
            [
                {step,
                    "step({At, R, _, {says, 1}}, _) -> {violation, v(At, R)};\nstep(_, N) -> {ok, N}.\n"}
            ],
            "mine.erl:6: step/2 returned {violation,#{"},
        {early, [{step, "step({_, _, app, {says, 9}}, N) -> {ok, N}.\n"}], "mine.erl:6: step/2: "},
        {early,
            [{step, "step({_, _, app, {says, 2}}, _) -> exit(normal);\nstep(_, N) -> {ok, N}.\n"}],
            "mine.erl:6: step/2: "},
        {late,
            [
                {v,
                    "v(At, Robot) -> #{contract => mine, what => three, at_us => At, robots => [Robot]}.\n"}
            ],
            "mine.erl:6: step/2 returned a violation without the key details, a map"},
        {late,
            [
                {v,
                    "v(At, Robot) -> #{contract => mine, what => three, at_us => At, robots => Robot,\n"
                    "    details => #{}}.\n"}
            ],
            "mine.erl:6: step/2 returned a violation with robots => 1; expected: a list of robots"},
        {late,
            [
                {v,
                    "v(At, Robot) -> #{contract => mine, what => three, at_us => At / 1.0e6,\n"
                    "    robots => [Robot], details => #{}}.\n"}
            ],
            "mine.erl:6: step/2 returned a violation with at_us => 0.002; expected: "
            "a time in whole microseconds"},
        {late, [{v, "v(_At, _Robot) -> three.\n"}],
            "mine.erl:6: step/2 returned three; expected: a violation"},
        {last, [{finish, "finish(End, N) -> {violation, v(End, 1), #{seen => N}}.\n"}],
            "mine.erl:8: finish/2 returned {violation,#{"},
        {last, [{finish, "finish(_End, _N) -> {error, oops}.\n"}],
            "mine.erl:8: finish/2 returned {error,oops}; expected: {ok, #{...}} or "
            "{{violation, [Violation]}, #{...}}"},
        {last, [{finish, "finish(_End, _N) -> done.\n"}], "mine.erl:8: finish/2 returned done; "},
        {last, [{finish, "finish(_End, N) -> {ok, [{seen, N}]}.\n"}],
            "mine.erl:8: finish/2 returned {ok,[{seen,"},
        {last, [{finish, "finish(_End, N) -> {{violation, []}, #{seen => N}}.\n"}],
            "mine.erl:8: finish/2 returned {{violation,[]},"},
        {last, [{finish, "finish(_End, N) -> {{violation, [none]}, #{seen => N}}.\n"}],
            "mine.erl:8: finish/2 returned none; expected: a violation"},
        {last, [{finish, "finish(_End, N) -> {ok, #{seen => 1 / (N - N)}}.\n"}],
            "mine.erl:8: finish/2: "}
    ].

%% Every mistake is one line, and the other monitors judge to the end: `yours' finds the number 3.
mistakes_test_() ->
    {timeout, 120, fun() ->
        ?assert(length(cases()) >= 20),
        in_directory(fun(Dir) -> [one(Case, Dir) || Case <- cases()] end)
    end}.

one({When, Changes, Line}, Dir) ->
    written(Dir, Changes),
    Shown = {When, Changes},
    case starl_sim:start(#{app => mine_app, robots => 1, time => 5}) of
        {error, {scene, Why}} ->
            ?assertEqual({start, Shown}, {When, Shown}),
            is_line(Line, Why);
        {ok, Sim} ->
            _ = starl_sim:run(Sim),
            {Outcome, #{figures := []}} = starl_sim:finish(Sim),
            #{violations := Violations, unjudged := Unjudged, monitors := Results} = Outcome,
            ?assertMatch({[#{monitors := ["mine"], why := {mistake, _}}], _}, {Unjudged, Shown}),
            [#{why := {mistake, Said}, from_us := From}] = Unjudged,
            is_line(Line, Said),
            ?assertNot(is_map_key(mine, Results)),
            ?assertMatch(#{yours := #{seen := _}}, Results),
            ?assertEqual({found(When), Shown}, {[C || #{contract := C} <- Violations], Shown}),
            ?assert(From =< 2000 orelse When =:= last, Shown)
    end.

%% What was found until the mistake is kept.
found(early) -> [yours];
found(late) -> [yours];
found(last) -> [mine, yours].

is_line(Line, Said) ->
    Text = unicode:characters_to_list(Said),
    ?assertEqual({Line, Text, 1}, {
        lists:sublist(Text, length(Line)), Text, length(string:split(Text, "\n", all))
    }).

%% A module that is not there, one that is listed twice, a list that is none.
listed_test() ->
    in_directory(fun(Dir) ->
        written(Dir, []),
        [
            begin
                app(Dir, List),
                {error, {scene, Why}} = starl_sim:start(#{app => mine_app}),
                is_line(Line, Why)
            end
         || {List, Line} <- [
                {"[{minne, #{}}]", "mine_app.erl:4: monitors/1: there is no module minne"},
                {"[{mine, #{}}, {mine, #{}}]", "mine_app.erl:4: monitors/1: mine is listed twice"},
                {"[mine]",
                    "mine_app.erl:4: monitors/1: a list of {Module, #{...}} expected, not [mine]"},
                {"error(no)", "mine_app.erl:4: monitors/1: "}
            ]
        ]
    end).

%% In virtual time and in real time: the line, the results of the others, and the status of its own.
command_test_() ->
    {timeout, 90, fun() ->
        in_directory(fun(Dir) ->
            written(Dir, [{finish, "finish(End, N) -> {violation, v(End, 1), #{seen => N}}.\n"}]),
            File = filename:join(Dir, "mine_app.erl"),
            {ok, Source} = file:read_file(File),
            %% it never says 3
            ok = file:write_file(File, string:replace(Source, "{says, N}", "{says, 10 * N}")),
            [
                begin
                    Out = filename:join(Dir, "out"),
                    Text = starl_cli_vm:says(5, "NOT JUDGED TO THE END", [
                        "run", File, "--out", Out | How
                    ]),
                    starl_cli_vm:contains("not judged: mine from ", Text),
                    starl_cli_vm:contains("mine.erl:8: finish/2 returned {violation,#{", Text),
                    {ok, Report} = file:read_file(filename:join(Out, "report.txt")),
                    starl_cli_vm:contains("crash, motion, sap, yours", binary_to_list(Report)),
                    starl_cli_vm:contains("not judged: mine from", binary_to_list(Report)),
                    ok = file:del_dir_r(Out)
                end
             || How <- [[], ["--live"], ["--nodes", "2", "--robots", "2"]]
            ]
        end)
    end}.

%% The recording of a run is judged by the user's own monitor, whose source the run keeps.
%% Holds: A recording is judged by the monitors whose sources its run keeps
%% Red: e9af1e0, run
own_monitor_is_judged_test_() ->
    {timeout, 60, fun() ->
        in_directory(fun(Dir) ->
            written(Dir, []),
            Out = filename:join(Dir, "out"),
            File = filename:join(Dir, "mine_app.erl"),
            starl_cli_vm:says(3, "mine broken", ["run", File, "--record", "--out", Out]),
            _ = [
                file:delete(filename:join(Dir, Name))
             || Name <- ["mine.erl", "yours.erl", "mine_app.erl"]
            ],
            starl_cli_vm:says(3, "mine broken", ["judge", Out]),
            ok = file:del_dir_r(filename:join(Out, "inputs")),
            starl_cli_vm:says(2, "the contract mine is not known here", ["judge", Out])
        end)
    end}.

%% -- the sources ----------------------------------------------------------------------------

%% Writes and loads the monitors, one of them with changes, and an application that says 1, 2, 3 a
%% millisecond apart.
written(Dir, Changes) ->
    Parts = lists:ukeymerge(1, lists:keysort(1, Changes), lists:keysort(1, ?RIGHT)),
    In = fun(Name, Of) ->
        [
            io_lib:format("-module(~ts).\n", [Name])
            | [proplists:get_value(Part, Of) || {Part, _} <- ?RIGHT]
        ]
    end,
    load(Dir, "mine", In("mine", Parts)),
    Yours = string:replace(In("yours", ?RIGHT), "contract => mine", "contract => yours"),
    load(Dir, "yours", Yours),
    app(Dir, "[{mine, #{start => 0}}, {yours, #{start => 0}}]").

app(Dir, Monitors) ->
    load(Dir, "mine_app", [
        "-module(mine_app).\n-behaviour(starl_app).\n-export([init/2, step/2, monitors/1, report/2]).\n",
        ["monitors(_) -> ", Monitors, ".\n"],
        "init(_, _) -> 1.\n",
        "step(Robot, N) ->\n    starl:trace(Robot, {says, N}),\n    starl:sleep(Robot, 1),\n",
        "    case N of 4 -> {done, N}; _ -> {continue, N + 1} end.\n",
        %% the report of an application that trusts its monitors
        "report(_, #{monitors := #{mine := _}}) -> #{figures => [{mine, 1}]}.\n"
    ]).

load(Dir, Name, Text) ->
    File = filename:join(Dir, Name ++ ".erl"),
    ok = file:write_file(File, Text),
    {ok, Module, Beam} = compile:file(File, [binary, debug_info, nowarn_unused_function]),
    _ = code:purge(Module),
    {module, Module} = code:load_binary(Module, File, Beam).

in_directory(Test) ->
    Dir = filename:join("/tmp", "starl-monitor-mistakes-" ++ os:getpid()),
    ok = file:make_dir(Dir),
    try
        Test(Dir)
    after
        [
            begin
                _ = code:purge(M),
                code:delete(M)
            end
         || M <- [mine, yours, mine_app]
        ],
        ok = file:del_dir_r(Dir)
    end.
