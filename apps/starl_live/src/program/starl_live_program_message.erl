%% @doc Encodes and decodes the messages between StarL and a chassis that is a program, one JSON
%% object a line: see `doc/chassis.md'. A pure module; numbers are checked, unknown messages and
%% keys are ignored.
-module(starl_live_program_message).

-export([encode/1, decode/1, value/1]).

-export_type([command/0, message/0, limits/0, leg/0, kind/0]).

%% A leg of a drive: mm/s ahead, rad/s to the left, and its time; at its end begins the next, after the last the
%% robot stands.
-type leg() :: {V :: number(), W :: number(), Ms :: number()}.

%% What StarL says. `at': where the robot stands when the program starts, if that is known.
-type command() ::
    {hello, #{robot := starl:robot_id(), at => starl:pose()}}
    | {drive, Id :: pos_integer(), [leg()]}
    | {set, Id :: pos_integer(), Device :: binary(), value()}
    | {ping, N :: pos_integer()}
    | stop
    | rest.

-type value() :: number() | binary() | boolean() | [value()].

%% What a program says of itself. `frame': its poses begin where it starts (`start'), or are places on the
%% floor. The speeds are the highest (mm/s, rad/s).
-type limits() :: #{
    name := binary(),
    frame := start | floor,
    devices := [binary()],
    vmax := number(),
    wmax := number()
}.

%% The kinds of senses, as a Create has them.
-type kind() :: bump | cliff | wheel_drop | button | battery | dock | other.

%% What a program says; `At' is its own clock, in microseconds.
-type message() ::
    {hello, limits()}
    | {ack | done | stalled, Id :: integer(), At :: number() | none}
    | {refuse, Id :: integer(), Why :: binary()}
    | {pose, starl:pose(), At :: number() | none}
    | {sense, {kind(), term()}}
    | {pong, N :: integer()}
    | {log, binary()}
    | unknown.

%% The version of the protocol.
-define(PROTOCOL, 1).
%% Farther, faster and later than any robot.
-define(MOST, 1.0e9).
-define(MOST_US, 1.0e18).
-define(KINDS, [bump, cliff, wheel_drop, button, battery, dock]).

%% @doc The line of a command.
-spec encode(command()) -> iodata().
encode({hello, #{robot := Robot} = Hello}) ->
    At = maps:from_list([{at, tuple_to_list(Pose)} || #{at := Pose} <- [Hello]]),
    starl_json:encode(At#{op => hello, protocol => ?PROTOCOL, robot => Robot});
encode({drive, Id, Legs}) ->
    All = [#{v => V, w => W, ms => Ms} || {V, W, Ms} <- Legs],
    starl_json:encode(#{op => drive, id => Id, legs => All});
encode({set, Id, Device, Value}) ->
    starl_json:encode(#{op => set, id => Id, device => Device, value => Value});
encode({ping, N}) ->
    starl_json:encode(#{op => ping, n => N});
encode(Op) when Op =:= stop; Op =:= rest ->
    starl_json:encode(#{op => Op}).

%% @doc The value of a device as a program gets it; `none' if it has no such form.
-spec value(term()) -> {ok, value()} | none.
value(Value) when is_number(Value); is_binary(Value); is_boolean(Value) -> {ok, Value};
value(Value) when is_atom(Value) -> {ok, atom_to_binary(Value)};
value(Value) when is_tuple(Value) -> values(tuple_to_list(Value));
value(_Value) -> none.

values(Values) ->
    All = [value(Value) || Value <- Values],
    case lists:member(none, All) of
        true -> none;
        false -> {ok, [Value || {ok, Value} <- All]}
    end.

