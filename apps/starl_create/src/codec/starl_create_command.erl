%% @doc The commands of the Open Interface as terms and as bytes, of both generations.
%%
%% A command is the name of its opcode, with its data, as in `{drive_direct, Right, Left}'. What is
%% decoded need not be valid: a number out of its range makes the whole command `invalid()',
%% and a robot ignores it.
%%
%% Sources: Create Open Interface (2006), Create 2 Open Interface (2016).
-module(starl_create_command).

-export([encode/2, encode_all/2, check/2, decode/2]).

-export_type([t/0, radius/0]).

%% A turning circle (mm, left if positive), or one of the special cases.
-type radius() :: straight | clockwise | counterclockwise | -2000..2000.

%% `max', `reset', `power', `stop', `drive_pwm', `buttons' and whatever concerns the digits, the schedule and
%% the clock are the Create 2's; `demo', `outputs', `send_ir', scripts and waits the Create 1's.
-type t() ::
    reset
    | start
    | {baud, Code :: 0..11}
    | control
    | safe
    | full
    | power
    | spot
    | clean
    | {demo, -1..9}
    | max
    | {drive, MmS :: -500..500, radius()}
    | {motors, Bits :: byte()}
    | {leds, Bits :: byte(), Colour :: byte(), Intensity :: byte()}
    | {song, Number :: 0..15, [{Note :: byte(), Duration :: byte()}, ...]}
    | {play, Number :: 0..15}
    | {sensors, starl_create_packet:id()}
    | dock
    | {pwm_motors, -128..128, -128..128, 0..128}
    | {drive_direct, Right :: -500..500, Left :: -500..500}
    | {drive_pwm, Right :: -255..255, Left :: -255..255}
    | {outputs, Bits :: 0..7}
    | {stream, [starl_create_packet:id()]}
    | {query, [starl_create_packet:id()]}
    | {stream_on, 0..1}
    | {send_ir, byte()}
    | {script, binary()}
    | play_script
    | show_script
    | {wait_time, Tenths :: byte()}
    | {wait_distance, Mm :: integer()}
    | {wait_angle, Degrees :: integer()}
    | {wait_event, -22..22}
    | {scheduling_leds, byte(), byte()}
    | {digits_raw, byte(), byte(), byte(), byte()}
    | {digits, 32..126, 32..126, 32..126, 32..126}
    | {buttons, byte()}
    | {schedule, binary()}
    | {day_time, Day :: 0..6, Hour :: 0..23, Minute :: 0..59}
    | stop.

%% A field of a command: a number in a range, or of a kind of its own.
-type field() :: {u8 | i8 | i16, integer(), integer()} | radius | song | ids | script | schedule.

%% @doc The bytes of a command for this generation. A command that it does not have is an error of
%% the caller.
-spec encode(t(), starl_create_packet:model()) -> binary().
encode(Command, Model) ->
    case check(Command, Model) of
        ok -> bytes(Command, Model);
        {error, _} -> error({no_command, Command, Model})
    end.

%% @doc The bytes of several commands.
-spec encode_all([t()], starl_create_packet:model()) -> binary().
encode_all(Commands, Model) -> <<<<(encode(C, Model))/binary>> || C <- Commands>>.

%% @doc Is it a command of this generation, with numbers in their ranges?
-spec check(term(), starl_create_packet:model()) -> ok | {error, unknown | range}.
check(Command, Model) ->
    case row(name(Command), Model) of
        none -> {error, unknown};
        {_Op, Fields} -> ranges(Fields, data(Command))
    end.

ranges(Fields, Data) when length(Fields) =/= length(Data) ->
    {error, unknown};
ranges(Fields, Data) ->
    case lists:all(fun({Field, Value}) -> fits(Field, Value) end, lists:zip(Fields, Data)) of
        true -> ok;
        false -> {error, range}
    end.

name(Command) when is_tuple(Command), tuple_size(Command) > 0 -> element(1, Command);
name(Command) -> Command.

