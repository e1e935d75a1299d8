%% @doc The interface of leader election: robots agree on a leader.
%%
%% An election has a name, any small term; another name means another election. The robots that call
%% {@link elect/2} with the same name take part in the same election. Guarantee (the paper's
%% Proposition 1): any two robots that elect in the same election elect the same leader. A robot
%% that gets only the announcement elects the announced leader. Every other robot fails in bounded
%% time. When no message is lost, all elect.
%%
%% The ballots give this guarantee ({@link starl_election_ballots}). The block {@link starl_bully}
%% replaces this block by the bully algorithm, with the same interface. It elects the highest robot
%% that is alive, even with dead robots in the team. But if messages are lost, two robots may elect
%% different leaders.
-module(starl_election).
-behaviour(starl_block).

-export([elect/2, elect/3]).
-export([
    options/0,
    machines/1,
    monitors/2,
    guarantees/0,
    propositions/0,
    contract/0,
    exercise/0,
    models/0,
    history/0,
    benchmark/0
]).

-export_type([election/0]).

-type election() :: term().

%% @doc Takes part in an election, and waits for at most 30 s for the result.
-spec elect(starl:robot(), election()) ->
    {ok, Leader :: starl:robot_id()} | {error, timeout | restarted}.
elect(Robot, Election) -> elect(Robot, Election, 30000).

%% @doc Takes part in an election, and fails after `Ms' milliseconds. A robot that failed may call
%% again with the same name. It takes part with the same ballot, and robots that have elected
%% meanwhile send it their leader.
-spec elect(starl:robot(), election(), Ms :: pos_integer()) ->
    {ok, Leader :: starl:robot_id()} | {error, timeout | restarted}.
elect(Robot, Election, Ms) ->
    ok = starl_caller:payload({?MODULE, elect, 3}, 'Election', label, Election),
    ok = starl_caller:check({?MODULE, elect, 3}, 'Ms', positive_ms, Ms),
    case starl:call(Robot, election, {elect, Election, Ms * 1000}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

%% -- the block ------------------------------------------------------------------------------

%% @doc `patience_ms': the longest timeout of a call; a call that lasts a second longer breaks the
%% contract.
-spec options() -> [starl_options:option()].
options() ->
    [
        {patience_ms, {integer, 1, 1000000000}, 600000,
            "no call of elect/3 has more patience: one that lasts longer breaks the contract, ms"}
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(_Options) -> [{election, starl_election_ballots, #{}}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{patience_ms := Ms}, #{robots := Robots}) ->
    [
        {starl_election_monitor, #{
            robots => Robots,
            bound_us => 1000 * Ms + 1000000,
            again_us => starl_election_ballots:again_us(),
            complete => true
        }}
    ].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {agree, safety, "two robots that elect in one election elect the same leader", []},
        {announced, safety, "an announcement elects: who is electing elects the leader it is told",
            [
                prompt
            ]},
        {ends, safety, "a robot elects or fails in bounded time", [clock_rate, prompt]},
        {elected, progress, "nothing lost: all elect the same", [no_loss, alive, {sap, delivered}]}
    ].

-spec propositions() -> [starl_guarantee:proposition()].
propositions() ->
    [
        {"Proposition 1(a)", agree, [different_leaders, two_leaders_at_one_robot]},
        {"Proposition 1(b)", announced, [announcement_ignored]},
        {"Proposition 1, failing in bounded time", ends, [no_result]},
        {"Proposition 1, progress", elected, [not_settled]}
    ].

-spec contract() -> string().
contract() -> "two robots that elect in one election elect the same leader".

-spec exercise() -> module().
exercise() -> starl_election_exercise.

-spec history() -> module().
history() -> starl_election_history.

-spec models() -> [starl_block:model_entry()].
models() -> [{election, "election by randomized ballots", fun model/1}].

%% Only the largest ballot of a complete set counts, so nothing but the place of its robot could
%% make a difference, and every place is as good as the last: there is one ballot only here, the
%% robot's number decides, and all robots but the last are alike. A robot that has a leader keeps
%% it.
model(#{robots := Ids}) ->
    #{
        blocks => [{election, starl_election_ballots, #{ballots => 1}}],
        script => fun(_) -> [{call, election, {elect, first, 30000000}}] end,
        crash => [election, app],
        monitor => {starl_election_monitor, #{robots => Ids, bound_us => 1}},
        fixed => [length(Ids)],
        inert => fun
            (leader, {_, _}) -> true;
            (_, _) -> false
        end
    }.

-spec benchmark() -> starl_block:benchmark().
benchmark() ->
    #{
        workload => #{turns => 1},
        operations => elections,
        packets => fun(N) -> 2 * N * N end,
        formula => "ballots N^2 and N for each announcement, at most 2 N^2"
    }.