%% @doc Reads a line of a program, or says what is wrong with it.
-spec decode(binary()) -> {ok, message()} | {error, unicode:chardata()}.
decode(Line) ->
    case starl_json:decode(Line) of
        {ok, #{<<"op">> := Op} = Object} when is_binary(Op) -> message(Op, Object);
        {ok, _} -> {error, "no object with an \"op\""};
        error -> {error, "no JSON"}
    end.

message(<<"hello">>, Object) -> hello(Object);
message(<<"ack">>, Object) -> answer(ack, Object);
message(<<"done">>, Object) -> answer(done, Object);
message(<<"stalled">>, Object) -> answer(stalled, Object);
message(<<"refuse">>, #{<<"id">> := Id} = Object) when is_integer(Id) -> {ok, refuse(Id, Object)};
message(<<"pose">>, Object) -> pose(Object);
message(<<"sense">>, #{<<"kind">> := Kind} = Object) -> {ok, {sense, sense(Kind, Object)}};
message(<<"pong">>, #{<<"n">> := N}) when is_integer(N) -> {ok, {pong, N}};
message(<<"log">>, #{<<"text">> := Text}) when is_binary(Text) -> {ok, {log, Text}};
message(Op, _Object) -> wrong(Op).

wrong(Op) ->
    case lists:member(Op, [<<"refuse">>, <<"sense">>, <<"pong">>, <<"log">>]) of
        true -> {error, [Op, " lacks a key, or it has a wrong value"]};
        false -> {ok, unknown}
    end.

answer(What, #{<<"id">> := Id} = Object) when is_integer(Id) ->
    case at(Object) of
        {ok, At} -> {ok, {What, Id, At}};
        error -> {error, [atom_to_binary(What), " has a \"t\" that is no time"]}
    end;
answer(What, _Object) ->
    {error, [atom_to_binary(What), " has no whole \"id\""]}.

refuse(Id, #{<<"why">> := Why}) when is_binary(Why) -> {refuse, Id, Why};
refuse(Id, _Object) -> {refuse, Id, <<>>}.

pose(#{<<"x">> := X, <<"y">> := Y, <<"th">> := Heading} = Object) when
    is_number(X),
    is_number(Y),
    is_number(Heading),
    abs(X) < ?MOST,
    abs(Y) < ?MOST,
    abs(Heading) < ?MOST
->
    case at(Object) of
        {ok, At} -> {ok, {pose, {float(X), float(Y), float(Heading)}, At}};
        error -> {error, "pose has a \"t\" that is no time"}
    end;
pose(_Object) ->
    {error, "pose needs \"x\", \"y\" (mm) and \"th\" (rad)"}.

at(#{<<"t">> := At}) when is_number(At), abs(At) < ?MOST_US -> {ok, At};
at(#{<<"t">> := _}) -> error;
at(#{}) -> {ok, none}.

%% A kind that StarL does not know keeps its name as text.
sense(Text, Object) ->
    Value = maps:get(<<"value">>, Object, true),
    case [Kind || Kind <- ?KINDS, atom_to_binary(Kind) =:= Text] of
        [Kind] -> {Kind, side(Value)};
        [] -> {other, {Text, Value}}
    end.

side(Text) when is_binary(Text) ->
    case [Side || Side <- [left, right, both, none, low], atom_to_binary(Side) =:= Text] of
        [Side] -> Side;
        [] -> Text
    end;
side(Value) ->
    Value.

hello(#{<<"protocol">> := ?PROTOCOL} = Object) ->
    Checks = [
        {name, maps:get(<<"name">>, Object, none), fun is_binary/1, "\"name\", a text"},
        {chassis, maps:get(<<"chassis">>, Object, <<"differential">>), fun is_differential/1,
            "\"chassis\":\"differential\", the one that there is"},
        {frame, maps:get(<<"frame">>, Object, <<"start">>), fun is_frame/1,
            "\"frame\": \"start\" or \"floor\""},
        {devices, maps:get(<<"devices">>, Object, []), fun are_texts/1,
            "\"devices\", an array of texts"},
        {vmax, maps:get(<<"vmax">>, Object, none), fun is_speed/1, "\"vmax\", mm/s"},
        {wmax, maps:get(<<"wmax">>, Object, none), fun is_speed/1, "\"wmax\", rad/s"}
    ],
    case [Expected || {_, Value, Is, Expected} <- Checks, not Is(Value)] of
        [] -> {ok, {hello, limits(maps:from_list([{Key, Value} || {Key, Value, _, _} <- Checks]))}};
        Expected -> {error, ["hello needs ", lists:join("; ", Expected)]}
    end;
hello(#{<<"protocol">> := Other}) ->
    {error, io_lib:format("hello: protocol ~0tp, and this StarL speaks ~b", [Other, ?PROTOCOL])};
hello(_Object) ->
    {error, io_lib:format("hello needs \"protocol\":~b", [?PROTOCOL])}.

is_differential(Chassis) -> Chassis =:= <<"differential">>.
is_frame(Frame) -> Frame =:= <<"start">> orelse Frame =:= <<"floor">>.
are_texts(Texts) -> is_list(Texts) andalso lists:all(fun is_binary/1, Texts).
is_speed(Speed) -> is_number(Speed) andalso Speed > 0 andalso Speed < ?MOST.

limits(#{frame := Frame} = Hello) ->
    Named =
        case Frame of
            <<"start">> -> start;
            <<"floor">> -> floor
        end,
    (maps:without([chassis], Hello))#{frame := Named}.
