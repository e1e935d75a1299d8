%% @doc Converts the messages of a run into messages for viewers: frames, scene, log, and our own,
%% on the channels of {@link starl_trace_schema}. It shows all events except those of motion and
%% SAP. It shows packets as lines of text, except acknowledgements that arrive. A pure module,
%% shared by recordings and live viewers.
-module(starl_trace_foxglove).

-export([new/1, message/2, packets/3]).

-export_type([t/0, update/0]).

%% The depth to which an event is shown, and the characters.
-define(DEPTH, 9).
-define(SHOWN, 40).

-record(shown, {
    %% between frames
    period_us :: pos_integer(),
    %% the lines of packets that wait, the latest first
    packets = [] :: [binary()],
    lost = 0 :: non_neg_integer(),
    scene = starl_trace_scene:new() :: starl_trace_scene:t(),
    frames = #{} :: #{starl:robot_id() => starl:pose()},
    frames_at = 0 :: integer()
}).

-opaque t() :: #shown{}.

%% What a channel shows at a time.
-type update() ::
    {starl_trace_schema:channel(), AtUs :: integer(), starl_json:value()}.

%% @doc Nothing has been shown; frames come at most once in such a period.
-spec new(FramesUs :: pos_integer()) -> t().
new(FramesUs) -> #shown{period_us = FramesUs}.

