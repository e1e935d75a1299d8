%% @doc Tracks what robots may have forgotten of the rounds that they have reached. A machine that
%% crashes forgets the others' counts, and a store can be damaged or set back. A pure part of
%% {@link starl_barrier_monitor}, which decides with which round such a robot may go on.
-module(starl_barrier_monitor_memory).

-export([new/0, crashed/3, damaged/3, set_back/3, reached/2, passed/2]).
-export([doubt/3, may_be_next/4, is_unsound/2, damages/1]).

-export_type([t/0, key/0, doubt/0]).

%% A robot's rounds of a name.
-type key() :: {Name :: term(), starl:robot_id()}.

%% The damage since a round was reached: another robot may have forgotten its count of this one; or
%% had so when the round was reached, and need not know of it before it is passed; or this one's
%% store is damaged, and the other may have forgotten, too; or all stores are damaged.
-type damage() :: forgotten | untold | damaged | damaged_and_forgotten | lost.

%% Nothing; a damage; or nobody knows anything more of a robot that was set back, which then goes on
%% from this round at the earliest.
-type doubt() :: none | damage() | {from, non_neg_integer()}.

-record(memory, {
    %% what has happened since the last round was reached
    doubts = #{} :: #{key() => damage()},
    %% the robots whose stores were damaged, or set back, since they have passed a round
    unsound = #{} :: #{key() => damaged | set_back},
    %% who may know nothing of its last rounds, since its machine has crashed meanwhile
    ignorant = #{} :: #{key() => #{starl:robot_id() => forgotten | untold}}
}).

-opaque t() :: #memory{}.

%% @doc Nothing is forgotten.
-spec new() -> t().
new() -> #memory{}.

