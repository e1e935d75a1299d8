%% @doc The sensor packets of the Open Interface: their names, sizes and signs, and the groups that
%% hold several. Both generations share one table; the Create 1 ends at packet 42.
%%
%% Sources: Create Open Interface (2006), Create 2 Open Interface (2016).
-module(starl_create_packet).

-export([bytes/1, byte_count/1, members/1, name/1, id/1, known/2]).
-export([encode/2, encode_all/2, decode/2, decode_all/2]).

-export_type([id/0, name/0, model/0, readings/0]).

%% The generation: 1 is the Create of 2006, 2 the Create 2 of 2014 (a Roomba 600).
-type model() :: 1 | 2.

%% The number of a packet or a group.
-type id() :: byte().

-type name() ::
    bumps_drops
    | wall
    | cliff_left
    | cliff_front_left
    | cliff_front_right
    | cliff_right
    | virtual_wall
    | overcurrents
    | dirt
    | unused
    | ir_omni
    | buttons
    | distance
    | angle
    | charging_state
    | voltage
    | current
    | temperature
    | charge
    | capacity
    | wall_signal
    | cliff_left_signal
    | cliff_front_left_signal
    | cliff_front_right_signal
    | cliff_right_signal
    | digital_inputs
    | analog_input
    | charging_sources
    | mode
    | song
    | song_playing
    | stream_packets
    | velocity
    | radius
    | right_velocity
    | left_velocity
    | left_encoder
    | right_encoder
    | light_bumper
    | light_left
    | light_front_left
    | light_center_left
    | light_center_right
    | light_front_right
    | light_right
    | ir_left
    | ir_right
    | left_current
    | right_current
    | main_brush_current
    | side_brush_current
    | stasis.

%% The values of packets, as numbers of the table. Encoders are unsigned here, so that they wrap at
%% 65536.
-type readings() :: #{name() => integer()}.

%% @doc The packets of a group, in their order; a packet alone is a group of one.
-spec members(id()) -> [id()] | unknown.
members(0) -> lists:seq(7, 26);
members(1) -> lists:seq(7, 16);
members(2) -> lists:seq(17, 20);
members(3) -> lists:seq(21, 26);
members(4) -> lists:seq(27, 34);
members(5) -> lists:seq(35, 42);
members(6) -> lists:seq(7, 42);
members(100) -> lists:seq(7, 58);
members(101) -> lists:seq(43, 58);
members(106) -> lists:seq(46, 51);
members(107) -> lists:seq(54, 58);
members(Id) when Id >= 7, Id =< 58 -> [Id];
members(_) -> unknown.

%% @doc Does this generation know the packet or group?
-spec known(id(), model()) -> boolean().
known(Id, 1) -> Id >= 0 andalso Id =< 42;
known(Id, 2) -> members(Id) =/= unknown.

%% @doc The number of data bytes of a packet or group that exists.
-spec bytes(id()) -> pos_integer().
bytes(Id) -> total([element(2, row(Member)) || Member <- members(Id)]).

%% @doc The number of data bytes of several.
-spec byte_count([id()]) -> non_neg_integer().
byte_count(Ids) -> total([bytes(Id) || Id <- Ids]).

%% A sum of whole numbers is one: the guard tells the type checker so.
total(Numbers) ->
    case lists:sum(Numbers) of
        Sum when is_integer(Sum) -> Sum
    end.

%% @doc The name of a single packet.
-spec name(7..58) -> name().
name(Id) -> element(1, row(Id)).

%% @doc The number of a named packet.
-spec id(name()) -> 7..58.
id(Name) -> id(Name, 7).

id(Name, Id) ->
    case row(Id) of
        {Name, _, _} -> Id;
        _ -> id(Name, Id + 1)
    end.

%% @doc The data bytes of a packet or group; a reading that is missing is 0.
-spec encode(id(), readings()) -> binary().
encode(Id, Readings) ->
    <<<<(one(row(Member), Readings))/binary>> || Member <- members(Id)>>.

one({Name, Bytes, _Sign}, Readings) ->
    Bits = 8 * Bytes,
    <<(maps:get(Name, Readings, 0)):Bits>>.

%% @doc The data bytes of several, one after the other.
-spec encode_all([id()], readings()) -> binary().
encode_all(Ids, Readings) -> <<<<(encode(Id, Readings))/binary>> || Id <- Ids>>.

