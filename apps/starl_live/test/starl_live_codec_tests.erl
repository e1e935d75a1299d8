-module(starl_live_codec_tests).
-include_lib("eunit/include/eunit.hrl").

packet(Body) -> starl_packet:shout(1, {app, news}, Body).

%% A packet around a body that is given as bytes of the external term format.
bytes(Body) ->
    {ok, <<1, Bytes/binary>>} = starl_live_codec:encode(packet(here)),
    Hole = <<119, 4, "here">>,
    [Before, <<>>] = binary:split(Bytes, Hole),
    <<1, Before/binary, Body/binary>>.

decode(Body) -> starl_live_codec:decode(1, bytes(Body)).

plain_data_comes_back_test() ->
    [
        begin
            {ok, Bytes} = starl_live_codec:encode(packet(Body)),
            ?assertEqual({ok, packet(Body)}, starl_live_codec:decode(1, Bytes))
        end
     || Body <- starl_live_packets:plain()
    ].

other_data_is_refused_at_the_sender_test() ->
    [
        begin
            {error, Why} = starl_live_codec:encode(packet(Body)),
            Line = lists:flatten(starl_live_codec:format_error(packet(Body), Why)),
            ?assertMatch("a datagram {app,news} cannot be sent: it " ++ _, Line),
            ?assertNotEqual(nomatch, string:find(Line, Word)),
            ?assertEqual(nomatch, string:find(Line, "\n"))
        end
     || {Body, Word} <- starl_live_packets:odd()
    ].

