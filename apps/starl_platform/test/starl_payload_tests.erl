%% A payload is plain data within the bounds of its kind; whatever breaks them is named.
-module(starl_payload_tests).
-include_lib("eunit/include/eunit.hrl").

-define(KINDS, [packet, message, content, label, kept]).

plain_data_passes_test() ->
    Plain = [0, -1, 1 bsl 2039, 1.5, <<"text">>, ok, 'größe', [], {}, #{}, [a | b], "text"],
    [?assertEqual({K, ok}, {K, starl_payload:check(K, T)}) || K <- ?KINDS, T <- [Plain | Plain]].

odd_terms_are_named_wherever_they_are_test() ->
    Odd = [
        {pid, self()},
        {port, hd(erlang:ports())},
        {reference, make_ref()},
        {function, fun() -> ok end},
        {function, fun lists:map/2},
        {bitstring, <<1:3>>},
        {huge_integer, 1 bsl 2040},
        {huge_integer, -(1 bsl 2040)}
    ],
    Inside = fun(T) -> [T, [T], [a | T], {a, T}, #{T => 1}, #{1 => T}, [{#{a => [T]}}]] end,
    [
        ?assertEqual({Term, {error, {holds, What}}}, {Term, starl_payload:check(Kind, Term)})
     || Kind <- ?KINDS, {What, T} <- Odd, Term <- Inside(T)
    ].

%% The last size that passes, and the next.
size_is_that_of_the_bytes_test() ->
    [
        begin
            Most = starl_payload:most_bytes(Kind),
            Bytes = fun(N) -> binary:copy(<<7>>, N) end,
            Atoms = fun(N) -> lists:duplicate(N, 'größe') end,
            ?assertEqual(ok, starl_payload:check(Kind, Bytes(Most - 6))),
            ?assertEqual({error, too_large}, starl_payload:check(Kind, Bytes(Most - 5))),
            ?assertEqual(ok, starl_payload:check(Kind, Atoms((Most - 7) div 9))),
            ?assertEqual({error, too_large}, starl_payload:check(Kind, Atoms((Most - 7) div 9 + 1)))
        end
     || Kind <- ?KINDS
    ].

depth_is_that_of_the_kind_test() ->
    Nested = fun(N) -> lists:foldl(fun(_, In) -> {In} end, x, lists:seq(1, N)) end,
    [
        begin
            Deepest = starl_payload:deepest(Kind),
            ?assertEqual(ok, starl_payload:check(Kind, Nested(Deepest))),
            ?assertEqual({error, too_deep}, starl_payload:check(Kind, Nested(Deepest + 1)))
        end
     || Kind <- ?KINDS
    ].

%% A term whose parts are shared can be far larger than the memory that it takes.
a_term_larger_than_the_memory_is_refused_test() ->
    Shared = lists:foldl(fun(_, In) -> {In, In} end, x, lists:seq(1, 48)),
    [
        ?assertEqual({error, too_large}, starl_payload:check(Kind, Shared))
     || Kind <- [packet, message, content, label]
    ].

%% What an application or a machine hands over has room around it in a packet.
kinds_have_room_around_them_test() ->
    Sizes = [{starl_payload:most_bytes(K), starl_payload:deepest(K)} || K <- ?KINDS -- [kept]],
    ?assertEqual(lists:reverse(lists:usort(Sizes)), lists:sort(fun erlang:'>='/2, Sizes)),
    ?assert(starl_payload:most_bytes(packet) - starl_payload:most_bytes(message) >= 5000).

every_reason_says_what_and_what_to_do_test() ->
    Reasons =
        [too_large, too_deep] ++
            [
                {holds, Odd}
             || Odd <- [pid, port, reference, function, bitstring, huge_integer, other]
            ],
    [
        ?assertMatch({match, _}, re:run(starl_payload:format_error(Kind, Why), "^it .*; [a-z]+ "))
     || Kind <- ?KINDS, Why <- Reasons
    ].
