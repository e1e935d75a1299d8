%% @doc `./starl replay': runs a recorded run again and compares the digests, or stops on the way
%% to it and shows the robots.
-module(starl_cli_replay).

-export([command/1, setup/1]).

-export_type([setup/0, stop/0]).

%% Where to stop: at a virtual time, just after the N-th event of a robot, or at the end.
-type stop() :: {at_us, non_neg_integer()} | {event, starl:robot_id(), N :: pos_integer()} | 'end'.

%% A checked command line: as that of a run, with the place to stop at, if any, the robots to
%% show in full there, and the record to compare with, if there is one.
-type setup() :: #{
    run := starl_cli_setup:t(),
    stop := stop() | none,
    inspect := [starl:robot_id()],
    record := starl_cli_record:t() | none
}.

-type answer() :: {ok, setup()} | help | {error, [unicode:chardata(), ...]}.

-define(EXAMPLE, "as in ./starl replay out/painting-1; ./starl replay --help tells more").

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    case setup(Args) of
        {ok, #{stop := none, record := none, run := Run}} -> starl_cli_simulation:run(Run);
        {ok, #{stop := none} = Setup} -> again(Setup);
        {ok, Setup} -> look(Setup);
        help -> help();
        {error, Problems} -> starl_cli_terminal:bad_input([["replay: ", P] || P <- Problems])
    end.

%% @doc Reads and checks the arguments, all in one go.
-spec setup([string()]) -> answer().
setup(Args) ->
    case {starl_cli_setup:help_wanted(Args), Args} of
        {true, _} -> help;
        {false, []} -> {error, ["name a run, " ?EXAMPLE]};
        {false, [[C | _] = Word | Flags]} when C =/= $- -> named(is_seed(Word), Word, Flags);
        {false, _} -> {error, ["name a run before the flags, " ?EXAMPLE]}
    end.

is_seed(Word) -> lists:all(fun(C) -> C >= $0 andalso C =< $9 end, Word).

named(true, Seed, Flags) ->
    case app(Flags) of
        {App, Others} -> target(starl_cli_target:resolve(App), ["--seed", Seed | Others]);
        none -> {error, [["seed ", Seed, " of what? Name it, as in --app painting"]]}
    end;
named(false, Word, Flags) ->
    case {starl_cli_target:looks_like_one(Word), filelib:is_dir(Word)} of
        {false, true} -> {error, [starl_cli_record:format_error({no_record, Word})]};
        _ -> target(starl_cli_target:resolve(Word), Flags)
    end.

app(["--app", App | Flags]) -> {App, Flags};
app(["--app=" ++ App | Flags]) -> {App, Flags};
app([Flag | Flags]) ->
    case app(Flags) of
        {App, Others} -> {App, [Flag | Others]};
        none -> none
    end;
app([]) -> none.

target({error, Problems}, _Flags) ->
    {error, Problems};
target({ok, Target}, Flags) ->
    case starl_cli_flags:parse(Flags, own_flags() ++ run_flags(Target)) of
        {ok, Values} -> checked(Target, Values);
        {error, Problems} -> {error, starl_cli_setup:flag_lines(Problems)}
    end.

%% A recorded run is run as it was, but for what does not change it.
run_flags(#{app := App, record := _}) ->
    Options = starl_cli_setup:options(App),
    [Flag || {Key, _, _, _} = Flag <- Options, Key =:= mode orelse Key =:= shards];
run_flags(#{app := App}) ->
    starl_cli_setup:options(App).

own_flags() ->
    [
        {until, string, none, "stop here and show all robots: at a virtual time, s (the end of the "
            "window that it lies in), or ROBOT:N, just after the N-th event of a robot"},
        {inspect, {list, {integer, 1, 100000}}, none, "show these robots in full: every machine's "
            "state and data"},
        {out, string, none, "directory for the results of a run that is not compared"},
        {quiet, switch, false, "no progress and no summary"},
        {help, switch, false, "this help"}
    ].

checked(#{name := Name, given := FromFile} = Target, Values) ->
    Own = [Key || {Key, _, _, _} <- own_flags()],
    Given = maps:merge(FromFile, maps:without(Own, Values)),
    {Unsound, Scenario} = starl_cli_setup:scenario(Target, Given),
    {Unwritable, Out} = starl_cli_setup:out(maps:get(out, Values, none), Name),
    Inspect = maps:get(inspect, Values, []),
    {Unknown, Stop} = stop(maps:get(until, Values, none), Inspect),
    Absent = absent(Stop, Inspect, Scenario),
    case Unsound ++ Unwritable ++ Unknown ++ Absent of
        [] ->
            {ok, #{
                run => #{
                    target => Target, scenario => Scenario, out => Out, nodes => none,
                    quiet => maps:get(quiet, Values, false), print_scenario => false
                },
                stop => Stop,
                inspect => Inspect,
                record => maps:get(record, Target, none)
            }};
        Problems ->
            {error, Problems}
    end.

stop(none, []) -> {[], none};
stop(none, [_ | _]) -> {[], 'end'};
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

%% Robots that there are none of.
absent(Stop, Inspect, #{robots := Robots}) ->
    Until = [{"--until", Id} || {event, Id, _} <- [Stop]],
    [
        io_lib:format("~ts: there is no robot ~b, only 1 to ~b", [Flag, Id, Robots])
     || {Flag, Id} <- Until ++ [{"--inspect", Id} || Id <- Inspect], Id > Robots
    ];
absent(_Stop, _Inspect, #{}) ->
    [].

%% -- the same again -------------------------------------------------------------------------

again(#{run := #{scenario := #{time := Seconds} = Scenario} = Run, record := Record} = Setup) ->
    %% what was interrupted is compared as far as it came
    UntilUs =
        case Record of
            #{ending := stopped, end_us := EndUs} -> EndUs;
            #{} -> round(Seconds * 1.0e6)
        end,
    Ran = starl_cli_drive:with(Scenario, fun(Sim) ->
        {Ending, _} = starl_cli_drive:run(Sim, UntilUs, Run),
        {Outcome, _} = starl_sim:finish(Sim),
        {Ending, Outcome}
    end),
    came(Ran, Setup).

came({ok, {stopped, _}}, _Setup) ->
    starl_cli_terminal:out("interrupted: not compared\n"),
    130;
came({ok, {_Ending, Outcome}}, #{record := Record} = Setup) ->
    #{digest := Digest, violations := Violations, end_us := EndUs, events := Events} = Outcome,
    #{run := #{target := #{name := Name}}} = Setup,
    Lines = [[starl_monitor:format_violation(V), "\n"] || V <- Violations],
    Head = io_lib:format("~ts: ~b events in ~.1f s~n", [Name, Events, EndUs / 1.0e6]),
    starl_cli_terminal:out([Head, Lines]),
    compare(starl_cli_record:hex(Digest), Record, Setup);
came(Failed, #{run := Run}) ->
    failed(Failed, Run).

failed({error, Reason}, _Run) -> starl_cli_terminal:bad_input([starl_sim:format_error(Reason)]);
failed({failed, Reason}, Run) -> starl_cli_simulation:failed(Reason, Run).

compare(Digest, #{ending := lost}, _Setup) ->
    starl_cli_terminal:out(["the recorded run lost a node: not compared; digest ", Digest, "\n"]),
    0;
compare(Digest, #{digest := Digest}, _Setup) ->
    starl_cli_terminal:out(["same digest ", Digest, "\n"]),
    0;
compare(Digest, #{digest := Recorded, events := Events}, #{run := #{target := #{file := File}}}) ->
    starl_cli_terminal:out([
        "NOT THE SAME: digest ", Digest, ", recorded was ", Recorded,
        io_lib:format(" (~b events)~n", [Events]),
        "Unless the code is another one, something outside the scenario has a part in it; where:\n",
        "  ./starl diverge ", starl_cli_flags:shell(File), "\n"
    ]),
    3.

%% -- a look inside --------------------------------------------------------------------------

look(#{run := #{scenario := Scenario} = Run} = Setup) ->
    case starl_cli_drive:with(Scenario, fun(Sim) -> stopped(go(Sim, Setup), Sim, Setup) end) of
        {ok, Status} -> Status;
        Failed -> failed(Failed, Run)
    end.

go(Sim, #{stop := {event, Robot, N}}) ->
    starl_sim:run_until_event(Sim, Robot, N);
go(Sim, #{stop := 'end', run := #{scenario := #{time := Seconds}}} = Setup) ->
    go(Sim, Setup#{stop := {at_us, round(Seconds * 1.0e6)}});
go(Sim, #{stop := {at_us, Us}, run := Run}) ->
    _ = starl_cli_drive:run(Sim, Us, Run),
    {ok, starl_sim:status(Sim)}.

stopped({ok, #{ending := stopped}}, _Sim, _Setup) ->
    interrupted();
stopped({ok, #{now_us := Now, ending := Ending}}, Sim, Setup) ->
    #{stop := Stop, inspect := Inspect, run := #{target := #{name := Name}}} = Setup,
    Width = starl_cli_terminal:columns(),
    Robots = [{Id, Summary, starl_sim:inspect(Sim, Id)} || {Id, Summary} <- starl_sim:robots(Sim)],
    starl_cli_terminal:out([
        Name, where(Ending, Stop), " ", starl_cli_inspect:overview(Now, Robots, Width),
        [
            ["\n", starl_cli_inspect:robot(Id, Summary, Machines, Width)]
         || {Id, Summary, Machines} <- Robots, lists:member(Id, Inspect)
        ]
    ]),
    0;
stopped({error, Missed}, Sim, _Setup) ->
    case starl_sim:status(Sim) of
        #{ending := stopped} -> interrupted();
        #{} -> starl_cli_terminal:bad_input([["--until: ", starl_sim:format_error(Missed)]])
    end.

interrupted() ->
    starl_cli_terminal:out("interrupted\n"),
    130.

where(none, {event, Robot, N}) -> io_lib:format(" just after event ~b of robot ~b", [N, Robot]);
where(none, _) -> "";
where(Ending, _) -> [" at its end (", atom_to_list(Ending), ")"].

%% -- help -----------------------------------------------------------------------------------

help() ->
    Width = starl_cli_terminal:columns(),
    starl_cli_terminal:out([
        "Usage: ./starl replay RUN [FLAGS]\n"
        "       ./starl replay SEED --app TARGET [FLAGS]\n\n",
        starl_cli_terminal:wrap("RUN is the directory of a run or its run.term: the run is done "
            "again and its digest compared (--mode and --shards may differ, which changes "
            "nothing). It may also be whatever ./starl run takes, with the "
            "same flags; SEED --app TARGET is TARGET --seed SEED.", 0, Width),
        "\n\n", starl_cli_flags:help(own_flags(), Width),
        "\nExit status: 0 the same digest, or stopped where asked for; 3 another digest; 2 bad\n"
        "usage or input; 130 interrupted; without a record those of ./starl run.\n"
    ]),
    0.
