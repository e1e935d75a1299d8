%% @doc Frames packets as messages between Erlang processes, for the transports
%% {@link starl_live_local} and {@link starl_live_dist}. The messages carry the packet's bytes as on
%% every other transport. So a term that cannot travel between two computers does not travel between
%% two processes either.
%%
%% Processes of one VM, and nodes that are connected, trust each other: nothing is sealed. Fleet and
%% run are checked against mistakes, not against attacks.
-module(starl_live_frame).

-export([new/1, air/1, write/3, read/2, figures/1, count/2]).

-export_type([t/0, frame/0, air/0]).

%% Robots of one fleet and one run hear each other.
-type air() :: {Fleet :: binary(), Run :: non_neg_integer()}.

-type frame() :: {
    starl_frame, air(), From :: starl:robot_id(), To :: starl:robot_id() | all, Bytes :: binary()
}.

-record(ends, {
    air :: air(),
    robot :: starl:robot_id(),
    team :: starl_team:t(),
    figures = #{} :: starl_live_transport:figures()
}).

-opaque t() :: #ends{}.

%% @doc The robot's end, without figures yet.
-spec new(starl_live_transport:config()) -> t().
new(#{robot := Robot, participants := Team, fleet := Fleet, run := Run}) ->
    #ends{air = {unicode:characters_to_binary(Fleet), Run}, robot = Robot, team = Team}.

%% @doc The air that the robot shares.
-spec air(t()) -> air().
air(#ends{air = Air}) -> Air.

%% @doc The frame of a packet, and the robots that get it; or one line on a packet that cannot be
%% sent.
-spec write(starl:robot_id() | all, starl_packet:t(), t()) ->
    {ok, frame(), [starl:robot_id()], t()} | {refused, unicode:chardata()}.
write(To, Packet, #ends{air = Air, robot = Robot} = Ends) ->
    case starl_live_codec:encode(Packet) of
        {ok, Bytes} ->
            Frame = {starl_frame, Air, Robot, To, Bytes},
            {ok, Frame, robots(To, Ends), count(sent, Ends)};
        {error, Why} ->
            {refused, starl_live_codec:format_error(Packet, Why)}
    end.

robots(all, #ends{robot = Robot, team = Team}) -> starl_team:others(Robot, Team);
robots(To, _Ends) -> [To].

%% @doc The packet of a frame; `unknown': the message is no frame.
-spec read(term(), t()) -> {[starl_packet:t()], t()} | unknown.
read({starl_frame, Air, From, To, Bytes}, #ends{robot = Robot, team = Team} = Ends) when
    is_binary(Bytes)
->
    Member = is_integer(From) andalso From =/= Robot andalso starl_team:has(From, Team),
    if
        Air =/= Ends#ends.air -> {[], count(other_air(Air, Ends), Ends)};
        not Member -> {[], count(stranger, Ends)};
        To =/= all, To =/= Robot -> {[], count(address, Ends)};
        true -> decoded(From, starl_live_codec:decode(From, Bytes), Ends)
    end;
read(_Message, _Ends) ->
    unknown.

other_air({Fleet, _}, #ends{air = {Fleet, _}}) -> run;
other_air(_, _) -> fleet.

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
