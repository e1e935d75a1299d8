%% @doc Turns messages into the bytes of a recording. A pure module: the caller writes the bytes.
%%
%% Each message is kept exactly, as a term, on the channel `/starl'; only positions are left out
%% where they follow from the motions in the trace, and the reader computes them again. The other
%% channels show the same to people and their viewers ({@link starl_trace_foxglove}), frames twice a
%% second. Each ten seconds the motions of all robots are written at the beginning of a chunk, so that
%% a reader can begin there. The scenario stands behind the first chunk once more, as an attachment. A chunk ends with the first message half a second of time after its
%% beginning, so a killed run loses less than a second as long as something happens.
-module(starl_trace_writer).

-export([new/0, messages/2, flush/1, finish/1, frames_us/0, patch/0]).

-export_type([t/0]).

%% Millionths of a unit are enough for all that is shown.
-define(DECIMALS, 6).
-define(CHUNK_US, 500000).
-define(CHUNK_BYTES, 1048576).
-define(CHUNK_MESSAGES, 20000).
-define(FRAMES_US, 500000).
-define(PLACES_US, 10000000).

%% The attachment that repeats the scenario.
-define(SCENARIO, "scenario").
-define(JSON, "application/json").

-record(writer, {
    mcap :: starl_mcap_writer:t(),
    %% the open chunk: when it began, its messages, the latest first
    since = none :: integer() | none,
    now = 0 :: integer(),
    terms = [] :: [starl_trace_message:t()],
    count = 0 :: non_neg_integer(),
    shown = starl_trace_foxglove:new(?FRAMES_US) :: starl_trace_foxglove:t(),
    %% do positions follow from the trace? the motions, and the time of the next account of them
    derived = false :: boolean(),
    motions = #{} :: #{starl:robot_id() => [starl_trajectory:piece(), ...]},
    pens = #{} :: #{starl:robot_id() => up | down},
    places_at = ?PLACES_US :: integer(),
    %% the scenario, which is to be repeated
    scenario = none :: starl_trace_message:t() | none
}).

-opaque t() :: #writer{}.

%% @doc An empty recording, and its first bytes.
-spec new() -> {iodata(), t()}.
new() ->
    {Bytes, Mcap} = starl_mcap_writer:new("starl", starl_trace_schema:channels()),
    {Bytes, #writer{mcap = Mcap}}.

%% @doc The period of the frames.
-spec frames_us() -> pos_integer().
frames_us() -> ?FRAMES_US.

%% @doc Adds messages, in the order of their times; the bytes of the chunks that are complete.
-spec messages([starl_trace_message:t()], t()) -> {iodata(), t()}.
messages(Messages, Writer) -> messages(Messages, [], Writer).

messages([], Bytes, Writer) ->
    {lists:reverse(Bytes), Writer};
messages([{_, At, _} = Message | Messages], Bytes, Writer0) ->
    {Chunk, Writer} = ended(At, Writer0),
    messages(Messages, [Chunk | Bytes], message(Message, begun(At, Writer))).

begun(At, #writer{since = none, derived = true, places_at = Due} = Writer) when At >= Due ->
    #writer{motions = Motions, pens = Pens} = Writer,
    Places = [
        {Id, Pieces, maps:get(Id, Pens, none)}
     || {Id, Pieces} <- lists:sort(maps:to_list(Motions))
    ],
    Next = Writer#writer{since = At, now = At, places_at = At + ?PLACES_US},
    added({places, At, Places}, Next);
begun(At, #writer{since = none} = Writer) ->
    Writer#writer{since = At, now = At};
begun(At, #writer{now = Now} = Writer) ->
    Writer#writer{now = max(At, Now)}.

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
flush(#writer{since = Since, now = Now, terms = Terms, shown = Shown} = Writer) ->
    %% the times of a file never decrease
    Listed = shown(starl_trace_foxglove:packets(Since, Now, Shown), Writer),
    Text = starl_trace_terms:encode(lists:reverse(Terms)),
    #writer{mcap = Mcap} = Full = put_text(terms, Now, Text, Listed),
    {Bytes, Next} = starl_mcap_writer:flush(Mcap),
    repeated(Bytes, Full#writer{mcap = Next, since = none, terms = [], count = 0}).

repeated(Bytes, #writer{scenario = none} = Writer) ->
    {Bytes, Writer};
repeated(Bytes, #writer{scenario = Scenario, mcap = Mcap} = Writer) ->
    Text = starl_trace_terms:encode([Scenario]),
    {More, Next} = starl_mcap_writer:other({attachment, 0, 0, ?SCENARIO, ?JSON, Text}, Mcap),
    {[Bytes, More], Writer#writer{scenario = none, mcap = Next}}.

%% @doc What a recording says of what it has lost, when it is recovered.
-spec patch() -> starl_mcap_recover:patch().
patch() ->
    #{
        channels => starl_trace_schema:channels(),
        channel => starl_trace_schema:id(terms),
        hole => fun(From, To) ->
            starl_trace_terms:encode([{gap, From div 1000, hole(To)}])
        end,
        repeated => fun
            ({attachment, _, _, <<?SCENARIO>>, <<?JSON>>, Text}) -> {ok, Text};
            (_Other) -> none
        end
    }.

hole(the_end) -> no_end;
hole(To) -> {hole, To div 1000}.

%% @doc The last bytes.
-spec finish(t()) -> iolist().
finish(Writer) ->
    {Bytes, #writer{mcap = Mcap}} = flush(Writer),
    [Bytes, starl_mcap_writer:finish(Mcap)].

%% -- messages -------------------------------------------------------------------------------

message(Message, #writer{shown = Before} = Writer) ->
    shown(starl_trace_foxglove:message(Message, Before), kept(Message, Writer)).

kept({scenario, _, _} = Message, Writer) ->
    added(Message, Writer#writer{scenario = Message});
kept({poses, _, _}, #writer{derived = true} = Writer) ->
    Writer;
kept({trace, _, {Robot, chassis, {motion, Piece}}} = Message, #writer{motions = Motions} = Writer) ->
    Pieces =
        case Motions of
            #{Robot := [Last | _]} -> [Piece, Last];
            #{} -> [Piece]
        end,
    added(Message, Writer#writer{derived = true, motions = Motions#{Robot => Pieces}});
kept({trace, _, {Robot, chassis, {actuated, pen, Pen}}} = Message, #writer{pens = Pens} = Writer) ->
    added(Message, Writer#writer{pens = Pens#{Robot => Pen}});
kept(Message, Writer) ->
    added(Message, Writer).

added(Message, #writer{terms = Terms, count = Count} = Writer) ->
    Writer#writer{terms = [Message | Terms], count = Count + 1}.

shown({Updates, Shown}, Writer) ->
    Put = fun({Channel, At, Json}, W) ->
        put_text(Channel, At, starl_json:encode(Json, ?DECIMALS), W)
    end,
    lists:foldl(Put, Writer#writer{shown = Shown}, Updates).

put_text(Channel, At, Text, #writer{mcap = Mcap} = Writer) ->
    Id = starl_trace_schema:id(Channel),
    Writer#writer{mcap = starl_mcap_writer:message(Id, 1000 * max(0, At), Text, Mcap)}.
