%% @doc The top supervisor of a robot's node. It bears no failure of its robot: a robot that cannot
%% start any more ends the application, and with it the node, which whoever started the node then
%% starts anew.
-module(starl_live_sup).
-behaviour(supervisor).

-export([start_link/0, open/1, open/2, robot/0]).
-export([init/1]).

%% @doc Starts the supervisor, without a robot.
-spec start_link() -> supervisor:startlink_ret().
start_link() -> supervisor:start_link({local, ?MODULE}, ?MODULE, []).

%% @doc Starts the robot of this node. The robot's machines find all code loaded: an atom of a packet
%% that no module of theirs knows is refused.
-spec open(starl_live_robot:spec()) -> supervisor:startchild_ret().
open(Spec) ->
    supervisor:start_child(?MODULE, #{
        id => robot, type => supervisor, start => {starl_live_robot, start_link, [Spec]}
    }).

%% @doc The same, with its metrics over HTTP.
-spec open(starl_live_robot:spec(), #{ip := inet:ip_address(), port := inet:port_number()}) ->
    supervisor:startchild_ret().
open(Spec, Http) ->
    Metrics = #{id => metrics, start => {starl_live_http, start_link, [Http]}},
    case supervisor:start_child(?MODULE, Metrics) of
        {ok, _} -> open(Spec);
        {error, _} = Error -> Error
    end.

%% @doc The robot of this node.
-spec robot() -> pid() | none.
robot() ->
    case lists:keyfind(robot, 1, supervisor:which_children(?MODULE)) of
        {robot, Pid, _, _} when is_pid(Pid) -> Pid;
        _ -> none
    end.

-spec init([]) -> {ok, {supervisor:sup_flags(), []}}.
init([]) -> {ok, {#{strategy => one_for_one, intensity => 0, period => 1}, []}}.