%% Depth is what is open at one place, not what has been opened before: containers beside each other may
%% be as many as there is room for, and each as deep as the first.
width_costs_no_depth_test() ->
    Deep = lists:foldl(fun(_, In) -> {In} end, y, lists:seq(1, 50)),
    Kinds = [Deep, {}, {a, b}, [a, b], #{a => b}, list_to_tuple(lists:seq(1, 300))],
    [
        begin
            {ok, Bytes} = starl_live_codec:encode(packet([lists:duplicate(40, Body), Deep])),
            ?assertEqual(
                {ok, packet([lists:duplicate(40, Body), Deep])}, starl_live_codec:decode(1, Bytes)
            )
        end
     || Body <- Kinds
    ],
    Deeper = lists:foldl(fun(_, In) -> {In} end, Deep, lists:seq(1, 20)),
    ?assertEqual({error, too_deep}, starl_live_codec:encode(packet([{}, Deeper]))).

%% What may be handed over may travel, with the longest head that a team of 300 gives it; what the codec
%% refuses cannot be handed over.
what_is_handed_over_travels_test() ->
    Most = starl_payload:most_bytes(message),
    Nested = lists:foldl(fun(_, In) -> [x | {In}] end, y, lists:seq(1, 30)),
    For = maps:from_list([{Robot, 1 bsl 57} || Robot <- lists:seq(1, 300)]),
    [
        begin
            ?assertEqual(ok, starl_payload:check(message, Body)),
            Packet = starl_packet:data({1, 1 bsl 57, 1 bsl 57, 1 bsl 57, For, {app, news}, Body}),
            {ok, Bytes} = starl_live_codec:encode(Packet),
            ?assertEqual({ok, Packet}, starl_live_codec:decode(1, Bytes))
        end
     || Body <- [binary:copy(<<7>>, Most - 6), Nested | plain()]
    ],
    [?assertMatch({error, _}, starl_payload:check(message, Body)) || {Body, _} <- odd()].

plain() -> [Body || Body <- starl_live_packets:plain(), not is_binary(Body)].

odd() -> starl_live_packets:odd().

other_data_is_refused_at_the_receiver_test() ->
    Odd = [self(), make_ref(), fun() -> ok end, fun lists:map/2, hd(erlang:ports()), <<1:3>>],
    [
        begin
            <<131, Term/binary>> = term_to_binary(Body, [{minor_version, 2}]),
            ?assertEqual({error, term}, decode(Term))
        end
     || Body <- Odd
    ].

the_hole_takes_bytes_test() -> ?assertEqual({ok, packet(7)}, decode(<<97, 7>>)).

compressed_terms_are_refused_test() ->
    Bomb = term_to_binary(packet(binary:copy(<<0>>, 10_000_000)), [{compressed, 9}]),
    ?assertEqual({error, term}, starl_live_codec:decode(1, <<1, Bomb/binary>>)),
    %% nor inside of a term
    <<131, Inner/binary>> = term_to_binary(binary:copy(<<0>>, 10_000), [compressed]),
    ?assertMatch(<<80, _/binary>>, Inner),
    ?assertEqual({error, term}, decode(Inner)),
    ?assertEqual({error, term}, decode(<<131, Inner/binary>>)).

unknown_atoms_are_refused_test() ->
    Name = <<"never_heard_of_this_atom_here">>,
    Before = erlang:system_info(atom_count),
    ?assertEqual({error, unknown_atom}, decode(<<119, (byte_size(Name)), Name/binary>>)),
    ?assertEqual({error, unknown_atom}, decode(<<118, (byte_size(Name)):16, Name/binary>>)),
    ?assertEqual(Before, erlang:system_info(atom_count)).

%% Bytes that binary_to_term/1 alone would try, with absurd counts among them.
absurd_terms_are_refused_test_() ->
    [
        ?_assertEqual({error, Why}, decode(Bytes))
     || {Why, Bytes} <- [
            {term, <<>>},
            {term, <<105, 16#FFFFFFFF:32>>},
            {term, <<108, 16#FFFFFFFF:32, 106>>},
            {term, <<116, 16#FFFFFFFF:32, 97, 1>>},
            {term, <<109, 16#FFFFFFFF:32, 0>>},
            {term, <<107, 9:16, 1>>},
            {term, <<97, 1, 97, 1>>},
            %% more than one term, of each kind
            {term, <<97, 1, 98, 1:32>>},
            {term, <<97, 1, 106>>},
            {term, <<97, 1, 104, 0>>},
            {term, <<97, 1, 104, 1, 97, 1>>},
            {term, <<97, 1, 105, 0:32>>},
            {term, <<97, 1, 108, 0:32, 106>>},
            {term, <<97, 1, 116, 0:32>>},
            {term, <<97, 1, 109, 0:32>>},
            {term, <<97, 1, 119, 2, "ok">>},
            {term, <<97, 1, 0>>},
            {term, <<104, 2, 97, 1>>},
            {term, <<100, 2:16, "ok">>},
            {term, <<82, 0>>},
            {term, <<131, 97, 1>>},
            {term, binary:copy(<<104, 1>>, 1000)},
            {term, <<108, 1:32, (binary:copy(<<108, 1:32>>, 1000))/binary>>},
            %% a key twice
            {unknown_atom, <<116, 2:32, 97, 1, 97, 1, 97, 1, 97, 1>>},
            %% no number
            {unknown_atom, <<70, 16#7FF0000000000000:64>>},
            %% no text
            {unknown_atom, <<119, 2, 255, 255>>}
        ]
    ].

too_long_or_of_another_version_test() ->
    Long = <<109, 65_536:32, 0:(8 * 65_536)>>,
    ?assertEqual({error, term}, decode(Long)),
    {ok, <<1, Bytes/binary>>} = starl_live_codec:encode(packet(1)),
    ?assertEqual({error, version}, starl_live_codec:decode(1, <<2, Bytes/binary>>)),
    ?assertEqual({error, version}, starl_live_codec:decode(1, <<>>)),
    ?assertEqual({error, term}, starl_live_codec:decode(1, <<1>>)),
    ?assertEqual({error, term}, starl_live_codec:decode(1, <<1, 130, 97, 1>>)).

%% The largest packet travels, one of a byte more does not.
the_largest_packet_travels_test() ->
    Sized = fun(Size) -> packet(binary:copy(<<7>>, Size)) end,
    Most =
        starl_payload:most_bytes(packet) -
            byte_size(term_to_binary(Sized(0), [{minor_version, 2}])),
    {ok, Bytes} = starl_live_codec:encode(Sized(Most)),
    ?assertEqual({ok, Sized(Most)}, starl_live_codec:decode(1, Bytes)),
    ?assertEqual({error, too_large}, starl_live_codec:encode(Sized(Most + 1))).

a_packet_of_its_sender_test() ->
    {ok, Bytes} = starl_live_codec:encode(packet(1)),
    ?assertEqual({error, sender}, starl_live_codec:decode(2, Bytes)),
    Hello = term_to_binary({starl, 1, hello, 1, -1}, [{minor_version, 2}]),
    ?assertEqual({error, packet}, starl_live_codec:decode(1, <<1, Hello/binary>>)).

%% Of what cannot travel the sender learns what it is.
what_cannot_travel_is_named_test_() ->
    {ok, Port} = gen_udp:open(0),
    ok = gen_udp:close(Port),
    [
        ?_assertEqual({error, {holds, What}}, starl_live_codec:encode(packet([Term])))
     || {What, Term} <- [
            {pid, self()},
            {port, Port},
            %% one of another computer that has opened very many
            {port, binary_to_term(<<131, 120, 119, 3, "a@b", (1 bsl 40):64, 1:32>>)},
            {reference, make_ref()},
            {function, fun() -> Port end},
            {function, fun lists:map/2},
            {bitstring, <<1:3>>},
            {huge_integer, 1 bsl 4000}
        ]
    ].

%% A line says which packet it is: a message or a datagram with its type, or one of the transport's own.
what_cannot_be_sent_is_named_test_() ->
    Says = fun(Packet) ->
        lists:flatten(starl_live_codec:format_error(Packet, {holds, pid}))
    end,
    Message = starl_packet:data({1, 2, 3, 4, #{2 => 1}, {app, news}, self()}),
    [
        ?_assertMatch("a message {app,news} cannot be sent: " ++ _, Says(Message)),
        ?_assertMatch("a datagram {app,news} cannot be sent: " ++ _, Says(packet(self()))),
        ?_assertMatch("a packet cannot be sent: " ++ _, Says(other))
    ].

%% Containers of each kind may be nested as deep as a payload, and no deeper; what is no container is not too deep.
each_kind_of_container_counts_test_() ->
    Nested = fun(Wrap, N) ->
        starl_live_codec:encode(packet(lists:foldl(fun(_, T) -> Wrap(T) end, x, lists:seq(1, N))))
    end,
    Deepest = starl_payload:deepest(packet) - 1,
    [
        begin
            Right = Nested(Wrap, Deepest),
            Wrong = Nested(Wrap, Deepest + 1),
            [?_assertMatch({ok, _}, Right), ?_assertEqual({error, too_deep}, Wrong)]
        end
     || Wrap <- [
            fun(T) -> [T] end,
            fun(T) -> {T} end,
            fun(T) -> #{k => T} end,
            fun(T) -> list_to_tuple([T | lists:duplicate(255, 0)]) end
        ]
    ] ++
        [
            ?_assertEqual(
                {error, {holds, pid}},
                starl_live_codec:encode(
                    packet(lists:foldl(fun(_, T) -> {T} end, self(), lists:seq(1, Deepest)))
                )
            )
        ].
