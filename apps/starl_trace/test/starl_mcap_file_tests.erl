%% The bytes of MCAP files: what the summary says of them, and what is read of whole, cut and damaged ones.
-module(starl_mcap_file_tests).
-include_lib("eunit/include/eunit.hrl").

channels() ->
    [
        {schema, 1, <<"s">>, <<"jsonschema">>, <<"{}">>},
        {channel, 1, 1, <<"/a">>, <<"json">>, []},
        {channel, 2, 1, <<"/b">>, <<"json">>, []}
    ].

%% Two chunks, and between them an attachment and metadata.
bytes() ->
    {Head, W0} = starl_mcap_writer:new(<<"test">>, channels()),
    ?assertEqual(0, starl_mcap_writer:waiting(W0)),
    {[], W0} = starl_mcap_writer:flush(W0),
    W1 = put_all([{1, 100, "x"}, {2, 50, "yy"}, {1, 200, "zzz"}], W0),
    ?assert(starl_mcap_writer:waiting(W1) > 6),
    {First, W2} = starl_mcap_writer:flush(W1),
    ?assertEqual(0, starl_mcap_writer:waiting(W2)),
    {Attachment, W3} = starl_mcap_writer:other({attachment, 7, 8, "n", "m", "data"}, W2),
    {Metadata, W4} = starl_mcap_writer:other({metadata, "meta", [{"k", "v"}]}, W3),
    {Second, W5} = starl_mcap_writer:flush(put_all([{1, 300, "w"}], W4)),
    iolist_to_binary([Head, First, Attachment, Metadata, Second, starl_mcap_writer:finish(W5)]).

put_all(Messages, Writer) ->
    lists:foldl(
        fun({Channel, Time, Data}, W) -> starl_mcap_writer:message(Channel, Time, Data, W) end,
        Writer,
        Messages
    ).

in_file(Bytes, Test) ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    File = filename:join("/tmp", "starl_mcap_" ++ os:getpid() ++ "_" ++ Unique),
    ok = file:write_file(File, Bytes),
    try
        Test(File)
    after
        file:delete(File)
    end.

read(Bytes, Test) ->
    in_file(Bytes, fun(File) ->
        {ok, Reader} = starl_mcap_reader:open(File),
        Answer = Test(Reader),
        ok = starl_mcap_reader:close(Reader),
        Answer
    end).

%% Every record, with its place.
records(Reader) -> records(starl_mcap_reader:first(Reader), Reader).

records(At, Reader) ->
    case starl_mcap_reader:next(At, Reader) of
        {ok, Record, After} -> [{At, After - At, Record} | records(After, Reader)];
        End -> [End]
    end.

the_summary_leads_to_everything_test() ->
    read(bytes(), fun(Reader) ->
        Records = records(Reader),
        {ok, Summary} = starl_mcap_reader:summary(Reader),
        At = fun(Place, Length) -> [R || {P, L, R} <- Records, P =:= Place, L =:= Length] end,
        [
            ?assertMatch([{attachment, 7, 8, <<"n">>, <<"m">>, <<"data">>}], At(P, L))
         || {attachment_index, P, L, 7, 8, 4, <<"n">>, <<"m">>} <- Summary
        ],
        [
            ?assertMatch([{metadata, <<"meta">>, _}], At(P, L))
         || {metadata_index, P, L, <<"meta">>} <- Summary
        ],
        [
            ?assertMatch([{chunk, Start, End, Size, _, <<>>, _}], At(P, L))
         || {chunk_index, Start, End, P, L, _, _, <<>>, Size, Size} <- Summary
        ],
        ?assertEqual(
            [{50, 200}, {300, 300}],
            [{Start, End} || {chunk_index, Start, End, _, _, _, _, _, _, _} <- Summary]
        ),
        %% the indexes of a chunk stand behind it, and their length is said
        [
            begin
                Behind = [
                    {P, L, R}
                 || {P, L, {message_index, _, _} = R} <- Records, P >= From, P < To
                ],
                ?assertEqual(Offsets, [{C, P} || {P, _, {message_index, C, _}} <- Behind]),
                ?assertEqual(Length, lists:sum([L || {_, L, _} <- Behind]))
            end
         || {chunk_index, _, _, P0, L0, Offsets, Length, _, _, _} <- Summary,
            From <- [P0 + L0],
            To <- [P0 + L0 + Length]
        ],
        ?assertEqual(
            [{statistics, 4, 1, 2, 1, 1, 2, 50, 300, [{1, 3}, {2, 1}]}],
            [S || S <- Summary, element(1, S) =:= statistics]
        ),
        ?assertEqual(channels(), [R || R <- Summary, lists:member(element(1, R), [schema, channel])]),
        %% each group of the summary lies where its offset says
        Groups = [{Op, P, L} || {summary_offset, Op, P, L} <- Summary],
        ?assertEqual([3, 4, 11, 8, 10, 13], [Op || {Op, _, _} <- Groups]),
        [
            ?assertEqual(L, lists:sum([Length || {Q, Length, _} <- Records, Q >= P, Q < P + L]))
         || {_, P, L} <- Groups
        ],
        ?assertEqual('end', lists:last(Records))
    end).

