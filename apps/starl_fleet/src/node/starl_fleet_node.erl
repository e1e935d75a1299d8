%% @doc Runs a robot on a node of its own: makes the robot from the fleet file of its release, opens
%% it, and knows its status. Only the service manager of the computer supervises the node.
-module(starl_fleet_node).
-behaviour(gen_server).

-export([start_link/1, status/0, code/0, runs/1, takes/2, leaves/2, answers/1, spec/3, prepare/1]).
-export([init/1, handle_continue/2, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([status/0]).

%% `started': seconds since 1970; `result': of the application; `crashes': of machines and of the
%% application since the node started, with the latest in words; `chassis': how the body is, if it tells;
%% `reload': of the latest one, the machines that have not taken it yet, and what has failed;
%% `peers': what it knows of the other robots; `ahead_us': how far the time of the VM, which nobody can
%% set, is ahead of the computer's clock.
-type status() :: #{
    robot := starl:robot_id(),
    release := string(),
    run := non_neg_integer(),
    app := module(),
    started := integer(),
    link := answers | silent,
    result := running | given_up | {done, string()},
    crashes := non_neg_integer(),
    crash := string() | none,
    ahead_us := integer(),
    reload => #{waiting := [starl_machine:name()], failed := string() | none},
    figures => map(),
    peers => [starl_live_peers:peer()],
    chassis => map()
}.

-record(node, {
    place :: starl_fleet_place:t(),
    app = none :: module(),
    started :: integer(),
    result = running :: running | given_up | {done, term()},
    crashes = 0 :: non_neg_integer(),
    crash = none :: none | {starl_machine:name(), starl_crash:cause()},
    %% the modules of the robot's machines; the number of reloads, the modules that run in versions, and the
    %% orders that have not failed, the newest first
    parts = #{} :: #{starl_machine:name() => module()},
    count = 0 :: non_neg_integer(),
    versions = [] :: [module()],
    orders = [] :: [starl_reload:order()],
    reload = none :: reload() | none
}).

%% The latest reload: from which release it came.
-type reload() :: #{
    number := starl_reload:count(),
    before := starl_fleet_place:t(),
    waiting := [starl_machine:name()],
    failed := string() | none
}.

%% Its reason of not starting, for bin/robot.
-define(WHY, "why").
-define(RECORDINGS, "recordings").
-define(ANSWER_MS, 2000).

%% @doc Starts the node's robot.
-spec start_link(starl_fleet_place:t()) -> gen_server:start_ret().
start_link(Place) -> gen_server:start_link({local, ?MODULE}, ?MODULE, Place, []).

%% @doc The state of the robot.
-spec status() -> status().
status() -> gen_server:call(?MODULE, status, infinity).

%% @doc What a reload must know: its number, the modules of the robot's machines, and those that run in
%% versions already.
-spec code() ->
    #{
        number := starl_reload:count(),
        parts := #{starl_machine:name() => module()},
        versions := [module()]
    }.
code() -> gen_server:call(?MODULE, code, infinity).

%% @doc The code of the robot is that of this release from now on.
-spec runs(Release :: file:filename()) -> ok.
runs(Release) -> gen_server:call(?MODULE, {runs, Release}, infinity).

%% @doc The robot takes new versions, which are loaded: those of this release.
-spec takes(starl_reload:order(), Release :: file:filename()) -> ok | {error, string()}.
takes(Order, Release) -> gen_server:call(?MODULE, {takes, Order, Release}, infinity).

%% @doc The latest reload has failed on that robot, so this robot goes back to this release. It
%% cannot go back if its node has started anew since the reload.
-spec leaves(Release :: file:filename(), Failed :: starl:robot_id()) -> ok | {error, string()}.
leaves(Release, Failed) -> gen_server:call(?MODULE, {leaves, Release, Failed}, infinity).

