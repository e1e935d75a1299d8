%% @doc The sensors of an emulated Create: their values, when asked for or in the stream.
-module(starl_create_sensors).

-export([readings/1, is_cliff/1, answer/2, frame/1, stream/2]).

-define(CLIFF_SIGNALS, [
    cliff_left_signal, cliff_front_left_signal, cliff_front_right_signal, cliff_right_signal
]).
%% What a cliff's sensor sees of a floor.
-define(FLOOR, 1500).

%% @doc All readings. What the body has felt outweighs everything.
-spec readings(starl_create_state:t()) -> starl_create_packet:readings().
readings(#{now := Now, mode := Mode, felt := Felt} = State) ->
    #{battery := Battery, panel := Panel, wheels := Wheels} = State,
    Parts = [
        maps:from_list([{starl_create_packet:name(Id), 0} || Id <- lists:seq(7, 58)]),
        own(State),
        maps:from_list([{Name, floor_seen(Battery)} || Name <- ?CLIFF_SIGNALS]),
        starl_create_battery:readings(Mode, starl_create_state:load(State), Battery),
        starl_create_panel:readings(Now, Panel),
        starl_create_wheels:readings(Wheels),
        Felt
    ],
    lists:foldl(fun(Part, Before) -> maps:merge(Before, Part) end, #{}, Parts).

own(#{model := Model, mode := Mode, stream := Stream, quirks := #{mode_offset := Offset}}) ->
    #{
        ir_omni => no_ir(Model),
        mode => Offset + code(Mode),
        stream_packets => stream_packets(Stream),
        digital_inputs => inputs(Model)
    }.

no_ir(1) -> 255;
no_ir(2) -> 0.

code(off) -> 0;
code(passive) -> 1;
code(safe) -> 2;
code(full) -> 3.

stream_packets(none) -> 0;
stream_packets(Ids) -> length(Ids).

%% Inputs that are not connected are high.
inputs(1) -> 2#01111;
inputs(2) -> 0.

floor_seen(Battery) ->
    case starl_create_battery:is_docked(Battery) of
        true -> 0;
        false -> ?FLOOR
    end.

%% @doc Does it see a cliff?
-spec is_cliff(starl_create_packet:readings()) -> boolean().
is_cliff(Readings) ->
    lists:any(
        fun(Name) -> maps:get(Name, Readings, 0) =/= 0 end,
        [cliff_left, cliff_front_left, cliff_front_right, cliff_right]
    ).

%% @doc Answers. Nothing is answered if there is a packet that the generation does not have.
-spec answer([starl_create_packet:id()], starl_create_state:t()) ->
    {starl_create_state:outs(), starl_create_state:t()}.
answer(Ids, State) ->
    case are_known(Ids, State) of
        true ->
            Bytes = starl_create_packet:encode_all(Ids, readings(State)),
            starl_create_state:send(Bytes, was_read(Ids, State));
        false ->
            {[], State}
    end.

%% @doc These packets are its stream from now on, if it has them all.
-spec stream([starl_create_packet:id()], starl_create_state:t()) -> starl_create_state:t().
stream(Ids, State) ->
    case are_known(Ids, State) of
        true -> State#{stream := Ids, streams := Ids =/= []};
        false -> State
    end.

are_known(Ids, #{model := Model}) ->
    lists:all(fun(Id) -> starl_create_packet:known(Id, Model) end, Ids).

%% @doc Sends a frame of its stream.
-spec frame(starl_create_state:t()) -> {starl_create_state:outs(), starl_create_state:t()}.
frame(#{streams := false} = State) ->
    {[], State};
frame(#{stream := Ids, quirks := #{checksum := Checksum}} = State) ->
    Frame = starl_create_stream:frame(Ids, readings(State), Checksum),
    starl_create_state:send(Frame, was_read(Ids, State)).

was_read(Ids, #{wheels := Wheels} = State) ->
    Members = lists:append([starl_create_packet:members(Id) || Id <- Ids]),
    Names = [starl_create_packet:name(Id) || Id <- Members],
    State#{wheels := starl_create_wheels:read(Names, Wheels)}.
