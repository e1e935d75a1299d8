%% @doc Drives a Create by keys. Each key moves it for a short time only: without a further one (a
%% key held down repeats) it stops, by the port's own clock.
-module(starl_create_by_hand).

-export([run/2, key/2, keys/0]).

-export_type([options/0, act/0]).

%% `hold_ms': how long a key moves it. `ready': called once the robot is under control.
-type options() :: #{
    model := starl_create_packet:model(),
    baud := pos_integer(),
    speed := 10..500,
    hold_ms := pos_integer(),
    ready => fun(() -> term()),
    atom() => term()
}.

%% `none': the beginning of an arrow.
-type act() ::
    {go, Right :: integer(), Left :: integer()} | stop | {speed, pos_integer()} | quit | none.

-define(STEP, 50).
-define(LISTEN_MS, 300).

%% @doc What the keys do.
-spec keys() -> [{string(), string()}].
keys() ->
    [
        {"w s a d, arrows", "forward, backward, turn left, turn right, while the key is held"},
        {"+ -", "faster, slower"},
        {"any other", "stop at once"},
        {"q", "stop and end"}
    ].

%% @doc Takes control and obeys messages `{keys, Bytes}' to this process, until a `q', or `quit'. `ended': it
%% has ended before.
-spec run(Device :: string(), options()) -> ok | {error | ended, unicode:chardata()}.
run(Device, #{baud := Baud} = Options) ->
    case starl_create_probe:open(Device, Baud, starl_create_calibration:stop()) of
        {ok, Probe} ->
            Ended = controlled(in_control(Probe), Probe, Options),
            ok = starl_create_probe:close(Probe),
            Ended;
        {error, {_Reason, Text}} ->
            {error, Text}
    end.

in_control(Probe) ->
    ok = starl_create_probe:send(Probe, binary:copy(<<128>>, 8)),
    _ = starl_create_probe:listen(Probe, 40),
    ok = starl_create_probe:send(Probe, <<131>>),
    _ = starl_create_probe:listen(Probe, 40),
    starl_create_probe:ask(Probe, <<142, 35>>, 1, ?LISTEN_MS).

controlled({ok, <<Mode>>}, Probe, Options) when Mode =:= 2; Mode =:= 3 ->
    _ = (maps:get(ready, Options, fun() -> ok end))(),
    loop(Probe, Options);
controlled({ok, _}, _Probe, _Options) ->
    {error,
        "it does not let itself be driven: take it off its dock and its charger, put it on the floor"};
controlled(none, _Probe, #{baud := Baud}) ->
    {error, [
        "it does not answer at ",
        integer_to_list(Baud),
        " baud; ./starl create doctor finds out why"
    ]}.

loop(Probe, Options) -> loop(Probe, <<>>, Options).

%% Keys arrive as they like, an arrow perhaps in three parts.
loop(Probe, Before, Options) ->
    receive
        quit -> ok;
        {keys, Keys} -> hit(<<Before/binary, Keys/binary>>, Probe, Options);
        {closed, _} -> {ended, "the cable is pulled"};
        _ -> loop(Probe, Before, Options)
    end.

hit(Keys, Probe, Options) ->
    case key(Keys, Options) of
        none -> loop(Probe, Keys, Options);
        Act -> obeyed(Act, Probe, Options)
    end.

obeyed(quit, _Probe, _Options) ->
    ok;
obeyed({speed, Speed}, Probe, Options) ->
    loop(Probe, Options#{speed := Speed});
obeyed(stop, Probe, Options) ->
    ok = starl_create_probe:go(Probe, [], starl_create_calibration:stop()),
    loop(Probe, Options);
obeyed({go, Right, Left}, Probe, #{hold_ms := Ms} = Options) ->
    Go = <<145, Right:16, Left:16>>,
    ok = starl_create_probe:go(Probe, [{Go, 1000 * Ms}], starl_create_calibration:stop()),
    loop(Probe, Options).

%% @doc What the last of these keys says.
-spec key(binary(), options()) -> act().
key(Keys, Options) -> does(last(lists:reverse(binary_to_list(Keys))), Options).

does($w, #{speed := Speed}) -> {go, Speed, Speed};
does($s, #{speed := Speed}) -> {go, -Speed, -Speed};
does($a, #{speed := Speed}) -> {go, Speed div 2, -(Speed div 2)};
does($d, #{speed := Speed}) -> {go, -(Speed div 2), Speed div 2};
does($+, #{speed := Speed}) -> {speed, min(500, Speed + ?STEP)};
does($-, #{speed := Speed}) -> {speed, max(?STEP, Speed - ?STEP)};
does($q, _Options) -> quit;
does($\e, _Options) -> none;
does(_, _Options) -> stop.

%% Arrows are three bytes.
last([$A, $[, $\e | _]) -> $w;
last([$B, $[, $\e | _]) -> $s;
last([$C, $[, $\e | _]) -> $d;
last([$D, $[, $\e | _]) -> $a;
last([$[, $\e | _]) -> $\e;
last([Key | _]) -> Key;
last([]) -> $\e.
