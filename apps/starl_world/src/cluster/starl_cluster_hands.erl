%% @doc What holds in a cluster because hands, or chaos, have done it: cut links, frozen positions,
%% full disks, pulled cables, stores that are lost or set back when their nodes start anew. A pure module.
-module(starl_cluster_hands).

-export([new/0, healed/1, robots/1, links/1, done/2, cuts/1, deaf/2, frozen/1, full/1]).
-export([unplugged/1, store/2, senses/1, senses/2]).

-export_type([t/0, act/0, fate/0]).

%% An act on robots by number ({@link starl_cluster_chaos:act()}).
-type act() ::
    {
        kill
        | lose_store
        | set_back
        | fill
        | clear
        | freeze
        | thaw
        | unplug
        | unplug_in_time
        | plug,
        starl:robot_id()
    }
    | {pause | pause_at_work, starl:robot_id(), Seconds :: number()}
    | {cut | mend, starl:robot_id(), starl:robot_id()}
    | {sense, starl:robot_id(), starl_sense:kind() | all, starl_live_sense_fault:fault() | well}.

%% What becomes of a robot's store before its node starts.
-type fate() :: kept | lost | set_back.

-record(hands, {
    %% both directions of each link
    cuts = [] :: [{starl:robot_id(), starl:robot_id()}],
    frozen = [] :: [starl:robot_id()],
    full = [] :: [starl:robot_id()],
    unplugged = [] :: [starl:robot_id()],
    senses = #{} :: #{
        {starl:robot_id(), starl_sense:kind() | all} => starl_live_sense_fault:fault()
    },
    stores = #{} :: #{starl:robot_id() => fate()}
}).

-opaque t() :: #hands{}.

%% @doc Nothing holds.
-spec new() -> t().
new() -> #hands{}.

%% @doc Nothing holds any more but what no heal brings back: stores.
-spec healed(t()) -> t().
healed(#hands{stores = Stores}) -> #hands{stores = Stores}.

%% @doc The robots of an act.
-spec robots(act()) -> [starl:robot_id(), ...].
robots({_What, Robot}) -> [Robot];
robots({Pause, Robot, _Seconds}) when Pause =:= pause; Pause =:= pause_at_work -> [Robot];
robots({sense, Robot, _Sense, _Fault}) -> [Robot];
robots({_What, A, B}) -> [A, B].

%% @doc The robots whose nodes have to be told of an act: they hear others than before, or sense otherwise.
-spec links(act()) -> [starl:robot_id()].
links({CutOrMend, A, B}) when CutOrMend =:= cut; CutOrMend =:= mend -> [A, B];
links({sense, Robot, _Sense, _Fault}) -> [Robot];
links(_Act) -> [].

%% @doc The faults of a robot's senses.
-spec senses(starl:robot_id(), t()) -> starl_live_sense_fault:faults().
senses(Robot, #hands{senses = Senses}) ->
    maps:from_list([{S, F} || {{R, S}, F} <- maps:to_list(Senses), R =:= Robot]).

%% @doc What holds after an act. A kill holds nothing: the node is started anew. Of a store that is lost
%% and set back at once nothing is left.
-spec done(act(), t()) -> t().
done({kill, _}, Hands) ->
    Hands;
done({lose_store, R}, #hands{stores = Stores} = Hands) ->
    Hands#hands{stores = Stores#{R => lost}};
done({set_back, R}, #hands{stores = Stores} = Hands) ->
    Hands#hands{stores = maps:merge(#{R => set_back}, Stores)};
done({sense, R, Sense, well}, #hands{senses = Senses} = Hands) ->
    Hands#hands{senses = maps:remove({R, Sense}, Senses)};
done({sense, R, Sense, Fault}, #hands{senses = Senses} = Hands) ->
    Hands#hands{senses = Senses#{{R, Sense} => Fault}};
done({cut, A, B}, #hands{cuts = Cuts} = Hands) ->
    Hands#hands{cuts = lists:usort(both(A, B) ++ Cuts)};
done({mend, A, B}, #hands{cuts = Cuts} = Hands) ->
    Hands#hands{cuts = Cuts -- both(A, B)};
done({freeze, R}, #hands{frozen = Frozen} = Hands) ->
    Hands#hands{frozen = with(R, Frozen)};
done({thaw, R}, #hands{frozen = Frozen} = Hands) ->
    Hands#hands{frozen = lists:delete(R, Frozen)};
done({fill, R}, #hands{full = Full} = Hands) ->
    Hands#hands{full = with(R, Full)};
done({clear, R}, #hands{full = Full} = Hands) ->
    Hands#hands{full = lists:delete(R, Full)};
done({plug, R}, #hands{unplugged = Out} = Hands) ->
    Hands#hands{unplugged = lists:delete(R, Out)};
done({_Unplug, R}, #hands{unplugged = Out} = Hands) ->
    Hands#hands{unplugged = with(R, Out)}.

both(A, B) -> [{A, B}, {B, A}].

with(Robot, Robots) -> lists:usort([Robot | Robots]).

%% @doc The links that are cut, in both directions.
-spec cuts(t()) -> [{starl:robot_id(), starl:robot_id()}].
cuts(#hands{cuts = Cuts}) -> Cuts.

%% @doc The robots that this one does not hear.
-spec deaf(starl:robot_id(), t()) -> [starl:robot_id()].
deaf(Robot, #hands{cuts = Cuts}) -> [Other || {R, Other} <- Cuts, R =:= Robot].

%% @doc The robots that get no new positions.
-spec frozen(t()) -> [starl:robot_id()].
frozen(#hands{frozen = Frozen}) -> Frozen.

%% @doc The robots whose disks are full.
-spec full(t()) -> [starl:robot_id()].
full(#hands{full = Full}) -> Full.

%% @doc The robots whose cables are out.
-spec unplugged(t()) -> [starl:robot_id()].
unplugged(#hands{unplugged = Unplugged}) -> Unplugged.

%% @doc The faults of all robots' senses.
-spec senses(t()) ->
    [{starl:robot_id(), starl_sense:kind() | all, starl_live_sense_fault:fault()}].
senses(#hands{senses = Senses}) -> [{R, S, F} || {{R, S}, F} <- lists:sort(maps:to_list(Senses))].

%% @doc What becomes of the store of a robot whose node starts now; what holds then.
-spec store(starl:robot_id(), t()) -> {fate(), t()}.
store(Robot, #hands{stores = Stores} = Hands) ->
    {maps:get(Robot, Stores, kept), Hands#hands{stores = maps:remove(Robot, Stores)}}.