data({song, Number, Notes}) -> [{Number, Notes}];
data(Command) when is_tuple(Command) -> tl(tuple_to_list(Command));
data(_) -> [].

fits({_, Least, Most}, N) -> is_integer(N) andalso N >= Least andalso N =< Most;
fits(radius, Radius) -> is_radius(Radius);
fits(ids, Ids) -> is_list(Ids) andalso length(Ids) =< 255 andalso lists:all(fun is_byte/1, Ids);
fits(script, Script) -> is_binary(Script) andalso byte_size(Script) =< 100;
fits(schedule, Bytes) -> is_binary(Bytes) andalso byte_size(Bytes) =:= 15;
fits(song, {Number, Notes}) -> is_byte(Number) andalso Number =< 15 andalso is_notes(Notes).

is_radius(Special) when is_atom(Special) ->
    lists:member(Special, [straight, clockwise, counterclockwise]);
is_radius(Mm) ->
    is_integer(Mm) andalso abs(Mm) =< 2000 andalso abs(Mm) =/= 1.

is_byte(N) -> is_integer(N) andalso N >= 0 andalso N =< 255.

is_notes(Notes) when is_list(Notes), length(Notes) >= 1, length(Notes) =< 16 ->
    lists:all(
        fun
            ({Note, Duration}) -> is_byte(Note) andalso is_byte(Duration);
            (_) -> false
        end,
        Notes
    );
is_notes(_) ->
    false.

bytes(Command, Model) ->
    {Op, Fields} = row(name(Command), Model),
    Data = <<<<(field(F, V))/binary>> || {F, V} <- lists:zip(Fields, data(Command))>>,
    <<Op, Data/binary>>.

field({i16, _, _}, N) -> <<N:16>>;
field({_, _, _}, N) -> <<N>>;
field(radius, straight) -> <<16#8000:16>>;
field(radius, clockwise) -> <<-1:16>>;
field(radius, counterclockwise) -> <<1:16>>;
field(radius, Mm) -> <<Mm:16>>;
field(ids, Ids) -> <<(length(Ids)), (list_to_binary(Ids))/binary>>;
field(script, Script) -> <<(byte_size(Script)), Script/binary>>;
field(schedule, Bytes) -> Bytes;
field(song, {Number, Notes}) -> <<Number, (length(Notes)), <<<<N, D>> || {N, D} <- Notes>>/binary>>.

%% @doc Takes the first command off the bytes. `more': it is not complete; a robot waits for the
%% rest without a time limit. `invalid': a number is out of its range. `unknown': no opcode.
-spec decode(binary(), starl_create_packet:model()) ->
    {ok, t(), Rest :: binary()}
    | {invalid, Bytes :: binary(), Rest :: binary()}
    | {unknown, byte(), Rest :: binary()}
    | more.
decode(<<>>, _Model) ->
    more;
decode(<<Op, Rest/binary>> = All, Model) ->
    case by_opcode(Op, Model) of
        none -> {unknown, Op, Rest};
        {Name, Fields} -> decoded(Name, values(Fields, Rest, []), All)
    end.

decoded(_Name, more, _All) ->
    more;
decoded(Name, {IsValid, Values, Rest}, All) ->
    Length = byte_size(All) - byte_size(Rest),
    <<Own:Length/binary, _/binary>> = All,
    case IsValid of
        true -> {ok, command(Name, Values), Rest};
        false -> {invalid, Own, Rest}
    end.

command(Name, []) -> Name;
command(song, [{Number, Notes}]) -> {song, Number, Notes};
command(Name, Values) -> list_to_tuple([Name | Values]).

values([], Rest, Values) ->
    {not lists:member(invalid, Values), lists:reverse(Values), Rest};
values([Field | Fields], Bytes, Values) ->
    case value(Field, Bytes) of
        more -> more;
        {Value, Rest} -> values(Fields, Rest, [valid(Field, Value) | Values])
    end.

