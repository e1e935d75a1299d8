-module(starl_live_fragment_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ROOM, 100).

message(Size) -> <<<<(N rem 251)>> || <<N:16>> <= <<<<N:16>> || N <- lists:seq(1, Size)>>>>.

split(Message) -> [iolist_to_binary(P) || P <- starl_live_fragment:split(?ROOM, Message)].

%% The messages that come of payloads, and what is left.
join(From, Payloads, Fragments) ->
    lists:foldl(
        fun(Payload, {Messages, Before}) ->
            case starl_live_fragment:join(From, Payload, 0, Before) of
                {whole, Message, Next} -> {Messages ++ [Message], Next};
                {more, Next} -> {Messages, Next};
                {error, _, Next} -> {Messages, Next}
            end
        end,
        {[], Fragments},
        Payloads
    ).

new() -> starl_live_fragment:new(?ROOM).

whole_in_any_order_and_doubled_test() ->
    [
        begin
            Parts = split(message(Size)),
            [?assert(byte_size(Part) =< ?ROOM) || Part <- Parts],
            Empty = new(),
            ?assertEqual({[message(Size)], Empty}, join(1, Parts, Empty)),
            ?assertEqual({[message(Size)], Empty}, join(1, lists:reverse(Parts), Empty)),
            [First | Rest] = Parts,
            Twice = [First | [Part || Part <- Rest, _ <- [1, 2]]],
            {Messages, _} = join(1, lists:droplast(Twice) ++ [lists:last(Twice)], Empty),
            ?assertEqual(message(Size), hd(Messages))
        end
     || Size <- [0, 1, 98, 99, 100, 178, 179, 1000, 5000]
    ].

a_retransmission_fills_the_gaps_test() ->
    [First, Second | Rest] = Parts = split(message(500)),
    {[], Some} = join(1, [First | Rest], new()),
    ?assertMatch({[_], _}, join(1, [Second], Some)),
    %% another robot's do not
    ?assertMatch({[], _}, join(2, [Second], Some)),
    ?assertEqual(
        {[message(500)], new()}, join(1, Parts -- [First], element(2, join(1, [First], new())))
    ).

absurd_fragments_are_refused_test_() ->
    Digest = <<1:64>>,
    Part = binary:copy(<<1>>, ?ROOM - 11),
    [
        ?_assertMatch({error, fragment, _}, starl_live_fragment:join(1, Bytes, 0, new()))
     || Bytes <- [
            <<>>,
            <<2, "x">>,
            <<1>>,
            <<1, Digest/binary, 0, 0, Part/binary>>,
            <<1, Digest/binary, 1, 0, Part/binary>>,
            <<1, Digest/binary, 2, 2, Part/binary>>,
            <<1, Digest/binary, 2, 0, "short">>,
            <<1, Digest/binary, 2, 1>>,
            <<1, Digest/binary, 2, 1, Part/binary, "x">>
        ]
    ].

as_many_as_the_largest_has_test() ->
    Bytes = fun(Count) -> <<1, 1:64, Count, 0, 0:(8 * (1142 - 11))>> end,
    Fragments = starl_live_fragment:new(1142),
    ?assertMatch({more, _}, starl_live_fragment:join(1, Bytes(58), 0, Fragments)),
    ?assertMatch({error, fragment, _}, starl_live_fragment:join(1, Bytes(59), 0, Fragments)),
    Largest = binary:copy(<<1>>, 65_537),
    ?assertEqual(58, length(starl_live_fragment:split(1142, Largest))).

%% The largest message is a byte larger than the largest packet: here that byte needs a fragment of its own.
the_last_byte_of_the_largest_counts_test() ->
    Length = 1024,
    65_537 = 64 * Length + 1,
    Fragments = starl_live_fragment:new(Length + 11),
    Joins = fun(Count, N) ->
        {How, _} = without(
            starl_live_fragment:join(1, <<1, 1:64, Count, N, 0:(8 * Length)>>, 0, Fragments)
        ),
        How
    end,
    ?assertEqual([more, more, error, error], [
        Joins(Count, N)
     || Count <- [65, 66], N <- [0, Count - 1]
    ]).

without({more, Fragments}) -> {more, Fragments};
without({error, fragment, Fragments}) -> {error, Fragments}.

