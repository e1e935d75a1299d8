%% @doc The faults of a cluster: scheduled, random (chaos) and manual ones
%% ({@link starl_world_injection}), nodes that are halted ({@link starl_cluster_halts}), and nodes
%% that hang by themselves. It reports each fault to the world. Work that needs an answer from a
%% node, or a new node, is returned to the cluster as a list of wants.
-module(starl_cluster_faults).

-export([new/2, planned/4, most_halted_ms/0]).
-export([act/3, halt_at_work/5, heal/3, hear/3]).
-export([silent/3, lost/2, all_go_on/1, stop/1]).
-export([starts/3, up/2, may_start/2, disk/2, changes/2, world/1]).

-export_type([t/0, want/0]).

%% What the cluster is to do: end a node, or start it, if it may; know a robot as dead; watch its node
%% anew; tell its node what it hears and senses now; end one of its machines.
-type want() ::
    {kill | start | dead | watch | tell, starl:robot_id()}
    | {machine, starl:robot_id(), starl_machine:name()}.

-record(faults, {
    injection :: starl_world_injection:t(),
    halts = starl_cluster_halts:new() :: starl_cluster_halts:t(),
    %% the robots whose nodes stand still, and nobody has halted them
    hanging = [] :: [starl:robot_id()]
}).

-opaque t() :: #faults{}.

%% What has been done so far, and whether all of it could be.
-type doing() :: {ok | {error, unicode:chardata()}, [want()], t()}.

%% Less than three quarters of the time (60 s) after which Erlang's distribution gives up a silent node.
-define(MOST_HALTED_S, 30).

%% @doc The longest that a node can be halted, by the computer's clock.
-spec most_halted_ms() -> pos_integer().
most_halted_ms() -> 1000 * ?MOST_HALTED_S.

%% @doc No fault has begun.
-spec new([starl:robot_id()], starl_world_injection:run()) -> t().
new(Robots, Run) -> #faults{injection = starl_world_injection:new(Robots, Run)}.