%% @doc The readings of a packet or group from exactly its data bytes.
-spec decode(id(), binary()) -> readings().
decode(Id, Data) -> values([row(Member) || Member <- members(Id)], Data, #{}).

values([], <<>>, Readings) ->
    Readings;
values([{Name, Bytes, unsigned} | Rows], Data, Readings) ->
    Bits = 8 * Bytes,
    <<Value:Bits/unsigned, Rest/binary>> = Data,
    values(Rows, Rest, Readings#{Name => Value});
values([{Name, Bytes, signed} | Rows], Data, Readings) ->
    Bits = 8 * Bytes,
    <<Value:Bits/signed, Rest/binary>> = Data,
    values(Rows, Rest, Readings#{Name => Value}).

%% @doc The readings of several: the answer to a query list.
-spec decode_all([id()], binary()) -> readings().
decode_all(Ids, Data) ->
    {Readings, <<>>} = lists:foldl(
        fun(Id, {Before, Left}) ->
            Size = bytes(Id),
            <<Own:Size/binary, Rest/binary>> = Left,
            {maps:merge(Before, decode(Id, Own)), Rest}
        end,
        {#{}, Data},
        Ids
    ),
    Readings.

%% The table: name, bytes, sign; in the groups of the documents.
row(Id) when Id =< 16 -> contact(Id);
row(Id) when Id =< 20 -> motion(Id);
row(Id) when Id =< 26 -> power(Id);
row(Id) when Id =< 34 -> signal(Id);
row(Id) when Id =< 42 -> state(Id);
row(Id) when Id =< 53 -> encoder_or_light(Id);
row(Id) -> current(Id).

contact(7) -> {bumps_drops, 1, unsigned};
contact(8) -> {wall, 1, unsigned};
contact(9) -> {cliff_left, 1, unsigned};
contact(10) -> {cliff_front_left, 1, unsigned};
contact(11) -> {cliff_front_right, 1, unsigned};
contact(12) -> {cliff_right, 1, unsigned};
contact(13) -> {virtual_wall, 1, unsigned};
contact(14) -> {overcurrents, 1, unsigned};
contact(15) -> {dirt, 1, unsigned};
contact(16) -> {unused, 1, unsigned}.

motion(17) -> {ir_omni, 1, unsigned};
motion(18) -> {buttons, 1, unsigned};
motion(19) -> {distance, 2, signed};
motion(20) -> {angle, 2, signed}.

power(21) -> {charging_state, 1, unsigned};
power(22) -> {voltage, 2, unsigned};
power(23) -> {current, 2, signed};
power(24) -> {temperature, 1, signed};
power(25) -> {charge, 2, unsigned};
power(26) -> {capacity, 2, unsigned}.

signal(27) -> {wall_signal, 2, unsigned};
signal(28) -> {cliff_left_signal, 2, unsigned};
signal(29) -> {cliff_front_left_signal, 2, unsigned};
signal(30) -> {cliff_front_right_signal, 2, unsigned};
signal(31) -> {cliff_right_signal, 2, unsigned};
signal(32) -> {digital_inputs, 1, unsigned};
signal(33) -> {analog_input, 2, unsigned};
signal(34) -> {charging_sources, 1, unsigned}.

state(35) -> {mode, 1, unsigned};
state(36) -> {song, 1, unsigned};
state(37) -> {song_playing, 1, unsigned};
state(38) -> {stream_packets, 1, unsigned};
state(39) -> {velocity, 2, signed};
state(40) -> {radius, 2, signed};
state(41) -> {right_velocity, 2, signed};
state(42) -> {left_velocity, 2, signed}.

encoder_or_light(43) -> {left_encoder, 2, unsigned};
encoder_or_light(44) -> {right_encoder, 2, unsigned};
encoder_or_light(45) -> {light_bumper, 1, unsigned};
encoder_or_light(46) -> {light_left, 2, unsigned};
encoder_or_light(47) -> {light_front_left, 2, unsigned};
encoder_or_light(48) -> {light_center_left, 2, unsigned};
encoder_or_light(49) -> {light_center_right, 2, unsigned};
encoder_or_light(50) -> {light_front_right, 2, unsigned};
encoder_or_light(51) -> {light_right, 2, unsigned};
encoder_or_light(52) -> {ir_left, 1, unsigned};
encoder_or_light(53) -> {ir_right, 1, unsigned}.

current(54) -> {left_current, 2, signed};
current(55) -> {right_current, 2, signed};
current(56) -> {main_brush_current, 2, signed};
current(57) -> {side_brush_current, 2, signed};
current(58) -> {stasis, 1, unsigned}.
