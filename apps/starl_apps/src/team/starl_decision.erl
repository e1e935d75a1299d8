%% @doc Makes one decision for a whole team. An elected leader decides and puts the decision into a
%% register that all share. It stores the decision before it publishes it, so that it makes no other
%% decision after a restart. A robot that takes part in the election after a restart, perhaps alone,
%% also looks for the decision.
%% ```
%%   leader                                       others
%%      |--- elect ------------------------------->|
%%      |    decide, store
%%      |--- register := decision ---------------->|  each reads its copy
%% '''
%% An elected robot looks once more before it decides, because it may have decided before. If its
%% store is damaged, it looks for a while. Two robots may decide all the same, when the store of the
%% first is damaged or lost and no other robot is heard meanwhile. Then the later decision counts,
%% and a robot that waits in vain for the others asks for it ({@link latest/3}).
%%
%% For applications. The blocks are `starl_election' and `starl_registers'. The application's store
%% holds the decision, and nothing else.
-module(starl_decision).

-export([await/3, latest/3]).

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
        {ok, New} ->
            case made(Robot, Names, again_ms(Robot)) of
                {ok, Decision} ->
                    Decision;
                none ->
                    ok = starl:store(Robot, New),
                    tell(Robot, Names, New)
            end
    end.

%% A robot whose store is damaged may have forgotten that it decided, and the others know it.
again_ms(Robot) ->
    case starl:stored(Robot) of
        damaged -> ?PATIENCE_MS;
        none -> 0
    end.

%% Is a decision seen within so many milliseconds?
made(Robot, {_, Register} = Names, Ms) ->
    case starl_registers:get(Robot, Register) of
        {ok, Decision} ->
            {ok, Decision};
        {error, _} when Ms > 0 ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            made(Robot, Names, Ms - ?LOOK_MS);
        {error, _} ->
            none
    end.

%% @doc The decision that counts now, where the robot knows one that was made.
-spec latest(starl:robot(), names(), Known :: Decision) -> Decision.
latest(Robot, Names, Known) ->
    case made(Robot, Names, 0) of
        {ok, Decision} -> Decision;
        none -> Known
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
