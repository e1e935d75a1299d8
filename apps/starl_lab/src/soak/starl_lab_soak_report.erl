%% @doc The results of a soak: a table, and the first run of each kind of violation.
-module(starl_lab_soak_report).

-export([tell/2, missed/3, failing/2]).

-type founds() :: [{Block :: atom(), Seed :: non_neg_integer(), starl_lab_soak:found()}].

%% The first run with a kind of violation, and the number of such runs.
-type failure() :: {
    Block :: atom(), Seed :: non_neg_integer(), starl_monitor:violation(), Runs :: pos_integer()
}.

%% @doc Prints a line for each block.
-spec tell([atom(), ...], founds()) -> ok.
tell(Blocks, Founds) ->
    Rows = [row(Block, of_block(Block, Founds)) || Block <- Blocks],
    Head = io_lib:format("~-10s ~7s ~10s ~9s ~14s~n", [
        "block", "seeds", "violations", "failures", "seeds/min/core"
    ]),
    starl_cli_terminal:out([Head, Rows, [failure(Found) || {_, _, {failed, _}} = Found <- Founds]]).

failure({Block, Seed, {failed, Reason}}) ->
    Why = starl_sim_shrink:format_error({trial, Reason}),
    io_lib:format("~ts, seed ~b: ~ts~n", [Block, Seed, Why]).

row(Block, Founds) ->
    Seconds = lists:sum([S || {ok, _, S, _} <- Founds]),
    Judged = length([x || {ok, _, _, _} <- Founds]),
    io_lib:format("~-10s ~7b ~10b ~9b ~14b~n", [
        Block,
        length(Founds),
        length([x || {ok, [_ | _], _, _} <- Founds]),
        length(Founds) - Judged,
        round(60 * Judged / max(1.0e-6, Seconds))
    ]).

of_block(Block, Founds) -> [Found || {B, _, Found} <- Founds, B =:= Block].

%% @doc Prints what has not happened in the runs of each block. `owed': there was something that has to. Runs of teams of one size
%% only owe nothing.
-spec missed([atom(), ...], founds(), AreDrawn :: boolean()) -> owed | none.
missed(Blocks, Founds, AreDrawn) ->
    Missed = [{Block, never(of_block(Block, Founds), Block, AreDrawn)} || Block <- Blocks],
    Lines = [
        line(Block, Kind, maps:get(Kind, Never))
     || {Block, Never} <- Missed, Kind <- [owed, seldom]
    ],
    starl_cli_terminal:out(Lines),
    case [Block || {Block, #{owed := [_ | _]}} <- Missed] of
        [] -> none;
        [_ | _] -> owed
    end.

never(Founds, Block, AreDrawn) ->
    Counts = [C || {ok, _, _, C} <- Founds],
    Runs = length([x || AreDrawn, _ <- Counts]),
    starl_lab_soak_sometimes:never(Block, Runs, Counts).

line(_Block, _Kind, []) ->
    [];
line(Block, Kind, Names) ->
    Words = lists:join(", ", [starl_lab_soak_sometimes:format(Name) || Name <- Names]),
    Text = [atom_to_list(Block), " ", which(Kind), ": ", Words],
    [starl_cli_terminal:wrap(Text, 4, starl_cli_terminal:columns()), "\n"].

which(owed) -> "has never had, but owes";
which(seldom) -> "has never had".

%% @doc The first run of each kind of violation of a block's contracts, numbered within the
%% block.
-spec failing([atom(), ...], founds()) -> [{N :: pos_integer(), failure()}].
failing(Blocks, Founds) ->
    lists:append([lists:enumerate(ways(Block, Founds)) || Block <- Blocks]).

ways(Block, Founds) ->
    Broken = [
        {starl_violation:shape(V), Seed, V}
     || {B, Seed, {ok, [V | _], _, _}} <- Founds, B =:= Block
    ],
    First = lists:ukeysort(1, Broken),
    [
        {Block, Seed, V, length([x || {W, _, _} <- Broken, W =:= Way])}
     || {Way, Seed, V} <- lists:keysort(2, First)
    ].
