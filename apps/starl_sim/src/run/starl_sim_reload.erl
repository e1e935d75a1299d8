%% @doc Handles reloads that are ordered while a simulation runs, besides those of its scenario
%% ({@link starl_run_reloads}). It also collects the robots' reports on both. It loads the new code
%% on all nodes before any robot gets the order. Apart from that, a pure module.
-module(starl_sim_reload).

-export([new/1, order/4, note/2, reloads/1]).

-export_type([t/0]).

-record(reload, {
    nodes :: [node()],
    parts :: #{starl_machine:name() => module()},
    robots :: [starl:robot_id()],
    count :: non_neg_integer(),
    %% what was told of reloads, of the latest window first
    told = [] :: [starl_monitor:trace_event()]
}).

-opaque t() :: #reload{}.

-define(NODE_MS, 30000).

%% @doc Of a run with this plan nothing has been told yet.
-spec new(starl_sim_plan:t()) -> t().
new(#{sites := Sites, world := World, robots := Poses}) ->
    #reload{
        nodes = lists:usort([Node || #{node := Node} <- Sites]),
        parts = maps:get(parts, World, #{}),
        robots = [Id || {Id, _} <- Poses],
        count = map_size(maps:get(reloads, World, #{}))
    }.

%% @doc A reload of all robots at this time.
-spec order([starl_version:source()], TrialMs, AtUs, t()) ->
    {ok, starl_run_reloads:t(), t()} | {error, starl_reload:reason() | {node(), unreachable}}
when
    TrialMs :: non_neg_integer(), AtUs :: starl_sim_queue:time().
order(Sources, TrialMs, At, #reload{parts = Parts, robots = Robots, count = Count} = Reload) ->
    case starl_reload:order(Count + 1, Sources, Parts, TrialMs) of
        {ok, Order, Code} ->
            Made = #{at_us => At, robots => Robots, order => Order},
            loaded(load(Code, Reload#reload.nodes), Made, Reload#reload{count = Count + 1});
        {error, _} = Error ->
            Error
    end.

loaded(ok, Made, Reload) -> {ok, Made, Reload};
loaded({error, _} = Error, _Made, _Reload) -> Error.

load(_Code, []) ->
    ok;
load(Code, [Node | Nodes]) ->
    case on(Node, Code) of
        ok -> load(Code, Nodes);
        {error, _} = Error -> Error
    end.

on(Node, Code) ->
    try erpc:call(Node, starl_version, load, [Code], ?NODE_MS) of
        ok -> ok;
        {error, Why} -> {error, {code, [Why]}}
    catch
        error:{erpc, _} -> {error, {Node, unreachable}}
    end.

%% @doc A window was reported.
-spec note([starl_monitor:trace_event()], t()) -> t().
note(_Trace, #reload{count = 0} = Reload) ->
    Reload;
note(Trace, #reload{told = Told} = Reload) ->
    Reload#reload{told = [Event || {_, _, _, {reloaded, _, _}} = Event <- Trace] ++ Told}.

%% @doc What has become of the reloads.
-spec reloads(t()) -> [starl_reload_monitor:reload()].
reloads(#reload{told = Told}) ->
    Monitor = lists:foldl(
        fun(Event, State) ->
            {ok, Next} = starl_reload_monitor:step(Event, State),
            Next
        end,
        starl_reload_monitor:init(#{}),
        lists:keysort(1, Told)
    ),
    {ok, #{reloads := Reloads}} = starl_reload_monitor:finish(0, Monitor),
    Reloads.
