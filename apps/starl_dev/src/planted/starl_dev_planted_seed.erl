%% @doc Finds a seed with which a planted bug is detected. The VMs of the jobs call it.
-module(starl_dev_planted_seed).

-export([bugs/0, propositions/0, caught/1]).

-export_type([answer/0, bug/0]).

%% Its name, its block, and the pitfall into which the block falls.
-type bug() :: {Bug :: atom(), Block :: atom(), Pitfall :: unicode:chardata()}.

-type answer() ::
    {caught, Seed :: pos_integer(), starl_monitor:violation(), Seconds :: float()}
    | {not_caught, Seeds :: pos_integer(), Seconds :: float()}
    | {failed, term()}.

%% @doc All bugs of the catalogue.
-spec bugs() -> [bug()].
bugs() ->
    Catalogue = catalogue(),
    Catalogue:bugs().

%% @doc For each proposition of the paper its guarantee, the clauses that judge it, and the bugs of its block
%% that break one of them.
-spec propositions() ->
    [
        {Of :: string(), starl_guarantee:t() | none, Clauses :: [atom()], Bugs :: [atom()]}
    ].
propositions() ->
    Catalogue = catalogue(),
    Breaks = Catalogue:breaks(),
    [
        {Of, guarantee(Guarantee, Block), Clauses, [
            Bug
         || {Bug, Name0, _} <- bugs(),
            Name0 =:= Name,
            {Bug0, What} <- Breaks,
            Bug0 =:= Bug,
            lists:member(What, Clauses)
        ]}
     || {Name, Block} <- starl_block_catalogue:known(),
        {Of, Guarantee, Clauses} <- starl_block:propositions(Block)
    ].

guarantee(Name, Block) ->
    {ok, Guarantees} = starl_block:guarantees(Block),
    case lists:keyfind(Name, 1, Guarantees) of
        false -> none;
        Guarantee -> Guarantee
    end.

%% The test module with the catalogue of all bugs: `bugs/0', `scenario/2' and `sound/1'. It exists
%% only after the tests have been compiled.
catalogue() -> list_to_existing_atom("starl_planted").

%% @doc The first seed whose run violates a contract with the bug but not without it.
-spec caught({Bug, Seeds} | {Bug, Seeds, monitors | histories}) -> answer() when
    Bug :: atom(), Seeds :: pos_integer().
caught({Bug, Seeds}) -> caught({Bug, Seeds, monitors});
caught({Bug, Seeds, By}) -> caught(Bug, 1, Seeds, By, erlang:monotonic_time(millisecond)).

caught(_Bug, Seed, Seeds, _By, Begin) when Seed > Seeds ->
    {not_caught, Seeds, since(Begin)};
caught(Bug, Seed, Seeds, By, Begin) ->
    Catalogue = catalogue(),
    Scenario = Catalogue:scenario(Bug, Seed),
    case judged(Scenario, By) of
        {ok, #{violations := []}} ->
            caught(Bug, Seed + 1, Seeds, By, Begin);
        {ok, #{violations := [First | _]}} ->
            proven(Scenario, First, {Bug, Seed, Seeds, By, Begin});
        {error, Reason} ->
            {failed, Reason}
    end.

proven(Scenario, Violation, {Bug, Seed, Seeds, By, Begin}) ->
    Catalogue = catalogue(),
    case judged(Catalogue:sound(Scenario), By) of
        {ok, #{violations := []}} -> {caught, Seed, Violation, since(Begin)};
        {ok, _} -> caught(Bug, Seed + 1, Seeds, By, Begin);
        {error, Reason} -> {failed, Reason}
    end.

judged(Scenario, monitors) ->
    starl_sim_trial:run(Scenario);
judged(Scenario, histories) ->
    Alone = #{histories => {alone, starl_block_catalogue:histories()}},
    starl_sim_trial:run(Scenario, fun(_Sim) -> ok end, [], Alone).

since(Begin) -> (erlang:monotonic_time(millisecond) - Begin) / 1000.
