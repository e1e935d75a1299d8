%% @doc The serial line of an emulated Create. It knows the baud rates of both ends, computes when
%% bytes have left, and applies quirks on the way: bursts, stray bytes, and garbage at a wrong rate.
-module(starl_create_uart).

-export([new/4, baud/1, slow/1, rate/3, other/2, hears/2, send/3]).

-export_type([t/0]).

-record(uart, {
    quirks :: starl_create_quirks:t(),
    wedged :: boolean(),
    %% both ends' baud rates
    baud :: pos_integer(),
    other = any :: pos_integer() | any,
    deaf_until :: integer(),
    %% when the robot's bytes have left it, and their number
    free_at :: integer(),
    sent = 0 :: non_neg_integer()
}).

-opaque t() :: #uart{}.

%% After a change of the baud rate it hears nothing for this time.
-define(DEAF_US, 100000).
-define(RATES, {300, 600, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 38400, 57600, 115200}).

%% @doc A line at this rate; `usual': that of its generation.
-spec new(starl_create_packet:model(), usual | pos_integer(), starl_create_quirks:t(), integer()) ->
    t().
new(Model, usual, Quirks, Now) ->
    new(Model, usual_baud(Model), Quirks, Now);
new(_Model, Baud, #{wedged := Wedged} = Quirks, Now) ->
    #uart{quirks = Quirks, wedged = Wedged, baud = Baud, deaf_until = Now, free_at = Now}.

usual_baud(1) -> 57600;
usual_baud(2) -> 115200.

%% @doc The robot's baud rate.
-spec baud(t()) -> pos_integer().
baud(#uart{baud = Baud}) -> Baud.

%% @doc The rate after three pulses of BRC.
-spec slow(t()) -> t().
slow(Uart) -> Uart#uart{baud = 19200}.

%% @doc A command changes the rate.
-spec rate(Code :: 0..11, NowUs :: integer(), t()) -> t().
rate(Code, Now, Uart) ->
    Uart#uart{baud = element(Code + 1, ?RATES), deaf_until = Now + ?DEAF_US}.

%% @doc The rate of the other end; `any': the right one.
-spec other(pos_integer() | any, t()) -> t().
other(Other, Uart) -> Uart#uart{other = Other}.

%% @doc Does the robot hear bytes now? Those at another rate are framing errors.
-spec hears(NowUs :: integer(), t()) -> boolean().
hears(Now, #uart{deaf_until = Until} = Uart) -> Now >= Until andalso is_same_rate(Uart).

is_same_rate(#uart{other = Other, baud = Baud}) -> Other =:= any orelse Other =:= Baud.

%% @doc Sends. Bytes bear the time at which the last has left. More than the line takes is lost.
-spec send(NowUs :: integer(), binary(), t()) -> {[{AtUs :: integer(), {bytes, binary()}}], t()}.
send(_Now, <<>>, Uart) ->
    {[], Uart};
send(_Now, _Bytes, #uart{wedged = true} = Uart) ->
    {[], Uart};
send(Now, Bytes0, #uart{free_at = Free, baud = Baud, sent = Sent} = Uart) ->
    Bytes = garbled(strayed(Bytes0, Uart), Uart),
    Begins = max(Now, Free),
    Leaves = Begins + byte_size(Bytes) * 10000000 div Baud,
    case Begins - Now > starl_create_tick:us() of
        true ->
            {[], Uart};
        false ->
            Next = Uart#uart{free_at = Leaves, sent = Sent + byte_size(Bytes)},
            {[{burst(Leaves, Uart), {bytes, Bytes}}], Next}
    end.

burst(At, #uart{quirks = #{burst_ms := 0}}) ->
    At;
burst(At, #uart{quirks = #{burst_ms := Ms}}) ->
    (starl_create_tick:floor_div(At, 1000 * Ms) + 1) * 1000 * Ms.

strayed(Bytes, #uart{quirks = #{stray_byte := 0}}) ->
    Bytes;
strayed(Bytes, #uart{quirks = #{stray_byte := Each}, sent = Sent}) ->
    case (Sent rem Each) + byte_size(Bytes) >= Each of
        true -> <<Bytes/binary, (erlang:phash2(Sent, 256))>>;
        false -> Bytes
    end.

%% The other end reads at another rate.
garbled(Bytes, #uart{sent = Sent} = Uart) ->
    case is_same_rate(Uart) of
        true ->
            Bytes;
        false ->
            Numbered = lists:zip(lists:seq(1, byte_size(Bytes)), binary_to_list(Bytes)),
            <<<<(erlang:phash2({Sent, N, Byte}, 256))>> || {N, Byte} <- Numbered>>
    end.