fragments_of_different_messages_do_not_mix_test() ->
    [A | _] = split(message(150)),
    [_, <<1, _:8/binary, Rest/binary>>] = split(binary:copy(<<9>>, 150)),
    <<1, Digest:8/binary, _/binary>> = A,
    {more, Some} = starl_live_fragment:join(1, A, 0, new()),
    Forged = <<1, Digest/binary, Rest/binary>>,
    ?assertEqual({error, digest, new()}, starl_live_fragment:join(1, Forged, 0, Some)),
    %% nor do those of different counts
    Other = <<1, Digest/binary, 3, 2, "x">>,
    ?assertEqual({error, fragment, Some}, starl_live_fragment:join(1, Other, 0, Some)).

%% A robot that begins messages and never ends them costs room for eight, and drops none of others.
memory_is_bounded_test() ->
    [First, Second] = split(message(150)),
    {more, Some} = starl_live_fragment:join(2, First, 0, new()),
    Begin = fun(N, Before) ->
        Bytes = <<1, N:64, 58, 0, 0:(8 * (?ROOM - 11))>>,
        {more, Next} = starl_live_fragment:join(1, Bytes, N, Before),
        Next
    end,
    Few = lists:foldl(Begin, Some, lists:seq(1, 8)),
    Many = lists:foldl(Begin, Few, lists:seq(9, 1000)),
    ?assert(erts_debug:flat_size(Many) =< erts_debug:flat_size(Few)),
    ?assertMatch({whole, _, _}, starl_live_fragment:join(2, Second, 1000, Many)).

many_robots_memory_is_bounded_test() ->
    Begin = fun(N, Before) ->
        Bytes = <<1, 1:64, 58, 0, 0:(8 * (?ROOM - 11))>>,
        {more, Next} = starl_live_fragment:join(N, Bytes, 0, Before),
        Next
    end,
    Few = lists:foldl(Begin, new(), lists:seq(1, 64)),
    Many = lists:foldl(Begin, Few, lists:seq(65, 1000)),
    %% the shape of a map depends on its keys as well
    ?assert(erts_debug:flat_size(Many) =< 1.5 * erts_debug:flat_size(Few)).

unfinished_messages_are_forgotten_test() ->
    [First, Second] = split(message(150)),
    {more, Some} = starl_live_fragment:join(1, First, 0, new()),
    [Other, _] = split(message(160)),
    {more, Later} = starl_live_fragment:join(1, Other, 10_001, Some),
    ?assertMatch({more, _}, starl_live_fragment:join(1, Second, 10_001, Later)),
    {more, Sooner} = starl_live_fragment:join(1, Other, 10_000, Some),
    ?assertMatch({whole, _, _}, starl_live_fragment:join(1, Second, 10_000, Sooner)),
    %% each fragment gives its message ten seconds anew, whatever the time
    [A, B, C] = split(message(250)),
    Joins = fun({Payload, Now}, Before) ->
        {more, Next} = starl_live_fragment:join(1, Payload, Now, Before),
        Next
    end,
    Waits = lists:foldl(Joins, new(), [{A, 20_000}, {B, 29_000}, {Other, 39_000}]),
    ?assertMatch({whole, _, _}, starl_live_fragment:join(1, C, 39_000, Waits)).

%% Eight of a robot, and 64 of all: for one more the oldest is dropped.
the_oldest_is_dropped_for_one_more_test_() ->
    Parts = fun(N) -> split(<<N:16, (message(150))/binary>>) end,
    Begun = fun(Robots) ->
        lists:foldl(
            fun({Robot, N}, Before) ->
                {more, Next} = starl_live_fragment:join(Robot, hd(Parts(N)), N, Before),
                Next
            end,
            new(),
            Robots
        )
    end,
    Ends = fun({Robot, N}, Fragments) ->
        element(1, starl_live_fragment:join(Robot, lists:last(Parts(N)), 100, Fragments))
    end,
    Own = [{1, N} || N <- lists:seq(1, 9)],
    All = [{N, N} || N <- lists:seq(1, 65)],
    [
        ?_assertEqual(
            {Expected, First, Most},
            {Ends(lists:nth(First, Robots), Begun(lists:sublist(Robots, Most))), First, Most}
        )
     || {Robots, Full} <- [{Own, 8}, {All, 64}],
        {Expected, First, Most} <- [
            {whole, 1, Full}, {more, 1, Full + 1}, {whole, 2, Full + 1}, {whole, Full + 1, Full + 1}
        ]
    ].
