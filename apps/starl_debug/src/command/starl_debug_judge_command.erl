%% @doc `./starl judge': judges a recording by all contracts of its run.
-module(starl_debug_judge_command).
-behaviour(starl_cli_command).

-export([command/0]).

-type word() :: kept | broken | depends.

%% The contract, what of it, the word, and the violations that the monitors had found.
-type judgement() :: #{
    contract := atom(),
    what := atom(),
    word := word(),
    violations := [starl_monitor:violation()],
    answer := starl_debug_check:answer()
}.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "judge",
        synopsis => "judge a recording by all contracts of its run",
        argument => {required, "FILE", {example, "out/painting-1/run.mcap"}},
        subject => fun subject/2,
        about => [
            "FILE is a recording, or the directory of a run that holds one. The monitors of the run "
            "read its events again; the verdicts are those of the run. A recording that was cut off is "
            "judged to its last whole second, one with a hole up to that. Of recordings of the robots themselves, merged, the "
            "contracts are judged that do not need the true motions; which are not judged is said. A "
            "contract of your own is taken from the directory inputs beside the recording, where a run "
            "keeps its source.",
            "The times of the recording are taken as they are. With --sigma the contracts that speak of two "
            "robots at one moment are judged for all clocks within it: kept, broken, or depends on the "
            "clocks."
        ],
        flags => [{"Flags", [starl_debug_bounds:flag(""), starl_debug_bounds:drift()]}],
        statuses => [
            {0, "no contract is broken"},
            {3, "a contract is broken"},
            {5,
                "a part of the run is not judged, or what needs robots whose recordings are missing; in the rest "
                "no contract is broken"},
            {6, "none is broken for sure; with --sigma one depends on the clocks"}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) ->
    {ok, file:filename(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    starl_cli_out:recording(Word, "./starl run TARGET --record makes one", Args).

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := File, values := #{sigma := Sigma, drift := Drift}}) ->
    case starl_debug_bounds:read(Sigma) of
        {ok, _} when Sigma =:= none -> judged(starl_trace_judge:file(File), {File, none}, []);
        {ok, Us} -> judged(starl_trace_judge:file(File), {File, {Us, Drift}}, []);
        {error, Line} -> {error, [Line]}
    end.

judged({ok, Judged}, {File, none}, _Loaded) ->
    told(File, Judged, []);
judged({ok, Judged}, {File, Clocks}, _Loaded) ->
    case by_clocks(File, Judged, Clocks) of
        {ok, Judgements} -> told(File, Judged, Judgements);
        {error, Line} -> {error, [Line]}
    end;
judged({error, {no_monitor, _, Module} = Reason}, {File, _} = Wanted, Loaded) ->
    case lists:member(Module, Loaded) orelse starl_cli_inputs:source(Module, File) of
        {ok, Source} -> loaded(starl_cli_source:modules(Source), Module, Wanted, Loaded);
        {error, Line} -> {error, [Line]};
        _ -> {error, [starl_trace_judge:format_error(Reason)]}
    end;
judged({error, Reason}, _Wanted, _Loaded) ->
    {error, [starl_trace_judge:format_error(Reason)]}.

loaded({ok, _, _}, Module, {File, _} = Wanted, Loaded) ->
    judged(starl_trace_judge:file(File), Wanted, [Module | Loaded]);
loaded({error, _} = Error, _Module, _Wanted, _Loaded) ->
    Error.

by_clocks(File, #{violations := Violations, not_judged := NotJudged}, {Sigma, Drift}) ->
    case starl_debug_recording:read([File], #{}) of
        {ok, #{monitors := Monitors} = Recording} ->
            OfTeam = [M || {M, robots} <- NotJudged],
            Judged = Recording#{
                monitors := [One || {M, _} = One <- Monitors, not lists:member(M, OfTeam)]
            },
            judgements(
                starl_debug_bounds:bounds(Sigma, Recording, Drift), Judged, Violations, Drift
            );
        {error, Reason} ->
            {error, starl_debug_recording:format_error(Reason)}
    end.

judgements({ok, Bounds}, Recording, Violations, Drift) ->
    Options = #{sigma => Bounds, drift_ppm => ceil(Drift)},
    {ok, by_moments(Recording, Violations, Options)};
judgements({error, Line}, _Recording, _Violations, _Drift) ->
    {error, Line}.

told(File, #{violations := Found, scenario := #{app := App} = Scenario} = Judged, Judgements) ->
    #{until_us := Until, events := Events, ended := Ended, unjudged := Unjudged} = Judged,
    Violations = Found -- lists:append([Vs || #{word := depends, violations := Vs} <- Judgements]),
    Us = Until - maps:get(begun_us, Scenario, 0),
    starl_cli_terminal:out([
        io_lib:format("~ts: ~ts, ~.1f s, ~b events judged", [File, App, Us / 1.0e6, Events]),
        ["; " || Ended =/= closed],
        cut(Ended),
        "\n",
        [[starl_violation:format(V), "\n"] || V <- Violations],
        not_judged(Judged),
        [by_clocks(Judgement) || Judgement <- Judgements],
        [[starl_unjudged:format(Part), "\n"] || Part <- Unjudged],
        verdict(Violations, Unjudged, lacks_robots(Judged)),
        same(Judged)
    ]),
    IsPart = Unjudged =/= [] orelse lacks_robots(Judged),
    status(Violations, IsPart, [J || #{word := depends} = J <- Judgements]).

by_clocks(#{contract := Contract, what := What, word := Word, violations := Found, answer := Answer}) ->
    io_lib:format("~ts, ~ts: ~ts\n", [Contract, What, word(Word, Found, Answer)]).

word(kept, _Found, #{verdict := certainly}) ->
    "kept; it happened, and a fault explains it";
word(kept, _Found, #{known_until := Us}) when is_integer(Us) ->
    "kept, for all clocks within that, as far as the recording tells all";
word(kept, _Found, _Answer) ->
    "kept, for all clocks within that";
word(broken, _Found, _Answer) ->
    "broken, for all clocks within that";
word(depends, [], _Answer) ->
    "depends on the clocks";
word(depends, _Found, _Answer) ->
    "depends on the clocks; by the times of the recording it is broken".

cut(closed) -> "";
cut(cut_off) -> "the file is cut off after that";
cut({damaged, At}) -> io_lib:format("the file is damaged after that, at byte ~b", [At]).

lacks_robots(#{not_judged := NotJudged}) -> lists:keymember(robots, 2, NotJudged).

not_judged(#{not_judged := NotJudged, scenario := Scenario}) ->
    [
        ["not judged: ", lists:join(", ", Names), ": ", Why, "\n"]
     || {Needs, Why} <- [
            {motions, "they need the true motions, which the world's run.mcap has; merge it, too"},
            {robots, missing(Scenario)}
        ],
        Names <- [[starl_monitor:name(Module) || {Module, N} <- NotJudged, N =:= Needs]],
        Names =/= []
    ].

missing(#{told_by := By, robots := Robots}) ->
    case [integer_to_list(Id) || {Id, _} <- Robots] -- [integer_to_list(Id) || Id <- By] of
        [Robot] ->
            ["the recording of robot ", Robot, " is missing; merge it, too"];
        Missing ->
            [
                "the recordings of robots ",
                lists:join(", ", Missing),
                " are missing; merge them, too"
            ]
    end;
missing(_AllAreThere) ->
    "".

verdict([], [], false) ->
    "no contract is broken\n";
verdict([], [], true) ->
    "NOT JUDGED FOR THE TEAM; in what each robot shows alone no contract is broken\n";
verdict([], _Unjudged, _LacksRobots) ->
    "NOT JUDGED TO THE END; until there no contract is broken\n";
verdict([_], _Unjudged, _LacksRobots) ->
    "a contract is broken\n";
verdict(Violations, _Unjudged, _LacksRobots) ->
    io_lib:format("contracts are broken ~b times\n", [length(Violations)]).

same(#{found := unknown}) ->
    "";
same(#{found := Found, violations := Violations}) ->
    case lists:sort(Found) =:= lists:sort(Violations) of
        true -> "";
        false -> io_lib:format("the run itself had found ~b violations\n", [length(Found)])
    end.

status([], false, []) -> 0;
status([], false, _Depends) -> 6;
status([], true, _Depends) -> 5;
status(_Violations, _IsPart, _Depends) -> 3.

%% -- without trust in the clocks ------------------------------------------------------------

%% The contracts that speak of several robots at one moment. The monitors of a run take the times of a
%% recording as they are. What they find is broken only if it is so for all clocks that are possible; what
%% they do not find may have happened for others. What is certain and was not found by them is explained
%% by a fault, since they excuse only that.
-spec by_moments(
    starl_debug_recording:t(), [starl_monitor:violation()], starl_debug_check:options()
) -> [judgement()].
by_moments(#{monitors := Monitors} = Recording, Violations, Options) ->
    [
        at_a_moment(Contract, What, Text, Recording, Violations, Options)
     || {Module, Config} <- Monitors, {Contract, What, Text} <- of_one_moment(Module, Config)
    ].

%% Which predicate breaks a contract, and how its monitor calls that. By their names: the debugger
%% does not rest on the blocks.
of_one_moment(starl_mutex_monitor, _Config) ->
    [{mutex, two_holders, "two_owners"}];
of_one_moment(starl_dpp_monitor, #{r_s := Mm}) ->
    [
        {dpp, two_coordinators, "two_coordinators"},
        {dpp, too_close, io_lib:format("too_near(~.3f mm)", [Mm * 1.0])}
    ];
of_one_moment(_Module, _Config) ->
    [].

at_a_moment(Contract, What, Text, Recording, Violations, Options) ->
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    #{verdict := Verdict} =
        Answer = starl_debug_check:run(Formula, Recording, Options, fun(_Done) -> continue end),
    Found = [V || #{contract := C, what := W} = V <- Violations, C =:= Contract, W =:= What],
    #{
        contract => Contract,
        what => What,
        word => judgement(Verdict, Found),
        violations => Found,
        answer => Answer
    }.

judgement(never, []) -> kept;
judgement(possibly, _) -> depends;
judgement(certainly, []) -> kept;
judgement(_Verdict, [_ | _]) -> broken.
