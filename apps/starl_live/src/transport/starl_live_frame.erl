%% @doc Frames packets as messages between Erlang processes, for the transports
%% {@link starl_live_local} and {@link starl_live_dist}. The messages carry the packet's bytes as on
%% every other transport. So a term that cannot travel between two computers does not travel between
%% two processes either.
%%
%% Processes of one VM, and nodes that are connected, trust each other: nothing is sealed. Fleet and
%% run are checked against mistakes, not against attacks.
-module(starl_live_frame).

-export([new/1, channel/1, write/3, read/2, figures/1, count/2]).

-export_type([t/0, frame/0, channel/0]).

%% Robots of one fleet and one run hear each other.
-type channel() :: {Fleet :: binary(), Run :: non_neg_integer()}.

-type frame() :: {
    starl_frame,
    channel(),
    From :: starl:robot_id(),
    To :: starl:robot_id() | all,
    Bytes :: binary()
}.

-record(ends, {
    channel :: channel(),
    robot :: starl:robot_id(),
    team :: starl_team:t(),
    figures = #{} :: starl_live_transport:figures()
}).

-opaque t() :: #ends{}.

%% @doc The robot's end, without figures yet.
-spec new(starl_live_transport:config()) -> t().
new(#{robot := Robot, participants := Team, fleet := Fleet, run := Run}) ->
    #ends{channel = {unicode:characters_to_binary(Fleet), Run}, robot = Robot, team = Team}.

%% @doc The channel that the robot shares.
-spec channel(t()) -> channel().
channel(#ends{channel = Channel}) -> Channel.

%% @doc The frame of a packet, and the robots that get it; or one line on a packet that cannot be
%% sent.
-spec write(starl:robot_id() | all, starl_packet:t(), t()) ->
    {ok, frame(), [starl:robot_id()], t()} | {refused, unicode:chardata()}.
write(To, Packet, #ends{channel = Channel, robot = Robot} = Ends) ->
    case starl_live_codec:encode(Packet) of
        {ok, Bytes} ->
            Frame = {starl_frame, Channel, Robot, To, Bytes},
            {ok, Frame, robots(To, Ends), count(sent, Ends)};
        {error, Why} ->
            {refused, starl_live_codec:format_error(Packet, Why)}
    end.

robots(all, #ends{robot = Robot, team = Team}) -> starl_team:others(Robot, Team);
robots(To, _Ends) -> [To].

%% @doc The packet of a frame; `unknown': the message is no frame.
-spec read(term(), t()) -> {[starl_packet:t()], t()} | unknown.
read({starl_frame, Channel, From, To, Bytes}, #ends{robot = Robot, team = Team} = Ends) when
    is_binary(Bytes)
->
    Member = is_integer(From) andalso From =/= Robot andalso starl_team:has(From, Team),
    if
        Channel =/= Ends#ends.channel -> {[], count(other_channel(Channel, Ends), Ends)};
        not Member -> {[], count(stranger, Ends)};
        To =/= all, To =/= Robot -> {[], count(address, Ends)};
        true -> decoded(From, starl_live_codec:decode(From, Bytes), Ends)
    end;
read(_Message, _Ends) ->
    unknown.

other_channel({Fleet, _}, #ends{channel = {Fleet, _}}) -> run;
other_channel(_, _) -> fleet.

decoded(_From, {ok, Packet}, Ends) ->
    {[Packet], Ends};
decoded(From, {error, Why}, #ends{figures = Figures} = Ends) ->
    {[], Ends#ends{figures = starl_live_transport:refused(Why, From, Figures)}}.

%% @doc The counters of this end.
-spec figures(t()) -> starl_live_transport:figures().
figures(#ends{figures = Figures}) -> Figures.

%% @doc One more of a kind.
-spec count(atom(), t()) -> t().
count(What, #ends{figures = Figures} = Ends) ->
    Ends#ends{figures = starl_live_transport:count(What, Figures)}.
