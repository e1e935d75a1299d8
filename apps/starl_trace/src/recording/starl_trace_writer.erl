%% @doc Turns messages into the bytes of a recording. A pure module: the caller writes the bytes.
%%
%% Each message is kept exactly, as a term, on the channel `/starl'; only positions are left out
%% where they follow from the motions in the trace, and the reader computes them again. The other
%% channels show the same to people and their viewers, in parts: frames twice a second, events but
%% those of motion and SAP, packets, but for acknowledgements that arrive, as lines. A chunk ends
%% before a second of time is over.
-module(starl_trace_writer).

-export([new/0, messages/2, flush/1, finish/1]).

-export_type([t/0]).

-define(CHUNK_US, 900000).
-define(CHUNK_BYTES, 1048576).
-define(CHUNK_MESSAGES, 20000).
-define(FRAMES_US, 500000).
%% The depth to which an event is shown, and the characters.
-define(DEPTH, 9).
-define(SHOWN, 48).

-record(writer, {
    mcap :: starl_mcap_writer:t(),
    %% the open chunk: when it began, its messages and the lines of its packets, the latest first
    since = none :: integer() | none,
    now = 0 :: integer(),
    terms = [] :: [starl_trace_message:t()],
    count = 0 :: non_neg_integer(),
    packets = [] :: [binary()],
    lost = 0 :: non_neg_integer(),
    scene = starl_trace_scene:new() :: starl_trace_scene:t(),
    %% do positions follow from the trace?
    derived = false :: boolean(),
    frames = #{} :: #{starl:robot_id() => starl:pose()},
    frames_at = 0 :: integer()
}).

-opaque t() :: #writer{}.

%% @doc An empty recording, and its first bytes.
-spec new() -> {iodata(), t()}.
new() ->
    {Bytes, Mcap} = starl_mcap_writer:new("starl", starl_trace_schema:channels()),
    {Bytes, #writer{mcap = Mcap}}.

%% @doc Adds messages, in the order of their times; the bytes of the chunks that are complete.
-spec messages([starl_trace_message:t()], t()) -> {iodata(), t()}.
messages(Messages, Writer) -> messages(Messages, [], Writer).

messages([], Bytes, Writer) ->
    {lists:reverse(Bytes), Writer};
messages([{_, At, _} = Message | Messages], Bytes, Writer0) ->
    {Chunk, Writer} = ended(At, Writer0),
    messages(Messages, [Chunk | Bytes], message(Message, begun(At, Writer))).

begun(At, #writer{since = none} = Writer) -> Writer#writer{since = At, now = At};
begun(At, #writer{now = Now} = Writer) -> Writer#writer{now = max(At, Now)}.

ended(At, #writer{since = Since, count = Count, mcap = Mcap} = Writer) ->
    IsFull =
        Count >= ?CHUNK_MESSAGES orelse starl_mcap_writer:waiting(Mcap) >= ?CHUNK_BYTES,
    case Since =/= none andalso (IsFull orelse At - Since >= ?CHUNK_US) of
        true -> flush(Writer);
        false -> {[], Writer}
    end.

%% @doc Closes the open chunk: what was added until now survives a crash once these bytes are
%% written.
-spec flush(t()) -> {iodata(), t()}.
flush(#writer{since = none} = Writer) ->
    {[], Writer};
flush(#writer{now = Now, terms = Terms} = Writer) ->
    %% the times of a file never decrease
    Listed = packets(Writer),
    Text = starl_trace_terms:encode(lists:reverse(Terms)),
    #writer{mcap = Mcap} = Full = put_text(terms, Now, Text, Listed),
    {Bytes, Next} = starl_mcap_writer:flush(Mcap),
    {Bytes, Full#writer{
        mcap = Next, since = none, terms = [], count = 0, packets = [], lost = 0
    }}.

%% @doc The last bytes.
-spec finish(t()) -> iolist().
finish(Writer) ->
    {Bytes, #writer{mcap = Mcap}} = flush(Writer),
    [Bytes, starl_mcap_writer:finish(Mcap)].

%% -- messages -------------------------------------------------------------------------------

message({poses, At, #{robots := Robots}} = Message, #writer{derived = Derived} = Writer) ->
    case Derived of
        true -> frames(At, Robots, Writer);
        false -> frames(At, Robots, kept(Message, Writer))
    end;
message({trace, At, {Robot, chassis, Event}} = Message, Writer) ->
    {Updates, Scene} = starl_trace_scene:event({At, Robot, chassis, Event}, Writer#writer.scene),
    Drawn = lists:foldl(
        fun(Update, W) -> put_json(scene, At, Update, W) end,
        kept(Message, Writer#writer{scene = Scene}),
        Updates
    ),
    case Event of
        {motion, _} -> Drawn#writer{derived = true};
        %% its ink is in the scene
        {actuated, pen, _} -> Drawn;
        _ -> shown(Message, Drawn)
    end;
message(Message, Writer) ->
    shown(Message, kept(Message, Writer)).

kept(Message, #writer{terms = Terms, count = Count} = Writer) ->
    Writer#writer{terms = [Message | Terms], count = Count + 1}.

shown({scenario, At, Facts}, Writer) ->
    #{robots := Robots} = Facts,
    Known = put_json(scenario, At, scenario(Facts), Writer),
    put_json(scene, At, starl_trace_scene:bodies(At, [Id || {Id, _} <- Robots]), Known);
shown({trace, _, {_, sap, _}}, Writer) ->
    Writer;
shown({trace, At, {Robot, Machine, Event}}, Writer) ->
    put_json(trace, At, event(Robot, Machine, Event), Writer);
shown({packets, At, Packet}, Writer) ->
    packet(At, Packet, Writer);
shown({faults, At, Fault}, Writer) ->
    put_json(faults, At, fault(Fault), Writer);
shown({verdicts, At, Verdict}, Writer) ->
    put_json(verdicts, At, verdict(Verdict), Writer);
shown({log, At, Line}, Writer) ->
    put_json(log, At, log(At, Line), Writer);
shown({gap, At, Missing}, Writer) ->
    Text = io_lib:format("~b messages are missing here", [Missing]),
    put_json(log, At, log(At, {warning, none, Text}), Writer);
shown({metrics, At, Counts}, Writer) ->
    Keys = [events, packets, lost, violations],
    put_json(metrics, At, {[{Key, maps:get(Key, Counts)} || Key <- Keys]}, Writer).

put_json(Channel, At, Json, Writer) ->
    put_text(Channel, At, starl_trace_json:encode(Json), Writer).

put_text(Channel, At, Text, #writer{mcap = Mcap} = Writer) ->
    Id = starl_trace_schema:id(Channel),
    Writer#writer{mcap = starl_mcap_writer:message(Id, 1000 * max(0, At), Text, Mcap)}.

%% Frames of the robots that have changed since the last ones.
frames(At, Robots, #writer{frames = Frames, frames_at = Due} = Writer) ->
    Latest = lists:foldl(fun({Id, Pose, _, _}, F) -> F#{Id => Pose} end, Frames, Robots),
    case At >= Due of
        true ->
            Update = starl_trace_scene:transforms(At, lists:sort(maps:to_list(Latest))),
            Next = Writer#writer{frames = #{}, frames_at = At + ?FRAMES_US},
            put_json(tf, At, Update, Next);
        false ->
            Writer#writer{frames = Latest}
    end.

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
    {[{what, <<"violation">>}, {text, text("~ts", [starl_monitor:format_violation(Violation)])}]};
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
packet(_At, {_, _, {ack, _}, _, {arrives, [{_, intact}]}}, Writer) ->
    Writer;
packet(At, {From, To, What, Bytes, Fate}, #writer{packets = Packets, lost = Lost} = Writer) ->
    Line = unicode:characters_to_binary([
        float_to_binary(At / 1.0e6, [{decimals, 3}]),
        [$\s, integer_to_binary(From), $>, integer_to_binary(To), $\s],
        [what(What), $\s, integer_to_binary(Bytes), "B "],
        fate(At, Fate)
    ]),
    More =
        case Fate of
            {lost, _} -> 1;
            {arrives, _} -> 0
        end,
    Writer#writer{packets = [Line | Packets], lost = Lost + More}.

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

packets(#writer{packets = []} = Writer) ->
    Writer;
packets(#writer{packets = Lines, since = Since, now = Now, lost = Lost} = Writer) ->
    Json =
        {[
            {since, starl_trace_scene:timestamp(Since)},
            {lost, Lost},
            {packets, lists:reverse(Lines)}
        ]},
    put_json(packets, Now, Json, Writer).
