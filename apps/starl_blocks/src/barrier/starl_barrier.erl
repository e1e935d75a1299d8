%% @doc The interface of barriers: robots wait for each other.
%%
%% A barrier has a name, any small term, and as many rounds as are needed. A robot's K-th
%% {@link sync/2} with a name is its round K. All robots of the team take part.
%%
%% Rounds belong to the robot, not to its application. After a crash of the application or the
%% robot, the application goes on with the first round that the robot has not passed.
%% {@link round/2} returns the number of that round.
%%
%% Guarantee: no robot passes round K of a name before all robots have reached it. When messages get
%% through, all pass within a short time of each other. Memory grows with the number of names, not
%% with the number of rounds: use few names.
-module(starl_barrier).
-behaviour(starl_block).

-export([
    options/0,
    machines/1,
    monitors/2,
    guarantees/0,
    propositions/0,
    contract/0,
    exercise/0,
    models/0,
    benchmark/0
]).
-export([sync/2, sync/3, round/2, round/3]).

-export_type([name/0, round/0]).

-define(PATIENCE_MS, 30000).

-type name() :: term().

%% Counts the rounds of a name, from 1.
-type round() :: pos_integer().

%% @doc Returns the round that the next `sync' with this name is for; waits for at most 30 s. In the
%% robot's first life the answer comes at once. In a later life, or if the robot's store is damaged,
%% it comes when all others have answered.
-spec round(starl:robot(), name()) -> {ok, round()} | {error, full | timeout | restarted}.
round(Robot, Name) -> round(Robot, Name, ?PATIENCE_MS).

%% @doc The same with a timeout in milliseconds.
-spec round(starl:robot(), name(), Ms :: pos_integer()) ->
    {ok, round()} | {error, full | timeout | restarted}.
round(Robot, Name, Ms) ->
    ok = starl_caller:payload({?MODULE, round, 3}, 'Name', label, Name),
    ok = starl_caller:check({?MODULE, round, 3}, 'Ms', positive_ms, Ms),
    case progress(Robot, Name, Ms) of
        {ok, {Round, _All}} -> {ok, Round};
        {error, _} = Error -> Error
    end.

progress(Robot, Name, Ms) ->
    case starl:call(Robot, barrier, {round, Name}, Ms) of
        {ok, {error, full}} -> {error, full};
        Answer -> Answer
    end.

%% @doc Waits until all robots have reached this round, for at most 30 s. `full': the robot already
%% uses as many other names as it may.
-spec sync(starl:robot(), name()) -> ok | {error, full | timeout | restarted}.
sync(Robot, Name) -> sync(Robot, Name, ?PATIENCE_MS).

%% @doc Waits until all robots have reached this round, for at most `Ms' milliseconds. A robot that
%% failed may call again. It has still reached the round and waits for the same one, even if its
%% barrier machine has crashed meanwhile (`restarted').
-spec sync(starl:robot(), name(), Ms :: pos_integer()) ->
    ok | {error, full | timeout | restarted}.
sync(Robot, Name, Ms) ->
    ok = starl_caller:payload({?MODULE, sync, 3}, 'Name', label, Name),
    ok = starl_caller:check({?MODULE, sync, 3}, 'Ms', positive_ms, Ms),
    %% Two calls, so that the robot's progress is known here if the machine crashes. The timeout is
    %% that of both.
    Until = starl:now(Robot) + Ms,
    case progress(Robot, Name, Ms) of
        {ok, Progress} -> pass(Robot, Name, Progress, max(0, Until - starl:now(Robot)));
        {error, _} = Error -> Error
    end.

pass(Robot, Name, Progress, Ms) ->
    case starl:call(Robot, barrier, {sync, Name, Progress, Ms * 1000}, infinity) of
        {ok, Answer} ->
            Answer;
        {error, restarted} ->
            ok = remind(Robot, Name, Progress),
            {error, restarted}
    end.

%% Gives the new machine the round that was not passed, and what was known then.
remind(Robot, Name, Progress) ->
    case starl:call(Robot, barrier, {resume, Name, Progress}, infinity) of
        {ok, ok} -> ok;
        {error, restarted} -> remind(Robot, Name, Progress)
    end.

%% -- the block ------------------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() ->
    [
        {retry_ms, {integer, 1, 1000000000}, 3000,
            "a robot that waits asks those that it misses after this, ms"},
        {names, {integer, 1, 1000000}, 256, "the most names that a robot uses"}
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) -> [{barrier, starl_barrier_rounds, Options}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{retry_ms := Retry}, #{robots := Robots}) ->
    [{starl_barrier_monitor, #{robots => Robots, retry_us => 1000 * Retry}}].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {together, safety, "no robot passes a round before all have reached it", []},
        {once, safety,
            "each robot passes every round once, over reboots too, if stores keep what they took", [
                store
            ]},
        {passed, progress, "all pass, within δ of each other: a message and its acknowledgement", [
            alive, {sap, delivered}
        ]}
    ].

-spec propositions() -> [starl_guarantee:proposition()].
propositions() ->
    [
        {"Proposition 3", together, [passed_early]},
        {"Proposition 3, δ", passed, [late_pass]}
    ].

-spec contract() -> string().
contract() -> "nobody passes a round before all have reached it".

-spec exercise() -> module().
exercise() -> starl_barrier_exercise.

-spec models() -> [starl_block:model_entry()].
models() ->
    New = fun(Team) -> starl_barrier_model:new(machines(#{}), Team) end,
    [{barrier, "barrier, two rounds", New}].

-spec benchmark() -> starl_block:benchmark().
benchmark() ->
    #{
        workload => #{turns => 5},
        operations => rounds,
        packets => fun(N) -> N * N end,
        formula => "N^2"
    }.
