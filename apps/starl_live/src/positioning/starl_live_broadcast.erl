%% @doc The positioning broadcast: one small datagram reports to all robots where all of them are.
%% This module writes the datagrams for any system that measures positions. It also reads them, as a
%% source of {@link starl_live_positioning}.
%%
%% Format, version 1; all numbers little-endian. A datagram has at most 1,200 bytes. A picture of
%% more robots than fit is sent in several datagrams with the same number and time.
%% ```
%%     0   2  "SP"
%%     2   1  version, 1
%%     3   1  flags: 1 whole millimetres and milliradians, else micrometres and microradians
%%                   2 the datagram ends with a seal
%%     4   4  run: datagrams of another run are ignored
%%     8   4  number of the picture
%%    12   8  when it was taken, signed: system time in microseconds
%%    20   1  n, the number of robots
%%    21 14n  robot (2), x, y, heading (4 each, signed)
%%       16   with flag 2, the seal: HMAC-SHA-256 of all before it, truncated
%% '''
%% The key of the seal is HMAC-SHA-256 of the words "starl positioning 1" with the fleet's key.
%%
%% Options of the source: `port' (51000), `group', `interface' ({@link starl_live_datagrams}); `run'
%% (0). `key': the fleet's key; with it all datagrams must be sealed, have a time within ten seconds
%% of ours, and never go back in time. `latency_us' (0): the least time between the moment given as
%% `when taken' and the arrival here.
-module(starl_live_broadcast).
-behaviour(starl_live_positioning).

-export([encode/4, decode/2, seal_key/1]).
-export([open/1, hear/2, figures/1, close/1]).
-export([new/1, datagram/3]).

-export_type([options/0, content/0, reason/0, seal_key/0, pure/0]).

-type options() :: #{run => 0..16#ffffffff, rounded => boolean(), seal_key => seal_key()}.

%% Hidden in a function: so it stands in no log.
-type seal_key() :: fun(() -> binary()).

%% What a datagram says. `rounded': in whole millimetres, so that a robot which stands shows the same
%% pose again and again.
-type content() :: #{
    number := non_neg_integer(),
    time_us := integer(),
    rounded := boolean(),
    poses := [{starl:robot_id(), starl:pose()}]
}.

%% Not of this format; of a later version; a length that does not fit; of another run; without or
%% with a wrong seal; sealed, and we have no key; a place or a heading that cannot be.
-type reason() ::
    not_ours | version | truncated | other_run | unsealed | forged | no_key | absurd.

-define(VERSION, 1).
-define(ROUNDED, 1).
-define(SEALED, 2).
-define(HEADER, 21).
-define(ROBOT, 14).
-define(SEAL, 16).
-define(LARGEST, 1200).
%% Robots that fit into a datagram.
-define(MOST, ((?LARGEST - ?HEADER - ?SEAL) div ?ROBOT)).
-define(PORT, 51000).
%% The largest coordinate (mm), and the largest heading with its rounding (rad).
-define(FAR_MM, 1.0e6).
-define(HALF_TURN, 3.1425).
%% How far the clocks of two computers may be apart.
-define(SKEW_US, 10000000).

-record(broadcast, {
    options :: options(),
    participants :: starl_team:t(),
    clock :: starl_live_clock:t(),
    latency_us :: non_neg_integer(),
    frames = starl_live_frames:new() :: starl_live_frames:t(),
    %% the latest time under a seal
    sealed_us = none :: integer() | none,
    figures = #{} :: starl_live_positioning:figures()
}).

-opaque pure() :: #broadcast{}.

%% -- the format -----------------------------------------------------------------------------

%% @doc The datagrams that show robots. Their number is one more than that of the picture before.
-spec encode(
    Number :: non_neg_integer(), TakenUs :: integer(), [{starl:robot_id(), starl:pose()}], options()
) -> [binary()].
encode(Number, TakenUs, Poses, Options) ->
    [encode_one(Number, TakenUs, Part, Options) || Part <- parts(Poses)].

parts(Poses) when length(Poses) =< ?MOST -> [Poses];
parts(Poses) ->
    {Part, Rest} = lists:split(?MOST, Poses),
    [Part | parts(Rest)].

