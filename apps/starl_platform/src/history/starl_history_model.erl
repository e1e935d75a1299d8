%% @doc The behaviour of a model: the promise of a block to its callers, expressed only in calls and
%% answers ({@link starl_history}). It is written from the block's page, not from its machine.
%%
%% A model judges the calls of one object, such as a token, by themselves. If it can explain some
%% calls, it must also explain each beginning of them, with the calls that were under way then as
%% unknown. The shortest beginning without an explanation is found by halving.
-module(starl_history_model).

-export_type([judge/0, judgement/0]).

%% The most states of a search; when stores were damaged or set back; when clocks were; whose application
%% stood still within a step, and told afterwards; how far two clocks differ at most: calls are longer by it already.
-type judge() :: #{
    states := pos_integer(),
    marks := [starl_history:mark()],
    clocks => [{FromUs :: integer(), ToUs :: integer()}],
    stills => [{starl:robot_id(), FromUs :: integer(), ToUs :: integer()}],
    sigma_us => non_neg_integer()
}.

%% With what it is, or is not: "linearizable".
-type judgement() ::
    {explained, What :: unicode:chardata()} | {unexplained, What :: unicode:chardata()} | undecided.

%% The machine that is called.
-callback machine() -> starl_machine:name().
%% The monitor whose contract the model stands for: a run with this contract is judged by the model, with
%% the monitor's configuration.
-callback contract() -> module().
%% The calls of each object.
-callback objects([starl_history:call()], Config :: map()) ->
    [{Object :: term(), [starl_history:call()]}].
%% Can the answers of an object's calls be explained?
-callback judge([starl_history:call()], Config :: map(), judge()) -> judgement().
