%% @doc Chooses viewpoints from which a team can see a whole floor.
%% ```
%%   #{views := Views, unseen := Unseen} = starl_search_cover:plan(Floor, #{
%%       range_mm => 3000.0, ball_mm => 100.0, slack_mm => 11.0,
%%       places => Places, comes_to => fun(P) -> ... end, line => fun(P) -> ... end
%%   })
%% '''
%% The floor is a grid of cells ({@link starl_search_cells}). For each place that robots can reach,
%% rays find the cells that can be seen from there, whatever the errors of the place and the ball.
%% Views are chosen one by one, always the one that shows the most remaining cells. If no place
%% shows a cell, the search starts from the cell: is there any other place from which it is seen?
%%
%% Doors count as closed, since they may be. Only cells that cannot be seen otherwise are looked at
%% through an open door. Pure; equal floors give equal views. Lengths are millimetres.
-module(starl_search_cover).

-export([plan/2, cells/1, sees/4]).

-export_type([view/0, run/0, config/0, plan/0]).

-type cell() :: starl_search_cells:cell().
%% Cells side by side, from the first to the last.
-type run() :: {cell(), cell()}.

%% A short line to drive; at its beginning, whichever end that is, the robot looks all around. `sees':
%% the cells for which it has to.
-type view() :: #{line := starl_geometry:segment(), sees := [run()]}.

%% How far a camera sees, the radius of the ball, how far a robot may be from its line, and how far lines are from walls. `places':
%% where robots can come to; `comes_to': can they come to another place? `line': a short line at a place.
-type config() :: #{
    range_mm := float(),
    ball_mm := float(),
    slack_mm := float(),
    wall_mm := float(),
    places := [starl_geometry:point()],
    comes_to := fun((starl_geometry:point()) -> boolean()),
    line := fun((starl_geometry:point()) -> {ok, starl_geometry:segment()} | none)
}.

%% The views; of the cells that nobody can come to see the middles; and the number of all cells.
-type plan() :: #{
    views := [view()], unseen := [starl_geometry:point()], cells := non_neg_integer()
}.

-record(cover, {
    config :: config(),
    %% where a ball can lie, near the middle of each cell
    balls :: #{cell() => starl_geometry:point()},
    %% how far from the place of a ball its cell may reach, and so how much room a line of sight needs
    room :: float(),
    range :: float()
}).

%% What can be seen past, by its distance from a place.
-record(eye, {at :: starl_geometry:point(), rays :: tuple()}).

%% The width of a cell ({@link starl_search_cells}), and the distance of its corners from its middle.
-define(PITCH_MM, 100.0).
-define(HALF_DIAGONAL_MM, 71.0).
-define(RAYS, 360).
%% Places that are nearer to each other show nearly the same.
-define(APART_MM, 500.0).
-define(TURN, 6.283185307179586).
%% The half of the line of a view.
-define(HALF_MM, 30.0).
%% Of the places that may show a cell so many are looked at, and so many of those tried.
-define(LOOKED_AT, 40).
-define(TRIES, 8).

%% @doc The views of a floor.
-spec plan(starl_floor:t(), config()) -> plan().
plan(Floor, #{places := Places} = Config) ->
    Open = starl_walls:new(Floor),
    Closed = starl_walls:add(maps:get(doors, Floor), Open),
    #cover{balls = Balls} = Cover = new(Config, Floor),
    Shown = [{P, shown(eye(P, Closed, Cover), Cover)} || P <- apart(Places)],
    Seen = all(Shown),
    Left = connected(Seen, maps:without(maps:keys(Seen), Balls)),
    More = besides(Left, [Closed | [Open || Open =/= Closed]], Open, Cover),
    Given = all(More),
    #{
        views => [view(P, Cells, Config) || {P, Cells} <- needed(More ++ greedy(Shown, Given))],
        unseen => in_order(maps:without(maps:keys(maps:merge(Seen, Given)), Balls)),
        cells => map_size(Balls)
    }.

