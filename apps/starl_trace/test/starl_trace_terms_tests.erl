%% Terms in a recording: exact, and harmless when they come from a stranger.
-module(starl_trace_terms_tests).
-include_lib("eunit/include/eunit.hrl").

exact_test() ->
    Term = [{trace, -5, {1, sap, {told, 0.1, <<1, 2:3>>, "text", #{a => [b | c]}, 1 bsl 90}}}],
    ?assertEqual({ok, Term}, decoded(starl_trace_terms:encode(Term))).

%% The atoms of an application that is not loaded are made: here from bytes, as a file has them.
new_atoms_test() ->
    Name = fresh_name(),
    Bytes = <<131, 104, 2, 119, (byte_size(Name)), Name/binary, 116, 1:32, 97, 1, 97, 2>>,
    {ok, {Atom, #{1 := 2}}} = decoded(text(Bytes)),
    ?assertEqual(Name, atom_to_binary(Atom)).

%% An atom behind a term of whatever kind is found, and those within it.
atoms_behind_every_kind_of_term_test() ->
    X = 1,
    Kinds =
        [atom, 1, 255, 256, -1, 1.5, 1 bsl 70, -(1 bsl 70), 1 bsl 2100, [], "text", <<>>, <<"b">>] ++
            [<<1:3>>, {}, {1, 2}, list_to_tuple(lists:seq(1, 300)), [1 | 2], [a, 1.0], #{}] ++
            [#{a => 1, 2 => b}, self(), make_ref(), hd(erlang:ports()), fun lists:max/1] ++
            [fun() -> X end, fun(Y) -> {X, Y} end],
    %% and of kinds that other releases write: the names of Latin-1, processes and references of old
    Node = <<119, 1, "n">>,
    Old = [
        <<100, 2:16, "ab">>,
        <<118, 2:16, "ab">>,
        <<115, 1, 16#e4>>,
        <<105, 1:32, 97, 1>>,
        <<103, Node/binary, 0:72>>,
        <<88, Node/binary, 0:96>>,
        <<89, Node/binary, 0:64>>,
        <<120, Node/binary, 0:96>>,
        <<114, 2:16, Node/binary, 0:72>>,
        <<90, 2:16, Node/binary, 0:96>>
    ],
    [
        begin
            Name = fresh_name(),
            Behind = <<131, 104, 2, Bytes/binary, 119, (byte_size(Name)), Name/binary>>,
            ?assertEqual({Bytes, ok}, {Bytes, starl_trace_atoms:make(Behind, 10000)}),
            ?assertEqual(Name, atom_to_binary(binary_to_existing_atom(Name))),
            ?assertEqual(
                {Bytes, {error, not_terms}},
                {Bytes, starl_trace_atoms:make(<<Behind/binary, 1>>, 10000)}
            )
        end
     || Bytes <-
            [binary:part(B, 1, byte_size(B) - 1) || B <- lists:map(fun term_to_binary/1, Kinds)] ++
                Old
    ].

%% Beyond the bound none is made.
too_many_atoms_test() ->
    Names = [<<(fresh_name())/binary, (integer_to_binary(N))/binary>> || N <- lists:seq(1, 10001)],
    Atoms = [<<119, (byte_size(Name)), Name/binary>> || Name <- Names],
    Bytes = iolist_to_binary([<<131, 108, 10001:32>>, Atoms, 106]),
    ?assertEqual({error, too_many_atoms}, decoded(text(Bytes))),
    ?assertError(badarg, binary_to_existing_atom(hd(Names))).

%% The room for atoms is one for all recordings: what one has taken another cannot take.
room_for_atoms_is_taken_once_test() ->
    Make = fun(Name, Most) ->
        starl_trace_atoms:make(<<131, 119, (byte_size(Name)), Name/binary>>, Most)
    end,
    [A, B, C] = [<<(fresh_name())/binary, N>> || N <- "abc"],
    ok = Make(A, 1000000000),
    Taken = counters:get(persistent_term:get(starl_trace_atoms), 1),
    ?assertEqual({error, too_many_atoms}, Make(B, Taken)),
    ?assertEqual(ok, Make(B, Taken + 1)),
    %% an atom that exists takes none
    ?assertEqual(ok, Make(A, Taken + 1)),
    ?assertEqual({error, too_many_atoms}, Make(C, Taken + 1)).

%% A large term is packed, and read again.
large_terms_test() ->
    Large = binary:copy(<<"large">>, 1000000),
    Text = iolist_to_binary(starl_trace_terms:encode(Large)),
    ?assert(byte_size(Text) < 100000),
    ?assertEqual({ok, Large}, starl_trace_terms:decode(Text)).

%% A text that unpacks to more than it says, or says that it is huge.
bombs_test() ->
    <<_, _:32, _/binary>> = Packed = zlib:compress(binary:copy(<<97>>, 1000000)),
    ?assertEqual({error, too_large}, decoded(text([<<131, 80, 100:32>>, Packed]))),
    ?assertEqual({error, too_large}, decoded(text([<<131, 80, 16#ffffffff:32>>, Packed]))).

%% The bound is on what a text says of itself, before anything is unpacked.
a_term_may_have_32_megabytes_test() ->
    <<131, Bytes/binary>> = term_to_binary(small),
    Says = fun(Size) -> decoded(text([<<131, 80, Size:32>>, zlib:compress(Bytes)])) end,
    ?assertEqual({ok, small}, Says(32 * 1024 * 1024)),
    ?assertEqual({error, too_large}, Says(32 * 1024 * 1024 + 1)).

strangers_test() ->
    [
        ?assertMatch({error, not_terms}, decoded(Text))
     || Text <- [
            <<>>,
            <<"{}">>,
            <<"{\"terms\":\"">>,
            <<"{\"terms\":\"x">>,
            <<"{\"terms\":\"\"}">>,
            <<"{\"terms\":\"????\"}">>,
            text(<<131, 104, 200>>),
            text(<<131, 80, 5:32, 1, 2, 3>>),
            text(<<131, 119, 255, "short">>)
        ]
    ].

decoded(Text) -> starl_trace_terms:decode(iolist_to_binary(Text)).

text(Bytes) -> ["{\"terms\":\"", base64:encode(iolist_to_binary(Bytes)), "\"}"].

fresh_name() ->
    <<"fresh_",
        (integer_to_binary(erlang:unique_integer([positive]) + erlang:system_time()))/binary>>.
