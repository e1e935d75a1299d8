%% @doc The command `./starl planted --progress': runs building blocks and applications whose
%% progress is broken. They run on radios that lose packets, and beside harmless faults that last.
%% In each of these cells a monitor finds the bug, or the run reports which clause of these monitors
%% it has not judged. The same run without the bug keeps all contracts.
-module(starl_dev_planted_progress).

-export([bugs/0, table/3, is_right/1]).
%% Called in the VMs of the jobs.
-export([tried/1, tried/2]).

-export_type([cell/0]).

%% What came of a bug in one cell.
-type cell() ::
    {found, starl_monitor:violation()}
    | {not_judged, Lines :: [unicode:chardata(), ...]}
    | missed
    %% the sound one breaks a contract in the same run
    | {accused, starl_monitor:violation()}
    | {failed, term()}.

-define(BUG, 24).
-define(CELL, 14).
-define(SEED, 1).

%% @doc All bugs: name, the monitors that judge its progress, and what is wrong.
-spec bugs() -> [{atom(), [atom()], string()}].
bugs() ->
    Catalogue = catalogue(),
    Catalogue:bugs().

%% It exists only after the tests have been compiled.
catalogue() -> list_to_existing_atom("starl_progress_planted").

%% @doc Runs these bugs, and prints the table.
-spec table([{atom(), [atom()], string()}], [starl_cli_target:code()], Values :: map()) ->
    0 | 4 | 130.
table(Bugs, Codes, #{jobs := Most}) ->
    {How, Answers} = starl_lab_jobs:run(
        [Bug || {Bug, _, _} <- Bugs],
        #{
            work => {?MODULE, tried},
            at_once => Most,
            what => "bugs",
            each => fun(Bug, Answer, All) -> All#{Bug => cells(Answer)} end,
            code => Codes
        },
        #{}
    ),
    Rows = [{B, maps:get(Bug, Answers)} || {Bug, _, _} = B <- Bugs, is_map_key(Bug, Answers)],
    Wrong = [Cell || {_, Cells} <- Rows, {_, Cell} <- Cells, not is_right(Cell)],
    starl_cli_terminal:out([
        [row(B, Cells) || {B, Cells} <- Rows],
        io_lib:format("~b bugs in ~b cells: ~b found, ~b not judged, ~b neither\n", [
            length(Rows),
            lists:sum([length(Cells) || {_, Cells} <- Rows]),
            length([x || {_, Cells} <- Rows, {_, {found, _}} <- Cells]),
            length([x || {_, Cells} <- Rows, {_, {not_judged, _}} <- Cells]),
            length(Wrong)
        ])
    ]),
    status(How, Wrong).

status(interrupted, _Wrong) -> 130;
status(done, []) -> 0;
status(done, [_ | _]) -> 4.

cells({ok, Cells}) -> Cells;
cells({crashed, Reason}) -> [{"all", {failed, Reason}}].

%% @doc Is a bug found in a cell, or does the run say that it is not judged?
-spec is_right(cell()) -> boolean().
is_right({found, _}) -> true;
is_right({not_judged, _}) -> true;
is_right(_Other) -> false.

row({Bug, _, Doc}, Cells) ->
    [
        [atom_to_list(Bug), ": ", Doc, "\n"],
        [["    ", string:pad(Name, ?CELL), " ", shown(Cell), "\n"] || {Name, Cell} <- Cells]
    ].

shown({found, Violation}) -> ["found    ", brief(Violation)];
shown({not_judged, Lines}) -> lists:join("\n                   ", Lines);
shown(missed) -> "MISSED";
shown({accused, Violation}) -> ["ACCUSED without the bug: ", brief(Violation)];
shown({failed, Reason}) -> io_lib:format("FAILED ~0tP", [Reason, 8]).

brief(#{contract := Contract, what := What, at_us := Us}) ->
    Words = string:replace(atom_to_list(What), "_", " ", all),
    [atom_to_list(Contract), ": ", Words, io_lib:format(", at ~.1f s", [Us / 1.0e6])].

%% @private A bug in each cell.
-spec tried(Bug :: atom()) -> [{Cell :: string(), cell()}].
tried(Bug) ->
    Catalogue = catalogue(),
    tried(Bug, [Name || {Name, _, _} <- Catalogue:cells()]).

%% @doc A bug in the cells of these names.
-spec tried(Bug :: atom(), Cells :: [string()]) -> [{Cell :: string(), cell()}].
tried(Bug, Names) ->
    Catalogue = catalogue(),
    {Bug, Contracts, _} = lists:keyfind(Bug, 1, bugs()),
    [
        {Name, cell(Contracts, Catalogue:scenario(Bug, Cell, ?SEED))}
     || {Name, _, _} = Cell <- Catalogue:cells(), lists:member(Name, Names)
    ].

cell(Contracts, Scenario) ->
    Catalogue = catalogue(),
    case {starl_sim_trial:run(Scenario), starl_sim_trial:run(Catalogue:sound(Scenario))} of
        {_, {ok, #{violations := [First | _]}}} -> {accused, First};
        {{ok, #{violations := [First | _]}}, {ok, _}} -> {found, First};
        {{ok, #{monitors := Results}}, {ok, _}} -> unfound(unjudged(Contracts, Results));
        {{error, Reason}, _} -> {failed, Reason};
        {_, {error, Reason}} -> {failed, Reason}
    end.

unfound([]) -> missed;
unfound(Lines) -> {not_judged, Lines}.

%% The clauses of these monitors that the run says it has not judged.
unjudged(Contracts, Results) ->
    Names = [atom_to_list(Contract) || Contract <- Contracts],
    starl_monitor:clauses_not_judged(
        maps:filter(
            fun(Monitor, _) -> lists:member(starl_monitor:name(Monitor), Names) end, Results
        )
    ).
