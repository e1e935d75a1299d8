%% @doc Makes random pictures of many short lines, 0.01 to 10 mm, by number. The lines stand alone,
%% between long lines, and in chains; there are dots, and some lines occur twice. So a soak tries
%% what occurs in real drawings, but in none that ships.
%% ```
%%   ./starl run painting --picture short_lines:7
%% '''
%% The same number gives the same picture.
-module(starl_picture_sample).

-export([named/1, svg/1]).

-define(NAME, "short_lines:").
%% About one millimetre of the floor is one unit of the picture.
-define(SIZE, 8000).
-define(SHORTEST, 0.01).
-define(LONGEST, 10.0).
%% How many there are of each: single short lines, short lines between long ones, chains, dots.
-define(ALONE, 12).
-define(BETWEEN, 4).
-define(CHAINS, 5).
-define(DOTS, 2).
-define(LINKS, 15).

%% @doc The number in the name of such a picture.
-spec named(string()) -> {ok, non_neg_integer()} | error.
named(?NAME ++ Digits) ->
    case string:to_integer(Digits) of
        {N, ""} when is_integer(N), N >= 0 -> {ok, N};
        _ -> error
    end;
named(_Name) ->
    error.

%% @doc The picture of this number, an SVG document.
-spec svg(non_neg_integer()) -> binary().
svg(N) ->
    Kinds = [{?ALONE, fun alone/1}, {?BETWEEN, fun between/1}, {?CHAINS, fun chain/1}],
    Draws = lists:append([lists:duplicate(Count, Draw) || {Count, Draw} <- Kinds]),
    {Paths, Rand} = lists:mapfoldl(fun(Draw, R) -> Draw(R) end, rand:seed_s(exsss, N), Draws),
    {Dots, _} = lists:mapfoldl(fun(_, R) -> dot(R) end, Rand, lists:seq(1, ?DOTS)),
    iolist_to_binary([
        io_lib:format(
            "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 ~b ~b' fill='none' "
            "stroke='black' stroke-linecap='round'><title>~s~b</title>",
            [?SIZE, ?SIZE, ?NAME, N]
        ),
        [path(Points) || Points <- Paths ++ Dots ++ [hd(Paths), lists:reverse(hd(Paths))]],
        "</svg>"
    ]).

path([From | Rest]) -> ["<path d='M", xy(From), [["L", xy(To)] || To <- Rest], "'/>"].

xy({X, Y}) -> io_lib:format("~.4f,~.4f ", [X, Y]).

%% -- what is drawn ----------------------------------------------------------------------------

alone(Rand0) ->
    {P, Rand1} = place(Rand0),
    {Q, Rand} = short(P, Rand1),
    {[P, Q], Rand}.

between(Rand0) ->
    {P, Rand1} = place(Rand0),
    {Q, Rand2} = long(P, Rand1),
    {R, Rand3} = short(Q, Rand2),
    {S, Rand} = long(R, Rand3),
    {[P, Q, R, S], Rand}.

chain(Rand0) ->
    {P, Rand1} = place(Rand0),
    {Links, Rand2} = rand:uniform_s(?LINKS, Rand1),
    lists:foldl(
        fun(_, {[Last | _] = Points, R}) -> link(short(Last, R), Points) end,
        {[P], Rand2},
        lists:seq(1, Links)
    ).

link({Point, Rand}, Points) -> {[Point | Points], Rand}.

dot(Rand0) ->
    {P, Rand} = place(Rand0),
    {[P, P], Rand}.

%% -- places -----------------------------------------------------------------------------------

-spec place(rand:state()) -> {starl_geometry:point(), rand:state()}.
place(Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand} = rand:uniform_s(Rand1),
    {{?SIZE * (0.1 + 0.8 * X), ?SIZE * (0.1 + 0.8 * Y)}, Rand}.

%% Each order of magnitude is as likely as the others.
short(From, Rand0) ->
    {Part, Rand} = rand:uniform_s(Rand0),
    away(From, ?SHORTEST * math:pow(?LONGEST / ?SHORTEST, Part), Rand).

long(From, Rand0) ->
    {Part, Rand} = rand:uniform_s(Rand0),
    away(From, ?SIZE * (0.01 + 0.08 * Part), Rand).

away({X, Y}, Mm, Rand0) ->
    {Turn, Rand} = rand:uniform_s(Rand0),
    Angle = 2 * math:pi() * Turn,
    {{X + Mm * math:cos(Angle), Y + Mm * math:sin(Angle)}, Rand}.
