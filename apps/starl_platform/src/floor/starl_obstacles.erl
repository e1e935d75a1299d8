%% @doc Temporary obstacles on a floor plan: a closed door, or a box that was put down. The walls
%% are constant between two changes.
%% ```
%%   {ok, Sides} = starl_obstacles:door(1, Floor),
%%   Obstacles = starl_obstacles:new([{10000000, 20000000, Sides}], Walls),
%%   Closed = starl_obstacles:walls(15000000, Obstacles)
%% '''
%% An obstacle has no inside: a body that stands where one appears is caught. It may leave, and moves
%% nowhere where it gets deeper into a side ({@link starl_contact}). Times are microseconds, lengths
%% millimetres.
-module(starl_obstacles).

-export([door/2, box/1, of_fault/3, new/2, walls/2, stretches/3, sides/2, caught/2]).

-export_type([t/0, obstacle/0]).

%% From when on, and before when, and the sides of it.
-type obstacle() :: {FromUs :: integer(), ToUs :: integer(), [starl_geometry:segment(), ...]}.

%% The walls between two changes, ordered by time: each from then on.
-record(obstacles, {
    obstacles :: [obstacle()],
    always :: starl_walls:t(),
    stretches :: [{FromUs :: integer(), starl_walls:t()}]
}).

-opaque t() :: #obstacles{}.

%% @doc The sides of the plan's door of this number, counted from 1; the number of doors if it has no
%% such door.
-spec door(pos_integer(), starl_floor:t()) ->
    {ok, [starl_geometry:segment(), ...]} | {error, Doors :: non_neg_integer()}.
door(N, #{doors := Doors}) when N > length(Doors) -> {error, length(Doors)};
door(N, #{doors := Doors}) -> {ok, [lists:nth(N, Doors)]}.

%% @doc The sides of a box, lower left corner first.
-spec box({X :: number(), Y :: number(), Width :: number(), Height :: number()}) ->
    [starl_geometry:segment(), ...].
box({X, Y, W, H}) ->
    [A, B, C, D] = starl_floor:box(X, Y, X + W, Y + H),
    [{A, B}, {B, C}, {C, D}, {D, A}].

%% @doc The sides of what a fault of a floor puts in the way ({@link starl_run_fault}, class `floor').
-spec of_fault(Kind :: atom(), Params :: #{atom() => term()}, starl_floor:t()) ->
    [starl_geometry:segment()].
of_fault(closed, #{door := Door}, Floor) ->
    case door(Door, Floor) of
        {ok, Sides} -> Sides;
        {error, _} -> []
    end;
of_fault(obstacle, #{x := X, y := Y, width := W, height := H}, _Floor) ->
    box({X, Y, W, H});
of_fault(_Other, _Params, _Floor) ->
    [].

%% @doc The walls of a floor with these obstacles beside them.
-spec new([obstacle()], starl_walls:t()) -> t().
new(Obstacles0, Walls) ->
    Obstacles = [O || {From, To, _} = O <- Obstacles0, From < To],
    Changes = lists:usort(lists:append([[From, To] || {From, To, _} <- Obstacles])),
    #obstacles{
        obstacles = Obstacles,
        always = Walls,
        stretches = [{T, starl_walls:add(standing(T, Obstacles), Walls)} || T <- Changes]
    }.

standing(T, Obstacles) -> lists:append([Sides || {_, _, Sides} <- holding(T, Obstacles)]).

holding(T, Obstacles) -> [O || {From, To, _} = O <- Obstacles, From =< T, T < To].

%% @doc All that is in the way at a time.
-spec walls(TimeUs :: integer(), t()) -> starl_walls:t().
walls(T, #obstacles{always = Always, stretches = Stretches}) ->
    lists:foldl(
        fun
            ({From, Walls}, _) when From =< T -> Walls;
            (_, Before) -> Before
        end,
        Always,
        Stretches
    ).

%% @doc The stretches of a span of time, in order, each with its walls.
-spec stretches(FromUs :: integer(), ToUs :: integer(), t()) ->
    [{FromUs :: integer(), ToUs :: integer(), starl_walls:t()}, ...].
stretches(From, To, #obstacles{stretches = Stretches} = Obstacles) ->
    Changes = [T || {T, _} <- Stretches, From < T, T < To],
    Starts = [From | Changes],
    [
        {Start, End, walls(Start, Obstacles)}
     || {Start, End} <- lists:zip(Starts, Changes ++ [To])
    ].

%% @doc The sides of the obstacles that stand at a time.
-spec sides(TimeUs :: integer(), t()) -> [starl_geometry:segment()].
sides(T, #obstacles{obstacles = Obstacles}) -> standing(T, Obstacles).

%% @doc Does an obstacle appear at this time? Its sides.
-spec caught(TimeUs :: integer(), t()) -> [starl_geometry:segment()].
caught(T, #obstacles{obstacles = Obstacles}) ->
    lists:append([Sides || {From, _, Sides} <- Obstacles, From =:= T]).
