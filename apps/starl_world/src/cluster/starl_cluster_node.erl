%% @doc Opens a robot on a node of a cluster: its log, its code, its application.
-module(starl_cluster_node).

-export([open/4]).

-define(CALL_MS, 60000).
%% What a robot may run.
-define(APPLICATIONS, [starl_platform, starl_blocks, starl_live]).

%% @doc Opens the robot; its log goes to the caller. `Code': modules that were compiled in memory, or
%% reloaded. All code is loaded first: an atom that a node does not know is refused in a packet.
-spec open(node(), starl:robot_id(), starl_live_robot:spec(), [Code]) ->
    {ok, term()} | {error, term()}
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
    catch
        Class:Reason -> {error, {Class, Reason}}
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
