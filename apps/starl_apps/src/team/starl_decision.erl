%% @doc A decision of a team, made once: an elected leader decides, keeps it in its store before it tells it, so
%% that in a later life it makes no other one, and puts it into a register that all share. Who takes part in the
%% election after a restart, perhaps alone, looks for the decision meanwhile.
%% ```
%%   leader                                       others
%%      |--- elect ------------------------------->|
%%      |    decide, store
%%      |--- register := decision ---------------->|  each reads its copy
%% '''
%% For applications. The blocks are `starl_election' and `starl_registers'; the application's store holds the
%% decision, and nothing else. Two robots may decide when the store of the first is damaged.
-module(starl_decision).

-export([await/3]).

-export_type([names/0]).

%% Of the election and of the register.
-type names() :: {Election :: term(), Register :: atom()}.

-define(PATIENCE_MS, 10000).
-define(LOOK_MS, 250).

%% @doc The decision; waits for it. The function decides, or knows too little as yet.
-spec await(starl:robot(), names(), fun(() -> {ok, Decision} | unknown)) -> Decision.
await(Robot, Names, Decide) ->
    case starl:stored(Robot) of
        {stored, Decision} -> tell(Robot, Names, Decision);
        _NoneOrDamaged -> elect(Robot, Names, Decide)
    end.

elect(Robot, {Election, Register} = Names, Decide) ->
    case starl_registers:get(Robot, Register) of
        {ok, Decision} ->
            Decision;
        {error, _} ->
            elected(starl_election:elect(Robot, Election, ?PATIENCE_MS), Robot, Names, Decide)
    end.

elected({error, _}, Robot, Names, Decide) ->
    elect(Robot, Names, Decide);
elected({ok, Leader}, Robot, Names, Decide) ->
    case Leader =:= starl:id(Robot) andalso Decide() of
        false ->
            look(Robot, Names);
        unknown ->
            elect(Robot, Names, Decide);
        {ok, Decision} ->
            ok = starl:store(Robot, Decision),
            tell(Robot, Names, Decision)
    end.

tell(Robot, {_, Register} = Names, Decision) ->
    case starl_registers:put(Robot, Register, Decision) of
        ok ->
            Decision;
        %% most others take no writes of this robot, whose clock is wrong
        {error, refused} ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            tell(Robot, Names, Decision);
        {error, _} ->
            tell(Robot, Names, Decision)
    end.

look(Robot, {_, Register} = Names) ->
    case starl_registers:get(Robot, Register) of
        {ok, Decision} ->
            Decision;
        {error, _} ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            look(Robot, Names)
    end.