valid(Field, Value) ->
    case fits(Field, Value) of
        true -> Value;
        false -> invalid
    end.

value({i16, _, _}, <<N:16/signed, Rest/binary>>) ->
    {N, Rest};
value({i8, _, _}, <<N/signed, Rest/binary>>) ->
    {N, Rest};
value({u8, _, _}, <<N, Rest/binary>>) ->
    {N, Rest};
value(radius, <<Mm:16/signed, Rest/binary>>) ->
    {radius(Mm), Rest};
value(ids, <<N, Ids:N/binary, Rest/binary>>) ->
    {binary_to_list(Ids), Rest};
value(script, <<N, Script:N/binary, Rest/binary>>) ->
    {Script, Rest};
value(schedule, <<Bytes:15/binary, Rest/binary>>) ->
    {Bytes, Rest};
value(song, <<Number, N, Notes:(2 * N)/binary, Rest/binary>>) ->
    {{Number, [{Note, Duration} || <<Note, Duration>> <= Notes]}, Rest};
value(_, _) ->
    more.

radius(-16#8000) -> straight;
radius(16#7FFF) -> straight;
radius(-1) -> clockwise;
radius(1) -> counterclockwise;
radius(Mm) -> Mm.

-define(BYTE, {u8, 0, 255}).
-define(WHEEL, {i16, -500, 500}).

-spec row(term(), starl_create_packet:model()) -> {byte(), [field()]} | none.
row(Name, Model) ->
    case [{Op, Fields} || {Op, N, Fields} <- rows(Model), N =:= Name] of
        [Row] -> Row;
        [] -> none
    end.

by_opcode(Op, Model) ->
    case lists:keyfind(Op, 1, rows(Model)) of
        {Op, Name, Fields} -> {Name, Fields};
        false -> none
    end.

rows(1) -> create_1() ++ common();
rows(2) -> create_2() ++ common().

create_1() ->
    [
        {136, demo, [{i8, -1, 9}]},
        {144, pwm_motors, [{u8, 0, 128}, {u8, 0, 128}, {u8, 0, 128}]},
        {147, outputs, [{u8, 0, 7}]},
        {151, send_ir, [?BYTE]},
        {152, script, [script]},
        {153, play_script, []},
        {154, show_script, []},
        {155, wait_time, [?BYTE]},
        {156, wait_distance, [{i16, -32768, 32767}]},
        {157, wait_angle, [{i16, -32768, 32767}]},
        {158, wait_event, [{i8, -22, 22}]}
    ].

create_2() ->
    [
        {7, reset, []},
        {133, power, []},
        {136, max, []},
        {144, pwm_motors, [{i8, -127, 127}, {i8, -127, 127}, {u8, 0, 127}]},
        {146, drive_pwm, [{i16, -255, 255}, {i16, -255, 255}]},
        {162, scheduling_leds, [?BYTE, ?BYTE]},
        {163, digits_raw, [?BYTE, ?BYTE, ?BYTE, ?BYTE]},
        {164, digits, lists:duplicate(4, {u8, 32, 126})},
        {165, buttons, [?BYTE]},
        {167, schedule, [schedule]},
        {168, day_time, [{u8, 0, 6}, {u8, 0, 23}, {u8, 0, 59}]},
        {173, stop, []}
    ].

common() ->
    [
        {128, start, []},
        {129, baud, [{u8, 0, 11}]},
        {130, control, []},
        {131, safe, []},
        {132, full, []},
        {134, spot, []},
        {135, clean, []},
        {137, drive, [?WHEEL, radius]},
        {138, motors, [?BYTE]},
        {139, leds, [?BYTE, ?BYTE, ?BYTE]},
        {140, song, [song]},
        {141, play, [{u8, 0, 15}]},
        {142, sensors, [?BYTE]},
        {143, dock, []},
        {145, drive_direct, [?WHEEL, ?WHEEL]},
        {148, stream, [ids]},
        {149, query, [ids]},
        {150, stream_on, [{u8, 0, 1}]}
    ].