messages_are_counted_by_channel_test() ->
    read(bytes(), fun(Reader) ->
        Chunks = [C || {_, _, {chunk, _, _, _, _, _, _} = C} <- records(Reader)],
        Inside = lists:append([
            begin
                {ok, Records} = starl_mcap_chunk:records(C),
                Records
            end
         || C <- Chunks
        ]),
        ?assertEqual(
            channels() ++
                [
                    {message, 1, 0, 100, 100, <<"x">>},
                    {message, 2, 0, 50, 50, <<"yy">>},
                    {message, 1, 1, 200, 200, <<"zzz">>},
                    {message, 1, 2, 300, 300, <<"w">>}
                ],
            Inside
        ),
        [First | _] = Chunks,
        {ok, Bytes} = starl_mcap_chunk:contents(First),
        {ok, Index} = starl_mcap_chunk:index(Bytes),
        ?assertMatch(#{1 := [{200, _}, {100, _}], 2 := [{50, _}]}, Index),
        ?assertEqual({error, cut_off}, starl_mcap_chunk:index(binary:part(Bytes, 0, 30))),
        %% what a chunk says of itself must be so
        {chunk, Start, End, Size, Crc, Compression, Data} = First,
        Of = fun(S, C, Z) -> starl_mcap_chunk:contents({chunk, Start, End, S, C, Z, Data}) end,
        ?assertEqual({ok, Data}, Of(Size, Crc, Compression)),
        ?assertEqual({ok, Data}, Of(Size, 0, <<>>)),
        ?assertEqual({error, checksum}, Of(Size, Crc bxor 1, <<>>)),
        ?assertEqual({error, {size, Size + 1}}, Of(Size + 1, Crc, <<>>)),
        ?assertEqual({error, {size, 1 bsl 40}}, Of(1 bsl 40, Crc, <<>>)),
        ?assertEqual({error, {packed, <<"lz4">>, unknown}}, Of(Size, Crc, <<"lz4">>))
    end).

%% The chunks by the index are those by the heads of the records, in a file that was cut.
chunks_with_and_without_an_index_test() ->
    Bytes = bytes(),
    {Places, DataEnd} = read(Bytes, fun(Reader) ->
        Records = records(Reader),
        [DataEnd] = [P || {P, _, {data_end, _}} <- Records],
        Chunks = [{S, E, P} || {P, _, {chunk, S, E, _, _, _, _}} <- Records],
        ?assertEqual({Chunks, closed}, starl_mcap_reader:chunks(Reader)),
        ?assert(starl_mcap_reader:has_index(Reader)),
        [{_, _, First}, {_, _, Second}] = Chunks,
        ?assert(starl_mcap_reader:is_chunk(First, Reader)),
        ?assertNot(starl_mcap_reader:is_chunk(First + 1, Reader)),
        ?assertEqual({ok, First}, starl_mcap_reader:following(0, Reader)),
        ?assertEqual({ok, Second}, starl_mcap_reader:following(First, Reader)),
        ?assertEqual(none, starl_mcap_reader:following(Second, Reader)),
        ?assertEqual(byte_size(Bytes), starl_mcap_reader:size(Reader)),
        {Chunks, DataEnd}
    end),
    [One, {_, _, Second} = Two] = Places,
    Cut = fun(Left) ->
        read(binary:part(Bytes, 0, Left), fun(Reader) ->
            ?assertNot(starl_mcap_reader:has_index(Reader)),
            ?assertEqual(none, starl_mcap_reader:summary(Reader)),
            ?assertEqual({cut, true}, {element(1, lists:last(records(Reader))), true}),
            starl_mcap_reader:chunks(Reader)
        end)
    end,
    ?assertEqual({[One, Two], cut_off}, Cut(DataEnd)),
    ?assertEqual({[One], cut_off}, Cut(Second + 30)),
    ?assertEqual({[], cut_off}, Cut(20)),
    %% with its end, and without the last bytes of the summary
    ?assertEqual({[One, Two], closed}, Cut(byte_size(Bytes) - 5)),
    %% nothing but zeros, as after a loss of power
    Zeros = <<(binary:part(Bytes, 0, Second))/binary, 0:800>>,
    read(Zeros, fun(Reader) ->
        ?assertEqual({[One], {damaged, Second}}, starl_mcap_reader:chunks(Reader))
    end).

%% Wherever a file is cut (at every third byte here), the chunks before are its chunks, and are recovered with all their messages; it is closed
%% when the end of its data is there.
every_cut_test_() -> {timeout, 120, fun every_cut/0}.

every_cut() ->
    Bytes = bytes(),
    {Chunks, DataEnd} = read(Bytes, fun(Reader) ->
        Records = records(Reader),
        [DataEnd] = [P || {P, _, {data_end, _}} <- Records],
        {[{P + N, {S, E, P}} || {P, N, {chunk, S, E, _, _, _, _}} <- Records], DataEnd}
    end),
    Messages = [3, 1],
    [
        in_file(binary:part(Bytes, 0, Left), fun(File) ->
            Whole = [Chunk || {End, Chunk} <- Chunks, End =< Left],
            Is = fun(Size) ->
                case Size >= DataEnd + 9 of
                    true -> closed;
                    false -> cut_off
                end
            end,
            {ok, Reader} = starl_mcap_reader:open(File),
            ?assertEqual({Left, {Whole, Is(Left)}}, {Left, starl_mcap_reader:chunks(Reader)}),
            ok = starl_mcap_reader:close(Reader),
            Count = length(Whole),
            Sum = lists:sum(lists:sublist(Messages, Count)),
            case starl_mcap_recover:file(File, File ++ ".out", as_is) of
                {ok, Recovered} ->
                    ?assertMatch(#{chunks := Count, messages := Sum, damaged := 0}, Recovered),
                    {ok, Out} = starl_mcap_reader:open(File ++ ".out"),
                    ?assertMatch({[_ | _], closed}, starl_mcap_reader:chunks(Out)),
                    ok = starl_mcap_reader:close(Out);
                {error, Reason} ->
                    ?assertEqual({0, {nothing, File}}, {Count, Reason})
            end,
            file:delete(File ++ ".out")
        end)
     || Left <- lists:seq(8, byte_size(Bytes), 3)
    ].

%% Whatever byte is bad (every second one here), the chunks in which it is not are recovered.
every_bad_byte_test_() -> {timeout, 120, fun every_bad_byte/0}.

every_bad_byte() ->
    {Head, W0} = starl_mcap_writer:new("test", channels()),
    {Parts, W} = lists:mapfoldl(
        fun(N, Writer) ->
            starl_mcap_writer:flush(starl_mcap_writer:message(1, 100 * N, <<"data", N>>, Writer))
        end,
        W0,
        [1, 2, 3]
    ),
    Bytes = iolist_to_binary([Head, Parts, starl_mcap_writer:finish(W)]),
    Ranges = read(Bytes, fun(Reader) ->
        [{P, P + N} || {P, N, {chunk, _, _, _, _, _, _}} <- records(Reader)]
    end),
    Recovered = fun(Damaged) ->
        in_file(Damaged, fun(File) ->
            {ok, Figures} = starl_mcap_recover:file(File, File, as_is),
            {ok, Whole} = file:read_file(File),
            Told = read(Whole, fun(Reader) ->
                [
                    Data
                 || {_, _, {chunk, _, _, _, _, _, _} = C} <- records(Reader),
                    {ok, Records} <- [starl_mcap_chunk:records(C)],
                    {message, 1, _, _, _, Data} <- Records
                ]
            end),
            {maps:with([damaged, messages, chunks], Figures), Told}
        end)
    end,
    Bad = fun(At, In) ->
        <<Before:At/binary, Byte, After/binary>> = In,
        <<Before/binary, (Byte bxor 255), After/binary>>
    end,
    [
        begin
            {#{damaged := Damaged, messages := N}, Told} = Recovered(Bad(At, Bytes)),
            Others = [
                <<"data", K>>
             || {K, {From, To}} <- lists:enumerate(Ranges), At < From orelse At >= To
            ],
            ?assertEqual({At, []}, {At, Others -- Told}),
            ?assertEqual({At, lists:sort(Told)}, {At, Told}),
            ?assertEqual({At, length(Told)}, {At, N}),
            ?assertEqual({At, 3}, {At, N + Damaged})
        end
     || At <- lists:seq(element(1, hd(Ranges)), byte_size(Bytes) - 1, 2)
    ],
    %% two of them, and all
    [At1, At2, At3] = [At || {At, _} <- binary:matches(Bytes, <<"data">>)],
    ?assertEqual(
        {#{damaged => 2, messages => 1, chunks => 1}, [<<"data", 3>>]},
        Recovered(Bad(At1, Bad(At2, Bytes)))
    ),
    in_file(Bad(At1, Bad(At2, Bad(At3, Bytes))), fun(File) ->
        ?assertEqual({error, {nothing, File}}, starl_mcap_recover:file(File, File, as_is))
    end).

%% A record that hides a chunk of the index is damaged, and so is another one in the place of a chunk.
a_hidden_chunk_is_damage_test() ->
    Bytes = bytes(),
    [First, Second] = read(Bytes, fun(Reader) ->
        {Chunks, closed} = starl_mcap_reader:chunks(Reader),
        [P || {_, _, P} <- Chunks]
    end),
    Replaced = fun(At, By) ->
        Size = byte_size(By),
        <<Before:At/binary, _:Size/binary, After/binary>> = Bytes,
        <<Before/binary, By/binary, After/binary>>
    end,
    Next = fun(Changed, At) ->
        read(Changed, fun(Reader) -> element(1, starl_mcap_reader:next(At, Reader)) end)
    end,
    ?assertEqual(ok, Next(Bytes, First)),
    ?assertEqual(error, Next(Replaced(First, <<200>>), First)),
    Over = Second - First,
    ?assertEqual(error, Next(Replaced(First, <<6, Over:64/little>>), First)),
    ?assertEqual(error, Next(Replaced(First, <<15, 4:64/little>>), First)),
    ?assertEqual(cut, Next(Replaced(First, <<6, (1 bsl 40):64/little>>), First)).

other_files_are_none_test() ->
    in_file(<<"none at all">>, fun(File) ->
        ?assertEqual({error, {no_mcap, File}}, starl_mcap_reader:open(File))
    end),
    ?assertEqual({error, {file, "/nowhere", enoent}}, starl_mcap_reader:open("/nowhere")).

%% -- recovered ----------------------------------------------------------------------------------

%% What is lost is said where it was, by the patch; what stands in an attachment, too, is taken from there.
%% Holds: What is said of holes is no message of a recording
%% Red: 8cdf44d7
what_is_lost_is_said_test() ->
    {Head, W0} = starl_mcap_writer:new("test", channels()),
    {Chunks, W} = lists:mapfoldl(
        fun(N, Writer) ->
            starl_mcap_writer:flush(starl_mcap_writer:message(1, 100 * N, "abcdefgh", Writer))
        end,
        W0,
        [1, 2, 3]
    ),
    {Attached, Last} = starl_mcap_writer:other({attachment, 0, 0, "first", "m", "again"}, W),
    Bytes = iolist_to_binary([Head, Chunks, Attached, starl_mcap_writer:finish(Last)]),
    Places = [At || {At, _} <- binary:matches(Bytes, <<"abcdefgh">>)],
    Broken = fun(N) ->
        At = lists:nth(N, Places),
        <<Before:At/binary, _, After/binary>> = Bytes,
        <<Before/binary, "?", After/binary>>
    end,
    Message = fun(N) -> {1, 100 * N, <<"abcdefgh">>} end,
    ?assertEqual(
        {lost_chunks(3, 0), [Message(N) || N <- [1, 2, 3]]}, patched(Bytes)
    ),
    ?assertEqual(
        {lost_chunks(2, 1), [Message(1), {2, 100, <<"100-300">>}, Message(3)]},
        patched(Broken(2))
    ),
    ?assertEqual(
        {lost_chunks(2, 1), [Message(1), Message(2), {2, 200, <<"200-the_end">>}]},
        patched(Broken(3))
    ),
    Left = lists:nth(3, Places) + 3,
    {#{was_closed := false, lost_bytes := Lost, chunks := 2, messages := 2}, Told} = patched(
        binary:part(Bytes, 0, Left)
    ),
    ?assert(Lost > 0),
    ?assertEqual([Message(1), Message(2), {2, 200, <<"200-the_end">>}], Told).

%% A hole is from the last message before it to the first one behind it, whatever their order in a chunk.
a_hole_is_from_the_last_message_to_the_next_test() ->
    {Head, W0} = starl_mcap_writer:new("test", channels()),
    {Chunks, W} = lists:mapfoldl(
        fun(Times, Writer) ->
            Put = fun(At, Acc) -> starl_mcap_writer:message(1, At, "abcdefgh", Acc) end,
            starl_mcap_writer:flush(lists:foldl(Put, Writer, Times))
        end,
        W0,
        [[110, 130, 120], [200, 220], [330, 310, 320]]
    ),
    Bytes = iolist_to_binary([Head, Chunks, starl_mcap_writer:finish(W)]),
    At = element(1, lists:nth(4, binary:matches(Bytes, <<"abcdefgh">>))),
    <<Before:At/binary, _, After/binary>> = Bytes,
    {_, Told} = patched(<<Before/binary, "?", After/binary>>),
    ?assertEqual([{130, <<"130-310">>}], [{Time, Data} || {2, Time, Data} <- Told]).

%% What comes of a file by a patch: the figures, and the messages with their channels and times.
patched(Damaged) ->
    Patch = #{
        channels => channels(),
        channel => 2,
        hole => fun(From, To) -> io_lib:format("~p-~p", [From, To]) end,
        repeated => fun
            ({attachment, _, _, <<"first">>, _, Data}) -> {ok, Data};
            (_) -> none
        end
    },
    in_file(Damaged, fun(File) ->
        {ok, Answer} = starl_mcap_recover:file(File, File, as_is, Patch),
        {ok, Whole} = file:read_file(File),
        Told = read(Whole, fun(Reader) ->
            [
                {Channel, Time, Data}
             || {_, _, {chunk, _, _, _, _, _, _} = C} <- records(Reader),
                {ok, Records} <- [starl_mcap_chunk:records(C)],
                {message, Channel, _, Time, _, Data} <- Records
            ]
        end),
        {maps:with([chunks, messages, damaged, was_closed, lost_bytes], Answer), Told}
    end).

lost_chunks(Whole, Damaged) ->
    #{
        chunks => Whole, messages => Whole, damaged => Damaged, was_closed => true, lost_bytes => 0
    }.

%% Why chunks stay as they are is a line.
not_packed_test() ->
    ?assertEqual(ok, starl_mcap_recover:not_packed(#{not_packed => none})),
    {error, Line} = starl_mcap_recover:not_packed(#{not_packed => missing}),
    ?assertMatch({match, _}, re:run(Line, "install the program zstd")).

%% A file in which nothing was recorded is packed as it is; one that is no recording is told in a line.
what_cannot_be_packed_test() ->
    {Head, Writer} = starl_mcap_writer:new("test", channels()),
    Empty = iolist_to_binary([Head, starl_mcap_writer:finish(Writer)]),
    in_file(Empty, fun(File) ->
        ?assertEqual(ok, starl_mcap_recover:pack(File, none)),
        ?assertEqual({ok, Empty}, file:read_file(File))
    end),
    in_file(<<"none at all">>, fun(File) ->
        {error, Line} = starl_mcap_recover:pack(File, none),
        ?assertMatch({match, _}, re:run(unicode:characters_to_binary(Line), "no MCAP file"))
    end).
