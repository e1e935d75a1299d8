%% @doc Reports what one end of a robot's radio knows of each packet: that it was sent, and what
%% became of it here ({@link starl_observer:packet_report()}).
-module(starl_live_packet_reports).

-export([teller/1, new/1, at_us/1, sent/4, refused/4, came/5]).

-export_type([t/0, teller/0]).

%% Takes what the radio tells; `none': nobody wants to know.
-type teller() :: fun(([starl_monitor:trace_event()]) -> ok) | none.

-record(reports, {
    robot :: starl:robot_id(),
    team :: starl_team:t(),
    clock :: starl_live_clock:t(),
    tell :: teller()
}).

-opaque t() :: #reports{}.

%% @doc Returns a function that passes the reports of a robot's radio to its sink and its observer;
%% `none' if nobody wants them.
-spec teller(#{sink := pid() | none, robot := starl:robot_id(), atom() => term()}) -> teller().
teller(#{robot := Robot, sink := Sink} = Spec) ->
    Observer = maps:get(observe, Spec, none),
    case is_pid(Sink) andalso maps:get(packets, Spec, false) of
        false when Observer =:= none ->
            none;
        false ->
            fun(Events) -> starl_observer:tell({judged, Events, []}, Observer) end;
        true ->
            fun(Events) ->
                Sink ! {starl_radio, Robot, Events},
                starl_observer:tell({judged, Events, []}, Observer)
            end
    end.

%% @doc The state of this for a transport; `none': nobody wants to know.
-spec new(starl_live_transport:config()) -> t() | none.
new(#{tell := Tell, clock := Clock, robot := Robot, participants := Team}) when Tell =/= none ->
    #reports{robot = Robot, team = Team, clock = Clock, tell = Tell};
new(#{}) ->
    none.

%% @doc The present time: that of a packet before it goes on the air.
-spec at_us(t() | none) -> integer().
at_us(none) -> 0;
at_us(#reports{clock = Clock}) -> starl_live_clock:now_us(Clock).

%% @doc A packet went on the air at this time.
-spec sent(starl:robot_id() | all, starl_packet:t(), AtUs :: integer(), t() | none) -> ok.
sent(_To, _Packet, _At, none) ->
    ok;
sent(To, Packet, At, Reports) ->
    {Brief, Bytes, Hash} = short(Packet),
    each(To, fun(Robot) -> {sent, Robot, Brief, Bytes, Hash} end, At, Reports).

%% @doc A packet could not be sent.
-spec refused(starl:robot_id() | all, starl_packet:t(), AtUs :: integer(), t() | none) -> ok.
refused(_To, _Packet, _At, none) ->
    ok;
refused(To, Packet, At, Reports) ->
    {Brief, Bytes, _Hash} = short(Packet),
    each(To, fun(Robot) -> {packet, Robot, Brief, Bytes, {lost, refused}} end, At, Reports).

each(all, Event, At, #reports{robot = Robot, team = Team} = Reports) ->
    tell([Event(Other) || Other <- starl_team:others(Robot, Team)], At, Reports);
each(To, Event, At, Reports) ->
    tell([Event(To)], At, Reports).

%% @doc A packet has come; the robot hears it after these delays, if any.
-spec came(starl:robot_id() | malformed, starl_packet:t(), Delays, IsCut, t() | none) -> ok when
    Delays :: [Ms :: non_neg_integer()], IsCut :: boolean().
came(From, _Packet, _Delays, _IsCut, Reports) when Reports =:= none; From =:= malformed -> ok;
came(From, Packet, Delays, IsCut, #reports{clock = Clock} = Reports) ->
    {Brief, Bytes, Hash} = short(Packet),
    Fate =
        case Delays of
            [] when IsCut -> {lost, cut};
            [] -> {lost, chance};
            _ -> {arrives, [{after_ms(Ms, Clock), intact} || Ms <- lists:sort(Delays)]}
        end,
    tell([{came, From, Brief, Bytes, Hash, Fate}], at_us(Reports), Reports).

after_ms(Ms, Clock) ->
    starl_live_clock:at_us(starl_live_clock:system_time(microsecond, Clock) + 1000 * Ms, Clock).

tell(Events, At, #reports{robot = Robot, tell = Tell}) ->
    Tell([{At, Robot, radio, Event} || Event <- Events]).

short(Packet) ->
    {starl_packet:brief(Packet), erlang:external_size(Packet), erlang:phash2(Packet)}.
