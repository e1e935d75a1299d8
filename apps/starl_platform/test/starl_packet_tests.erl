%% What source/1 lets in: packets of exactly the known shapes, with whole numbers from 1 to 59 bits.
-module(starl_packet_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MOST, (1 bsl 59 - 1)).

%% Each shape, with its numbers: the first is the source.
shapes() ->
    [
        {[2, 1, 7, 9], fun([S, I, Q, N]) -> starl_packet:data({S, I, Q, N, #{}, t, body}) end},
        {[2, 1, 7, 9], fun([S, I, Q, N]) ->
            starl_packet:data({S, I, Q, {all, N}, #{1 => 2}, {app, t}, body})
        end},
        {[2, 1, 3, 7], fun([B, O, I, Q]) -> starl_packet:ack(B, O, I, Q) end},
        {[2, 1, 3, 7], fun([B, O, I, Q]) -> starl_packet:refusal(B, O, I, Q) end},
        {[2, 3], fun([R, I]) -> starl_packet:hello(R, I) end},
        {[2], fun([S]) -> starl_packet:shout(S, t, body) end},
        {[2], fun([S]) -> starl_packet:shout(S, {app, t}, body) end},
        {[2, 4711], fun([B, N]) -> starl_packet:ask(B, N, {0, 3}) end},
        {[2, 3, 4711, 5, 6], fun([R, I, N, L, C]) ->
            starl_packet:told(R, I, N, {L, C}, {0, 3})
        end}
    ].

known_shapes_test() ->
    [?assertEqual(2, starl_packet:source(Make(Numbers))) || {Numbers, Make} <- shapes()].

%% Each number of each shape in turn is replaced; the bounds are in.
bounds_of_numbers_test() ->
    [
        begin
            ?assertMatch(
                {_, Source} when Source =:= 2 orelse Source =:= N, {Packet, source(Packet)}
            )
        end
     || N <- [1, ?MOST], Packet <- replaced(N)
    ],
    Bad = [0, -1, ?MOST + 1, 1 bsl 70, 1.0, 2.5, one, "1", <<1>>, {1}, [], self()],
    [
        ?assertEqual({Packet, malformed}, {Packet, source(Packet)})
     || N <- Bad, Packet <- replaced(N)
    ].

source(Packet) -> starl_packet:source(Packet).

replaced(N) ->
    [
        Make(setnth(Place, Numbers, N))
     || {Numbers, Make} <- shapes(), Place <- lists:seq(1, length(Numbers))
    ].

setnth(1, [_ | Rest], N) -> [N | Rest];
setnth(Place, [First | Rest], N) -> [First | setnth(Place - 1, Rest, N)].

%% Two whole numbers from 0 on.
lives_test() ->
    Packets = fun(Lives) ->
        [starl_packet:ask(2, 1, Lives), starl_packet:told(2, 1, 1, {1, 1}, Lives)]
    end,
    [?assertEqual(2, source(P)) || Lives <- [{0, 0}, {3, ?MOST}], P <- Packets(Lives)],
    [
        ?assertEqual(malformed, source(P))
     || Lives <- [{-1, 0}, {0, ?MOST + 1}, {0}, {0, 0, 0}, [0, 0], none, {a, 1}],
        P <- Packets(Lives)
    ].

types_test() ->
    Packets = fun(Type) ->
        [starl_packet:data({2, 1, 7, 9, #{}, Type, body}), starl_packet:shout(2, Type, body)]
    end,
    [?assertEqual(2, source(P)) || Type <- [t, {app, t}], P <- Packets(Type)],
    Bad = [1, "t", <<"t">>, {t}, {}, {app}, {app, 1}, {other, t}, {app, t, t}, {t, app}, #{}],
    [?assertEqual({P, malformed}, {P, source(P)}) || Type <- Bad, P <- Packets(Type)].

%% Who it is meant for is a map; a number is one, or one among the broadcasts.
fields_of_data_test() ->
    Data = fun(Number, For) -> starl_packet:data({2, 1, 7, Number, For, t, body}) end,
    ?assertEqual(2, source(Data(9, #{3 => 2}))),
    [?assertEqual(malformed, source(Data(9, For))) || For <- [[], none, {3, 2}, 1]],
    Numbers = [{all}, {all, 0}, {one, 9}, {all, 9, 9}, {all, {all, 9}}, all, []],
    [?assertEqual({N, malformed}, {N, source(Data(N, #{}))}) || N <- Numbers].

%% Nothing else is a packet: another name, version or kind, a part more or less, what has no parts.
no_packet_test() ->
    [
        ?assertEqual({Other, malformed}, {Other, source(Other)})
     || {Numbers, Make} <- shapes(), Other <- near(Make(Numbers))
    ],
    [?assertEqual(malformed, source(T)) || T <- [{}, [], starl, 1, <<"starl">>, #{}, {starl, 1}]].

near(Packet) ->
    [
        setelement(1, Packet, other),
        setelement(2, Packet, 2),
        setelement(2, Packet, 0),
        setelement(3, Packet, other),
        erlang:append_element(Packet, 1),
        list_to_tuple(lists:droplast(tuple_to_list(Packet)))
    ].

%% What is told of numbers is a pair.
lows_test() ->
    [
        ?assertEqual(malformed, source(starl_packet:told(2, 3, 4711, Lows, {0, 0})))
     || Lows <- [5, {5}, {5, 6, 7}, [5, 6], none]
    ].