%% @doc What a message shows. Packets wait for {@link packets/3}.
-spec message(starl_trace_message:t(), t()) -> {[update()], t()}.
message({poses, At, #{robots := Robots}}, Shown) ->
    frames(At, Robots, Shown);
message({trace, At, {Robot, chassis, Event}} = Message, #shown{scene = Before} = Shown) ->
    {Updates, Scene} = starl_trace_scene:event({At, Robot, chassis, Event}, Before),
    Own =
        case Event of
            {motion, _} -> [];
            %% its ink is in the scene
            {actuated, pen, _} -> [];
            _ -> updates(Message)
        end,
    {[{scene, At, Update} || Update <- Updates] ++ Own, Shown#shown{scene = Scene}};
message({packets, At, Packet}, Shown) ->
    {[], packet(At, Packet, Shown)};
message({ways, At, {Robot, Way}}, Shown) ->
    {[], way(At, Robot, Way, Shown)};
message(Message, Shown) ->
    {updates(Message), Shown}.

updates({scenario, At, #{robots := Robots} = Facts}) ->
    Bodies = starl_trace_scene:bodies(At, [Id || {Id, _} <- Robots]),
    Plan = [{scene, At, starl_trace_scene:plan(At, Floor)} || #{floor := Floor} <- [Facts]],
    [{scenario, At, scenario(Facts)} | Plan] ++ [{scene, At, Bodies}];
updates({trace, At, {Robot, Machine, Event}}) ->
    traced(At, Robot, Machine, Event);
updates({faults, At, Fault}) ->
    [{faults, At, fault(Fault)}];
updates({verdicts, At, Verdict}) ->
    [{verdicts, At, verdict(Verdict)}];
updates({log, At, Line}) ->
    [{log, At, log(At, Line)}];
updates({gap, At, Why}) when not is_integer(Why) ->
    [{log, At, log(At, {warning, none, starl_unjudged:format_why(Why)})}];
updates({gap, At, Missing}) ->
    Text = io_lib:format("~b messages are missing here", [Missing]),
    [{log, At, log(At, {warning, none, Text})}];
updates({metrics, At, Counts}) ->
    Keys = [events, packets, lost, violations],
    [{metrics, At, {[{Key, maps:get(Key, Counts)} || Key <- Keys]}}].

traced(_At, _Robot, sap, _Event) ->
    [];
traced(At, Robot, app, {measure, Key, Value}) when is_atom(Key), is_number(Value) ->
    [{measures, At, measure(Robot, Key, Value)}];
traced(At, Robot, app, {draw, #{key := _} = Drawing}) ->
    [{drawings, At, starl_trace_drawing:update(At, Robot, Drawing)}];
traced(At, Robot, Machine, Event) ->
    [{trace, At, event(Robot, Machine, Event)}].

%% Frames of the robots that have changed since the last ones.
frames(At, Robots, #shown{frames = Frames, frames_at = Due, period_us = Period} = Shown) ->
    Latest = lists:foldl(fun({Id, Pose, _, _}, F) -> F#{Id => Pose} end, Frames, Robots),
    case At >= Due of
        true ->
            Update = starl_trace_scene:transforms(At, lists:sort(maps:to_list(Latest))),
            {[{tf, At, Update}], Shown#shown{frames = #{}, frames_at = At + Period}};
        false ->
            {[], Shown#shown{frames = Latest}}
    end.

%% @doc Shows the packets that wait, of a span of time, at its end.
-spec packets(SinceUs :: integer(), NowUs :: integer(), t()) -> {[update()], t()}.
packets(_Since, _Now, #shown{packets = []} = Shown) ->
    {[], Shown};
packets(Since, Now, #shown{packets = Lines, lost = Lost} = Shown) ->
    Json =
        {[
            {since, starl_trace_scene:timestamp(Since)},
            {lost, Lost},
            {packets, lists:reverse(Lines)}
        ]},
    {[{packets, Now, Json}], Shown#shown{packets = [], lost = 0}}.

%% -- texts for people -----------------------------------------------------------------------

scenario(#{kind := Kind, app := App, robots := Robots, scenario := Values}) ->
    {[
        {kind, atom_to_binary(Kind)},
        {application, atom_to_binary(App)},
        {robots, length(Robots)},
        {seed, maps:get(seed, Values, 0)},
        {values, [
            {[{key, text("~0tp", [Key])}, {value, text("~0tP", [Value, 100])}]}
         || {Key, Value} <- lists:sort(maps:to_list(Values))
        ]}
    ]}.

%% `series' is for viewers that plot every number by its path: /measures/series/KEY/robot_N.
measure(Robot, Key, Value) ->
    {Name, Number} = {atom_to_binary(Key), number(Value)},
    {[
        {robot, Robot},
        {key, Name},
        {value, Number},
        {series, {[{Name, {[{text("robot_~b", [Robot]), Number}]}}]}}
    ]}.

number(Value) when is_integer(Value) -> Value;
number(Value) -> {json, float_to_binary(Value, [short])}.

event(Robot, Machine, Event) when is_atom(Event) ->
    event(Robot, Machine, Event, <<>>);
event(Robot, Machine, Event) when is_tuple(Event), is_atom(element(1, Event)) ->
    [Name | Details] = tuple_to_list(Event),
    Shown = lists:join(", ", [io_lib:format("~tW", [Detail, ?DEPTH]) || Detail <- Details]),
    event(Robot, Machine, Name, short(unicode:characters_to_binary(Shown)));
event(Robot, Machine, Event) ->
    event(Robot, Machine, event, short(text("~tW", [Event, ?DEPTH]))).

short(Text) when byte_size(Text) =< ?SHOWN -> Text;
short(Text) ->
    %% not in the middle of a character
    Whole =
        case unicode:characters_to_binary(binary:part(Text, 0, ?SHOWN - 3)) of
            {_, Good, _} -> Good;
            Good -> Good
        end,
    <<Whole/binary, "...">>.

event(Robot, Machine, Name, Details) ->
    {[
        {robot, Robot},
        {machine, atom_to_binary(Machine)},
        {event, atom_to_binary(Name)},
        {details, Details}
    ]}.

fault({What, Fault}) ->
    [Id, _, _, Kind, Target | _] = tuple_to_list(Fault),
    {[
        {what, atom_to_binary(What)},
        {fault, text("~0tp", [Id])},
        {kind, text("~0tp", [Kind])},
        {target, text("~0tp", [Target])}
    ]}.

verdict({violation, Violation}) ->
    {[{what, <<"violation">>}, {text, text("~ts", [starl_violation:format(Violation)])}]};
verdict({ended, #{ending := Ending, violations := Violations}}) ->
    Text = text("~ts, violations: ~b", [Ending, length(Violations)]),
    {[{what, <<"ended">>}, {text, Text}]}.

log(At, {Level, Robot, Line}) ->
    Levels = #{info => 2, warning => 3, error => 4},
    Name =
        case Robot of
            none -> <<"run">>;
            _ -> text("robot ~b", [Robot])
        end,
    {[
        {timestamp, starl_trace_scene:timestamp(At)},
        {level, maps:get(Level, Levels)},
        {message, unicode:characters_to_binary(Line)},
        {name, Name},
        {file, <<>>},
        {line, 0}
    ]}.

text(Format, Values) -> unicode:characters_to_binary(io_lib:format(Format, Values)).

%% Such as `12.345 1>2 data 17 45B 8.2ms'.
packet(_At, {_, _, {ack, _}, _, {arrives, [{_, intact}]}}, Shown) ->
    Shown;
packet(At, {From, To, What, Bytes, Fate}, Shown) ->
    listed(line(At, {From, To, What, Bytes}, fate(At, Fate)), Fate, Shown).

%% What a robot itself knows of a packet.
way(_At, _Robot, {sent, _, {ack, _}, _, _}, Shown) ->
    Shown;
way(_At, _Robot, {came, _, {ack, _}, _, _, {arrives, _}}, Shown) ->
    Shown;
way(At, Robot, {sent, To, What, Bytes, _}, Shown) ->
    listed(line(At, {Robot, To, What, Bytes}, "sent"), sent, Shown);
way(At, Robot, {came, From, What, Bytes, _, {lost, _} = Fate}, Shown) ->
    listed(line(At, {From, Robot, What, Bytes}, fate(At, Fate)), Fate, Shown);
way(At, Robot, {came, From, What, Bytes, _, {arrives, _} = Fate}, Shown) ->
    listed(line(At, {From, Robot, What, Bytes}, "came"), Fate, Shown).

line(At, {From, To, What, Bytes}, Fate) ->
    unicode:characters_to_binary([
        float_to_binary(At / 1.0e6, [{decimals, 3}]),
        [$\s, integer_to_binary(From), $>, integer_to_binary(To), $\s],
        [what(What), $\s, integer_to_binary(Bytes), "B "],
        Fate
    ]).

listed(Line, {lost, _}, #shown{packets = Packets, lost = Lost} = Shown) ->
    Shown#shown{packets = [Line | Packets], lost = Lost + 1};
listed(Line, _SentOrArrives, #shown{packets = Packets} = Shown) ->
    Shown#shown{packets = [Line | Packets]}.

what({data, {app, Type}, Seq}) -> ["app ", atom_to_binary(Type), $\s, integer_to_binary(Seq)];
what({data, Type, Seq}) -> [atom_to_binary(Type), $\s, integer_to_binary(Seq)];
what({shout, {app, Type}}) -> ["shout app ", atom_to_binary(Type)];
what({shout, Type}) -> ["shout ", atom_to_binary(Type)];
what({Kind, Seq}) -> [atom_to_binary(Kind), $\s, integer_to_binary(Seq)];
what(Kind) -> atom_to_binary(Kind).

fate(_At, {lost, {fault, Id}}) ->
    io_lib:format("lost by ~0tp", [Id]);
fate(_At, {lost, Why}) ->
    ["lost: ", atom_to_binary(Why)];
fate(At, {arrives, Copies}) ->
    lists:join(", ", [
        [float_to_binary((To - At) / 1000, [{decimals, 1}]), "ms", damaged(State)]
     || {To, State} <- Copies
    ]).

damaged(intact) -> "";
damaged(corrupt) -> " damaged".
