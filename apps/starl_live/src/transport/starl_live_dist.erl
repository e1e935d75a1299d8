%% @doc The transport by Erlang distribution, between nodes that each carry robots. `peers' names
%% each robot's node.
%%
%% A send never waits, neither for a connection that is not up, nor for one that is busy. Such a
%% packet is lost, as on any radio. A process makes a missing connection in the background, at most
%% once a second. The connection is hidden. The connections of a team fail one by one, and visible
%% nodes would then cut off others as well, to keep all their views of the network alike (`global',
%% since OTP 25). Each second a connection is made to each node that has none. So it is known which
%% robots can be heard even if nobody sends anything.
-module(starl_live_dist).
-behaviour(starl_live_transport).

-export([open/1, transmit/3, hear/2, figures/1, peers/1, close/1]).

%% A node that could not be reached is tried again after this time.
-define(PAUSE_MS, 1000).
%% The time that a robot's former transport has to end.
-define(ENDS_MS, 1000).

-record(dist, {
    ends :: starl_live_frame:t(),
    robot :: starl:robot_id(),
    %% when each other robot was heard last, ms of monotonic time
    heard = #{} :: #{starl:robot_id() => integer()},
    peers :: #{starl:robot_id() => node()},
    %% the nodes that a connection is being made to
    connecting = #{} :: #{node() => reference()}
}).

-spec open(starl_live_transport:config()) -> {ok, #dist{}} | {error, unicode:chardata()}.
open(#{robot := Robot, participants := Team, peers := Peers} = Config) ->
    case [R || R <- starl_team:others(Robot, Team), not is_map_key(R, Peers)] of
        [] ->
            registered(Robot, #dist{
                ends = starl_live_frame:new(Config), robot = Robot, peers = Peers
            });
        [Missing | _] ->
            {error, io_lib:format("peers: no node of robot ~b", [Missing])}
    end.

registered(Robot, Dist) ->
    ok = ended(whereis(name(Robot))),
    try register(name(Robot), self()) of
        true -> {ok, connect_all(Dist)}
    catch
        error:badarg -> {error, io_lib:format("robot ~b runs on this node already", [Robot])}
    end.

%% A robot that starts anew may be sooner than its former transport, which ends after its link.
ended(undefined) ->
    ok;
ended(Former) ->
    Monitor = erlang:monitor(process, Former),
    receive
        {'DOWN', Monitor, process, Former, _Why} -> ok
    after ?ENDS_MS ->
        _ = demonitor(Monitor, [flush]),
        ok
    end.

%% The names are those of the robots in the configuration: no more than these.
name(Robot) -> list_to_atom("starl_robot_" ++ integer_to_list(Robot)).

-spec transmit(starl:robot_id() | all, starl_packet:t(), #dist{}) ->
    {ok, #dist{}} | {refused, unicode:chardata(), #dist{}}.
transmit(To, Packet, #dist{ends = Ends} = Dist) ->
    case starl_live_frame:write(To, Packet, Ends) of
        {ok, Frame, Robots, Next} ->
            Send = fun(Robot, Before) -> send(Frame, Robot, Before) end,
            {ok, lists:foldl(Send, Dist#dist{ends = Next}, Robots)};
        {refused, Why} ->
            {refused, Why, Dist}
    end.

send(Frame, Robot, #dist{peers = Peers} = Dist) ->
    case Peers of
        #{Robot := Node} ->
            To = {name(Robot), Node},
            sent(erlang:send(To, Frame, [noconnect, nosuspend]), Node, Dist);
        #{} ->
            count(unknown_peer, Dist)
    end.

sent(ok, _Node, Dist) -> Dist;
sent(nosuspend, _Node, Dist) -> count(busy, Dist);
sent(noconnect, Node, Dist) -> connect(Node, count(not_connected, Dist)).

%% Nodes are connected, or it is known that they are not.
connect_all(#dist{peers = Peers, robot = Robot} = Dist) ->
    _ = erlang:send_after(?PAUSE_MS, self(), {?MODULE, connect}),
    Missing = lists:usort(maps:values(maps:remove(Robot, Peers))) -- [node() | nodes(connected)],
    lists:foldl(fun connect/2, Dist, Missing).

connect(Node, #dist{connecting = Connecting} = Dist) when is_map_key(Node, Connecting) ->
    Dist;
connect(Node, #dist{connecting = Connecting} = Dist) ->
    {_Pid, Monitor} = spawn_monitor(fun() -> connect(Node) end),
    Dist#dist{connecting = Connecting#{Node => Monitor}}.

connect(Node) ->
    case net_kernel:hidden_connect_node(Node) of
        true -> ok;
        _Failed -> pause()
    end.

pause() ->
    receive
    after ?PAUSE_MS -> ok
    end.

-spec hear(term(), #dist{}) -> {[starl_packet:t()], #dist{}} | unknown.
hear({'DOWN', Monitor, process, _Pid, _Why}, #dist{connecting = Connecting} = Dist) ->
    Left = maps:filter(fun(_Node, Ref) -> Ref =/= Monitor end, Connecting),
    {[], Dist#dist{connecting = Left}};
hear({?MODULE, connect}, Dist) ->
    {[], connect_all(Dist)};
hear(Message, #dist{ends = Ends, heard = Heard} = Dist) ->
    case starl_live_frame:read(Message, Ends) of
        {Packets, Next} ->
            Now = erlang:monotonic_time(millisecond),
            From = maps:from_list([{starl_packet:source(Packet), Now} || Packet <- Packets]),
            {Packets, Dist#dist{ends = Next, heard = maps:merge(Heard, From)}};
        unknown ->
            unknown
    end.

count(What, #dist{ends = Ends} = Dist) -> Dist#dist{ends = starl_live_frame:count(What, Ends)}.

-spec figures(#dist{}) -> starl_live_transport:figures().
figures(#dist{ends = Ends}) -> starl_live_frame:figures(Ends).

%% A connection is a sign of life: distribution itself ends one that has been silent for a minute.
-spec peers(#dist{}) -> [starl_live_peers:peer()].
peers(#dist{peers = Peers, robot = Robot, heard = Heard}) ->
    Connected = [node() | nodes(connected)],
    Now = erlang:monotonic_time(millisecond),
    [
        peer(Other, lists:member(Node, Connected), [Now - At || #{Other := At} <- [Heard]])
     || {Other, Node} <- lists:sort(maps:to_list(Peers)), Other =/= Robot
    ].

peer(Robot, IsConnected, Ago) ->
    {Silence, Why} =
        case {IsConnected, Ago} of
            {true, []} -> {0, none};
            {true, [Ms]} -> {Ms, none};
            {false, []} -> {never, not_connected};
            {false, [Ms]} -> {Ms, not_connected}
        end,
    #{
        robot => Robot,
        is_silent => not IsConnected,
        heard_ms => Silence,
        address => none,
        life => none,
        refused => #{},
        why => Why
    }.

%% The name goes with the process.
-spec close(#dist{}) -> ok.
close(#dist{}) -> ok.
