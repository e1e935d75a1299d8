%% @doc Leader election by the bully algorithm: it elects the highest robot that is alive. Alive
%% means that the robot hears the others and that they hear it. The block replaces
%% {@link starl_election}, and applications use the interface of `starl_election'.
-module(starl_bully).
-behaviour(starl_block).

-export([
    options/0,
    machines/1,
    monitors/2,
    guarantees/0,
    contract/0,
    exercise/0,
    models/0,
    history/0,
    benchmark/0
]).

%% @doc See {@link starl_election_bully:config()}; `patience_ms' as in {@link starl_election}.
-spec options() -> [starl_options:option()].
options() ->
    [
        {answer_ms, {integer, 1, 1000000}, 500,
            "the wait for higher robots to answer that they are alive, ms"},
        {rounds, {integer, 1, 1000}, 4,
            "the number of challenges by a robot whose application does not wait"}
        | starl_election:options()
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) ->
    [{election, starl_election_bully, maps:with([answer_ms, rounds], Options)}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{patience_ms := Ms, answer_ms := Answer}, #{robots := Robots}) ->
    Bounds = #{bound_us => 1000 * Ms + 1000000, answer_us => 1000 * Answer},
    [{starl_election_bully_monitor, Bounds#{robots => Robots}}].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {once, safety, "a robot never reports two leaders for one term", []},
        {elected, progress, "nothing lost, bounded delay: all elect the highest robot alive", [
            no_loss, quick, {sap, delivered}
        ]}
    ].

-spec contract() -> string().
contract() -> "a robot never reports two leaders for one term".

-spec exercise() -> module().
exercise() -> starl_bully_exercise.

-spec history() -> module().
history() -> starl_bully_history.

-spec models() -> [starl_block:model_entry()].
models() -> [{bully, "election by the bully algorithm", fun model/1}].

%% A robot that has a leader keeps it.
model(#{robots := Ids, faults := Faults}) ->
    Lossless = lists:sum(maps:values(Faults)) =:= 0,
    Judge = #{robots => Ids, bound_us => 1, lossless => Lossless},
    #{
        blocks => machines(#{}),
        script => fun(_) -> [{call, election, {elect, first, 30000000}}] end,
        crash => [election, app],
        monitor => {starl_election_bully_monitor, Judge},
        fixed => lists:seq(1, length(Ids)),
        inert => fun
            (bully_leader, {_, _, majority}) -> true;
            (_, _) -> false
        end
    }.

-spec benchmark() -> starl_block:benchmark().
benchmark() ->
    #{
        workload => #{turns => 1},
        operations => elections,
        packets => fun(N) -> 2 * N * (N - 1) + 2 * N end,
        formula => "2 N (N - 1) + 2 N"
    }.