%% @doc A machine that crashed has forgotten the others' counts. The keys are those of all rounds reached.
-spec crashed(starl:robot_id(), [key()], t()) -> t().
crashed(Robot, Keys, #memory{ignorant = Ignorant} = Memory) ->
    Others = [Key || {_, R} = Key <- Keys, R =/= Robot],
    Forgot = [{K, (maps:get(K, Ignorant, #{}))#{Robot => forgotten}} || K <- Others],
    Next = Memory#memory{ignorant = maps:merge(Ignorant, maps:from_list(Forgot))},
    grown(Others, fun forgotten/1, Next).

%% @doc A machine has started with a damaged store.
-spec damaged(starl:robot_id(), [key()], t()) -> t().
damaged(Robot, Keys, Memory) -> unsound(damaged, Robot, Keys, Memory).

%% @doc A robot's store was set back: it gives a round back as reached and not passed, if nobody knows of a
%% later life.
-spec set_back(starl:robot_id(), [key()], t()) -> t().
set_back(Robot, Keys, Memory) ->
    grown(own(Robot, Keys), fun forgotten/1, unsound(set_back, Robot, Keys, Memory)).

own(Robot, Keys) -> [Key || {_, R} = Key <- Keys, R =:= Robot].

unsound(How, Robot, Keys, Memory) ->
    Own = own(Robot, Keys),
    #memory{doubts = Doubts, unsound = Before} = Damaged = grown(Own, fun damaged/1, Memory),
    Unsound = maps:merge_with(fun worse/3, Before, maps:from_keys(Own, How)),
    Sound = [Key || Key <- Keys, not is_map_key(Key, Unsound)],
    Lost = [Key || {Name, _} = Key <- maps:keys(Unsound), not lists:keymember(Name, 1, Sound)],
    Damaged#memory{doubts = maps:merge(Doubts, maps:from_keys(Lost, lost)), unsound = Unsound}.

worse(_Key, damaged, How) -> How;
worse(_Key, set_back, _How) -> set_back.

grown(Keys, Grow, #memory{doubts = Doubts} = Memory) ->
    Grown = maps:from_list([{Key, Grow(maps:get(Key, Doubts, none))} || Key <- Keys]),
    Memory#memory{doubts = maps:merge(Doubts, Grown)}.

forgotten(Doubt) when Doubt =:= none; Doubt =:= forgotten; Doubt =:= untold -> forgotten;
forgotten(lost) -> lost;
forgotten(_Damaged) -> damaged_and_forgotten.

damaged(none) -> damaged;
damaged(Doubt) when Doubt =:= forgotten; Doubt =:= untold -> damaged_and_forgotten;
damaged(Damaged) -> Damaged.

%% @doc A robot has reached a round. One that has forgotten the last round need not have heard of the one
%% that is reached now.
-spec reached(key(), t()) -> t().
reached(Key, Memory) -> learn(Key, fun reached_with/1, Memory).

reached_with(none) -> none;
reached_with(damaged) -> none;
reached_with(_Forgotten) -> untold.

%% @doc A robot has passed a round, as it does when all others have heard that it has reached it.
-spec passed(key(), t()) -> t().
passed(Key, #memory{unsound = Unsound} = Memory) ->
    learn(Key, fun passed_with/1, Memory#memory{unsound = maps:remove(Key, Unsound)}).

passed_with(untold) -> none;
passed_with(Doubt) -> Doubt.

learn(Key, Change, #memory{doubts = Doubts, ignorant = Ignorant} = Memory) ->
    Others = maps:get(Key, Ignorant, #{}),
    Left = maps:from_list([
        {Robot, Still}
     || {Robot, Doubt} <- maps:to_list(Others), Still <- [Change(Doubt)], Still =/= none
    ]),
    Memory#memory{
        doubts = changed(Key, Change(maps:get(Key, Doubts, none)), Doubts),
        ignorant = Ignorant#{Key => Left}
    }.

changed(Key, none, Doubts) -> maps:remove(Key, Doubts);
changed(Key, Doubt, Doubts) -> Doubts#{Key => Doubt}.

%% @doc What is forgotten of a robot's last round; with the last rounds of the name that the others have
%% passed. A robot that was set back, of which no other one knows anything more, is where its store says;
%% but who has passed a round has stored that all have reached it.
-spec doubt(key(), Others :: [{starl:robot_id(), Passed :: non_neg_integer()}], t()) ->
    doubt().
doubt(Key, Others, #memory{doubts = Doubts, unsound = Unsound, ignorant = Ignorant}) ->
    Doubt = maps:get(Key, Doubts, none),
    Knowing = [R || {R, _} <- Others, not is_map_key(R, maps:get(Key, Ignorant, #{}))],
    case maps:get(Key, Unsound, none) =:= set_back andalso Knowing =:= [] of
        true when Doubt =/= lost -> {from, lists:max([0 | [Passed || {_, Passed} <- Others]])};
        _ -> Doubt
    end.

%% @doc With this doubt, may the next round be this one, after the last passed and the last reached?
-spec may_be_next(doubt(), K, Last :: K, Reached :: K) -> boolean() when K :: non_neg_integer().
may_be_next(lost, K, _Last, Reached) -> K =< Reached + 1;
may_be_next({from, First}, K, _Last, Reached) -> K >= First andalso K =< Reached + 1;
may_be_next(damaged_and_forgotten, K, Last, Reached) -> K >= Last andalso K =< Reached + 1;
may_be_next(damaged, K, Last, Reached) -> K > Last andalso K =< Reached + 1;
may_be_next(_Sound, _K, _Last, _Reached) -> false.

%% @doc Was the robot's store damaged, or set back, since it has passed a round?
-spec is_unsound(key(), t()) -> boolean().
is_unsound(Key, #memory{unsound = Unsound}) -> is_map_key(Key, Unsound).

%% @doc The damages, without what others have forgotten.
-spec damages(t()) -> #{key() => damage()}.
damages(#memory{doubts = Doubts}) ->
    maps:filter(fun(_Key, Doubt) -> not lists:member(Doubt, [forgotten, untold]) end, Doubts).