%% @doc The faults of a schedule, and what chaos does, come as messages in their time, `{chaos, Hand}' and as
%% of {@link starl_world_injection}. What holds from the beginning on begins here: nodes hear of it with their
%% robot.
-spec planned(
    [starl_run_fault:t()],
    [{AtUs :: integer(), starl_run_hand:t()}],
    starl_cluster_nodes:t(),
    t()
) -> t().
planned(Schedule, Chaos, Nodes, #faults{injection = Injection} = Faults) ->
    ok = lists:foreach(
        fun({Us, Hand}) -> starl_world_injection:at(Us div 1000, {chaos, Hand}, Injection) end,
        Chaos
    ),
    lists:foldl(
        fun(Fault, Before) ->
            {_, Begun} = played(Fault, Nodes, Before),
            Begun
        end,
        Faults,
        starl_world_injection:planned(Schedule, Injection)
    ).

%% @doc The world of the run.
-spec world(t()) -> pid().
world(#faults{injection = Injection}) -> starl_world_injection:world(Injection).

%% -- hands, chaos and the schedule ----------------------------------------------------------

%% @doc Applies manual faults now. All are of the same kind and for the same robots. If one cannot
%% be applied, the first such problem is the answer.
-spec act([starl_run_hand:t()], starl_cluster_nodes:t(), t()) -> doing().
act(Hands, Nodes, #faults{injection = Injection} = Faults) ->
    acted(Hands, Nodes, {starl_world_injection:check(Hands, Injection), [], Faults}).

acted([Hand | More], Nodes, {ok, Wants, #faults{injection = Injection} = Faults}) ->
    {Fault, Named} = starl_world_injection:hand(Hand, Injection),
    {Answer, Own, Next} = attempted(Fault, Nodes, Faults#faults{injection = Named}),
    acted(More, Nodes, {Answer, Wants ++ Own, Next});
acted(_DoneOrRefused, _Nodes, Doing) ->
    Doing.

attempted(Fault, Nodes, Faults) ->
    case can(Fault, Nodes, Faults) of
        ok -> begun(Fault, Nodes, Faults);
        {error, _} = Error -> {Error, [], Faults}
    end.

%% @doc Halts the node of a robot for a time of the computer, in the middle of its work; the caller waits
%% until it goes on.
-spec halt_at_work(
    starl:robot_id(), Seconds :: number(), gen_server:from(), starl_cluster_nodes:t(), t()
) ->
    {ok, t()} | {error, unicode:chardata()}.
halt_at_work(Robot, Seconds, From, Nodes, Faults) ->
    case act([{pause, Robot, #{at_work => true}, round(1000 * Seconds)}], Nodes, Faults) of
        {ok, [], #faults{halts = Halts} = Next} ->
            {ok, Next#faults{halts = starl_cluster_halts:wait(Robot, From, Halts)}};
        {{error, _} = Error, [], _Faults} ->
            Error
    end.

%% @doc What a message of this module's wants, if it is one: chaos, the time at which a fault begins or is
%% over, news of a halt.
-spec hear(Message :: term(), starl_cluster_nodes:t(), t()) -> {[want()], t()} | unknown.
hear({chaos, Hand}, Nodes, Faults) ->
    chaos(Hand, Nodes, Faults);
hear({begins, Fault}, Nodes, Faults) ->
    begins(Fault, Nodes, Faults);
hear({over, Id}, Nodes, Faults) ->
    over(Id, Nodes, Faults);
hear(Message, _Nodes, #faults{halts = Halts} = Faults) ->
    case starl_cluster_halts:hear(Message, Halts) of
        {Told, Next} -> told([Told], Faults#faults{halts = Next});
        unknown -> unknown
    end.

chaos(Hand, Nodes, Faults) ->
    #{leader := Leader} = starl_world:status(world(Faults)),
    case starl_cluster_chaos:aimed(Hand, Leader) of
        none -> {[], Faults};
        Aimed -> chaos_at(Aimed, Nodes, Faults)
    end.

chaos_at(Aimed, Nodes, Faults) ->
    logger:notice(#{what => chaos, act => Aimed}),
    {_, Wants, Next} = act([Aimed], Nodes, Faults),
    {Wants, Next}.

%% A node that is down is not there to be halted, but may well stay down for longer.
begins(Fault, Nodes, Faults) ->
    case {element(4, Fault), can(Fault, Nodes, Faults)} of
        {Kind, {error, Why}} when Kind =:= pause; Kind =:= store_full ->
            ok = starl_world_injection:not_played(Fault, Why),
            {[], Faults};
        _ ->
            played(Fault, Nodes, Faults)
    end.

played(Fault, Nodes, Faults) ->
    {Answer, Wants, Next} = begun(Fault, Nodes, Faults),
    _ = [starl_world_injection:not_played(Fault, Why) || {error, Why} <- [Answer]],
    {Wants, Next}.

begun(Fault, Nodes, #faults{injection = Injection} = Faults) ->
    case starl_world_injection:begins(Fault, Injection) of
        {ok, Effects, Next} ->
            completed(Fault, Nodes, effects(Effects, Nodes, Faults#faults{injection = Next}));
        {error, _} = Error ->
            {Error, [], Faults}
    end.

%% A fault that could not be done is over: the world was told that it has begun.
completed(_Fault, _Nodes, {ok, _, _} = Done) ->
    Done;
completed(Fault, Nodes, {{error, _} = Error, Wants, Faults}) ->
    {Own, Over} = over(element(1, Fault), Nodes, Faults),
    {Error, Wants ++ Own, Over}.

over(Id, Nodes, #faults{injection = Injection} = Faults) ->
    {Effects, Next} = starl_world_injection:over(Id, Injection),
    {_, Wants, Last} = effects(Effects, Nodes, Faults#faults{injection = Next}),
    {Wants, Last}.

%% @doc Ends these faults now.
-spec heal(starl_run_hand:heal(), starl_cluster_nodes:t(), t()) -> {[want()], t()}.
heal(all, Nodes, Faults) ->
    {Watched, GoneOn} = all_go_on(Faults),
    {Wants, Healed} = healed(all, Nodes, GoneOn),
    {Watched ++ Wants ++ [{tell, Id} || Id <- starl_cluster_nodes:ids(Nodes)], Healed};
heal(What, Nodes, Faults) ->
    healed(What, Nodes, Faults).

healed(What, Nodes, #faults{injection = Injection} = Faults) ->
    lists:foldl(
        fun(Id, {Wants, Before}) ->
            {Own, Next} = over(Id, Nodes, Before),
            {Wants ++ Own, Next}
        end,
        {[], Faults},
        starl_world_injection:healable(What, Injection)
    ).

%% -- what leads to nothing ------------------------------------------------------------------

can({_, From, To, pause, Robot, _}, Nodes, #faults{injection = Injection} = Faults) ->
    can_halt(Robot, starl_world_injection:real_ms(To - From, Injection), Nodes, Faults);
can({_, _, _, Kind, Robot, _}, Nodes, _Faults) when
    Kind =:= reboot; Kind =:= kill_robot; Kind =:= store_lost; Kind =:= store_set_back
->
    case starl_cluster_nodes:name(Robot, Nodes) of
        none -> {error, io_lib:format("the node of robot ~b is down already", [Robot])};
        _ -> ok
    end;
can({_, _, _, store_full, _, _}, _Nodes, _Faults) ->
    starl_cluster_quota:is_possible();
can(_Fault, _Nodes, _Faults) ->
    ok.

can_halt(_Robot, Ms, _Nodes, _Faults) when Ms < 1; Ms > 1000 * ?MOST_HALTED_S ->
    {error, io_lib:format("a node can be halted for 0.001 to ~b s", [?MOST_HALTED_S])};
can_halt(Robot, _Ms, Nodes, #faults{halts = Halts}) ->
    case {starl_cluster_halts:is_halted(Robot, Halts), starl_cluster_nodes:os_pids(Nodes)} of
        {true, _} -> {error, io_lib:format("the node of robot ~b stands still already", [Robot])};
        {false, #{Robot := _}} -> ok;
        {false, #{}} -> {error, io_lib:format("the node of robot ~b is down", [Robot])}
    end.

%% -- effects --------------------------------------------------------------------------------

effects(Effects, Nodes, Faults) ->
    lists:foldl(fun(Effect, Doing) -> does(Effect, Nodes, Doing) end, {ok, [], Faults}, Effects).

-spec does(starl_world_injection:effect(), starl_cluster_nodes:t(), doing()) -> doing().
does({halt, Robot, Ms, Moment, Fault}, Nodes, {Answer, Wants, Faults}) ->
    #{Robot := OsPid} = starl_cluster_nodes:os_pids(Nodes),
    {Answer, Wants, halt(Robot, OsPid, Ms, {Moment, Fault}, Faults)};
does({tell, Robots}, _Nodes, {Answer, Wants, Faults}) ->
    {Answer, Wants ++ [{tell, Robot} || Robot <- Robots], Faults};
does({Change, Robot}, Nodes, {Answer, Wants, Faults}) when Change =:= fill; Change =:= clear ->
    {lists:max([Answer, starl_cluster_nodes:disk(Change, Robot, Nodes)]), Wants, Faults};
does(Want, _Nodes, {Answer, Wants, Faults}) ->
    {Answer, Wants ++ [Want], Faults}.

%% -- nodes that stand still -----------------------------------------------------------------

halt(Robot, OsPid, Ms, {Moment, Fault}, #faults{injection = Injection, halts = Halts} = Faults) ->
    ok = starl_world:halt(world(Faults), Robot, Fault),
    For = {OsPid, max(1, round(starl_world_injection:real_ms(Ms, Injection)))},
    Faults#faults{halts = starl_cluster_halts:halt(Robot, For, Moment, Halts)}.

told(All, Faults) -> {lists:append([told_one(Told, world(Faults)) || Told <- All]), Faults}.

told_one({halted, Robot, Found}, World) ->
    logger:notice(#{what => node_halted, robot => Robot, found => Found}),
    ok = starl_world:halted(World, Robot),
    [];
told_one({resumed, Robot, Found, Callers}, World) ->
    ok = starl_world:resumed(World, Robot),
    ok = lists:foreach(fun(From) -> gen_server:reply(From, {ok, Found}) end, Callers),
    [{watch, Robot}].

%% @doc All nodes that are halted go on.
-spec all_go_on(t()) -> {[want()], t()}.
all_go_on(#faults{halts = Halts} = Faults) ->
    {Told, Next} = starl_cluster_halts:undo_all(Halts),
    told(Told, Faults#faults{halts = Next}).

%% @doc Handles that the node of a robot has missed answers, or answers again. A manual halt, or one
%% by chaos, has its own time. Any other silence is reported to the world in the same way, so no
%% robot is accused because its node hangs.
-spec silent(starl_cluster_watchdog:word(), starl:robot_id(), t()) -> {[want()], t()}.
silent(Word, Robot, #faults{halts = Halts} = Faults) ->
    case {Word, starl_cluster_halts:is_halted(Robot, Halts)} of
        {back, _} ->
            {[], hangs_no_more(Robot, Faults)};
        {doubtful, false} ->
            {[], hangs(Robot, Faults)};
        {doubtful, true} ->
            {[], Faults};
        {silent, false} ->
            logger:error(#{what => node_silent, robot => Robot, then => killed_and_started_anew}),
            {[{kill, Robot}], Faults};
        {silent, true} ->
            {[{watch, Robot}], Faults}
    end.

hangs(Robot, #faults{injection = Injection, hanging = Hanging} = Faults) ->
    {Fault, Named} = starl_world_injection:unnamed("hang", Injection),
    ok = starl_world:halt(world(Faults), Robot, Fault),
    ok = starl_world:halted(world(Faults), Robot),
    Faults#faults{hanging = [Robot | lists:delete(Robot, Hanging)], injection = Named}.

hangs_no_more(Robot, #faults{hanging = Hanging} = Faults) ->
    _ = [ok = starl_world:resumed(world(Faults), Robot) || lists:member(Robot, Hanging)],
    Faults#faults{hanging = lists:delete(Robot, Hanging)}.

%% @doc Handles the end of a robot's node: it is no longer halted.
-spec lost(starl:robot_id(), t()) -> t().
lost(Robot, #faults{halts = Halts} = Faults) ->
    {Told, Next} = starl_cluster_halts:undo(Robot, Halts),
    {_, GoneOn} = told(Told, Faults#faults{halts = Next}),
    hangs_no_more(Robot, GoneOn).

%% @doc Ends all halts, without a notification.
-spec stop(t()) -> ok.
stop(#faults{halts = Halts}) ->
    _ = starl_cluster_halts:undo_all(Halts),
    ok.

%% -- robots that start ----------------------------------------------------------------------

%% @doc A robot starts, with what is left of its store.
-spec starts(starl:robot_id(), starl_live_robot:spec(), t()) -> t().
starts(Robot, Spec, #faults{injection = Injection} = Faults) ->
    {Fate, Fated} = starl_world_injection:fate(Robot, Injection),
    ok = starl_world_store:before_start(Fate, Spec),
    Faults#faults{injection = Fated}.

%% @doc A robot is up: what had sent it down has ended.
-spec up(starl:robot_id(), t()) -> t().
up(Robot, #faults{injection = Injection} = Faults) ->
    Faults#faults{injection = starl_world_injection:up(Robot, Injection)}.

%% @doc May a robot start now? A fault may keep it down.
-spec may_start(starl:robot_id(), t()) -> boolean().
may_start(Robot, #faults{injection = Injection}) ->
    not starl_world_injection:is_down(Robot, Injection).

%% @doc The disk with which the node of a robot starts: one that is full stays so.
-spec disk(starl:robot_id(), t()) -> fill | clear.
disk(Robot, #faults{injection = Injection}) ->
    case starl_world_injection:is_full(Robot, Injection) of
        true -> fill;
        false -> clear
    end.

%% @doc What a robot hears and senses now.
-spec changes(starl:robot_id(), t()) ->
    {starl_live_conditions:settings(), starl_live_sense_fault:faults()}.
changes(Robot, #faults{injection = Injection}) ->
    {starl_world_injection:air(Robot, Injection), starl_world_injection:senses(Robot, Injection)}.
