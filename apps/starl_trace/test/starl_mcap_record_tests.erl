%% The bytes of MCAP records, as https://mcap.dev/spec has them.
-module(starl_mcap_record_tests).
-include_lib("eunit/include/eunit.hrl").

magic_test() ->
    ?assertEqual(<<16#89, 16#4D, 16#43, 16#41, 16#50, 16#30, 16#0D, 16#0A>>, magic()).

magic() -> starl_mcap_record:magic().

%% Each record, and its bytes in hexadecimal.
golden() ->
    [
        {{header, <<"p">>, <<"lib">>}, "01 0C00000000000000 01000000 70 03000000 6C6962"},
        {{footer, 1, 2, 3}, "02 1400000000000000 0100000000000000 0200000000000000 03000000"},
        {
            {schema, 1, <<"a">>, <<"b">>, <<"c">>},
            "03 1100000000000000 0100 01000000 61 01000000 62 01000000 63"
        },
        {
            {channel, 2, 1, <<"t">>, <<"json">>, [{<<"k">>, <<"v">>}]},
            "04 1F00000000000000 0200 0100 01000000 74 04000000 6A736F6E"
            " 0A000000 01000000 6B 01000000 76"
        },
        {
            {message, 2, 7, 8, 9, <<"x">>},
            "05 1700000000000000 0200 07000000 0800000000000000 0900000000000000 78"
        },
        {
            {chunk, 1, 2, 3, 4, <<>>, <<"abc">>},
            "06 2B00000000000000 0100000000000000 0200000000000000 0300000000000000 04000000"
            " 00000000 0300000000000000 616263"
        },
        {
            {message_index, 2, [{1, 3}]},
            "07 1600000000000000 0200 10000000 0100000000000000 0300000000000000"
        },
        {
            {chunk_index, 1, 2, 3, 4, [{2, 5}], 6, <<>>, 7, 8},
            "08 4A00000000000000 0100000000000000 0200000000000000 0300000000000000"
            " 0400000000000000 0A000000 0200 0500000000000000 0600000000000000 00000000"
            " 0700000000000000 0800000000000000"
        },
        {
            {attachment_index, 1, 2, 3, 4, 5, <<"n">>, <<"m">>},
            "0A 3200000000000000 0100000000000000 0200000000000000 0300000000000000"
            " 0400000000000000 0500000000000000 01000000 6E 01000000 6D"
        },
        {
            {statistics, 1, 2, 3, 4, 5, 6, 7, 8, [{2, 9}]},
            "0B 3800000000000000 0100000000000000 0200 03000000 04000000 05000000 06000000"
            " 0700000000000000 0800000000000000 0A000000 0200 0900000000000000"
        },
        {{metadata, <<"n">>, []}, "0C 0900000000000000 01000000 6E 00000000"},
        {
            {metadata_index, 1, 2, <<"n">>},
            "0D 1500000000000000 0100000000000000 0200000000000000 01000000 6E"
        },
        {{summary_offset, 3, 1, 2}, "0E 1100000000000000 03 0100000000000000 0200000000000000"},
        {{data_end, 258}, "0F 0400000000000000 02010000"}
    ].

golden_test_() ->
    [
        {atom_to_list(element(1, Record)), [
            ?_assertEqual(bytes(Hex), iolist_to_binary(starl_mcap_record:encode(Record))),
            ?_assertEqual({ok, Record, <<>>}, starl_mcap_record:decode(bytes(Hex)))
        ]}
     || {Record, Hex} <- golden()
    ].

%% The checksum of an attachment covers what stands before it in the record.
attachment_test() ->
    Covered = bytes(
        "0100000000000000 0200000000000000 01000000 6E 01000000 6D 0100000000000000 78"
    ),
    Bytes = iolist_to_binary(
        starl_mcap_record:encode({attachment, 1, 2, <<"n">>, <<"m">>, <<"x">>})
    ),
    Crc = erlang:crc32(Covered),
    ?assertEqual(<<9, 39:64/little, Covered/binary, Crc:32/little>>, Bytes),
    {ok, {attachment, 1, 2, <<"n">>, <<"m">>, <<"x">>}, <<>>} = starl_mcap_record:decode(Bytes),
    Wrong = <<9, 39:64/little, Covered/binary, (Crc + 1):32/little>>,
    ?assertEqual({error, {bad_record, 9}}, starl_mcap_record:decode(Wrong)).

%% A reader skips kinds that it does not know and bytes after the known fields.
later_versions_test() ->
    ?assertEqual(
        {ok, {unknown, 200, <<"x">>}, <<>>}, starl_mcap_record:decode(<<200, 1:64/little, "x">>)
    ),
    ?assertEqual(
        {ok, {data_end, 1}, <<"y">>},
        starl_mcap_record:decode(<<15, 6:64/little, 1:32/little, "zzy">>)
    ).

cut_off_test() ->
    Bytes = iolist_to_binary(starl_mcap_record:encode({header, <<"profile">>, <<"library">>})),
    [
        ?assertEqual(more, starl_mcap_record:decode(binary:part(Bytes, 0, N)))
     || N <- lists:seq(0, byte_size(Bytes) - 1)
    ],
    ?assertEqual({error, {bad_record, 1}}, starl_mcap_record:decode(<<1, 2:64/little, 9, 9>>)).

bytes(Hex) -> binary:decode_hex(iolist_to_binary(string:replace(Hex, " ", "", all))).
