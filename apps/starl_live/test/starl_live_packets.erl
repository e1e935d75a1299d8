%% Packets for tests: generators of PropEr, and one of every shape.
-module(starl_live_packets).
-include_lib("proper/include/proper.hrl").

-export([packet/1, body/0, plain/0, odd/0]).

%% Any packet of a robot.
packet(From) ->
    oneof([
        ?LET(
            {I, S, T, B},
            {count(), count(), type(), body()},
            starl_packet:data({From, I, S, oneof_number(S), #{2 => I, 3 => 7}, T, B})
        ),
        ?LET({A, B, C}, {count(), count(), count()}, starl_packet:ack(From, A, B, C)),
        ?LET({A, B, C}, {count(), count(), count()}, starl_packet:refusal(From, A, B, C)),
        ?LET(I, count(), starl_packet:hello(From, I)),
        ?LET({T, B}, {type(), body()}, starl_packet:shout(From, T, B)),
        ?LET(N, count(), starl_packet:ask(From, N, {0, N})),
        ?LET(
            {I, N, L, C},
            {count(), count(), count(), count()},
            starl_packet:told(From, I, N, {L, C}, {0, I})
        )
    ]).

oneof_number(S) when S rem 2 =:= 0 -> S;
oneof_number(S) -> {all, S}.

count() -> oneof([range(1, 100), range(1, 16#7FFFFFFFFFFFFFF)]).

type() -> oneof([dpp, election, {app, news}]).

body() -> ?SIZED(Size, body(min(Size, 40))).

body(0) ->
    leaf();
body(Size) ->
    Half = Size div 2,
    oneof([
        leaf(),
        ?LAZY(few(body(Half div 2))),
        ?LAZY(?LET(Elements, few(body(Half div 2)), list_to_tuple(Elements))),
        ?LAZY(?LET(Pairs, few({leaf(), body(Half div 2)}), maps:from_list(Pairs))),
        ?LAZY(?LET({Head, Tail}, {body(Half), body(Half)}, [Head | Tail]))
    ]).

%% So few that a packet of them is not too large.
few(Type) -> ?LET(Number, range(0, 6), vector(Number, Type)).

leaf() ->
    oneof([
        integer(),
        range(-(1 bsl 200), 1 bsl 200),
        float(),
        binary(),
        oneof([ok, '', 'größe', true, undefined]),
        "text",
        [],
        {}
    ]).

%% Bodies of every kind of plain data, at its bounds.
plain() ->
    [
        0,
        255,
        256,
        -1,
        1 bsl 31,
        -(1 bsl 31) - 1,
        (1 bsl 2040) - 1,
        1.5,
        -0.0,
        <<>>,
        <<1, 2>>,
        '',
        'größe',
        list_to_atom(lists:duplicate(255, $ü)),
        [],
        "abc",
        [a | b],
        [1, 2.0 | #{}],
        {},
        list_to_tuple(lists:seq(1, 300)),
        #{},
        maps:from_list([{N, N} || N <- lists:seq(1, 99)]),
        lists:seq(1, 5000),
        binary:copy(<<7>>, 60_000)
    ].

%% Bodies that cannot travel, each with a word of the line that says so.
odd() ->
    [
        {self(), "process"},
        {[{deep, #{self() => 1}}], "process"},
        {make_ref(), "reference"},
        {fun() -> ok end, "function"},
        {fun lists:map/2, "function"},
        {hd(erlang:ports()), "port"},
        {<<1:3>>, "bit string"},
        {1 bsl 2048, "integer of more than 255 bytes"},
        {lists:foldl(fun(_, In) -> {In} end, 0, lists:seq(1, 64)), "nested more than 64 deep"},
        {lists:foldl(fun(_, In) -> [In] end, x, lists:seq(1, 64)), "nested more than 64 deep"},
        {binary:copy(<<7>>, 65_536), "more than 65536"}
    ].
