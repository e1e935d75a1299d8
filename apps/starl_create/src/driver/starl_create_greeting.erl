%% @doc Finds and wakes the robot at the other end of a line: from the opened line to the first
%% frames of its stream. A pure module.
%% ```
%%     opened        120 ms          500 ms           150 ms
%%     ------> starting ----> asking -------> doubting -----> resting ----> the line is opened again
%%                               |               |
%%                               +- four frames -+---> found
%% '''
%% It begins with a row of Start commands, which completes whatever half command the robot waits
%% for. It asks a Create 1 for an encoder, which a Create 1 does not have: a robot that answers is a
%% Create 2. Without frames, it asks for the mode, because each robot answers this question with one
%% byte. It wakes a robot that stays silent, greets it again, and looks for it at the other baud
%% rates.
-module(starl_create_greeting).

-export([new/1, anew/1, opening/1, opened/1, due/1, hear/2, ids/1]).

-export_type([t/0, action/0]).

%% Tell the port; start the timer, after which {@link due/1} is to be called; say what is wrong.
-type action() ::
    {port, {open, Device :: term(), Baud :: pos_integer()}}
    | {port, {send, binary()}}
    | {port, {pulse, dtr | rts, LowMs :: pos_integer(), Times :: pos_integer()}}
    | {timer, step, Ms :: non_neg_integer()}
    | {say, warning, starl_create_advice:t()}.

-record(greeting, {
    options :: starl_create_options:t(),
    step = idle :: idle | starting | asking | doubting | resting | opening,
    tries = 0 :: non_neg_integer(),
    %% another baud rate than its own, at which a robot is looked for
    tried = none :: pos_integer() | none,
    frames = 0 :: non_neg_integer(),
    %% bytes that were no frames
    noise = <<>> :: binary()
}).

-opaque t() :: #greeting{}.

-define(FLUSH, 34).
-define(START_MS, 120).
-define(FRAMES_MS, 500).
-define(FRAMES, 4).
-define(ASK_MS, 150).
-define(AGAIN_MS, 2500).
-define(PULSE_MS, 200).
-define(MOST_NOISE, 100).
-define(BAUDS, [57600, 115200, 19200]).

%% @doc A greeting for the robot of these options.
-spec new(starl_create_options:t()) -> t().
new(Options) -> #greeting{options = Options}.

%% @doc Handles a lost line: the search begins again when the line is back.
-spec anew(t()) -> t().
anew(Greeting) -> Greeting#greeting{step = idle, tries = 0}.

%% @doc The word that opens the line.
-spec opening(t()) -> {open, Device :: term(), Baud :: pos_integer()}.
opening(#greeting{options = #{device := Device}, tried = none} = Greeting) ->
    {open, Device, own_baud(Greeting)};
opening(#greeting{options = #{device := Device}, tried = Baud}) ->
    {open, Device, Baud}.

own_baud(#greeting{options = Options}) -> starl_create_options:baud(Options).

%% @doc The sensors of the stream.
-spec ids(starl_create_packet:model()) -> [starl_create_packet:id()].
ids(1) -> [7, 9, 10, 11, 12, 14, 18, 25, 26, 34, 35, 41, 42];
ids(2) -> ids(1) ++ [43, 44].

%% @doc The line is open.
-spec opened(t()) -> {[action()], t()}.
opened(#greeting{options = #{model := Model}} = Greeting) ->
    Flush = binary:copy(starl_create_command:encode(start, Model), ?FLUSH),
    Fresh = Greeting#greeting{step = starting, frames = 0, noise = <<>>},
    {[{port, {send, Flush}}, {timer, step, ?START_MS}], Fresh}.

%% @doc The timer's time is over.
-spec due(t()) -> {[action()], t()}.
due(#greeting{step = starting, options = #{model := Model}} = Greeting) ->
    Probe = [{query, [43]} || Model =:= 1],
    Ask = starl_create_command:encode_all(Probe ++ [{stream, ids(Model)}], Model),
    Asking = Greeting#greeting{step = asking, noise = <<>>},
    {[{port, {send, Ask}}, {timer, step, ?FRAMES_MS}], Asking};
due(#greeting{step = asking, frames = 0, options = #{model := Model}} = Greeting) ->
    Ask = starl_create_command:encode({sensors, 35}, Model),
    Doubting = Greeting#greeting{step = doubting, noise = <<>>},
    {[{port, {send, Ask}}, {timer, step, ?ASK_MS}], Doubting};
due(#greeting{step = Step} = Greeting) when Step =:= asking; Step =:= doubting ->
    given_up(Greeting);
due(#greeting{step = resting} = Greeting) ->
    {[{port, opening(Greeting)}], Greeting#greeting{step = opening}};
due(Greeting) ->
    {[], Greeting}.

%% At another baud rate only the answer to the last question counts.
given_up(#greeting{tried = Baud, noise = <<_>>} = Greeting) when is_integer(Baud) ->
    {Rest, Next} = rest(?AGAIN_MS, Greeting#greeting{tried = none, tries = 0}),
    {[{say, warning, {answers_at, Baud}} | Rest], Next};
given_up(#greeting{noise = <<>>} = Greeting) ->
    silent(Greeting);
given_up(#greeting{tries = N} = Greeting) ->
    {Rest, Next} = rest(?AGAIN_MS, Greeting#greeting{tried = none, tries = N + 1}),
    {[{say, warning, diagnosed(Greeting)} | Rest], Next}.

diagnosed(#greeting{noise = <<_>>, options = #{model := Model}}) -> {other_sensors, Model};
diagnosed(Greeting) -> {no_frames_at, own_baud(Greeting)}.

silent(#greeting{tries = 0, options = Options} = Greeting) ->
    Pulse = [{port, {pulse, Line, ?PULSE_MS, 1}} || Line <- [wake(Options)], Line =/= none],
    {Rest, Next} = rest(?AGAIN_MS, Greeting#greeting{tries = 1}),
    {Pulse ++ Rest, Next};
silent(#greeting{tries = N, options = Options} = Greeting) ->
    Own = own_baud(Greeting),
    case lists:nthtail(N - 1, lists:delete(Own, ?BAUDS)) of
        [Other | _] ->
            rest(?START_MS, Greeting#greeting{tries = N + 1, tried = Other});
        [] ->
            {Rest, Next} = rest(?AGAIN_MS, Greeting#greeting{tries = 0, tried = none}),
            {[{say, warning, {asleep, Own, wake(Options)}} | Rest], Next}
    end.

wake(Options) -> maps:get(wake, Options, rts).

rest(Ms, Greeting) -> {[{timer, step, Ms}], Greeting#greeting{step = resting}}.

%% @doc Something has come along the line. `found': with this frame the robot is there; it is silent
%% no more.
-spec hear(starl_create_stream:found(), t()) -> {[action()], t()} | {found, t()}.
hear({noise, Bytes}, #greeting{noise = Noise} = Greeting) when byte_size(Noise) < ?MOST_NOISE ->
    {[], Greeting#greeting{noise = <<Noise/binary, Bytes/binary>>}};
hear({frame, _}, #greeting{step = Step, frames = N} = Greeting) when
    Step =:= asking; Step =:= doubting
->
    framed(Greeting#greeting{frames = N + 1});
hear(_Found, Greeting) ->
    {[], Greeting}.

%% Frames at another baud rate than that of the options; from a Create 2, which has answered the
%% question for an encoder among the first bytes.
framed(#greeting{tried = Baud} = Greeting) when is_integer(Baud) ->
    off({answers_at, Baud}, Greeting#greeting{tries = 0, tried = none});
framed(#greeting{options = #{model := 1}, noise = <<_:16>>, tries = N} = Greeting) ->
    off(is_create_2, Greeting#greeting{tries = N + 1, tried = none});
framed(#greeting{frames = N} = Greeting) when N < ?FRAMES ->
    {[], Greeting};
framed(Greeting) ->
    {found, Greeting#greeting{step = idle, tries = 0}}.

off(Advice, #greeting{options = #{model := Model}} = Greeting) ->
    Off = starl_create_command:encode({stream_on, 0}, Model),
    {Rest, Next} = rest(?AGAIN_MS, Greeting),
    {[{say, warning, Advice}, {port, {send, Off}} | Rest], Next}.
