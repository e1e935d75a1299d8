%% @doc `./starl planted': broken building blocks, one per pitfall, and what finds them. The broken
%% ones live with the tests; they are compiled in memory when they are wanted.
-module(starl_cli_planted).

-export([command/1, sources/0, compiled/1]).
%% called in VMs of their own
-export([caught/1]).

-export_type([answer/0]).

-type answer() ::
    {caught, Seed :: pos_integer(), starl_monitor:violation(), Seconds :: float()}
    | {not_caught, Seeds :: pos_integer(), Seconds :: float()}
    | {failed, term()}.

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    case {starl_cli_setup:help_wanted(Args), starl_cli_flags:parse(Args, flags())} of
        {true, _} ->
            help();
        {false, {ok, Values}} ->
            loaded(compiled(sources()), maps:merge(starl_cli_flags:defaults(flags()), Values));
        {false, {error, Problems}} ->
            refuse([starl_cli_flags:format_problem(Problem) || Problem <- Problems])
    end.

flags() ->
    [
        {bug, {list, string}, none, "only these bugs"},
        {seeds, {integer, 1, 1000000}, 1000, "with so many seeds at most"},
        starl_cli_jobs:at_once(),
        {help, switch, false, "this help"}
    ].

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

loaded({error, Problems}, _Values) ->
    refuse(Problems);
loaded({ok, Codes}, #{bug := Wanted} = Values) ->
    Catalogue = catalogue(),
    Bugs = Catalogue:bugs(),
    Names = [atom_to_list(Bug) || {Bug, _, _} <- Bugs],
    case [Name || Wanted =/= none, Name <- Wanted, not lists:member(Name, Names)] of
        [] ->
            Some = [B || {Bug, _, _} = B <- Bugs,
                         Wanted =:= none orelse lists:member(atom_to_list(Bug), Wanted)],
            search(Some, Codes, Values);
        [Name | _] ->
            refuse([["--bug: there is no bug ", Name, "; there are ", lists:join(", ", Names)]])
    end.

%% The test module that knows them all, with `bugs/0', `scenario/2' and `sound/1'. It is there when
%% the tests have been compiled, not before.
catalogue() -> list_to_existing_atom("starl_planted").

%% -- the search -----------------------------------------------------------------------------

search(Bugs, Codes, #{seeds := Seeds, jobs := Most}) ->
    ok = starl_cli_log:install(),
    Jobs = [{Bug, Seeds} || {Bug, _, _} <- Bugs],
    {How, Answers} = starl_cli_jobs:run(Jobs, #{
        work => {?MODULE, caught}, at_once => Most, what => "bugs", each => fun noted/3,
        code => Codes
    }, #{}),
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

noted({Bug, _}, {ok, Answer}, Answers) -> Answers#{Bug => Answer};
noted({Bug, _}, {crashed, Reason}, Answers) -> Answers#{Bug => {failed, Reason}}.

row({Bug, _Block, Pitfall}, Answer) -> [atom_to_list(Bug), Pitfall | found(Answer)].

found({caught, Seed, #{contract := Contract, what := What}, Seconds}) ->
    Words = string:replace(atom_to_list(What), "_", " ", all),
    [[atom_to_list(Contract), ": ", Words], integer_to_list(Seed), seconds(Seconds)];
found({not_caught, Seeds, Seconds}) ->
    ["NOT FOUND", integer_to_list(Seeds), seconds(Seconds)];
found({failed, Reason}) ->
    [io_lib:format("FAILED: ~0tP", [Reason, 8]), "", ""].

seconds(Seconds) -> io_lib:format("~.1f", [Seconds]).

table_row([Bug, Pitfall, Found, Seed, Seconds]) ->
    [
        string:pad(Bug, 22), string:pad(Pitfall, 58), string:pad(Found, 38),
        string:pad(Seed, 5, leading), string:pad(Seconds, 7, leading), "\n"
    ].

%% @private The first seed whose run violates a contract with the bug and does not without it.
-spec caught({Bug :: atom(), Seeds :: pos_integer()}) -> answer().
caught({Bug, Seeds}) -> caught(Bug, 1, Seeds, erlang:monotonic_time(millisecond)).

caught(_Bug, Seed, Seeds, Begin) when Seed > Seeds ->
    {not_caught, Seeds, since(Begin)};
caught(Bug, Seed, Seeds, Begin) ->
    Catalogue = catalogue(),
    Scenario = Catalogue:scenario(Bug, Seed),
    case starl_sim_trial:run(Scenario) of
        {ok, #{violations := []}} -> caught(Bug, Seed + 1, Seeds, Begin);
        {ok, #{violations := [First | _]}} -> proven(Scenario, First, {Bug, Seed, Seeds, Begin});
        {error, Reason} -> {failed, Reason}
    end.

proven(Scenario, Violation, {Bug, Seed, Seeds, Begin}) ->
    Catalogue = catalogue(),
    case starl_sim_trial:run(Catalogue:sound(Scenario)) of
        {ok, #{violations := []}} -> {caught, Seed, Violation, since(Begin)};
        {ok, _} -> caught(Bug, Seed + 1, Seeds, Begin);
        {error, Reason} -> {failed, Reason}
    end.

since(Begin) -> (erlang:monotonic_time(millisecond) - Begin) / 1000.

help() ->
    Width = starl_cli_terminal:columns(),
    starl_cli_terminal:out([
        "Usage: ./starl planted [FLAGS]\n\n",
        starl_cli_terminal:wrap("Shows that the monitors find bugs: every broken building block of "
            "the tests, one per pitfall, runs under random faults with seeds 1, 2, ... until a "
            "contract is violated that the sound one keeps in the same run. The table has the "
            "contract, the seed and the time. The broken ones are no part of StarL: their sources "
            "(apps/*/test/*_bug.erl, *_planted.erl, test/*_planted.erl) are compiled in memory.",
            0, Width),
        "\n\nFlags:\n", starl_cli_flags:help(flags(), Width),
        "\nExit status: 0 all were found; 4 some were not; 2 bad usage or input; 130 interrupted.\n"
    ]),
    0.

refuse(Problems) -> starl_cli_terminal:bad_input([["planted: ", P] || P <- Problems]).
