%% @doc `./starl hostile --insider': the attack in the simulator ({@link starl_dev_insider}) and on a
%% cluster ({@link starl_dev_insider_cluster}), as tables.
-module(starl_dev_insider_report).

-export([run/1]).

%% Of each block, on a cluster.
-define(MESSAGES, 100).

%% @doc Attacks all blocks, or one.
-spec run(#{atom() => term()}) ->
    ok | {wrong, [unicode:chardata()]} | {error, [unicode:chardata()]}.
run(#{block := all, seed := Seed} = Values) ->
    starl_cli_terminal:out(["In the simulator, seed ", integer_to_list(Seed), ":\n"]),
    Wrong = simulated(starl_dev_insider:blocks(), Values),
    starl_cli_terminal:out("\nOn a cluster, by UDP:\n"),
    verdict(Wrong ++ on_cluster(Values));
run(#{block := Block, apart := false} = Values) ->
    verdict(simulated([Block], Values));
run(#{block := Block, apart := true} = Values) ->
    verdict(apart(Block, Values)).

verdict([]) -> ok;
verdict(Wrong) -> {wrong, Wrong}.

simulated(Blocks, Values) ->
    starl_cli_terminal:out(starl_dev_insider:header()),
    lists:append([
        row(atom_to_list(Block), starl_dev_insider:run(Block, Options))
     || Block <- Blocks, Options <- starl_dev_insider:runs(options(Values))
    ]).

apart(Block, Values) ->
    Options = options(Values),
    starl_cli_terminal:out(starl_dev_insider:header()),
    lists:append([
        row(io_lib:format("~0tp", [Kind]), starl_dev_insider:run(Block, Options#{only => [Kind]}))
     || Kind <- starl_dev_insider:kinds(Block, Options),
        ok =:= starl_cli_terminal:out(io_lib:format("~0tp~n", [Kind]))
    ]).

row(What, Row) ->
    starl_cli_terminal:out(starl_dev_insider:format(Row)),
    [["the simulator: ", What] || not starl_dev_insider:is_borne(Row)].

options(#{robots := Robots, seed := Seed}) -> #{robots => max(4, Robots), seed => Seed}.

on_cluster(#{speed := Speed} = Values) ->
    Options = (options(Values))#{
        speed => Speed, messages => ?MESSAGES, log => fun starl_cli_log:node/3
    },
    lists:append([
        team(Team, Options#{attack => Attack})
     || Team <- starl_dev_insider_cluster:teams(), Attack <- [false, true]
    ]).

team(Team, Options) ->
    Row = starl_dev_hostile_run:with_dir(fun(Dir) ->
        starl_dev_insider_cluster:run(Team, Options, Dir)
    end),
    starl_cli_terminal:out(starl_dev_insider_cluster:format(Row)),
    Names = lists:join(", ", [atom_to_list(Block) || Block <- Team]),
    [["the cluster: ", Names] || not starl_dev_insider_cluster:is_borne(Row)].
