%% @doc The rows that a page receives: one row for each change, a short list that becomes a JSON
%% array. Motion is sent in closed form ({@link starl_trajectory}), so a robot that drives costs
%% nothing until it changes its motion; the page computes where it is.
%% ```
%%   ["m", T, Robot, 0, T0, X, Y, Heading, V, W]            a piece of constant speed and turn rate
%%   ["m", T, Robot, 1, T0, X, Y, Heading, VX0, VY0, VX1, VY1, Us]                          a ramp
%%   ["a", T, Robot, Device, Value]                                   an actuator, such as the pen
%%   ["r", T, Robot, [[X1, Y1, X2, Y2], ...]]              the centre lines of the tubes it holds
%%   ["g", T, Robot, Key, Kind, Colour, [X, Y, ...], Text, LifeUs]   an application's drawing; 0: it stays
%%   ["n", T, Robot, Key, Value]                                     a measure of its application
%%   ["s", T, Robot, Id, [To, ...], Type]                                   a message begins its way
%%   ["d", T, Robot, Id, Type]                                                   it is delivered
%%   ["o", T, Robot, Id, At, Outcome]                   acknowledged, lost or restarted at a robot
%%   ["p", T, From, To, What, Bytes, Fate, At]          a packet; At: 0 if it is lost
%%   ["x", T, Robot, Machine, What]        crashes, ends, new starts; what the body feels (chassis)
%%   ["f", T, Id, From, To, Kind, Target, Params]                a fault of the schedule, in ms; of the
%%                                                               floor with [Door] or [X, Y, Width, Height]
%%   ["v", T, Contract, Text, [Robot, ...]]                                     a broken contract
%%   ["u", T, [Contract, ...], Text]           not judged from then on, or at all; no name: all
%% '''
%% Times are in microseconds, lengths in millimetres, angles in radians.
-module(starl_view_row).

-export([of_message/1, fault/2, violation/1, contract/1, text/2]).

-export_type([row/0]).

-type row() :: [starl_json:value(), ...].

-define(DEPTH, 12).
-define(LENGTH, 60).
-define(FOREVER_MS, 1000000000).

%% @doc The rows of a message of a run; most have none.
-spec of_message(starl_trace_message:t()) -> [row()].
of_message({trace, T, {Robot, Machine, Event}}) ->
    of_event(Machine, Event, T, Robot);
of_message({packets, T, {From, To, What, Bytes, Fate}}) ->
    [packet(T, From, To, What, Bytes, Fate)];
of_message({verdicts, _, {violation, Violation}}) ->
    [violation(Violation)];
of_message({verdicts, _, {ended, #{violations := Violations} = Ending}}) ->
    %% some are found at the end only
    [violation(Violation) || Violation <- Violations] ++
        [unjudged(Part) || Part <- maps:get(unjudged, Ending, [])];
of_message({gap, T, Missing}) when is_integer(Missing) ->
    [unjudged(T, [], starl_unjudged:format_why({missing, Missing}))];
of_message({gap, T, Why}) ->
    [unjudged(T, [], starl_unjudged:format_why(Why))];
of_message({faults, T, {_BeganOrEnded, Fault}}) ->
    [fault(T, Fault)];
of_message(_) ->
    [].

of_event(chassis, Event, T, Robot) ->
    of_chassis(Event, T, Robot);
of_event(app, {draw, #{kind := _} = Drawing}, T, Robot) ->
    [drawing(Drawing, T, Robot)];
of_event(app, {measure, Key, Value}, T, Robot) when is_atom(Key), is_number(Value) ->
    [[<<"n">>, T, Robot, text(Key, ?LENGTH), Value]];
of_event(sap, Event, T, Robot) ->
    of_message(Event, T, Robot);
of_event(radio, {packet, To, What, Bytes, Fate}, T, Robot) ->
    [packet(T, Robot, To, What, Bytes, Fate)];
of_event(robot, {died, _Reason}, T, Robot) ->
    [[<<"x">>, T, Robot, robot, died]];
of_event(robot, UpOrDown, T, Robot) when is_atom(UpOrDown) ->
    [[<<"x">>, T, Robot, robot, UpOrDown]];
of_event(Machine, crashed, T, Robot) ->
    [[<<"x">>, T, Robot, Machine, crashed]];
of_event(_Coordinator, {reserved, Of, Lines}, T, _Robot) when is_integer(Of), is_list(Lines) ->
    held(T, Of, Lines);
of_event(_Coordinator, {assigned, Of, _Request, Lines}, T, _) when is_integer(Of), is_list(Lines) ->
    held(T, Of, Lines);
of_event(_Machine, _Event, _T, _Robot) ->
    [].

of_chassis({motion, Piece}, T, Robot) ->
    [[<<"m">>, T, Robot | piece(Piece)]];
of_chassis({actuated, Device, Value}, T, Robot) ->
    [[<<"a">>, T, Robot, text(Device, ?LENGTH), text(Value, ?LENGTH)]];
of_chassis({sensed, Sense}, T, Robot) ->
    [[<<"x">>, T, Robot, chassis, text(Sense, ?LENGTH)]];
of_chassis(crashed, T, Robot) ->
    [[<<"x">>, T, Robot, chassis, crashed]];
of_chassis(_Event, _T, _Robot) ->
    [].

of_message({sent, Id, To, Type, _}, T, Robot) ->
    [[<<"s">>, T, Robot, id(Id), To, type(Type)]];
of_message({delivered, Id, Type, _}, T, Robot) ->
    [[<<"d">>, T, Robot, id(Id), type(Type)]];
of_message({outcome, Id, At, Outcome}, T, Robot) ->
    [[<<"o">>, T, Robot, id(Id), At, Outcome]];
of_message(crashed, T, Robot) ->
    [[<<"x">>, T, Robot, sap, crashed]];
of_message(_Event, _T, _Robot) ->
    [].

drawing(#{key := Key, kind := Kind, points := Points, text := Text} = Drawing, T, Robot) ->
    #{colour := Colour, life_us := Life} = Drawing,
    Numbers = lists:append([[round(X), round(Y)] || {X, Y} <- Points]),
    [<<"g">>, T, Robot, text(Key, ?LENGTH), Kind, css(Colour), Numbers, Text, life(Life)].

%% The page knows the colours of robots.
css(own) -> own;
css(Name) -> list_to_binary(proplists:get_value(Name, starl_drawing:colours())).

life(infinity) -> 0;
life(Us) -> Us.

piece({piece, T0, X, Y, Heading, V, W}) ->
    [0, T0, X, Y, Heading, V, W];
piece({ramp, T0, X, Y, Heading, {VX0, VY0}, {VX1, VY1}, Us}) ->
    [1, T0, X, Y, Heading, VX0, VY0, VX1, VY1, Us].

%% Events of a user's own blocks may have the same names.
held(T, Robot, Lines) ->
    case [[X1, Y1, X2, Y2] || {{X1, Y1}, {X2, Y2}} <- Lines, is_number(X1)] of
        Numbers when length(Numbers) =:= length(Lines) -> [[<<"r">>, T, Robot, Numbers]];
        _ -> []
    end.

id({Robot, Incarnation, Seq}) ->
    iolist_to_binary(lists:join($., [integer_to_list(N) || N <- [Robot, Incarnation, Seq]])).

type({_Kind, Name}) -> text(Name, ?LENGTH);
type(Type) -> text(Type, ?LENGTH).

packet(T, From, To, What, Bytes, Fate) ->
    {Words, AtUs} = fate(Fate),
    [<<"p">>, T, From, To, text(What, ?LENGTH), Bytes, Words, AtUs].

fate({lost, {fault, Id}}) -> {text(Id, ?LENGTH), 0};
fate({lost, Why}) -> {text(Why, ?LENGTH), 0};
fate({arrives, [{AtUs, intact} | _]}) -> {<<"arrives">>, AtUs};
fate({arrives, [{AtUs, corrupt} | _]}) -> {<<"corrupt">>, AtUs}.

%% @doc A scheduled or manual fault, reported at a time.
-spec fault(integer(), starl_run_fault:t() | tuple()) -> row().
fault(T, {Id, From, To, Kind, Target, Params}) ->
    [<<"f">>, T, Id, From, ended(To), Kind, text(Target, ?LENGTH), text(Params, ?LENGTH)] ++
        on_floor(Kind, Params).

%% The number of a door, or a box, to be drawn.
on_floor(closed, #{door := Door}) -> [[Door]];
on_floor(obstacle, #{x := X, y := Y, width := W, height := H}) -> [[X, Y, W, H]];
on_floor(_Kind, _Params) -> [].

%% Of a fault by hand in a live run nobody knows the end.
ended(Ms) when is_integer(Ms) -> Ms;
ended(_) -> ?FOREVER_MS.

%% @doc A broken contract.
-spec violation(starl_monitor:violation()) -> row().
violation(#{contract := Contract, at_us := T, robots := Robots} = Violation) ->
    Text = unicode:characters_to_binary(starl_violation:format(Violation)),
    [<<"v">>, T, Contract, Text, Robots].

unjudged(#{monitors := all, from_us := T} = Part) ->
    unjudged(T, [], starl_unjudged:format(Part));
unjudged(#{monitors := Names, from_us := T} = Part) ->
    unjudged(T, lists:usort([contract(Name) || Name <- Names]), starl_unjudged:format(Part)).

unjudged(T, Contracts, Text) ->
    [<<"u">>, T, Contracts, unicode:characters_to_binary(Text)].

%% @doc The word by which the violations of a monitor, given by its name, name its contract.
-spec contract(Monitor :: string()) -> binary().
contract("run_progress") -> <<"progress">>;
contract("exercise") -> <<"calls">>;
contract("election_bully") -> <<"election">>;
contract(Name) -> <<_/binary>> = unicode:characters_to_binary(Name).

%% @doc A term as a short text.
-spec text(term(), pos_integer()) -> binary().
text(Word, _Length) when is_atom(Word) -> atom_to_binary(Word);
text(Term, Length) ->
    Text = unicode:characters_to_binary(io_lib:format("~0tP", [Term, ?DEPTH])),
    case string:length(Text) > Length of
        true -> <<(string:slice(Text, 0, Length - 1))/binary, "…"/utf8>>;
        false -> Text
    end.
