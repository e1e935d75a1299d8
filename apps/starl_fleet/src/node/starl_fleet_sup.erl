%% @doc Supervises the processes that run beside the robot on its node. It tolerates no failure of
%% theirs: the node ends, and the service manager starts it anew.
%% ```
%%     starl_fleet_sup (one_for_all)
%%       node (starl_fleet_node): opens the robot under starl_live_sup
%%       watchdog (starl_fleet_watchdog): notifies systemd while the robot answers
%%       control (starl_fleet_control): a socket for bin/robot
%% '''
-module(starl_fleet_sup).
-behaviour(supervisor).

-export([start_link/1]).
-export([init/1]).

%% @doc Starts the processes of this place.
-spec start_link(starl_fleet_place:t() | none) -> supervisor:startlink_ret().
start_link(Place) -> supervisor:start_link({local, ?MODULE}, ?MODULE, Place).

-spec init(starl_fleet_place:t() | none) ->
    {ok, {supervisor:sup_flags(), [supervisor:child_spec()]}}.
init(none) -> {ok, {flags(), []}};
init(Place) -> {ok, {flags(), children(Place)}}.

flags() -> #{strategy => one_for_all, intensity => 0, period => 1}.

children(Place) ->
    [
        #{id => node, start => {starl_fleet_node, start_link, [Place]}},
        #{id => watchdog, start => {starl_fleet_watchdog, start_link, watchdog()}},
        #{id => control, start => {starl_fleet_control, start_link, [Place]}}
    ].

watchdog() ->
    [
        starl_fleet_watchdog:systemd(),
        starl_fleet_watchdog:watcher(),
        fun starl_fleet_node:answers/1
    ].
