%% @doc A live robot: its link, and the supervision tree of its machines. The link holds the robot's
%% ports. When it ends, the machines end with it, and both start anew, as after a reboot.
%% ```
%%     starl_live_robot (rest_for_one)
%%       link (starl_live_link) --- transport, positioning, chassis
%%       machines (starl_robot_sup): started by the link
%% '''
-module(starl_live_robot).
-behaviour(supervisor).

-export([start_link/1, start_machines/2, link/1]).
-export([init/1]).

-export_type([spec/0]).

%% A robot, as {@link starl_live_link:spec()} without its supervisor.
-type spec() :: map().

%% The starts of a robot that may fail in a minute.
-define(INTENSITY, 5).
-define(PERIOD_S, 60).

%% @doc Starts a robot.
-spec start_link(spec()) -> supervisor:startlink_ret().
start_link(Spec) -> supervisor:start_link(?MODULE, Spec).

%% @doc Starts the processes of the robot's machines, for its link.
-spec start_machines(pid(), starl_robot_sup:spec()) -> supervisor:startchild_ret().
start_machines(Sup, Spec) ->
    supervisor:start_child(Sup, #{
        id => machines,
        type => supervisor,
        restart => temporary,
        start => {starl_robot_sup, start_link, [Spec]}
    }).

%% @doc The link of a robot.
-spec link(pid()) -> pid() | none.
link(Sup) ->
    case lists:keyfind(link, 1, supervisor:which_children(Sup)) of
        {link, Pid, _, _} when is_pid(Pid) -> Pid;
        _ -> none
    end.

-spec init(spec()) -> {ok, {supervisor:sup_flags(), [supervisor:child_spec()]}}.
init(Spec) ->
    Flags = #{strategy => rest_for_one, intensity => ?INTENSITY, period => ?PERIOD_S},
    Link = #{
        id => link, start => {starl_live_link, start_link, [Spec#{robot_sup => self()}]}
    },
    {ok, {Flags, [Link]}}.
