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

%% Beyond the bound none is made.
too_many_atoms_test() ->
    Names = [<<(fresh_name())/binary, (integer_to_binary(N))/binary>> || N <- lists:seq(1, 10001)],
    Atoms = [<<119, (byte_size(Name)), Name/binary>> || Name <- Names],
    Bytes = iolist_to_binary([<<131, 108, 10001:32>>, Atoms, 106]),
    ?assertEqual({error, too_many_atoms}, decoded(text(Bytes))),
    ?assertError(badarg, binary_to_existing_atom(hd(Names))).

%% A text that unpacks to more than it says, or says that it is huge.
bombs_test() ->
    <<_, _:32, _/binary>> = Packed = zlib:compress(binary:copy(<<97>>, 1000000)),
    ?assertEqual({error, too_large}, decoded(text([<<131, 80, 100:32>>, Packed]))),
    ?assertEqual({error, too_large}, decoded(text([<<131, 80, 16#ffffffff:32>>, Packed]))).

strangers_test() ->
    [
        ?assertMatch({error, not_terms}, decoded(Text))
     || Text <- [
            <<>>,
            <<"{}">>,
            <<"{\"terms\":\"">>,
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
