%% @doc Calls to the node of a robot in a cluster. They prepare the node (log, code, application),
%% open and close the robot, load code, and change the link conditions. A call to a node that hangs
%% waits until the node goes on or ends, so {@link starl_cluster_calls} makes them.
-module(starl_cluster_node).

-export([
    ready/4,
    ahead_us/1,
    open/4,
    load/2,
    set_air/2,
    set_senses/2,
    kill/2,
    peers/1,
    close/1,
    answers/2
]).
-export([ends_with_robot/0]).

%% How often a node is asked for its time.
-define(ASKS, 3).
%% What a robot may run.
-define(APPLICATIONS, [starl_platform, starl_blocks, starl_live]).

%% @doc Readies the node for its robot: its log goes to that process. `Code': modules that were compiled in
%% memory, or reloaded. All code is loaded first: an atom that a node does not know is refused in a packet.
-spec ready(node(), starl:robot_id(), [Code], Log :: pid()) ->
    ok | {error, ended | unicode:chardata()}
when
    Code :: {module(), file:filename(), binary()}.
ready(Node, Id, Code, Log) ->
    try
        ok = call(Node, starl_live_log, install, [Id, Log]),
        _ = [
            {module, Module} = call(Node, code, load_binary, [Module, File, Beam])
         || {Module, File, Beam} <- Code
        ],
        ok = call(Node, code, ensure_modules_loaded, [modules()]),
        {ok, _} = call(Node, application, ensure_all_started, [starl_live]),
        call(Node, ?MODULE, ends_with_robot, [])
    catch
        Class:Reason -> failed(Class, Reason)
    end.

%% @private A node whose robot cannot start any more ends. OTP would end it for a permanent application, with
%% a dump and lines of its own.
-spec ends_with_robot() -> ok.
ends_with_robot() ->
    _ = spawn(fun end_with_robot/0),
    ok.

-spec end_with_robot() -> no_return().
end_with_robot() ->
    Monitor = monitor(process, starl_live_sup),
    receive
        {'DOWN', Monitor, process, _, _} -> halt(1)
    end.

%% @doc How far the clock of the node is ahead of that of this VM at least, negative if it is behind. 0 if
%% both may be alike, given the time that the answers took.
-spec ahead_us(node()) -> integer().
ahead_us(Node) ->
    try [asked_time(Node) || _ <- lists:seq(1, ?ASKS)] of
        Times ->
            Least = lists:max([There - After || {_, There, After} <- Times]),
            Most = lists:min([There - Before || {Before, There, _} <- Times]),
            max(Least, min(Most, 0))
    catch
        %% its robot will not be opened either
        error:{erpc, _} -> 0
    end.

asked_time(Node) ->
    Before = erlang:system_time(microsecond),
    case call(Node, erlang, system_time, [microsecond]) of
        There when is_integer(There) -> {Before, There, erlang:system_time(microsecond)}
    end.

%% @doc Opens the robot with these link conditions and faults of its senses. Returns its link.
-spec open(
    node(), starl_live_robot:spec(), starl_live_conditions:settings(), starl_live_sense_fault:faults()
) ->
    {ok, [Link :: pid()]} | {error, ended | unicode:chardata()}.
open(Node, #{robot := Id} = Spec, Air, Senses) ->
    try call(Node, starl_live_sup, open, opening(Id, starl_world_setup:with_links(Air, Spec))) of
        {ok, _} ->
            ok = set_senses(Node, Senses),
            {ok, robot_link(Node)};
        {error, Reason} ->
            {error, starl_live_sup:format_error(Reason)}
    catch
        Class:Reason -> failed(Class, Reason)
    end.

failed(error, {erpc, noconnection}) ->
    {error, ended};
failed(Class, Reason) ->
    {error, io_lib:format("its node failed: ~0tP", [{Class, Reason}, 20])}.

call(Node, Module, Function, Args) -> erpc:call(Node, Module, Function, Args, infinity).

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

%% @doc Loads the code of versions beside the present one, and returns the link of the node's robot.
%% A node that ends meanwhile will be restarted.
-spec load(node(), [starl_version:code()]) ->
    {ok, [Link :: pid()]} | {error, unicode:chardata()}.
load(Node, Code) ->
    try call(Node, starl_version, load, [Code]) of
        ok -> {ok, robot_link(Node)};
        {error, _} = Error -> Error
    catch
        error:{erpc, _} -> {ok, []}
    end.

robot_link(Node) ->
    try
        Robot = call(Node, starl_live_sup, robot, []),
        [Link || Link <- [call(Node, starl_live_robot, link, [Robot])], is_pid(Link)]
    catch
        error:{erpc, _} -> [];
        exit:_ -> []
    end.

%% @doc Changes these link conditions of the node's robot.
-spec set_air(node(), starl_live_conditions:settings()) -> ok.
set_air(Node, Settings) ->
    lists:foreach(fun(Link) -> set_link_conditions(Link, Settings) end, robot_link(Node)).

set_link_conditions(Link, Settings) ->
    try
        starl_live_transport:set_conditions(starl_live_link:port(Link, transport), Settings)
    catch
        exit:_ -> ok
    end.

%% @doc The senses of the node's robot have these faults, and no others.
-spec set_senses(node(), starl_live_sense_fault:faults()) -> ok.
set_senses(Node, Faults) ->
    lists:foreach(fun(Link) -> starl_live_link:sense_faults(Link, Faults) end, robot_link(Node)).

%% @doc Ends this machine of the node's robot, as a crash does.
-spec kill(node(), starl_machine:name()) -> ok.
kill(Node, Name) ->
    lists:foreach(fun(Link) -> starl_live_link:kill(Link, Name) end, robot_link(Node)).

%% @doc What the node's robot knows of the others.
-spec peers(node()) -> [starl_live_peers:peer()].
peers(Node) -> lists:append([known(Link) || Link <- robot_link(Node)]).

known(Link) ->
    try
        starl_live_transport:peers(starl_live_link:port(Link, transport))
    catch
        exit:_ -> []
    end.

%% @doc Ends the node's robot, and its recording.
-spec close(node()) -> ok.
close(Node) ->
    try
        call(Node, starl_live_sup, close, [])
    catch
        error:{erpc, _} -> ok;
        exit:_ -> ok
    end.

%% @doc Whether the link of the node's robot answers within this time; `gone': the node has ended.
-spec answers(node(), TimeoutMs :: pos_integer()) -> boolean() | gone.
answers(Node, Ms) ->
    try
        erpc:call(Node, starl_live_sup, answers, [Ms], Ms)
    catch
        error:{erpc, noconnection} -> gone;
        error:{erpc, timeout} -> false;
        exit:_ -> false
    end.
