%% @doc The printed results of mutation testing: a table of the mutants caught by each kind of test,
%% the survivors as textual differences, and the score.
-module(starl_mutate_report).

-export([table/1, survivors/2, score/2, line/1]).

-export_type([result/0]).

-type result() :: {starl_mutate_sample:drawn(), starl_mutate_worker:verdict()}.

-define(COLUMNS, [unit, soak, check, suite, timeout, survived]).
%% Prints in 80 columns: a row of the table, code with its sign.
-define(NAME, 33).
-define(MUTANTS, 8).
-define(CODE, 77).
-define(WIDTH, 80).

%% @doc The number of mutants of each module caught by each kind of test; the cheapest test that
%% fails counts.
-spec table([result()]) -> unicode:chardata().
table(Results) ->
    Modules = lists:usort([module(Drawn) || {Drawn, _} <- Results]),
    Rows = [
        row(atom_to_list(Module), [V || {Drawn, V} <- Results, module(Drawn) =:= Module])
     || Module <- Modules
    ],
    Operators = [
        row(Doc, [V || {Drawn, V} <- Results, operator(Drawn) =:= Operator])
     || {Operator, Doc} <- [{O, atom_to_list(O)} || {O, _} <- starl_mutate_operators:operators()]
    ],
    All = row("all", [Verdict || {_, Verdict} <- Results]),
    [
        heading("module"),
        Rows,
        All,
        "\n",
        heading("operator"),
        Operators,
        "\n"
    ].

heading(What) -> cells([What, "mutants" | [atom_to_list(C) || C <- ?COLUMNS]]).

row(_Name, []) ->
    [];
row(Name, Verdicts) ->
    Columns = [column(Verdict) || Verdict <- Verdicts],
    Counts = [length([x || C <- Columns, C =:= Column]) || Column <- ?COLUMNS],
    cells([Name | [integer_to_list(N) || N <- [length(Verdicts) | Counts]]]).

cells([First | Others]) ->
    Name = string:slice(First, 0, ?NAME),
    Padded = [
        string:pad(Cell, Width, leading)
     || {Cell, Width} <- lists:zip(Others, [?MUTANTS | [1 + width(C) || C <- ?COLUMNS]])
    ],
    [string:pad(Name, ?NAME), Padded, "\n"].

width(Column) -> max(4, length(atom_to_list(Column))).

column(survived) -> survived;
column({caught, _, timeout}) -> timeout;
column({caught, Unit, _}) -> element(1, Unit).

module(#{candidate := #{source := #{module := Module}}}) -> Module.

operator(#{candidate := #{mutant := #{operator := Operator}}}) -> Operator.

%% @doc The survivors without a reason.
-spec survivors([result()], Reviewed :: #{string() => string()}) -> unicode:chardata().
survivors(Results, Reviewed) ->
    [
        [diff(Drawn), "\n"]
     || {#{id := Id} = Drawn, survived} <- lists:sort(fun by_id/2, Results),
        not is_map_key(Id, Reviewed)
    ].

by_id({#{id := One}, _}, {#{id := Other}, _}) -> One =< Other.

%% A mutant as a textual difference: the original clause and the changed one.
-spec diff(starl_mutate_sample:drawn()) -> unicode:chardata().
diff(#{id := Id, candidate := Candidate}) ->
    #{source := #{file := File}, before := Before, mutant := Mutant} = Candidate,
    #{operator := Operator, location := Location, clause := N, form := After} = Mutant,
    {Old, New} = texts(N, Before, After),
    {Same, Minus, Plus, Rest} = apart(Old, New),
    [
        io_lib:format("~ts:~b:~n  ~ts  ~ts~n", [File, line_of(Location), Operator, Id]),
        lines(" ", lists:nthtail(max(0, length(Same) - 1), Same)),
        lines("-", Minus),
        lines("+", Plus),
        lines(" ", lists:sublist(Rest, 1))
    ].

line_of({Line, _Column}) -> Line;
line_of(Line) -> Line.

lines(Sign, Lines) -> [[Sign, " ", Line, "\n"] || Line <- Lines].

texts(N, {function, _, _, _, Old} = Before, {function, _, _, _, New}) ->
    Kept = [lists:nth(N, New) || length(New) =:= length(Old)],
    {text(Before, [lists:nth(N, Old)]), text(Before, Kept)}.

text(_Function, []) ->
    [];
text({function, Anno, Name, Arity, _}, Clauses) ->
    Text = erl_pp:form({function, Anno, Name, Arity, Clauses}, [
        {linewidth, ?CODE}, {encoding, unicode}
    ]),
    string:lexemes(unicode:characters_to_list(Text), "\n").

%% Splits two texts into the common beginning, the different parts and the common end.
apart(Old, New) ->
    {Same, Minus, Plus} = ahead(Old, New, []),
    {Rest, Sunim, Sulp} = ahead(lists:reverse(Minus), lists:reverse(Plus), []),
    {Same, lists:reverse(Sunim), lists:reverse(Sulp), lists:reverse(Rest)}.

ahead([Line | Old], [Line | New], Same) -> ahead(Old, New, [Line | Same]);
ahead(Old, New, Same) -> {lists:reverse(Same), Old, New}.

%% @doc One line about a mutant: its name and the test that caught it.
-spec line(result()) -> unicode:chardata().
line({#{id := Id}, survived}) ->
    io_lib:format("~ts survived~n", [Id]);
line({#{id := Id}, {caught, Unit, How}}) ->
    Text = io_lib:format("~ts ~0tp ~ts", [Id, Unit, how(How)]),
    [starl_cli_terminal:wrap(Text, 4, ?WIDTH), "\n"].

how(timeout) -> "timeout";
how({failed, Reason}) -> Reason.

%% @doc The fraction of mutants that were caught, as a number and as text. Survivors with a reason
%% are not counted.
-spec score([result()], Reviewed :: #{string() => string()}) -> {float(), unicode:chardata()}.
score(Results, Reviewed) ->
    Survived = [Id || {#{id := Id}, survived} <- Results],
    Excused = length([Id || Id <- Survived, is_map_key(Id, Reviewed)]),
    Counted = length(Results) - Excused,
    Caught = length(Results) - length(Survived),
    Part = Caught / max(1, Counted),
    {Part, [
        io_lib:format("~.1f % caught: ~b of ~b mutants", [100 * Part, Caught, Counted]),
        [io_lib:format("; ~b more are equivalent, each with its reason", [Excused]) || Excused > 0],
        "\n"
    ]}.
