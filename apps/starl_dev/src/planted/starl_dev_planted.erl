%% @doc `./starl planted': runs broken building blocks, one per pitfall, until a monitor finds the
%% bug. The broken blocks belong to the tests and are compiled in memory when needed.
-module(starl_dev_planted).

-behaviour(starl_cli_command).

-export([name/0, synopsis/0, about/1, flags/1, statuses/0, run/1]).
-export([sources/0, compiled/1]).
%% Columns of the table; the pitfall of a bug has a line of its own.
-define(BUG, 24).
-define(FOUND, 38).
-define(WIDTH, 79).

-spec name() -> string().
name() -> "planted".

-spec synopsis() -> string().
synopsis() -> "show that the monitors find planted bugs".

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Shows that the monitors find bugs: every broken building block of the tests, one per "
        "pitfall, runs under random faults with seeds 1, 2, ... until a contract is violated that "
        "the sound one keeps in the same run. The table has the contract, the seed and the time. The "
        "broken ones are no part of StarL: their sources (apps/*/test/*_bug.erl, *_planted.erl, "
        "test/*_planted.erl) are compiled in memory. With --histories no monitor looks: the calls of the "
        "applications and their answers are all that is judged (./starl histories).",
        "With --when N each bug's run is shrunk, and ./starl when --draws 20 --points 8 is asked with the "
        "branch seeds 1 to N by which event its violation became inevitable; the first one twice, for the same "
        "curve. The table has the event, how often it is one that the bug makes wrong, the fractions before "
        "and after it, and the CPU time of all N.",
        "With --progress other bugs run: each breaks the progress of a block or of an application in one line. Each "
        "runs on radios that lose packets, and beside faults that last and do no harm. The table has the violation "
        "that is found, or the clause that the run says it has not judged."
    ].

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) ->
    [
        {"Flags", [
            {bug, {list, string}, none, "only these bugs"},
            {seeds, {integer, 1, 1000000}, 1000, "the most seeds to try for each bug"},
            {histories, switch, false, "judges histories alone"},
            {progress, switch, false, "breaks progress, at each loss and beside harmless faults"},
            {propositions, switch, false,
                "only lists what the paper says, the guarantee, the clause that judges it, and the bug"},
            {'when', {optional, {integer, 1, 1000}}, none,
                "asks when it became inevitable, with this many branch seeds"},
            starl_lab_jobs:at_once()
        ]}
    ].

-spec statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses() ->
    [
        {0, "all were found"},
        {4, "some were not, another event was named, or a proposition lacks something"},
        {130, "interrupted"}
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{histories := true, 'when' := N}}) when N =/= none ->
    {error, ["--when asks the monitors; leave out --histories"]};
run(#{values := #{progress := true, histories := Histories, 'when' := N}}) when
    Histories; N =/= none
->
    {error, ["--progress stands alone; leave out --histories and --when"]};
run(#{values := Values}) ->
    loaded(compiled(sources()), Values).

%% @doc The sources of the broken machines, in a checkout.
-spec sources() -> [file:filename()].
sources() ->
    Root = starl_cli_target:root(),
    lists:append([
        lists:sort(filelib:wildcard(filename:join(Root, Pattern)))
     || Pattern <- ["apps/*/test/*_{bug,planted}.erl", "test/*_planted.erl"]
    ]).

%% @doc Compiles and loads them.
-spec compiled([file:filename()]) ->
    {ok, [starl_cli_target:code()]} | {error, [unicode:chardata(), ...]}.
compiled([]) ->
    {error, ["there are no tests beside this StarL; run it in a checkout"]};
compiled(Files) ->
    Codes = [{File, compile:file(File, [binary, return_errors])} || File <- Files],
    case [File || {File, Answer} <- Codes, element(1, Answer) =/= ok] of
        [] -> {ok, [code(File, Module, Beam) || {File, {ok, Module, Beam}} <- Codes]};
        Bad -> {error, [[File, ": does not compile"] || File <- Bad]}
    end.

code(File, Module, Beam) ->
    {module, Module} = code:load_binary(Module, File, Beam),
    {Module, File, Beam}.

loaded({error, _} = Error, _Values) ->
    Error;
loaded({ok, _Codes}, #{propositions := true}) ->
    Rows = starl_dev_planted_seed:propositions(),
    starl_cli_terminal:out([proposition(Row) || Row <- Rows]),
    status(done, lists:all(fun is_full/1, Rows));
loaded({ok, Codes}, #{bug := Wanted} = Values) ->
    Bugs = catalogue(Values),
    Names = [atom_to_list(Bug) || {Bug, _, _} <- Bugs],
    case [Name || Wanted =/= none, Name <- Wanted, not lists:member(Name, Names)] of
        [] ->
            Some = [
                B
             || {Bug, _, _} = B <- Bugs,
                Wanted =:= none orelse lists:member(atom_to_list(Bug), Wanted)
            ],
            ok = starl_cli_log:install(),
            chosen(Some, Codes, Values);
        [Name | _] ->
            {error, [
                ["--bug: there is no bug ", Name, meant(starl_cli_flags:nearest(Name, Names))]
            ]}
    end.

catalogue(#{progress := true}) -> starl_dev_planted_progress:bugs();
catalogue(_Values) -> starl_dev_planted_seed:bugs().

is_full({_Of, Guarantee, Clauses, Bugs}) ->
    Guarantee =/= none andalso Clauses =/= [] andalso Bugs =/= [].

proposition({Of, Guarantee, Clauses, Bugs}) ->
    [
        [Of, "\n"],
        ["    guarantee  ", says(Guarantee), "\n"],
        ["    clause     ", lists:join(", ", [spaced(Clause) || Clause <- Clauses]), "\n"],
        ["    bug        ", lists:join(", ", [atom_to_list(Bug) || Bug <- Bugs]), "\n"]
    ].

says(none) -> "";
says({_, _, Says, _}) -> Says.

spaced(Name) -> string:replace(atom_to_list(Name), "_", " ", all).

meant([Near | _]) -> [" (did you mean ", Near, "?)"];
meant([]) -> "; without --bug the table has all".

%% -- the search -----------------------------------------------------------------------------

chosen(Bugs, Codes, #{progress := true} = Values) ->
    starl_dev_planted_progress:table(Bugs, Codes, Values);
chosen(Bugs, Codes, #{'when' := none} = Values) ->
    search(Bugs, Codes, Values);
chosen(Bugs, Codes, Values) ->
    starl_dev_planted_when:table(Bugs, Codes, Values).

search(Bugs, Codes, #{seeds := Seeds, jobs := Most} = Values) ->
    By = judges(maps:get(histories, Values, false)),
    Jobs = [{Bug, Seeds, By} || {Bug, _, _} <- Bugs],
    {How, Answers} = starl_lab_jobs:run(
        Jobs,
        #{
            work => {starl_dev_planted_seed, caught},
            at_once => Most,
            what => "bugs",
            each => fun noted/3,
            code => Codes
        },
        #{}
    ),
    Rows = [row(B, maps:get(Bug, Answers)) || {Bug, _, _} = B <- Bugs, is_map_key(Bug, Answers)],
    Caught = length([x || {caught, _, _, _} <- maps:values(Answers)]),
    starl_cli_terminal:out([
        [table_row(Row) || Row <- [["bug", "pitfall", "found as", "seed", "s"] | Rows]],
        io_lib:format("~b of ~b found, each with at most ~b seeds\n", [Caught, length(Bugs), Seeds])
    ]),
    status(How, Caught =:= length(Bugs)).

status(interrupted, _) -> 130;
status(done, true) -> 0;
status(done, false) -> 4.

noted({Bug, _, _}, {ok, Answer}, Answers) -> Answers#{Bug => Answer};
noted({Bug, _, _}, {crashed, Reason}, Answers) -> Answers#{Bug => {failed, Reason}}.

row({Bug, _Block, Pitfall}, {failed, Reason}) ->
    Why = io_lib:format("~0tP", [Reason, 8]),
    [atom_to_list(Bug), [Pitfall, "; the run failed: ", Why], "FAILED", "", ""];
row({Bug, _Block, Pitfall}, Answer) ->
    [atom_to_list(Bug), Pitfall | found(Answer)].

found({caught, Seed, #{contract := Contract, what := What}, Seconds}) ->
    Words = string:replace(atom_to_list(What), "_", " ", all),
    [[atom_to_list(Contract), ": ", Words], integer_to_list(Seed), seconds(Seconds)];
found({not_caught, Seeds, Seconds}) ->
    ["NOT FOUND", integer_to_list(Seeds), seconds(Seconds)].

seconds(Seconds) -> io_lib:format("~.1f", [Seconds]).

table_row([Bug, Pitfall, Found, Seed, Seconds]) ->
    [
        string:pad(Bug, ?BUG),
        string:pad(string:slice(Found, 0, ?FOUND), ?FOUND),
        string:pad(Seed, 8, leading),
        string:pad(Seconds, 9, leading),
        ["\n    ", starl_cli_terminal:wrap(Pitfall, 4, ?WIDTH), "\n"]
    ].

judges(true) -> histories;
judges(false) -> monitors.
