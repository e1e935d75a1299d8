%% @doc Writes and reads comma-separated values (RFC 4180), with a line feed at the end of a line.
-module(starl_lab_csv).

-export([line/1, parse/1]).

%% @doc One line of cells. A cell that contains a comma, a quote or a line end is quoted.
-spec line([unicode:chardata(), ...]) -> unicode:chardata().
line(Cells) -> [lists:join(",", [cell(unicode:characters_to_list(Cell)) || Cell <- Cells]), "\n"].

cell(Text) ->
    case lists:any(fun(C) -> lists:member(C, ",\"\r\n") end, Text) of
        true -> ["\"", string:replace(Text, "\"", "\"\"", all), "\""];
        false -> Text
    end.

%% @doc The complete lines of a text, and their length in bytes. A rest without a line end was left
%% by a writer that was stopped.
-spec parse(binary()) -> {[[string()]], Bytes :: non_neg_integer()}.
parse(Text) -> lines(Text, Text, [], 0).

lines(Rest, Text, Lines, End) ->
    case cells(Rest, []) of
        {Cells, More} -> lines(More, Text, [Cells | Lines], byte_size(Text) - byte_size(More));
        incomplete -> {lists:reverse(Lines), End}
    end.

cells(<<"\"", Rest/binary>>, Cells) -> quoted(Rest, <<>>, Cells);
cells(Rest, Cells) -> plain(Rest, <<>>, Cells).

plain(<<",", Rest/binary>>, Cell, Cells) -> cells(Rest, [text(Cell) | Cells]);
plain(<<"\r\n", Rest/binary>>, Cell, Cells) -> {lists:reverse(Cells, [text(Cell)]), Rest};
plain(<<"\n", Rest/binary>>, Cell, Cells) -> {lists:reverse(Cells, [text(Cell)]), Rest};
plain(<<Byte, Rest/binary>>, Cell, Cells) -> plain(Rest, <<Cell/binary, Byte>>, Cells);
plain(<<>>, _Cell, _Cells) -> incomplete.

quoted(<<"\"\"", Rest/binary>>, Cell, Cells) -> quoted(Rest, <<Cell/binary, $">>, Cells);
quoted(<<"\"", Rest/binary>>, Cell, Cells) -> plain(Rest, Cell, Cells);
quoted(<<Byte, Rest/binary>>, Cell, Cells) -> quoted(Rest, <<Cell/binary, Byte>>, Cells);
quoted(<<>>, _Cell, _Cells) -> incomplete.

%% An edited file may contain bytes that are not UTF-8.
text(Cell) ->
    case unicode:characters_to_list(Cell) of
        Text when is_list(Text) -> Text;
        _ -> binary_to_list(Cell)
    end.