in_order(Cells) -> [P || {_, P} <- lists:sort(maps:to_list(Cells))].

%% Some of these places, so far apart.
apart(Places) ->
    {Apart, _} = lists:foldl(
        fun(P, {Some, Grid}) ->
            Near = starl_grid:near({P, P}, ?APART_MM, Grid),
            case lists:any(fun(Q) -> starl_geometry:distance(P, Q) < ?APART_MM end, Near) of
                true -> {Some, Grid};
                false -> {[P | Some], starl_grid:add(P, {P, P}, Grid)}
            end
        end,
        {[], starl_grid:new(?APART_MM)},
        Places
    ),
    lists:reverse(Apart).

all(Views) -> maps:from_list([{Cell, true} || {_, Cells} <- Views, Cell <- Cells]).

view(P, Cells, #{line := Line}) ->
    {ok, Segment} = Line(P),
    #{line => Segment, sees => runs(lists:sort(Cells))}.

runs([]) -> [];
runs([Cell | Cells]) -> runs(Cell, Cell, Cells).

runs(From, To, [Next | Cells]) when Next =:= To + 1 -> runs(From, Next, Cells);
runs(From, To, Cells) -> [{From, To} | runs(Cells)].

%% @doc The cells of a view.
-spec cells(view()) -> [cell()].
cells(#{sees := Runs}) -> lists:append([lists:seq(From, To) || {From, To} <- Runs]).

%% @doc Is a ball that lies in this cell surely seen from a place? Where no ball has room there is
%% nothing to be seen.
-spec sees(
    starl_geometry:point(),
    cell(),
    #{range_mm := float(), ball_mm := float(), _ => _},
    starl_walls:t()
) ->
    boolean().
sees(From, Cell, #{range_mm := Range, ball_mm := Ball}, Walls) ->
    case starl_search_cells:place(Cell, Ball, Walls) of
        {ok, At} -> sees(From, At, Range, Ball, Walls);
        none -> true
    end.

sees(From, At, Range, Ball, Walls) ->
    Mm = starl_geometry:distance(From, At),
    Room = ?HALF_DIAGONAL_MM,
    Mm =< Range - 2 * Room andalso
        (Mm =< Ball orelse
            starl_walls:is_free(
                {From, starl_geometry:interpolate(From, At, 1.0 - Ball / Mm)}, Room, Walls
            )).

new(#{ball_mm := Ball, slack_mm := Slack, range_mm := Range} = Config, Floor) ->
    #cover{
        config = Config,
        balls = starl_search_cells:new(Floor, Ball),
        room = max(?HALF_DIAGONAL_MM, ?HALF_MM + Slack) + 1.0,
        range = Range - ?HALF_DIAGONAL_MM - ?HALF_MM - Slack
    }.

%% The cells that free floor joins to those that are seen. Nobody can see the others.
connected(Seen, Left) -> spread(lists:sort(maps:keys(Seen)), Left, []).

spread([], _Left, Found) ->
    lists:sort(Found);
spread([Cell | Cells], Left, Found) ->
    New = [N || N <- starl_search_cells:beside(Cell), is_map_key(N, Left)],
    spread(New ++ Cells, maps:without(New, Left), New ++ Found).

%% -- what is seen from a place ----------------------------------------------------------------

%% For each ray the distance at which it comes too near to a wall.
eye({X, Y} = P, Walls, #cover{range = Range, room = Room}) ->
    Near = starl_walls:near(starl_geometry:grow({X, Y, X, Y}, Range), Room, Walls),
    Hits = lists:append([hits(moved(Side, P), Room, Range) || {_, Side} <- Near]),
    #eye{at = P, rays = list_to_tuple(nearest(0, lists:sort(Hits), Range))}.

nearest(?RAYS, _Hits, _Range) -> [];
nearest(K, [{K, Mm} | Hits], Range) -> [Mm | nearest(K + 1, past(K, Hits), Range)];
nearest(K, Hits, Range) -> [Range | nearest(K + 1, Hits, Range)].

past(K, [{K, _} | Hits]) -> past(K, Hits);
past(_K, Hits) -> Hits.

moved({{AX, AY}, {BX, BY}}, {X, Y}) -> {{AX - X, AY - Y}, {BX - X, BY - Y}}.

%% The rays that come within `Room' of a wall before `Range', and where.
hits({A, B} = Wall, Room, Range) ->
    case starl_geometry:point_segment({0.0, 0.0}, Wall) of
        Mm when Mm =< Room -> [{K, 0.0} || K <- lists:seq(0, ?RAYS - 1)];
        Mm when Mm >= Range + Room -> [];
        _ -> hits(A, B, Room, Range)
    end.

hits({AX, AY} = A, {BX, BY} = B, Room, Range) ->
    {Low0, High0} = sector(A, Room),
    {Low1, High1} = sector(B, Room),
    Between = starl_geometry:angle_diff(math:atan2(BY, BX), math:atan2(AY, AX)),
    Turned = math:atan2(AY, AX) + Between - math:atan2(BY, BX),
    From = min(Low0, Low1 + Turned),
    To = max(High0, High1 + Turned),
    [
        {mod(K), Mm}
     || K <- lists:seq(floor(From * ?RAYS / ?TURN), ceil(To * ?RAYS / ?TURN)),
        Mm <- meets(math:cos(K * ?TURN / ?RAYS), math:sin(K * ?TURN / ?RAYS), A, B, Room),
        Mm < Range
    ].

mod(K) -> ((K rem ?RAYS) + ?RAYS) rem ?RAYS.

sector({X, Y}, Room) ->
    Angle = math:atan2(Y, X),
    Half = math:asin(min(1.0, Room / max(Room, math:sqrt(X * X + Y * Y)))),
    {Angle - Half, Angle + Half}.

%% A wall with `Room' around it: two lines beside it, and a disc at each end.
meets(UX, UY, A, B, Room) ->
    case disc(UX, UY, A, Room) ++ disc(UX, UY, B, Room) ++ side(UX, UY, A, B, Room) of
        [] -> [];
        All -> [lists:min(All)]
    end.

disc(UX, UY, {X, Y}, Room) ->
    Along = UX * X + UY * Y,
    Root = Along * Along - X * X - Y * Y + Room * Room,
    if
        Root < 0.0; Along < 0.0 -> [];
        true -> [max(0.0, Along - math:sqrt(Root))]
    end.

side(UX, UY, {AX, AY}, {BX, BY}, Room) ->
    {WX, WY} = {BX - AX, BY - AY},
    Length = math:sqrt(WX * WX + WY * WY),
    case Length < 1.0e-6 of
        true -> [];
        false -> line(UX, UY, {AX, AY}, WX / Length, WY / Length, Length, Room)
    end.

line(UX, UY, {AX, AY}, WX, WY, Length, Room) ->
    Off = AY * WX - AX * WY,
    Closing = UY * WX - UX * WY,
    Left = abs(Off) - Room,
    Speed =
        case Off >= 0.0 of
            true -> Closing;
            false -> -Closing
        end,
    if
        Left < 0.0; Speed < 1.0e-9 ->
            [];
        true ->
            Mm = Left / Speed,
            Part = (UX * Mm - AX) * WX + (UY * Mm - AY) * WY,
            [Mm || Part >= 0.0, Part =< Length]
    end.

%% The cells whose ball the eye shows: both rays beside it go on until the ball, which keeps the last
%% stretch free.
shown(#eye{at = {X, Y}, rays = Rays}, #cover{balls = Balls, config = #{ball_mm := Ball}} = Cover) ->
    {X0, Y0, X1, Y1} = box(0, Rays, {X, Y, X, Y}, {X, Y}),
    First = fun(Z) -> max(0, floor((Z - Ball) / ?PITCH_MM)) end,
    Last = fun(Z) -> floor((Z + Ball) / ?PITCH_MM) end,
    {I0, I1, J1} = {First(X0), Last(X1), Last(Y1)},
    Is = fun(At) -> is_shown(At, {X, Y}, Ball, Rays, Cover#cover.range) end,
    rows(First(Y0), J1, I0, I1, Is, Balls).

rows(J, J1, _I0, _I1, _Is, _Balls) when J > J1 -> [];
rows(J, J1, I0, I1, Is, Balls) ->
    {First, Last} = {starl_search_cells:cell(I0, J), starl_search_cells:cell(I1, J)},
    row(First, Last, Is, Balls, rows(J + 1, J1, I0, I1, Is, Balls)).

row(Cell, Last, _Is, _Balls, Cells) when Last < Cell -> Cells;
row(Cell, Last, Is, Balls, Cells) ->
    case Balls of
        #{Last := At} ->
            case Is(At) of
                true -> row(Cell, Last - 1, Is, Balls, [Last | Cells]);
                false -> row(Cell, Last - 1, Is, Balls, Cells)
            end;
        #{} ->
            row(Cell, Last - 1, Is, Balls, Cells)
    end.

%% The box of all that the rays reach.
box(?RAYS, _Rays, Box, _From) ->
    Box;
box(K, Rays, {X0, Y0, X1, Y1}, {X, Y} = From) ->
    Mm = element(K + 1, Rays),
    {EX, EY} = {X + Mm * math:cos(K * ?TURN / ?RAYS), Y + Mm * math:sin(K * ?TURN / ?RAYS)},
    box(K + 1, Rays, {min(X0, EX), min(Y0, EY), max(X1, EX), max(Y1, EY)}, From).

is_shown({BX, BY}, {X, Y}, Ball, Rays, Range) ->
    DX = BX - X,
    DY = BY - Y,
    Mm = math:sqrt(DX * DX + DY * DY),
    Mm =< Range andalso
        begin
            Ray = (math:atan2(DY, DX) + ?TURN) * (?RAYS / ?TURN),
            K = trunc(Ray) rem ?RAYS,
            element(K + 1, Rays) >= Mm - Ball andalso
                element((K + 1) rem ?RAYS + 1, Rays) >= Mm - Ball
        end.

%% -- the choice -------------------------------------------------------------------------------

%% Always the view that shows most of what is left; of equal ones the first.
greedy(Shown, Seen) ->
    Views = [{N, {P, Cells, Cells}} || {N, {P, Cells}} <- lists:enumerate(Shown)],
    Queue = gb_sets:from_list([{-length(Cells), N} || {N, {_, Cells, _}} <- Views]),
    greedy(Queue, maps:from_list(Views), Seen).

greedy(Queue, Views, Seen) ->
    case gb_sets:is_empty(Queue) of
        true ->
            [];
        false ->
            {{Before, N}, Rest} = gb_sets:take_smallest(Queue),
            #{N := {P, All, Cells}} = Views,
            New = [Cell || Cell <- Cells, not is_map_key(Cell, Seen)],
            taken({Before, N}, -length(New), {P, All, New}, Rest, Views, Seen)
    end.

taken(_Key, 0, _View, Rest, Views, Seen) ->
    greedy(Rest, Views, Seen);
taken({Gain, N}, Gain, {P, All, New}, Rest, Views, Seen) ->
    [{P, All} | greedy(Rest, maps:remove(N, Views), maps:merge(Seen, maps:from_keys(New, true)))];
taken({_, N}, Gain, View, Rest, Views, Seen) ->
    greedy(gb_sets:add({Gain, N}, Rest), Views#{N := View}, Seen).

%% Leaves out the views whose cells others show as well, the smallest first; and gives each cell to one view.
needed(Views) ->
    Times = lists:foldl(
        fun(Cell, Acc) -> maps:update_with(Cell, fun(N) -> N + 1 end, 1, Acc) end,
        #{},
        [Cell || {_, Cells} <- Views, Cell <- Cells]
    ),
    {Kept, _} = lists:foldl(fun keep/2, {[], Times}, lists:reverse(Views)),
    {Own, _} = lists:mapfoldl(fun own/2, #{}, Kept),
    Own.

keep({_, Cells} = View, {Kept, Times}) ->
    case lists:all(fun(Cell) -> maps:get(Cell, Times) > 1 end, Cells) of
        true ->
            {Kept,
                lists:foldl(fun(Cell, T) -> T#{Cell := maps:get(Cell, T) - 1} end, Times, Cells)};
        false ->
            {[View | Kept], Times}
    end.

own({P, Cells}, Given) ->
    New = [Cell || Cell <- Cells, not is_map_key(Cell, Given)],
    {{P, New}, maps:merge(Given, maps:from_keys(New, true))}.

%% -- cells that no place shows ----------------------------------------------------------------

%% Looks at each from its own side, with doors closed and then open. Sight is mutual: where its rays come to, it
%% is seen from.
besides([], _Ways, _Open, _Cover) ->
    [];
besides(Left, Ways, Open, #cover{balls = Balls, config = #{wall_mm := Mm}} = Cover) ->
    IsRoomy = fun(Cell) ->
        P = starl_search_cells:middle(Cell),
        starl_walls:is_free({P, P}, Mm, Open)
    end,
    Roomy = maps:from_keys(lists:filter(IsRoomy, maps:keys(Balls)), true),
    {Views, _} = lists:foldl(
        fun(Walls, {Added, Cells}) -> besides(Cells, #{}, Walls, Roomy, Added, [], Cover) end,
        {[], Left},
        Ways
    ),
    lists:reverse(Views).

besides([], _Seen, _Walls, _Roomy, Added, Unseen, _Cover) ->
    {Added, lists:reverse(Unseen)};
besides([Cell | Cells], Seen, Walls, Roomy, Added, Unseen, Cover) when is_map_key(Cell, Seen) ->
    besides(Cells, Seen, Walls, Roomy, Added, Unseen, Cover);
besides([Cell | Cells], Seen, Walls, Roomy, Added, Unseen, Cover) ->
    case best(Cell, Cells, Walls, Roomy, Cover) of
        {P, All} ->
            Known = maps:merge(Seen, maps:from_keys(All, true)),
            besides(Cells, Known, Walls, Roomy, [{P, All} | Added], Unseen, Cover);
        none ->
            besides(Cells, Seen, Walls, Roomy, Added, [Cell | Unseen], Cover)
    end.

best(Cell, Cells, Walls, Roomy, #cover{balls = Balls} = Cover) ->
    Left = maps:from_keys([Cell | Cells], true),
    Views = [
        {-length([C || C <- All, is_map_key(C, Left)]), P, All}
     || P <- places(maps:get(Cell, Balls), Walls, Roomy, Cover),
        All <- [shown(eye(P, Walls, Cover), Cover)],
        lists:member(Cell, All)
    ],
    case lists:sort(Views) of
        [{_, P, All} | _] -> {P, All};
        [] -> none
    end.

%% A few of the places that see a ball, from the nearest to the farthest.
places(Ball, Walls, Roomy, #cover{config = #{comes_to := ComesTo}} = Cover) ->
    Near = lists:sort([
        {starl_geometry:distance(Ball, P), P}
     || Cell <- shown(eye(Ball, Walls, Cover), Cover),
        is_map_key(Cell, Roomy),
        P <- [starl_search_cells:middle(Cell)]
    ]),
    some(?TRIES, [P || {_, P} <- some(?LOOKED_AT, Near), ComesTo(P)]).

some(Most, Places) ->
    Step = max(1, length(Places) div Most),
    [P || {N, P} <- lists:enumerate(0, Places), N rem Step =:= 0].
