%% @doc Calls to the node of a robot of a cluster: opens the robot (its log, its code, its
%% application), finds its link, changes its air. A node that does not answer is about to be started
%% anew.
-module(starl_cluster_node).

-export([open/4, robot_link/1, set_air/2, close/1]).

-define(CALL_MS, 60000).
%% What a robot may run.
-define(APPLICATIONS, [starl_platform, starl_blocks, starl_live]).

%% @doc Opens the robot; its log goes to the caller. `Code': modules that were compiled in memory, or
%% reloaded. All code is loaded first: an atom that a node does not know is refused in a packet.
-spec open(node(), starl:robot_id(), starl_live_robot:spec(), [Code]) ->
    ok | {error, unicode:chardata()}
when
    Code :: {module(), file:filename(), binary()}.
open(Node, Id, Spec, Code) ->
    try
        ok = call(Node, starl_live_log, install, [Id, self()]),
        _ = [
            {module, Module} = call(Node, code, load_binary, [Module, File, Beam])
         || {Module, File, Beam} <- Code
        ],
        ok = call(Node, code, ensure_modules_loaded, [modules()]),
        {ok, _} = call(Node, application, ensure_all_started, [starl_live, permanent]),
        call(Node, starl_live_sup, open, opening(Id, Spec))
    of
        {ok, _} -> ok;
        {error, Reason} -> {error, starl_live_sup:format_error(Reason)}
    catch
        Class:Reason -> {error, io_lib:format("its node failed: ~0tP", [{Class, Reason}, 20])}
    end.

call(Node, Module, Function, Args) -> erpc:call(Node, Module, Function, Args, ?CALL_MS).

opening(_Id, #{metrics := none} = Spec) ->
    [maps:remove(metrics, Spec)];
opening(Id, #{metrics := Port} = Spec) ->
    [maps:remove(metrics, Spec), #{ip => {127, 0, 0, 1}, port => Port + Id}].

%% All of these applications, and what this VM has loaded: the user's application is among that.
modules() ->
    Loaded = [M || {M, _} <- code:all_loaded(), lists:prefix("starl", atom_to_list(M))],
    lists:usort(Loaded ++ lists:append([modules(App) || App <- ?APPLICATIONS])).

modules(App) ->
    _ = application:load(App),
    case application:get_key(App, modules) of
        {ok, Modules} -> Modules;
        undefined -> []
    end.

%% @doc The link of the node's robot.
-spec robot_link(node()) -> [Link :: pid()].
robot_link(Node) ->
    try
        Robot = call(Node, starl_live_sup, robot, []),
        [call(Node, starl_live_robot, link, [Robot])]
    catch
        error:{erpc, _} -> [];
        exit:_ -> []
    end.

%% @doc Changes these settings of the air of the node's robot.
-spec set_air(node(), starl_live_air:settings()) -> ok.
set_air(Node, Settings) -> lists:foreach(fun(Link) -> aired(Link, Settings) end, robot_link(Node)).

aired(Link, Settings) ->
    try
        starl_live_transport:set_air(starl_live_link:line(Link, transport), Settings)
    catch
        exit:_ -> ok
    end.

%% @doc Ends the robots of these nodes, and their recordings; a node that does not answer is killed soon.
-spec close([node()]) -> ok.
close(Nodes) ->
    _ = erpc:multicall(Nodes, starl_live_sup, close, [], ?CALL_MS),
    ok.
