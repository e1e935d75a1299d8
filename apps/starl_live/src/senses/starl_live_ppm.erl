%% @doc Reads pictures that a camera program writes to a pipe: binary PPM (`P6'; the format's manual
%% page in Netpbm). They come one after the other, each with its own header. `ffmpeg ... -f
%% image2pipe -c:v ppm -' and `djpeg -pnm' write this format.
-module(starl_live_ppm).

-export([next/1, format_error/1]).

-export_type([frame/0, reason/0]).

%% Three bytes a pixel (red, green, blue), row by row from the top, each from the left.
-type frame() :: #{width := pos_integer(), height := pos_integer(), pixels := binary()}.
-type reason() :: {magic, binary()} | {size, integer(), integer()} | {depth, integer()} | header.

%% More than any camera has; the length of a header with its comments.
-define(MOST_PIXELS, 16#1000000).
-define(MOST_HEADER, 4096).

%% @doc The first picture of a stream, and what follows it. `more': the picture is not complete yet,
%% and needs at least this number of bytes.
-spec next(binary()) ->
    {ok, frame(), Rest :: binary()} | {more, pos_integer()} | {error, reason()}.
next(<<"P6", Rest/binary>> = All) -> header(numbers(Rest, 3, []), All);
next(<<"P">>) -> {more, 1};
next(<<>>) -> {more, 1};
next(<<Other:2/binary, _/binary>>) -> {error, {magic, Other}};
next(Other) -> {error, {magic, Other}}.

header({[Width, Height, 255], Pixels}, _All) when
    Width > 0, Height > 0, Width * Height =< ?MOST_PIXELS
->
    Bytes = 3 * Width * Height,
    case Pixels of
        <<Frame:Bytes/binary, Rest/binary>> ->
            {ok, #{width => Width, height => Height, pixels => Frame}, Rest};
        _ ->
            {more, Bytes - byte_size(Pixels)}
    end;
header({[_, _, Depth], _}, _All) when Depth =/= 255 -> {error, {depth, Depth}};
header({[Width, Height, _], _}, _All) ->
    {error, {size, Width, Height}};
header(more, All) when byte_size(All) < ?MOST_HEADER -> {more, 1};
header(_, _All) ->
    {error, header}.

%% Numbers with space or comments before each; a single space ends the last.
numbers(<<C, Rest/binary>>, 0, Found) when C =:= $\s; C =:= $\n; C =:= $\r; C =:= $\t ->
    {lists:reverse(Found), Rest};
numbers(_Text, 0, _Found) ->
    wrong;
numbers(<<C, Rest/binary>>, N, Found) when C =:= $\s; C =:= $\n; C =:= $\r; C =:= $\t ->
    numbers(Rest, N, Found);
numbers(<<$#, Rest/binary>>, N, Found) ->
    case binary:split(Rest, <<"\n">>) of
        [_, After] -> numbers(After, N, Found);
        [_] -> more
    end;
numbers(<<C, _/binary>> = Text, N, Found) when C >= $0, C =< $9 -> digits(Text, 0, 0, N, Found);
numbers(<<>>, _N, _Found) ->
    more;
numbers(_Text, _N, _Found) ->
    wrong.

digits(<<C, Rest/binary>>, Value, Length, N, Found) when C >= $0, C =< $9, Length < 8 ->
    digits(Rest, 10 * Value + C - $0, Length + 1, N, Found);
digits(<<>>, _Value, _Length, _N, _Found) ->
    more;
digits(<<C, _/binary>>, _Value, 8, _N, _Found) when C >= $0, C =< $9 ->
    wrong;
digits(Rest, Value, _Length, N, Found) ->
    numbers(Rest, N - 1, [Value | Found]).

%% @doc One line on what is wrong with a stream.
-spec format_error(reason()) -> unicode:chardata().
format_error({magic, Bytes}) ->
    io_lib:format("a picture begins with P6 (binary PPM), not ~0tp", [Bytes]);
format_error({size, Width, Height}) ->
    io_lib:format("a picture of ~b x ~b pixels; at most 16 million are taken", [Width, Height]);
format_error({depth, Depth}) ->
    io_lib:format("a picture of ~b levels a colour; 255 are expected", [Depth]);
format_error(header) ->
    "a picture whose header is not three numbers: width, height, 255".
