%% @doc Reads a map of the MovingAI benchmarks (`.map'): a header of four lines, then rows of
%% characters, the first at the top. Ground, grass and swamp are free; trees, water and what is out
%% of bounds are walls.
-module(starl_floor_map).

-export([parse/2]).

-define(FREE, ".GS").
-define(WALL, "@OTW").

%% @doc The floor plan of a map whose cells are so wide.
-spec parse(binary(), ScaleMm :: number()) ->
    {ok, starl_floor:t()} | {error, starl_floor_text:problem()}.
parse(Bytes, Scale) ->
    Lines = [string:trim(L, trailing) || L <- binary:split(Bytes, <<"\n">>, [global])],
    case Lines of
        [<<"type ", _/binary>>, <<"height ", H/binary>>, <<"width ", W/binary>>, <<"map">> | Rows] ->
            sized(number(H), number(W), Rows, Scale);
        _ ->
            {error, {1, "a MovingAI map begins with the lines type, height, width and map"}}
    end.

number(Text) ->
    case string:to_integer(string:trim(Text)) of
        {N, <<>>} when is_integer(N), N > 0, N =< 10000 -> N;
        _ -> bad
    end.

sized(bad, _W, _Rows, _Scale) ->
    {error, {2, "height needs a number from 1 to 10000"}};
sized(_H, bad, _Rows, _Scale) ->
    {error, {3, "width needs a number from 1 to 10000"}};
sized(H, W, Rows, Scale) ->
    Numbered = lists:enumerate(5, lists:sublist(Rows, H)),
    Long = [{N, byte_size(Row)} || {N, Row} <- Numbered, byte_size(Row) =/= W],
    Odd = [
        {N, Column, Char}
     || {N, Row} <- Numbered,
        {Column, Char} <- lists:enumerate(1, binary_to_list(Row)),
        not lists:member(Char, ?FREE ++ ?WALL)
    ],
    case {Long, Odd} of
        {[{N, Size} | _], _} ->
            {error, {N, io_lib:format("a row of ~b characters where width says ~b", [Size, W])}};
        {[], _} when length(Numbered) < H ->
            {error, {none, io_lib:format("~b rows where height says ~b", [length(Numbered), H])}};
        {[], [{N, Column, Char} | _]} ->
            {error, {N, io_lib:format("unknown character ~tc in column ~b", [Char, Column])}};
        {[], []} ->
            {ok, floor_of(Numbered, W, H, Scale)}
    end.

floor_of(Numbered, W, H, Scale) ->
    Solid = maps:from_list([
        {{Column, H - 1 - (N - 5)}, true}
     || {N, Row} <- Numbered,
        {Column, Char} <- lists:enumerate(0, binary_to_list(Row)),
        lists:member(Char, ?WALL)
    ]),
    starl_floor:new(#{
        size => {W * Scale, H * Scale}, walls => starl_floor_cells:walls(Solid, Scale)
    }).
