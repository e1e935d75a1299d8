%% @doc Draws random pictures for the table: segments, polylines and circles, from a few to 2,000
%% segments. The length of strokes is limited, so that their crossings make at most about 8,000
%% edges.
-module(starl_dev_table_pictures).

-export([write/2, remove/1, svg/2]).

-define(SIZE, 1000).
-define(MOST_SEGMENTS, 2000).
-define(MOST_EDGES, 8000).
%% The largest number of segments of a flattened circle.
-define(CIRCLE, 40).

-type pictures() :: {Dir :: file:filename() | none, [file:filename()]}.

%% @doc Writes `N' pictures, drawn from a seed, to a new temporary directory.
-spec write(N :: non_neg_integer(), Seed :: integer()) -> pictures().
write(0, _Seed) ->
    {none, []};
write(N, Seed) ->
    {ok, Dir} = starl_private_dir:new("random"),
    {Dir, [write_one(K, N, Seed, Dir) || K <- lists:seq(1, N)]}.

write_one(K, N, Seed, Dir) ->
    File = filename:join(Dir, "random-" ++ integer_to_list(K) ++ ".svg"),
    Svg = svg(segments(K, N), Seed * 10007 + K),
    ok = starl_cli_out:sure(File, file:write_file(File, Svg)),
    File.

%% From 5 segments to the maximum, on a logarithmic scale.
segments(N, N) -> ?MOST_SEGMENTS;
segments(K, N) -> round(5 * math:pow(?MOST_SEGMENTS / 5, (K - 1) / (N - 1))).

%% @doc Removes the directory.
-spec remove(file:filename() | none) -> ok.
remove(none) -> ok;
remove(Dir) -> starl_private_dir:remove(Dir).

%% @doc A picture of at most `Segments' segments.
-spec svg(Segments :: pos_integer(), Seed :: integer()) -> iolist().
svg(Segments, Seed) ->
    Shapes = shapes(Segments, longest(Segments), rand:seed_s(exsss, Seed)),
    [
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1000 1000\" fill=\"none\" "
        "stroke=\"black\">\n",
        Shapes,
        "</svg>\n"
    ].

%% K segments of length L in the area A cross about K^2 L^2 / (pi A) times; each crossing makes
%% two edges more.
longest(K) ->
    Crossings = (?MOST_EDGES - K) / 2,
    min(float(?SIZE), math:sqrt(Crossings * math:pi()) * ?SIZE / K).

shapes(Left, _Longest, _Rand) when Left =< 0 ->
    [];
shapes(Left, Longest, Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Taken, Shape, Rand2} = shape(X, Left, Longest, Rand1),
    [Shape | shapes(Left - Taken, Longest, Rand2)].

shape(X, Left, Longest, Rand0) when X < 0.1, Left >= ?CIRCLE ->
    {{CX, CY}, Rand1} = point(Rand0),
    {R, Rand2} = rand:uniform_s(Rand1),
    Text = io_lib:format("  <circle cx=\"~.1f\" cy=\"~.1f\" r=\"~.1f\"/>\n", [
        CX, CY, 5.0 + R * min(200.0, 3 * Longest)
    ]),
    {?CIRCLE, Text, Rand2};
shape(X, Left, Longest, Rand0) when X < 0.4 ->
    {Legs0, Rand1} = rand:uniform_s(7, Rand0),
    Legs = min(Left, Legs0 + 1),
    {Start, Rand2} = point(Rand1),
    {Points, Rand3} = walk(Legs, Start, Longest, Rand2),
    Text = [io_lib:format(" ~.1f,~.1f", [PX, PY]) || {PX, PY} <- [Start | Points]],
    {Legs, ["  <polyline points=\"", Text, "\"/>\n"], Rand3};
shape(_X, _Left, Longest, Rand0) ->
    {{X1, Y1} = P, Rand1} = point(Rand0),
    {[{X2, Y2}], Rand2} = walk(1, P, Longest, Rand1),
    Text = io_lib:format("  <line x1=\"~.1f\" y1=\"~.1f\" x2=\"~.1f\" y2=\"~.1f\"/>\n", [
        X1, Y1, X2, Y2
    ]),
    {1, Text, Rand2}.

walk(0, _From, _Longest, Rand) ->
    {[], Rand};
walk(Legs, {X, Y}, Longest, Rand0) ->
    {L, Rand1} = rand:uniform_s(Rand0),
    {A, Rand2} = rand:uniform_s(Rand1),
    Length = Longest * (0.2 + 0.8 * L),
    To = {
        inside(X + Length * math:cos(2 * math:pi() * A)),
        inside(Y + Length * math:sin(2 * math:pi() * A))
    },
    {Points, Rand3} = walk(Legs - 1, To, Longest, Rand2),
    {[To | Points], Rand3}.

point(Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {{?SIZE * X, ?SIZE * Y}, Rand2}.

inside(X) -> max(0.0, min(float(?SIZE), X)).
