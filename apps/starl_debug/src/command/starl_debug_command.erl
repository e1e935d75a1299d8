%% @doc The command `./starl debug': reports whether something was true at some moment of a recorded
%% run, although its robots' clocks may differ.
-module(starl_debug_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "debug",
        synopsis => "tell what can have happened in a recorded run whose clocks disagree",
        argument => {required, "RECORDING...", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => fun about/1,
        flags => [
            {"Flags", [
                {predicate, string, none, "what may have been true, see above"},
                starl_debug_bounds:flag(" (10ms)"),
                starl_debug_bounds:drift(),
                {from, {number, 0, 1.0e9}, none, "looks at the run from this second on"},
                {until, {number, 0, 1.0e9}, none, "looks at the run until this second"},
                {speed, {number, 1, 100000}, none,
                    "the robots' greatest speed, mm/s (that of the run)"},
                {pose_age, {number, 0, 60000}, 100,
                    "robots' own recordings: how old a pose is at most when it comes, ms"},
                {picture, file, none, "draws the moment that was found, as SVG"},
                {no_explain, switch, false, "only the answer, not what would change it"},
                {quiet, switch, false, "no progress"}
            ]}
        ],
        statuses => [
            {0, "never true"},
            {3, "certainly true at some moment"},
            {5, "not all was looked at, or is known, and in the part that was it was never true"},
            {6, "possibly true: it depends on the clocks, or on places between samples"}
        ],
        run => fun run/1
    }.

about(_Subject) ->
    [
        "./starl debug RECORDING... --predicate \"TEXT\" tells whether the predicate was never, possibly or "
        "certainly true at some moment of the run. RECORDING is a recording, the directory of a run, or "
        "the recordings of its robots. Any two clocks differ by at most sigma; clocks that are each within "
        "that of the true time differ by twice as much. Between samples of its place a robot may be "
        "wherever its greatest speed allows.",
        {lines, [
            "  dist(r1.pos, r2.pos) < 400 mm\n"
            "  exists a, b: leader(a) and leader(b)\n"
            "  count(r: r.mode = moving) > 3\n"
            "  (forall r: r.mode = waiting) for 2 s\n"
        ]},
        {list, "Predicates by name", [
            {[Name, takes(Kind)], Words}
         || {Name, Kind, _, Words} <- starl_debug_library:known()
        ]}
    ].

takes(none) -> "";
takes(length) -> "(400 mm)";
takes(duration) -> "(2 s)".

-spec subject(string(), [string()]) ->
    {ok, [file:filename(), ...], [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    {Words, Others} = lists:splitwith(fun(Arg) -> not lists:prefix("-", Arg) end, Args),
    Found = [
        starl_cli_out:recording(W, "./starl run TARGET --record makes one")
     || W <- [Word | Words]
    ],
    case lists:append([Problems || {error, Problems} <- Found]) of
        [] -> {ok, [File || {ok, File} <- Found], Others};
        Problems -> {error, Problems}
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{predicate := none}}) ->
    {error, [
        "--predicate is needed, such as --predicate \"too_near(400 mm)\"; --help shows the language"
    ]};
run(#{subject := Files, values := Values}) ->
    #{predicate := Text, sigma := Sigma} = Values,
    case {starl_debug:predicate(Text), starl_debug_bounds:read(Sigma)} of
        {{ok, Predicate}, {ok, Us}} -> read(Files, Predicate, Us, Values);
        {Parsed, Read} -> {error, wrong(Parsed, Text) ++ unread(Read)}
    end.

wrong({ok, _}, _Text) ->
    [];
wrong({error, {Column, Problem}}, Text) ->
    [io_lib:format("--predicate, column ~b: ~ts, in: ~ts", [Column, Problem, Text])].

unread({ok, _}) -> [];
unread({error, Line}) -> [Line].

%% -- the check ------------------------------------------------------------------------------

read(Files, Predicate, Sigma, Values) ->
    Limits = maps:from_list([
        {Key, V}
     || Key <- [speed, pose_age], #{Key := V} <- [Values], V =/= none
    ]),
    case starl_debug_recording:read(Files, Limits) of
        {ok, Recording} -> named(Predicate, Recording, Sigma, Values);
        {error, Reason} -> {error, [starl_debug_recording:format_error(Reason)]}
    end.

%% A name that the recording cannot have is a mistake.
named(Predicate, Recording, Sigma, #{predicate := Text} = Values) ->
    {ok, Expr} = starl_debug_parser:parse(Text),
    case starl_debug_names:check(Expr, Recording) of
        {ok, Lines} ->
            Formula = starl_debug:formula(Predicate, Recording),
            formula(Formula, Recording, Sigma, Values#{
                is_of_all => is_of_all(Predicate, Recording),
                remarks => Lines ++ starl_debug_names:remarks(Predicate, Recording)
            });
        {error, _} = Error ->
            {error, wrong(Error, Text)}
    end.

%% What is said of all robots is not known of those without a recording, nor is a token that only
%% they held.
is_of_all(_Predicate, #{missing := []}) ->
    true;
is_of_all(Predicate, #{robots := Here, missing := Missing} = Recording) ->
    Whole = Recording#{robots := lists:sort(Here ++ Missing)},
    {ok, Formula} = starl_debug:formula(Predicate, Whole),
    Robots = starl_debug_ground:robots(Formula),
    Robots =/= [] andalso not lists:any(fun(R) -> lists:member(R, Missing) end, Robots).

formula({ok, Formula}, Recording, Sigma, Values) ->
    case starl_debug_bounds:bounds(Sigma, Recording, maps:get(drift, Values)) of
        {ok, Known} -> checked(Formula, Recording, options(Known, Recording, Values), Values);
        {error, Line} -> {error, [Line]}
    end;
formula({error, {no_robots, Missing}}, #{robots := Robots}, _Sigma, _Values) ->
    Line = "--predicate: the recording has no robot ~ts; it has ~ts",
    {error, [io_lib:format(Line, [robots(Missing), robots(Robots)])]}.

robots(Robots) -> lists:join(", ", [["r", integer_to_list(R)] || R <- Robots]).

options(Sigma, #{begun := Begun}, Values) ->
    Times = [
        {Key, Begun + round(1.0e6 * S)}
     || Key <- [from, until], #{Key := S} <- [Values], S =/= none
    ],
    Solver = [{solver, starl_debug_z3:solver(File)} || {ok, File} <- [starl_debug_z3:find()]],
    maps:merge(
        #{sigma => Sigma, drift_ppm => ceil(maps:get(drift, Values))},
        maps:from_list(Times ++ Solver)
    ).

checked(Formula, Recording, Options, Values) ->
    Stop = atomics:new(1, []),
    starl_cli_signal:on_interrupt(fun() -> atomics:put(Stop, 1, 1) end),
    Progress = starl_cli_progress:new(drawing(Values)),
    Look = fun(Done) ->
        _ = starl_cli_progress:show(Progress, Done, fun() -> ["checked"] end),
        case atomics:get(Stop, 1) of
            0 -> continue;
            1 -> stop
        end
    end,
    Answer = starl_debug_check:run(Formula, Recording, Options, Look),
    starl_cli_signal:on_interrupt(quit),
    starl_cli_progress:erase(),
    told(Answer, Formula, Recording, Options, Values).

drawing(#{quiet := true}) -> quiet;
drawing(#{quiet := false}) -> auto.

%% -- the answer -----------------------------------------------------------------------------

told(Answer, Formula, Recording, Options, Values) ->
    starl_cli_terminal:out([
        head(Recording, Options),
        starl_debug_bounds:offsets(maps:get(sigma, Options), Recording),
        doubts(Recording),
        [[Line, "\n"] || Line <- maps:get(remarks, Values)],
        answer(Answer, Recording, Values),
        explained(Answer, Formula, Recording, Options, Values)
    ]),
    drawn(Answer, Recording, Values, status(Answer, Values)).

head(#{app := App, robots := Robots, extent := {First, Last}, how := How}, #{sigma := Sigma}) ->
    io_lib:format("~ts: ~b robots, ~.1f s~ts; ~ts\n", [
        App, length(Robots), (Last - First) / 1.0e6, told_by(How), starl_debug_bounds:words(Sigma)
    ]).

told_by(exact) -> "";
told_by(told) -> " that all have told of".

seconds(Us, #{begun := Begun}) -> io_lib:format("~.3f s", [(Us - Begun) / 1.0e6]).

doubts(#{missing := Missing, too_fast := TooFast, holes := Holes} = Recording) ->
    #{left_out := LeftOut, begun := Begun} = Recording,
    [
        [["no recording of ", robots(Missing), "\n"] || Missing =/= []],
        [
            io_lib:format(
                "r~b: faster than its chassis allows ~b times; its places are in doubt\n", [R, N]
            )
         || {R, N} <- TooFast
        ],
        [[starl_debug_hole:format(Hole, Begun), "\n"] || Hole <- Holes],
        [[File, ": left out; the robots' own recordings are here\n"] || File <- LeftOut]
    ].

answer(#{verdict := Verdict} = Answer, Recording, #{is_of_all := IsOfAll}) ->
    [
        word(Verdict),
        [" of the robots that are here" || not IsOfAll],
        part(Answer, Recording),
        "\n",
        found(maps:get(best, Answer), Recording),
        times(Answer, Recording)
    ].

word(never) -> "NEVER true";
word(possibly) -> "POSSIBLY true";
word(certainly) -> "CERTAINLY true".

part(#{is_whole := false, verdict := Verdict, until := Until}, Recording) when
    Verdict =/= certainly
->
    [" until ", seconds(Until, Recording), "; the rest was not looked at"];
part(#{verdict := never, known_until := Until}, Recording) when is_integer(Until) ->
    [" until ", seconds(Until, Recording), "; after that not all is known"];
part(_Answer, _Recording) ->
    "".

found(none, _Recording) ->
    "";
found(#{formula := Formula, outcome := #{witness := {At, _} = Witness} = Outcome}, Recording) ->
    #{begun := Begun} = Recording,
    Rows = starl_debug_witness:rows(Formula, Witness, Recording),
    [
        "at ",
        seconds(At, Recording),
        shown(Outcome),
        ":\n",
        [[Line, "\n"] || Line <- starl_debug_witness:format(Rows, Begun)]
    ].

shown(#{verdict := certainly}) -> ", for one of the clocks that are possible";
shown(#{is_shown := true}) -> ", if the clocks stood like this";
shown(#{is_shown := false}) -> ", where it cannot be excluded".

times(#{times := []}, _Recording) ->
    "";
times(#{times := Times, verdict := Verdict}, Recording) when Verdict =/= never ->
    Some = lists:sublist(Times, 4),
    [
        "it may be true ",
        lists:join(", ", [[seconds(A, Recording), " .. ", seconds(B, Recording)] || {A, B} <- Some]),
        [io_lib:format(" and ~b times more", [length(Times) - 4]) || length(Times) > 4],
        "\n"
    ];
times(_Answer, _Recording) ->
    "".

%% What the answer rests on, which takes some more checks.
explained(#{is_whole := false, verdict := Verdict}, _Formula, _Recording, _Options, _Values) when
    Verdict =/= certainly
->
    "";
explained(_Answer, _Formula, _Recording, _Options, #{no_explain := true}) ->
    "";
explained(#{verdict := Verdict} = Answer, Formula, Recording, Options, _Values) ->
    Explained = starl_debug_sigma:explain(Formula, Recording, Options, Verdict),
    [share(Answer), changes(Explained), decides(Verdict, Explained)].

share(#{parts := 0}) ->
    "";
share(#{parts := Parts, open := Open}) ->
    [
        io_lib:format("decided without a doubt: ~b of ~b parts in slices of a second\n", [
            Parts - length(Open), Parts
        ]),
        [
            "Z3 is not installed; it may decide what is left open of three robots and more (apt install z3)\n"
         || #{formula := {'and', [_, _, _ | _]}} <- lists:sublist(Open, 1),
            starl_debug_z3:find() =:= none
        ]
    ].

changes(#{smaller := Smaller, greater := Greater}) ->
    [
        [
            ["with clocks within ", starl_debug_bounds:ms(Us), " it is ", word_of(V), "\n"]
         || {until, V, Us} <- [Smaller]
        ],
        [
            ["with clocks off by ", starl_debug_bounds:ms(Us), " it is ", word_of(V), "\n"]
         || {from, V, Us} <- [Greater]
        ],
        [
            ["the same for clocks off by ", starl_debug_bounds:ms(Us), "\n"]
         || {not_until, Us} <- [Greater]
        ]
    ].

word_of(never) -> "never true";
word_of(possibly) -> "possibly true";
word_of(certainly) -> "certainly true".

decides(possibly, #{perfect_clocks := Clocks, known_places := Places, both := Both}) ->
    case {Clocks =/= possibly, Places =/= possibly, Both =/= possibly} of
        {true, true, _} -> "better clocks or more samples of places would decide it\n";
        {true, false, _} -> "better clocks would decide it\n";
        {false, true, _} -> "more samples of places would decide it\n";
        {false, false, true} -> "better clocks and more samples of places would decide it\n";
        {false, false, false} -> "neither better clocks nor more samples would decide it\n"
    end;
decides(_Verdict, _Explained) ->
    "".

drawn(
    #{best := #{formula := Formula, outcome := #{witness := Witness}}},
    Recording,
    #{picture := File},
    Status
) when
    File =/= none
->
    Title = ["at ", seconds(element(1, Witness), Recording), " of the time line"],
    case starl_debug_picture:svg(Formula, Witness, Recording, Title) of
        {ok, Svg} ->
            written(file:write_file(File, Svg), File, Status);
        {error, no_places} ->
            {error, [File, ": not drawn, since no place of these robots is known"]}
    end;
drawn(_Answer, _Recording, _Values, Status) ->
    Status.

written(ok, File, Status) ->
    starl_cli_terminal:out(["picture: ", File, "\n"]),
    Status;
written({error, Posix}, File, _Status) ->
    {error, [[File, ": ", file:format_error(Posix)]]}.

status(#{verdict := certainly}, _Values) -> 3;
status(#{verdict := possibly}, _Values) -> 6;
status(#{is_whole := false}, _Values) -> 5;
status(#{known_until := Until}, _Values) when is_integer(Until) -> 5;
status(#{verdict := never}, #{is_of_all := false}) -> 5;
status(#{verdict := never}, #{is_of_all := true}) -> 0.
