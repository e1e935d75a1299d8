%% @doc `./starl replay': repeats a recorded run and compares digest and results, or stops the run at a
%% given point and shows the robots.
-module(starl_lab_replay).

-behaviour(starl_cli_command).

-export([command/0, subject/2]).
-export([setup/1]).

-export_type([setup/0, stop/0]).

%% Where to stop: at a virtual time, just after the N-th event of a robot, or at the end.
-type stop() :: {at_us, non_neg_integer()} | {event, starl:robot_id(), N :: pos_integer()} | 'end'.

%% A checked command line of a run, with the point at which to stop, the robots to show in full
%% there, and the record to compare with. Each of these may be absent.
-type setup() :: #{
    run := starl_lab_setup:t(),
    stop := stop() | none,
    inspect := [starl:robot_id()],
    record := starl_cli_record:t() | none
}.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "replay",
        synopsis => "run a recorded run again, or stop in it and look at the robots",
        argument => {required, "RUN", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => [
            "RUN is the directory of a run or its run.term: the run is done again, and its digest "
            "and results are compared (--mode and --shards may differ, which changes nothing). It may also be anything that "
            "./starl run takes, with the same flags; SEED --app TARGET is TARGET --seed SEED."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "the same digest and results, or stopped where asked for"},
            {3, "another digest, or other results"},
            {130, "interrupted; without a record those of ./starl run"}
        ],
        run => fun run/1
    }.

flags(none) -> [{"Flags", own_flags()}];
flags(Target) -> [{"Flags", own_flags()}, {hidden, run_flags(Target)}].

%% A recorded run keeps its values. The flags that remain do not change the run.
run_flags(#{app := App, record := _}) ->
    Options = starl_run_scenario:options(App),
    [Flag || {Key, _, _, _} = Flag <- Options, Key =:= mode orelse Key =:= shards];
run_flags(#{app := App}) ->
    starl_run_scenario:options(App).

own_flags() ->
    [
        {until, string, none,
            "stop here and show all robots: at a virtual time, s (the end of the "
            "window that it lies in), or ROBOT:N, just after the N-th event of a robot"},
        {inspect, {list, {integer, 1, 100000}}, none,
            "show these robots in full: every machine's "
            "state and data"},
        {out, string, none, "directory for the results of a run that is not compared"},
        starl_cli_out:overwrite(),
        {quiet, switch, false, "no progress and no summary"},
        starl_lab_setup:judge_histories()
        | starl_lab_window:flags()
    ].

-spec subject(string(), [string()]) ->
    {ok, starl_cli_target:t(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    case starl_cli_target:seeded(Word, Args) of
        {error, _} = Error -> Error;
        {Target, Others} -> recorded(starl_cli_target:looks_like_one(Target), Target, Others)
    end.

recorded(Known, Word, Args) ->
    case not Known andalso filelib:is_dir(Word) of
        true -> {error, [starl_cli_record:format_error({no_record, Word})]};
        false -> starl_cli_target:subject(Word, Args)
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := Values} = Call) ->
    case setup(Call) of
        {ok, Setup} when map_get(view, Values) -> view(Setup, Values);
        {ok, #{stop := none, record := none, run := Run}} -> starl_lab_simulation:run(Run);
        {ok, #{stop := none} = Setup} -> again(Setup);
        {ok, Setup} -> look(Setup);
        {error, _} = Error -> Error
    end.

%% @doc Checks a command line and reports all problems at once.
-spec setup(starl_cli_command:call()) -> {ok, setup()} | {error, [unicode:chardata(), ...]}.
setup(#{subject := #{name := Name} = Target, values := Values} = Call) ->
    {Unsound, Scenario} = starl_cli_target:scenario(
        Target, starl_cli_target:given(Call, own_flags())
    ),
    {Unwritable, Out} = starl_cli_out:directory(
        maps:get(out, Values), Name, maps:get(overwrite, Values)
    ),
    Inspect = robots(maps:get(inspect, Values)),
    {Unknown, Stop} = stop(maps:get(until, Values), Inspect),
    Others = absent(Stop, Inspect, Scenario) ++ too_large(Unsound, Scenario),
    case Unsound ++ Unwritable ++ Unknown ++ Others of
        [] ->
            {ok, #{
                run => run_of(Target, Scenario, Out, Values),
                stop => Stop,
                inspect => Inspect,
                record => maps:get(record, Target, none)
            }};
        Problems ->
            {error, Problems}
    end.

run_of(Target, Scenario, Out, Values) ->
    (starl_lab_setup:histories(Target, Values))#{
        target => Target,
        scenario => Scenario,
        out => Out,
        inputs => starl_cli_inputs:read(Target, Scenario),
        nodes => none,
        quiet => maps:get(quiet, Values),
        print_scenario => false
    }.

too_large([], Scenario) -> starl_lab_memory:check(Scenario, #{jobs => 1, nodes => false});
too_large(_Unsound, _Scenario) -> [].

robots(none) -> [];
robots(Ids) -> Ids.

stop(none, []) ->
    {[], none};
stop(none, [_ | _]) ->
    {[], 'end'};
stop(Text, _Inspect) ->
    case [number(Part) || Part <- string:split(Text, ":", all)] of
        [Seconds] when is_number(Seconds) -> {[], {at_us, round(Seconds * 1.0e6)}};
        [Robot, N] when is_integer(Robot), is_integer(N), Robot > 0, N > 0 ->
            {[], {event, Robot, N}};
        _ ->
            {[["--until: seconds or ROBOT:N expected, as in 12.5 or 2:37, not ", Text]], none}
    end.

number(Text) ->
    case starl_options:parse({number, 0, 1.0e9}, Text) of
        {ok, Number} -> Number;
        error -> none
    end.

%% Robots that the command line names but the team does not have.
absent(Stop, Inspect, #{robots := Robots}) ->
    Until = [{"--until", Id} || {event, Id, _} <- [Stop]],
    [
        io_lib:format("~ts: there is no robot ~b, only 1 to ~b", [Flag, Id, Robots])
     || {Flag, Id} <- Until ++ [{"--inspect", Id} || Id <- Inspect], Id > Robots
    ];
absent(_Stop, _Inspect, #{}) ->
    [].

%% -- comparing ------------------------------------------------------------------------------

again(#{run := #{scenario := #{time := Seconds} = Scenario} = Run, record := Record} = Setup) ->
    %% An interrupted run is compared up to its interruption.
    UntilUs =
        case Record of
            #{ending := stopped, end_us := EndUs} -> EndUs;
            #{} -> round(Seconds * 1.0e6)
        end,
    came(starl_lab_drive:again(Scenario, maps:with([histories], Run), UntilUs, Run), Setup).

came({ok, {stopped, _}}, _Setup) ->
    starl_cli_terminal:out("interrupted: not compared\n"),
    130;
came({ok, {_Ending, Outcome}}, #{record := Record} = Setup) ->
    #{violations := Violations, end_us := EndUs, events := Events} = Outcome,
    #{run := #{target := #{name := Name}}} = Setup,
    Lines = [[starl_violation:format(V), "\n"] || V <- Violations],
    Head = io_lib:format("~ts: ~b events in ~.1f s~n", [Name, Events, EndUs / 1.0e6]),
    Stands = [[starl_sim_watchdog:format_hang(Hang), "\n"] || #{hung := Hang} <- [Outcome]],
    starl_cli_terminal:out([Head, Lines, Stands]),
    compare(Outcome, Record, Setup);
came(Failed, #{run := Run}) ->
    starl_lab_simulation:failed(Failed, Run).

%% Wall time has ended a run that hung, so its digest says nothing.
compare(#{hung := _}, #{ending := hung}, _Setup) ->
    starl_cli_terminal:out("so the recorded run ended, too: no digest to compare\n"),
    0;
compare(#{hung := _}, _Record, _Setup) ->
    starl_cli_terminal:out("NOT THE SAME: in the recorded run each step ended\n"),
    3;
compare(_Outcome, #{ending := hung}, _Setup) ->
    starl_cli_terminal:out("NOT THE SAME: in the recorded run a step did not end\n"),
    3;
compare(#{digest := Digest} = Outcome, Record, Setup) ->
    Results = starl_cli_record:results(Outcome),
    compare(starl_cli_record:hex(Digest), Results, Record, Setup).

compare(Digest, _Results, #{ending := lost}, _Setup) ->
    starl_cli_terminal:out(["the recorded run lost a node: not compared; digest ", Digest, "\n"]),
    0;
compare(Digest, _Results, #{digest := ""}, _Setup) ->
    starl_cli_terminal:out([
        "the recorded run passed in real time: not compared; digest ", Digest, "\n"
    ]),
    0;
compare(Digest, Results, #{digest := Digest} = Record, Setup) ->
    Recorded = maps:get(results, Record, Results),
    case [Robot || {{Robot, Hash}, {_, Now}} <- lists:zip(Recorded, Results), Hash =/= Now] of
        [] ->
            starl_cli_terminal:out(["same digest ", Digest, "\n"]),
            0;
        Others ->
            not_the_same([
                "the events are, with digest ",
                Digest,
                "; other results have ",
                [starl_lab_phrase:robots(Others), "\n"],
                outside(Setup)
            ])
    end;
compare(Digest, _Results, #{digest := Recorded, events := Events}, Setup) ->
    Line = io_lib:format("digest ~ts, recorded was ~ts (~b events)~n", [Digest, Recorded, Events]),
    not_the_same([Line, outside(Setup)]).

not_the_same(Why) ->
    starl_cli_terminal:out(["NOT THE SAME: ", Why]),
    3.

outside(#{run := #{target := #{file := File} = Target, scenario := Scenario}, record := Record}) ->
    [
        code(maps:get(code, Record, none), starl_lab_simulation:code(Target, Scenario)),
        "  ./starl diverge ",
        starl_cli_terminal:quoted(File),
        "\n"
    ].

code(none, _Code) ->
    "Unless the code is another one, something outside the scenario has a part in it; where:\n";
code(Code, Code) ->
    ["The code is the same, ", Code, "; something outside the scenario has a part in it; where:\n"];
code(Recorded, Code) ->
    [
        ["The recorded run was of other code: ", Recorded, ", this is ", Code, ".\n"],
        "If that is not the reason, something outside the scenario has a part in it; where:\n"
    ].

%% -- in a window ----------------------------------------------------------------------------

%% It rests where the user wants to look, and goes on as the page says.
view(#{stop := Stop, record := Record, run := Run} = Setup, Values) ->
    Config = #{paused => true, commands => commands(Stop)},
    case Record of
        none ->
            starl_lab_window:run(Run, Values#{pace => 1}, Config);
        _ ->
            starl_lab_window:played(Run, Values#{pace => 1}, Config#{options => #{}}, fun(Ended, _) ->
                viewed(Ended, Setup)
            end)
    end.

commands({at_us, Us}) -> [#{<<"do">> => <<"until">>, <<"at">> => Us / 1.0e6}];
commands({event, Robot, N}) -> [#{<<"do">> => <<"step">>, <<"robot">> => Robot, <<"to">> => N}];
commands(_) -> [].

viewed({ok, #{sim := Sim, ending := Ending, is_changed := IsChanged}}, Setup) ->
    {Outcome, _} = starl_sim:conclude(Sim),
    case IsChanged of
        true ->
            starl_cli_terminal:out("its faults were changed: not compared\n"),
            0;
        false ->
            came({ok, {Ending, Outcome}}, Setup)
    end;
viewed(Failed, Setup) ->
    came(Failed, Setup).

%% -- a look inside --------------------------------------------------------------------------

look(#{run := #{scenario := Scenario} = Run} = Setup) ->
    case starl_lab_drive:with(Scenario, fun(Sim) -> stopped(go(Sim, Setup), Sim, Setup) end) of
        {ok, Answer} -> Answer;
        Failed -> starl_lab_simulation:failed(Failed, Run)
    end.

go(Sim, #{stop := {event, Robot, N}}) ->
    starl_sim:run_until_event(Sim, Robot, N);
go(Sim, #{stop := 'end', run := #{scenario := #{time := Seconds}}} = Setup) ->
    go(Sim, Setup#{stop := {at_us, round(Seconds * 1.0e6)}});
go(Sim, #{stop := {at_us, Us}, run := Run}) ->
    _ = starl_lab_drive:run(Sim, Us, Run),
    {ok, starl_sim:status(Sim)}.

stopped({ok, #{ending := stopped}}, _Sim, _Setup) ->
    interrupted();
stopped({ok, #{now_us := Now, ending := Ending}}, Sim, Setup) ->
    #{stop := Stop, inspect := Inspect, run := #{target := #{name := Name}}} = Setup,
    Width = starl_cli_terminal:columns(),
    Robots = [{Id, Summary, starl_sim:inspect(Sim, Id)} || {Id, Summary} <- starl_sim:robots(Sim)],
    starl_cli_terminal:out([
        Name,
        where(Ending, Stop),
        " ",
        starl_lab_inspect:overview(Now, Robots, Width),
        [
            ["\n", starl_lab_inspect:robot(Id, Summary, Machines, Width)]
         || {Id, Summary, Machines} <- Robots, lists:member(Id, Inspect)
        ]
    ]),
    0;
stopped({error, Missed}, Sim, _Setup) ->
    case starl_sim:status(Sim) of
        #{ending := stopped} -> interrupted();
        #{} -> {error, [["--until: ", starl_sim:format_error(Missed)]]}
    end.

interrupted() ->
    starl_cli_terminal:out("interrupted\n"),
    130.

where(none, {event, Robot, N}) -> io_lib:format(" just after event ~b of robot ~b", [N, Robot]);
where(none, _) -> "";
where(Ending, _) -> [" at its end (", atom_to_list(Ending), ")"].
