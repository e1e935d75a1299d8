%% CSV: what is written is read back as itself, and a half line is not read at all.
-module(starl_lab_csv_tests).
-include_lib("eunit/include/eunit.hrl").

text(Lines) -> unicode:characters_to_binary([starl_lab_csv:line(Line) || Line <- Lines]).

lines() ->
    [["a", "b,c", ""], ["\"", "two\nlines", "5..50"], ["\x{e4}\x{1f916}", "", ","], [""]].

read_back_test() ->
    Text = text(lines()),
    ?assertEqual({lines(), byte_size(Text)}, starl_lab_csv:parse(Text)).

%% Whatever the byte at which the writer was stopped: the lines that are whole, and their bytes.
a_half_line_is_not_read_test() ->
    Text = text(lines()),
    Ends = [byte_size(text(lists:sublist(lines(), N))) || N <- lists:seq(0, length(lines()))],
    lists:foreach(
        fun(Size) ->
            Whole = lists:max([End || End <- Ends, End =< Size]),
            {Read, Bytes} = starl_lab_csv:parse(binary:part(Text, 0, Size)),
            ?assertEqual({Size, Whole}, {Size, Bytes}),
            ?assertEqual(lists:sublist(lines(), length(Read)), Read),
            ?assertEqual(Whole, byte_size(text(Read)))
        end,
        lists:seq(0, byte_size(Text))
    ).

quotes_only_where_needed_test() ->
    ?assertEqual(<<"a,\"b,c\",\"say \"\"x\"\"\"\n">>, text([["a", "b,c", "say \"x\""]])).

lines_of_other_systems_test() ->
    ?assertEqual({[["a", "b"], ["c", "d"]], 10}, starl_lab_csv:parse(<<"a,b\r\nc,d\r\n">>)).
