%% @doc Manual faults: faults of a schedule ({@link starl_run_fault}) that begin now. Pages,
%% commands, chaos and schedules all use this form. A run in real time cannot play every kind: the
%% table of the kinds says which.
%% ```
%%   {reboot, 3, #{}, 0}                              cluster kill 3
%%   {location_frozen, 4, #{}, lasting}               cluster freeze 4
%%   {loss, {1, 2}, #{part => 1.0}, 10000}            half of a cut, for ten seconds
%% '''
-module(starl_run_manual_fault).

-export([kinds/1, refused/2, cut/3, fault/3, robots/1]).

-export_type([t/0, world/0, heal/0]).

%% A kind with its target and its parameters, and its length: some milliseconds of the run (of a pause: of
%% the computer), or until it is healed.
-type t() :: {
    starl_run_fault:kind(), starl_run_fault:target(), map(), LastsMs :: non_neg_integer() | lasting
}.

%% Where a run is: in the simulator; or in real time, with all robots in one VM or each on a node.
-type world() :: simulation | one_vm | nodes.

%% The faults to heal: all, one by its name, those of a kind with this target, those of a robot's sense.
-type heal() ::
    all
    | {fault, atom()}
    | {starl_run_fault:kind(), starl_run_fault:target()}
    | {sense, starl:robot_id(), starl_sense:kind() | all}.

%% @doc The kinds of manual faults in a world. In the simulator there are none of clocks, because running
%% timers were set by them.
-spec kinds(world()) -> [starl_run_fault:spec()].
kinds(simulation) ->
    [Spec || {_, Class, _, _, _} = Spec <- starl_run_fault:kinds(), Class =/= clock];
kinds(World) ->
    [Spec || Spec <- starl_run_fault:kinds(), is_played(element(1, Spec), World)].

is_played(Kind, World) ->
    case starl_run_fault_kinds:played(Kind) of
        live -> true;
        nodes -> World =:= nodes;
        simulated -> false
    end.

%% @doc A line for each fault of a schedule that a run in real time cannot play: which kind, and what can.
-spec refused(one_vm | nodes, [starl_run_fault:t()]) -> [unicode:chardata()].
refused(World, Faults) ->
    [
        io_lib:format("fault ~ts: ~ts ~ts", [Id, Kind, instead(World, Kind)])
     || {Id, _, _, Kind, _, _} <- Faults, not is_played(Kind, World)
    ].

instead(one_vm, Kind) ->
    case is_played(Kind, nodes) of
        true -> "needs a node for each robot: take ./starl cluster";
        false -> instead(nodes, Kind)
    end;
instead(nodes, _Kind) ->
    "cannot be played in real time: take the simulator, ./starl run without --live".

%% @doc Two robots do not hear each other.
-spec cut(starl:robot_id(), starl:robot_id(), LastsMs :: non_neg_integer() | lasting) -> [t()].
cut(A, B, Lasts) -> [{loss, Link, #{part => 1.0}, Lasts} || Link <- [{A, B}, {B, A}]].

%% @doc The scheduled fault for a manual fault that is applied now; if it has no end, it lasts until
%% that time.
-spec fault(Id :: atom(), {NowMs, UntilMs}, t()) -> starl_run_fault:t() when
    NowMs :: non_neg_integer(), UntilMs :: non_neg_integer() | forever.
fault(Id, {Now, Until}, {Kind, Target, Params, lasting}) ->
    {Id, Now, Until, Kind, Target, Params};
fault(Id, {Now, _Until}, {Kind, Target, Params, Ms}) ->
    {Id, Now, Now + Ms, Kind, Target, Params}.

%% @doc The robots that a manual fault names.
-spec robots(t()) -> [starl:robot_id()].
robots(Fault) -> starl_run_fault:targets(fault(manual, {0, 0}, Fault)).
