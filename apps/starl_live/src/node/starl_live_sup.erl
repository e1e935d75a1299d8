%% @doc The top supervisor of a robot's node. It tolerates no failure of its robot: a robot that can
%% no longer start ends the application, and with it the node. Whatever started the node then starts
%% it anew. If a recorder fails, the recording ends, but not the robot; the same holds for a server
%% of metrics.
-module(starl_live_sup).
-behaviour(supervisor).

-export([start_link/0, open/1, open/2, format_error/1, robot/0, answers/1, figures/1, close/0]).
-export([init/1]).

%% A recorder writes the end of its file.
-define(CLOSE_MS, 10000).

%% @doc Starts the supervisor, without a robot.
-spec start_link() -> supervisor:startlink_ret().
start_link() -> supervisor:start_link({local, ?MODULE}, ?MODULE, []).

%% @doc Starts the robot of this node, with its recorder if the specification has one (`recorder',
%% {@link starl_observer:recorder()}). The robot's machines find all code loaded: an atom of a packet
%% that no module of theirs knows is refused.
-spec open(starl_live_robot:spec()) -> supervisor:startchild_ret().
open(#{recorder := {Module, Own}, robot := Robot, dir := Dir, clock := Clock} = Spec) ->
    Config = Own#{
        robot => Robot,
        now => fun() -> starl_live_clock:now_us(Clock) end,
        before => starl_live_record:last(Dir)
    },
    Recorder = #{
        id => recorder,
        start => {Module, start_link, [Config]},
        restart => temporary,
        shutdown => ?CLOSE_MS
    },
    Bare = maps:remove(recorder, Spec),
    case supervisor:start_child(?MODULE, Recorder) of
        {ok, Pid} ->
            open(Bare#{observe => Module:observer(Pid)});
        {error, {Why, _Child}} ->
            logger:error(#{what => no_recording, why => Why}),
            open(Bare)
    end;
open(Spec) ->
    supervisor:start_child(?MODULE, #{
        id => robot, type => supervisor, start => {starl_live_robot, start_link, [Spec]}
    }).

%% @doc The same, with its metrics over HTTP.
-spec open(starl_live_robot:spec(), #{
    ip := inet:ip_address(), port := inet:port_number(), problems => starl_live_http:problems()
}) -> supervisor:startchild_ret().
open(Spec, Http) ->
    Metrics = #{
        id => metrics, start => {starl_live_http, start_link, [Http]}, restart => temporary
    },
    case supervisor:start_child(?MODULE, Metrics) of
        {ok, _} -> open(Spec);
        {error, _} = Error -> Error
    end.

%% @doc One line on why a robot could not be opened: a port that cannot be opened gives the reason.
-spec format_error(term()) -> unicode:chardata().
format_error({Reason, Child}) when element(1, Child) =:= child ->
    format_error(Reason);
format_error({shutdown, {failed_to_start_child, _, Reason}}) ->
    format_error(Reason);
format_error({failed_to_start_child, _, Reason}) ->
    format_error(Reason);
format_error({shutdown, {Port, Why}}) when is_atom(Port), is_binary(Why) ->
    [atom_to_list(Port), ": ", Why];
format_error(Reason) ->
    case io_lib:deep_char_list(Reason) of
        true -> Reason;
        false -> io_lib:format("~0tP", [Reason, 20])
    end.

%% @doc The robot of this node.
-spec robot() -> pid() | none.
robot() ->
    case lists:keyfind(robot, 1, supervisor:which_children(?MODULE)) of
        {robot, Pid, _, _} when is_pid(Pid) -> Pid;
        _ -> none
    end.

%% @doc Whether the robot's link answers within this time.
-spec answers(TimeoutMs :: pos_integer()) -> boolean().
answers(Ms) -> figures(Ms) =/= silent.

%% @doc The counters of the robot; `silent': its link has not answered within this time.
-spec figures(TimeoutMs :: pos_integer()) -> starl_live_driver:figures() | silent.
figures(Ms) ->
    try
        gen_server:call(starl_live_robot:link(robot()), figures, Ms)
    catch
        exit:_ -> silent
    end.

%% @doc Ends the robot, and then its recorder.
-spec close() -> ok.
close() ->
    _ = [supervisor:terminate_child(?MODULE, Child) || Child <- [robot, recorder]],
    ok.

-spec init([]) -> {ok, {supervisor:sup_flags(), []}}.
init([]) -> {ok, {#{strategy => one_for_one, intensity => 0, period => 1}, []}}.
