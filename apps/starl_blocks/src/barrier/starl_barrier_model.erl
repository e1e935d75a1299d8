%% @doc The model of the barrier for the exhaustive checker: all robots pass some rounds of one
%% barrier. When the barrier machine restarts, a waiting application sends it the round that it
%% waits for, as {@link starl_barrier} does.
-module(starl_barrier_model).
-behaviour(starl_block_talk).

-export([new/2]).
-export([first/1, answered/3, restarted/2]).

-type place_in_rounds() :: {starl_barrier:name(), Last :: pos_integer()}.
-type mark() :: round | {sync | resume, starl_barrier_gate:progress()}.

%% A patience so long that the checker decides when a call fails.
-define(PATIENCE_US, 30000000).

%% @doc The model for a team with these machines.
-spec new([starl_robot_sup:machine()], starl_block:team()) -> starl_block:model().
new(Machines, #{robots := Ids, rounds := Rounds}) ->
    #{
        blocks => Machines,
        script => fun(_) -> [{talk, ?MODULE, {gate, Rounds}} || _ <- lists:seq(1, Rounds)] end,
        crash => [barrier, app],
        monitor => {starl_barrier_monitor, #{robots => Ids}},
        inert => fun is_inert/2
    }.

%% The counts of a barrier only grow.
is_inert(barrier, {reached, _, _, _, false}) -> true;
is_inert(barrier, {told, _, _, _}) -> true;
is_inert(_Type, _Body) -> false.

%% -- a round --------------------------------------------------------------------------------

%% @doc Asks which round it is.
-spec first(place_in_rounds()) -> starl_block_talk:call().
first({Name, _Last}) -> {barrier, {round, Name}, round}.

%% @doc Passes it, unless all are passed.
-spec answered(mark(), term(), place_in_rounds()) -> starl_block_talk:next().
answered(round, {Round, _All}, {_Name, Last}) when Round > Last -> over;
answered(round, Progress, {Name, _Last}) ->
    {call, {barrier, {sync, Name, Progress, ?PATIENCE_US}, {sync, Progress}}};
answered({resume, _}, ok, _Gate) ->
    again;
answered({sync, _}, {error, _}, _Gate) ->
    again;
answered({sync, _}, ok, _Gate) ->
    over.

%% @doc Tells the new machine which round was not passed.
-spec restarted(mark(), place_in_rounds()) -> starl_block_talk:next().
restarted({_, Progress}, {Name, _Last}) ->
    {call, {barrier, {resume, Name, Progress}, {resume, Progress}}};
restarted(round, _Gate) ->
    again.
