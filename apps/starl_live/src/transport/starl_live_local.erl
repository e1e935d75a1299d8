%% @doc The transport between robots of one VM. The robots find each other in a process group of the
%% VM.
-module(starl_live_local).
-behaviour(starl_live_transport).

-export([open/1, transmit/3, hear/2, figures/1, close/1]).

%% The scope of the process groups, which its first user starts and the VM keeps.
-define(SCOPE, ?MODULE).

-record(local, {ends :: starl_live_frame:t()}).

-spec open(starl_live_transport:config()) -> {ok, #local{}}.
open(#{robot := Robot} = Config) ->
    ok = scope(pg:start(?SCOPE)),
    Ends = starl_live_frame:new(Config),
    ok = pg:join(?SCOPE, {starl_live_frame:channel(Ends), Robot}, self()),
    {ok, #local{ends = Ends}}.

scope({ok, _Pid}) -> ok;
scope({error, {already_started, _Pid}}) -> ok.

-spec transmit(starl:robot_id() | all, starl_packet:t(), #local{}) ->
    {ok, #local{}} | {refused, unicode:chardata(), #local{}}.
transmit(To, Packet, #local{ends = Ends} = Local) ->
    case starl_live_frame:write(To, Packet, Ends) of
        {ok, Frame, Robots, Next} ->
            Channel = starl_live_frame:channel(Ends),
            lists:foreach(fun(Robot) -> send(Frame, {Channel, Robot}) end, Robots),
            {ok, Local#local{ends = Next}};
        {refused, Why} ->
            {refused, Why, Local}
    end.

%% The group may still hold a robot's process that has just ended; the latest comes first.
send(Frame, Group) ->
    case pg:get_local_members(?SCOPE, Group) of
        [Process | _] -> Process ! Frame;
        [] -> nobody
    end.

-spec hear(term(), #local{}) -> {[starl_packet:t()], #local{}} | unknown.
hear(Message, #local{ends = Ends} = Local) ->
    case starl_live_frame:read(Message, Ends) of
        {Packets, Next} -> {Packets, Local#local{ends = Next}};
        unknown -> unknown
    end.

-spec figures(#local{}) -> starl_live_transport:figures().
figures(#local{ends = Ends}) -> starl_live_frame:figures(Ends).

%% The group drops the process when it ends.
-spec close(#local{}) -> ok.
close(#local{}) -> ok.