encode_one(Number, TakenUs, Poses, Options) ->
    Rounded = maps:get(rounded, Options, false),
    Run = maps:get(run, Options, 0),
    Robots = [robot(Robot, Pose, unit(Rounded)) || {Robot, Pose} <- Poses],
    Flags = flag(Rounded, ?ROUNDED) bor flag(is_map_key(seal_key, Options), ?SEALED),
    sealed(
        iolist_to_binary([
            <<"SP", ?VERSION, Flags, Run:32/little, Number:32/little, TakenUs:64/little-signed>>,
            length(Poses)
            | Robots
        ]),
        Options
    ).

flag(true, Flag) -> Flag;
flag(false, _) -> 0.

unit(true) -> 1;
unit(false) -> 1000.

robot(Robot, {X, Y, Heading}, Unit) when Robot > 0, Robot < 65536 ->
    <<Robot:16/little, (whole(X, Unit)):32/little-signed, (whole(Y, Unit)):32/little-signed,
        (whole(Heading, 1000 * Unit)):32/little-signed>>.

whole(Value, Unit) -> round(Value * Unit).

sealed(Datagram, #{seal_key := Key}) -> <<Datagram/binary, (seal(Datagram, Key))/binary>>;
sealed(Datagram, _Options) -> Datagram.

seal(Datagram, Key) -> crypto:macN(hmac, sha256, Key(), Datagram, ?SEAL).

%% @doc The key of the seal, from the fleet's key, which may be hidden in a function likewise.
-spec seal_key(FleetKey :: binary() | fun(() -> binary())) -> seal_key().
seal_key(FleetKey) when is_function(FleetKey, 0) ->
    seal_key(FleetKey());
seal_key(FleetKey) ->
    Key = crypto:mac(hmac, sha256, FleetKey, <<"starl positioning 1">>),
    fun() -> Key end.

%% @doc Reads a datagram. With a key, nothing but the header is looked at before the seal.
-spec decode(binary(), options()) -> {ok, content()} | {error, reason()}.
decode(<<"SP", ?VERSION, Flags, Run:32/little, _/binary>> = Datagram, Options) ->
    case {maps:get(run, Options, 0), Flags band ?SEALED, Options} of
        {Run, 0, #{seal_key := _}} -> {error, unsealed};
        {Run, 0, _} -> content(Datagram);
        {Run, _, #{seal_key := Key}} -> open_seal(Datagram, Key);
        {Run, _, _} -> {error, no_key};
        _ -> {error, other_run}
    end;
decode(<<"SP", Version, _/binary>>, _Options) when Version =/= ?VERSION -> {error, version};
decode(<<"SP", _/binary>>, _Options) ->
    {error, truncated};
decode(_, _Options) ->
    {error, not_ours}.

open_seal(Datagram, Key) when byte_size(Datagram) >= ?HEADER + ?SEAL ->
    {Content, Seal} = split_binary(Datagram, byte_size(Datagram) - ?SEAL),
    case crypto:hash_equals(seal(Content, Key), Seal) of
        true -> content(Content);
        false -> {error, forged}
    end;
open_seal(_Datagram, _Key) ->
    {error, truncated}.

content(
    <<_:3/binary, Flags, _:32, Number:32/little, TimeUs:64/little-signed, N, Robots/binary>>
) when byte_size(Robots) =:= N * ?ROBOT ->
    Rounded = Flags band ?ROUNDED =/= 0,
    Poses = [
        {Robot, {X / unit(Rounded), Y / unit(Rounded), Heading / (1000 * unit(Rounded))}}
     || <<Robot:16/little, X:32/little-signed, Y:32/little-signed, Heading:32/little-signed>> <=
            Robots
    ],
    case lists:all(fun is_possible/1, Poses) of
        true -> {ok, #{number => Number, time_us => TimeUs, rounded => Rounded, poses => Poses}};
        false -> {error, absurd}
    end;
content(_) ->
    {error, truncated}.

is_possible({Robot, {X, Y, Heading}}) ->
    Robot > 0 andalso abs(X) =< ?FAR_MM andalso abs(Y) =< ?FAR_MM andalso
        abs(Heading) =< ?HALF_TURN.

%% -- the source -----------------------------------------------------------------------------

%% @doc Opens the socket.
-spec open(starl_live_positioning:config()) ->
    {ok, {gen_udp:socket(), pure()}} | {error, iolist()}.
open(Config) ->
    case checked(Config) of
        ok ->
            case starl_live_datagrams:open(maps:get(port, Config, ?PORT), Config) of
                {ok, Socket} -> {ok, {Socket, new(Config)}};
                {error, _} = Error -> Error
            end;
        {error, _} = Error ->
            Error
    end.

checked(#{run := Run}) when not is_integer(Run); Run < 0; Run > 16#ffffffff ->
    {error, io_lib:format("run must be a number from 0 to 4294967295, not ~0p", [Run])};
checked(#{key := Key}) when not is_binary(Key), not is_function(Key, 0) ->
    {error, "key must be the fleet's key, a binary"};
checked(_) ->
    ok.

%% @doc Nothing has arrived yet.
-spec new(starl_live_positioning:config()) -> pure().
new(#{participants := Participants, clock := Clock} = Config) ->
    Keys = maps:from_list([{seal_key, seal_key(Key)} || #{key := Key} <- [Config]]),
    #broadcast{
        options = maps:merge(maps:with([run], Config), Keys),
        participants = Participants,
        clock = Clock,
        latency_us = maps:get(latency_us, Config, 0)
    }.

-spec hear(term(), {gen_udp:socket(), pure()}) ->
    {[starl_live_positioning:sighting()], {gen_udp:socket(), pure()}} | unknown.
hear(Message, {Socket, Pure}) ->
    case starl_live_datagrams:hear(Message, Socket) of
        {datagram, _From, Datagram} ->
            {Sightings, Next} = datagram(Datagram, erlang:system_time(microsecond), Pure),
            {Sightings, {Socket, Next}};
        nothing ->
            {[], {Socket, Pure}};
        unknown ->
            unknown
    end.

-spec figures({gen_udp:socket(), pure()}) -> starl_live_positioning:figures().
figures({_Socket, #broadcast{figures = Figures}}) -> Figures.

-spec close({gen_udp:socket(), pure()}) -> ok.
close({Socket, _Pure}) -> gen_udp:close(Socket).

%% @doc The robots that a datagram shows, which has arrived at this system time.
-spec datagram(binary(), ArrivedUs :: integer(), pure()) ->
    {[starl_live_positioning:sighting()], pure()}.
datagram(Datagram, Arrived, #broadcast{options = Options} = Pure) ->
    case decode(Datagram, Options) of
        {ok, #{time_us := Time} = Content} ->
            case dated(Time, Arrived, Pure) of
                current -> content(Content, Arrived, Pure);
                Refused -> {[], count(Refused, Pure)}
            end;
        {error, Reason} ->
            {[], count(Reason, Pure)}
    end.

%% A sealed datagram that was recorded is of no use later, also to a robot that has just started. The
%% computer's clock may have been wrong then, and set right since.
dated(Time, Arrived, #broadcast{options = #{seal_key := _}, sealed_us = Last, clock = Clock}) ->
    Day = Arrived - starl_live_clock:ahead_us(Clock),
    if
        abs(Day - Time) > ?SKEW_US -> wrong_time;
        Last =/= none, Time < Last -> old;
        true -> current
    end;
dated(_Time, _Arrived, _Pure) ->
    current.

content(#{number := Number, time_us := Time, poses := Poses}, Arrived, Pure) ->
    #broadcast{participants = Participants, frames = Frames} = Pure,
    Ours = [One || {Robot, _} = One <- Poses, starl_team:has(Robot, Participants)],
    Picture = #{
        number => Number, time_us => Time, age_us => Pure#broadcast.latency_us, poses => Ours
    },
    {Order, Shown, Next} = starl_live_frames:picture(Picture, Arrived, Frames),
    Sightings = [
        {Robot, Pose, starl_live_clock:at_us(Taken, Pure#broadcast.clock)}
     || {Robot, Pose, Taken} <- Shown
    ],
    {Sightings, count(figure(Order), Pure#broadcast{frames = Next, sealed_us = Time})}.

figure(old) -> old;
figure(_) -> datagrams.

count(Figure, #broadcast{figures = Figures} = Pure) ->
    Pure#broadcast{figures = maps:update_with(Figure, fun(N) -> N + 1 end, 1, Figures)}.