%% @doc Whether the robot's link answers within this time.
-spec answers(TimeoutMs :: pos_integer()) -> boolean().
answers(Ms) -> starl_live_sup:answers(Ms).

%% -- the robot ------------------------------------------------------------------------------

%% @doc Makes a robot's specification, without starting anything.
-spec prepare(starl_fleet_place:t()) ->
    {ok, starl_fleet_file:t(), starl_live_robot:spec()} | {error, [unicode:chardata(), ...]}.
prepare(#{keys := Keys} = Place) ->
    case {starl_fleet_place:read(Place), starl_live_key:load(filename:join(Keys, "fleet.key"))} of
        {{ok, Fleet}, {ok, Key}} -> made(spec(Place, Key, Fleet), Fleet);
        {{ok, _}, {error, Why}} -> {error, [Why]};
        {{error, _} = Error, _} -> Error
    end.

made({ok, Spec}, Fleet) -> {ok, Fleet, Spec};
made({error, _} = Error, _Fleet) -> Error.

%% @doc The specification of a robot of a fleet.
-spec spec(starl_fleet_place:t(), starl_live_key:t(), starl_fleet_file:t()) ->
    {ok, starl_live_robot:spec()} | {error, [unicode:chardata(), ...]}.
spec(Place, Key, Fleet) ->
    case starl_run:plan(starl_fleet_file:scenario(Fleet), #{}) of
        {ok, Planned} -> {ok, recorded(Place, Planned, Fleet, robot(Place, Key, Planned, Fleet))};
        {error, Reason} -> {error, [starl_run:format_error(Reason)]}
    end.

%% The robot is recorded in its state's directory.
recorded(_Place, _Planned, #{record_mb := 0}, Spec) ->
    Spec;
recorded(#{state := State} = Place, Planned, #{record_mb := Most}, Spec) ->
    #{clock := Clock} = Spec,
    Facts = starl_live_clock:live_facts(starl_run_plan:facts(Planned, []), Clock),
    Own = #{
        dir => filename:join(State, ?RECORDINGS),
        facts => Facts#{run => starl_fleet_place:run(Place)},
        most_bytes => Most bsl 20
    },
    Spec#{record => true, recorder => {starl_trace_robot, Own}}.

robot(#{robot := Robot, state := State} = Place, Key, {_, _, Plan} = Planned, Fleet) ->
    {Source, Own} = starl_fleet_adapters:positioning(Robot, Key, Fleet),
    #{tree := Tree, world := #{profiles := Profiles, seed := Seed}} = Plan,
    #{name := Name} = Fleet,
    #{
        robot => Robot,
        tree => Tree,
        %% the same for all releases
        team_seed => erlang:phash2({Name, Seed}, 1 bsl 32),
        profile => starl_chassis:of_robot(Robot, Profiles),
        clock => starl_live_clock:new(0, 1),
        dir => State,
        transport => starl_fleet_adapters:transport(starl_fleet_place:run(Place), Key, Fleet),
        positioning => {Source, Own#{placing => starl_run_floor:placing(Planned)}},
        chassis => starl_fleet_adapters:chassis(Robot, Fleet),
        senses => starl_fleet_adapters:senses(Robot, Fleet),
        sink => self()
    }.

%% -- server ---------------------------------------------------------------------------------

-spec init(starl_fleet_place:t()) -> {ok, #node{}, {continue, open}}.
init(Place) ->
    {ok, #node{place = Place, started = erlang:system_time(second)}, {continue, open}}.

-spec handle_continue(open, #node{}) -> {noreply, #node{}}.
handle_continue(open, #node{place = #{state := State} = Place} = Node) ->
    ok = filelib:ensure_path(State),
    case prepare(Place) of
        {ok, #{app := App} = Fleet, #{tree := Tree} = Spec} ->
            Known = Node#node{app = App, parts = starl_robot_services:parts(Tree)},
            {noreply, opened(distribute(Place, Fleet), Spec, maps:get(metrics, Fleet), Known)};
        {error, Lines} ->
            {noreply, refused(lists:join("; ", Lines), Node)}
    end.

opened({error, Why}, _Spec, _Metrics, Node) ->
    refused(Why, Node);
opened(ok, Spec, Metrics, #node{place = Place} = Node) ->
    #{state := State, robot := Robot, version := Version} = Place,
    case open(Spec, Metrics) of
        {ok, _} ->
            _ = file:delete(filename:join(State, ?WHY)),
            logger:notice(#{what => robot_started, robot => Robot, release => Version}),
            Node;
        {error, Reason} ->
            refused(starl_live_sup:format_error(Reason), Node)
    end.

open(Spec, none) ->
    starl_live_sup:open(Spec);
open(Spec, Port) ->
    Problems = fun() -> starl_fleet_health:problems(status()) end,
    starl_live_sup:open(Spec, #{ip => {0, 0, 0, 0}, port => Port, problems => Problems}).

%% The service manager tries again. The chassis is not open, so nothing moves.
refused(Why, #node{place = #{state := State}} = Node) ->
    Line = unicode:characters_to_binary(Why),
    logger:error(#{what => robot_not_started, why => Line}),
    _ = file:write_file(filename:join(State, ?WHY), [Line, $\n]),
    ok = init:stop(1),
    Node.

distribute(#{robot := Robot, keys := Keys}, #{transport := dist} = Fleet) ->
    starl_fleet_net:start(Robot, Keys, Fleet);
distribute(_Place, #{}) ->
    ok.

-spec handle_call(term(), gen_server:from(), #node{}) ->
    {reply, status() | map() | ok | {error, string()}, #node{}}.
handle_call(code, _From, #node{count = Count, parts = Parts, versions = Versions} = Node) ->
    {reply, #{number => Count + 1, parts => Parts, versions => Versions}, Node};
handle_call({runs, Release}, _From, Node) ->
    {reply, ok, moved(Release, Node#node{reload = none})};
handle_call({takes, Order, Release}, _From, Node) ->
    case robot_link() of
        none -> {reply, {error, "its link does not answer"}, Node};
        Link -> {reply, ok, taking(Order, Release, Link, Node)}
    end;
handle_call({leaves, Release, Failed}, _From, #node{reload = Reload} = Node) ->
    case {Reload, robot_link()} of
        {#{number := N, before := #{release := Release}}, Link} when Link =/= none ->
            ok = starl_live_link:take_back(Link, N, Failed),
            {reply, ok, moved(Release, without(N, Node#node{reload = none}))};
        _ ->
            {reply, {error, "it does not come from this release by a reload"}, Node}
    end;
handle_call(status, _From, Node) ->
    {reply, status_of(Node), Node}.

status_of(#node{place = Place, started = Started, app = App} = Node) ->
    Figures = starl_live_sup:figures(?ANSWER_MS),
    Status = #{
        robot => maps:get(robot, Place),
        release => maps:get(version, Place),
        run => starl_fleet_place:run(Place),
        app => App,
        started => Started,
        link => heard(Figures),
        result => shown(Node#node.result),
        crashes => Node#node.crashes,
        crash => crash(Node#node.crash),
        ahead_us => starl_live_clock:ahead_us(starl_live_clock:new(0, 1))
    },
    Reload = [{reload, maps:with([waiting, failed], R)} || #{} = R <- [Node#node.reload]],
    maps:merge(Status, maps:merge(maps:from_list(Reload), more(Figures))).

moved(Release, #node{place = Place} = Node) ->
    Version = filename:basename(Release),
    logger:notice(#{what => code_reloaded, release => Version}),
    Moved = Place#{release := Release, version := Version},
    Node#node{place = Moved, crashes = 0, crash = none}.

taking(#{number := N, versions := New} = Order, Release, Link, #node{parts = Parts} = Node) ->
    #node{place = Before, versions = Versions, orders = Orders} = Node,
    ok = starl_live_link:reload(Link, Order, self()),
    moved(Release, Node#node{
        count = N,
        versions = lists:usort(maps:keys(New) ++ Versions),
        orders = [Order | Orders],
        reload = #{
            number => N,
            before => Before,
            waiting => [Name || {Name, M} <- maps:to_list(Parts), is_map_key(M, New)],
            failed => none
        }
    }).

without(N, #node{orders = Orders} = Node) ->
    Node#node{orders = [Order || #{number := M} = Order <- Orders, M =/= N]}.

robot_link() ->
    try starl_live_robot:link(starl_live_sup:robot()) of
        Link when is_pid(Link) -> Link;
        _ -> none
    catch
        exit:_ -> none
    end.

%% What its ports report, only where the link has just answered.
more(silent) ->
    #{};
more(Figures) ->
    Peers = port(transport, fun starl_live_transport:peers/1, []),
    Chassis = port(chassis, fun starl_live_chassis:condition/1, #{}),
    maps:from_list(
        [{figures, Figures}] ++
            [{peers, Peers} || Peers =/= []] ++
            [{chassis, Chassis} || map_size(Chassis) > 0]
    ).

port(Port, Ask, Otherwise) ->
    try
        Ask(starl_live_link:port(starl_live_robot:link(starl_live_sup:robot()), Port))
    catch
        exit:_ -> Otherwise
    end.

heard(silent) -> silent;
heard(_) -> answers.

shown({done, Result}) -> {done, lists:flatten(io_lib:format("~0tP", [Result, 12]))};
shown(Result) -> Result.

crash(none) ->
    none;
crash({Name, Cause}) ->
    lists:flatten(io_lib:format("~ts: ~ts", [Name, starl_crash:format(Cause)])).

-spec handle_cast(term(), #node{}) -> {noreply, #node{}}.
handle_cast(_Request, Node) -> {noreply, Node}.

-spec handle_info(starl_live_link:report() | {starl_reloaded, _, _, _}, #node{}) ->
    {noreply, #node{}}.
handle_info({starl_traced, _Id, _Link, {_Batch, _Looked, Events}}, Node) ->
    {noreply, lists:foldl(fun noted/2, Node, Events)};
handle_info({starl_ended, _Id, _Link, Result}, Node) ->
    logger:notice(#{what => application_ended, result => shown(Result)}),
    {noreply, Node#node{result = Result}};
handle_info({starl_started, _Id, Link, _Names}, #node{orders = Orders} = Node) ->
    %% a robot that has started anew in this node has its first code
    _ = [starl_live_link:reload(Link, Order, self()) || Order <- lists:sublist(Orders, 1)],
    {noreply, Node#node{result = running}};
handle_info({starl_reloaded, Id, Name, #{number := N} = Result}, #node{reload = Reload} = Node) ->
    case Reload of
        #{number := N} -> {noreply, applied(Id, Name, Result, Node)};
        _ -> {noreply, Node}
    end;
handle_info(_Message, Node) ->
    {noreply, Node}.

applied(Id, Name, #{number := N, outcome := Outcome, module := Module}, Node) ->
    #node{reload = #{waiting := Waiting, failed := Before} = Reload} = Node,
    Left = Reload#{waiting := lists:delete(Name, Waiting)},
    case Before =:= none andalso starl_reload:is_failure(Outcome) of
        true ->
            Line = unicode:characters_to_list(starl_reload:format(Id, Name, Module, Outcome)),
            without(N, Node#node{reload = Left#{failed := Line}});
        false ->
            Node#node{reload = Left}
    end.

noted({_Us, _Robot, supervisor, {crashed, Name, Cause}}, #node{crashes = N} = Node) ->
    Node#node{crashes = N + 1, crash = {Name, Cause}};
noted(_Event, Node) ->
    Node.
