%% @doc What holds in a cluster because hands, or chaos, have done it: cut links, frozen positions,
%% pulled cables. A pure module.
-module(starl_cluster_hands).

-export([new/0, robots/1, done/2, cuts/1, deaf/2, frozen/1, unplugged/1]).

-export_type([t/0, act/0]).

%% An act on robots by number ({@link starl_cluster_chaos:act()}).
-type act() ::
    {kill | freeze | thaw | unplug | unplug_in_time | plug, starl:robot_id()}
    | {cut | mend, starl:robot_id(), starl:robot_id()}.

-record(hands, {
    %% both directions of each link
    cuts = [] :: [{starl:robot_id(), starl:robot_id()}],
    frozen = [] :: [starl:robot_id()],
    unplugged = [] :: [starl:robot_id()]
}).

-opaque t() :: #hands{}.

%% @doc Nothing holds.
-spec new() -> t().
new() -> #hands{}.

%% @doc The robots of an act.
-spec robots(act()) -> [starl:robot_id(), ...].
robots({_What, Robot}) -> [Robot];
robots({_What, A, B}) -> [A, B].

%% @doc What holds after an act. A kill holds nothing: the node is started anew.
-spec done(act(), t()) -> t().
done({kill, _}, Hands) ->
    Hands;
done({cut, A, B}, #hands{cuts = Cuts} = Hands) ->
    Hands#hands{cuts = lists:usort(both(A, B) ++ Cuts)};
done({mend, A, B}, #hands{cuts = Cuts} = Hands) ->
    Hands#hands{cuts = Cuts -- both(A, B)};
done({freeze, R}, #hands{frozen = Frozen} = Hands) ->
    Hands#hands{frozen = with(R, Frozen)};
done({thaw, R}, #hands{frozen = Frozen} = Hands) ->
    Hands#hands{frozen = lists:delete(R, Frozen)};
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

%% @doc The robots whose cables are out.
-spec unplugged(t()) -> [starl:robot_id()].
unplugged(#hands{unplugged = Unplugged}) -> Unplugged.
