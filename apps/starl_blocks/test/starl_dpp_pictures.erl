%% @doc Pictures to plan on, as lists of segments in mm, each within the area of a 12 m floor.
-module(starl_dpp_pictures).
-export([names/0, picture/2, picture/3]).

-define(LOW, 1050.0).
-define(SIZE, 9900.0).

names() -> [lines, short_lines, grid, comb, spiral, text, single, star, overlaps, circles].

%% The picture of this name at its usual size.
picture(Name, Seed) -> picture(Name, usual(Name), Seed).

%% N is the number of strokes or turns.
picture(Name, N, Seed) -> draw(Name, N, rand:seed_s(exsss, Seed)).

usual(lines) -> 12;
usual(short_lines) -> 120;
usual(grid) -> 8;
usual(comb) -> 20;
usual(spiral) -> 6;
usual(text) -> 40;
usual(single) -> 1;
usual(star) -> 8;
usual(overlaps) -> 10;
usual(circles) -> 12.

draw(_Name, 0, _Rand) ->
    [];
draw(lines, N, Rand0) ->
    {P, Rand1} = point(Rand0),
    {Q, Rand2} = point(Rand1),
    [{P, Q} | draw(lines, N - 1, Rand2)];
draw(short_lines, N, Rand0) ->
    {P, Rand1} = point(Rand0),
    {A, Rand2} = rand:uniform_s(Rand1),
    {L, Rand3} = rand:uniform_s(Rand2),
    [{P, inside(polar(P, 200.0 + 800.0 * L, 6.2832 * A))} | draw(short_lines, N - 1, Rand3)];
draw(grid, N, _Rand) ->
    Ticks = [?LOW + ?SIZE * K / (N - 1) || K <- lists:seq(0, N - 1)],
    High = ?LOW + ?SIZE,
    [{{X, ?LOW}, {X, High}} || X <- Ticks] ++ [{{?LOW, Y}, {High, Y}} || Y <- Ticks];
draw(comb, N, _Rand) ->
    Ticks = [?LOW + ?SIZE * K / (N - 1) || K <- lists:seq(0, N - 1)],
    [{{?LOW, ?LOW}, {?LOW + ?SIZE, ?LOW}} | [{{X, ?LOW}, {X, ?LOW + ?SIZE}} || X <- Ticks]];
draw(spiral, Turns, _Rand) ->
    Steps = Turns * 24,
    Points = [
        polar({6000.0, 6000.0}, ?SIZE / 2 * K / Steps, 6.28318 * K / 24)
     || K <- lists:seq(0, Steps)
    ],
    strokes(Points);
draw(text, N, Rand0) ->
    {P, Rand1} = point(Rand0),
    {Letter, Rand2} = letter(P, 6, Rand1),
    strokes(Letter) ++ draw(text, N - 1, Rand2);
draw(single, _N, _Rand) ->
    [{{2000.0, 3000.0}, {9000.0, 8000.0}}];
draw(star, N, _Rand) ->
    [
        {polar({6000.0, 6000.0}, 4800.0, A), polar({6000.0, 6000.0}, -4800.0, A)}
     || K <- lists:seq(1, N), A <- [math:pi() * K / N]
    ];
draw(overlaps, N, Rand0) ->
    {{X, Y}, Rand1} = point(Rand0),
    {L, Rand2} = rand:uniform_s(Rand1),
    Row = ?LOW + 1000.0 * round((Y - ?LOW) / 1000.0),
    [{{X, Row}, inside({X + 6000.0 * (L - 0.5), Row})} | draw(overlaps, N - 1, Rand2)];
draw(circles, N, Rand0) ->
    {P, Rand1} = point(Rand0),
    {L, Rand2} = rand:uniform_s(Rand1),
    Points = [inside(polar(P, 300.0 + 1200.0 * L, 6.28318 * K / 36)) || K <- lists:seq(0, 36)],
    strokes(Points) ++ draw(circles, N - 1, Rand2).

letter(P, 0, Rand) ->
    {[P], Rand};
letter(P, N, Rand0) ->
    {A, Rand1} = rand:uniform_s(Rand0),
    {L, Rand2} = rand:uniform_s(Rand1),
    {Points, Rand3} = letter(inside(polar(P, 60.0 + 240.0 * L, 6.2832 * A)), N - 1, Rand2),
    {[P | Points], Rand3}.

strokes(Points) -> lists:zip(lists:droplast(Points), tl(Points)).

point(Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {{?LOW + ?SIZE * X, ?LOW + ?SIZE * Y}, Rand2}.

polar({X, Y}, R, A) -> {X + R * math:cos(A), Y + R * math:sin(A)}.

inside({X, Y}) -> {max(?LOW, min(?LOW + ?SIZE, X)), max(?LOW, min(?LOW + ?SIZE, Y))}.
