%% @doc Computes the lane of a convoy: the shortest path from the place `start' to the place `goal'
%% of a floor plan. The path follows the roadmap of path planning, is straightened, and is cut into
%% sections. A pure module; lengths are millimetres.
-module(starl_convoy_route).

-export([column/3, new/2, section/2, back/2, drawing/1]).

-export_type([t/0]).

%% The sections in the order of driving, counted from 0: the way from the middle of the one before to the own middle,
%% which is its last point, and the door that it leads through.
-type t() :: [{[starl_geometry:point(), ...], Door :: pos_integer() | none}, ...].

%% The size of the roadmap's meshes; the steps in which a way is measured.
-define(MESH_MM, 250.0).
%% More than a body and r(v) from walls.
-define(MARGIN_MM, 10.0).
-define(STEP_MM, 10).
%% A section is free if nobody is nearer to its middle than this part of its length.
-define(FREE, 0.75).
%% It takes three seconds, and longer in faults.
-define(WITHIN_MS, 30000).

%% @doc The lane, and where the robots of a column begin, the first one ahead: in the middle of a section each, towards
%% the next one. All stand before the first door at the beginning, and behind the last one at the end, or one line says
%% that they cannot.
-spec column([Id], starl_floor:t(), #{profiles := starl_chassis:profiles(), section_mm := number()}) ->
    {ok, t(), #{Id => starl:pose()}} | {error, unicode:chardata()}
when
    Id :: starl:robot_id().
column(Ids, Floor, Config) ->
    case new(Floor, Config) of
        {ok, Lane} -> starts(Ids, Lane);
        {error, _} = Error -> Error
    end.

%% @doc The lane for robots with these profiles, with sections of this length, or one line on what the plan lacks.
-spec new(starl_floor:t(), #{profiles := starl_chassis:profiles(), section_mm := number()}) ->
    {ok, t()} | {error, unicode:chardata()}.
new(#{places := #{start := From, goal := To}} = Floor, #{profiles := Profiles, section_mm := Length}) ->
    Body = lists:max([starl_chassis:radius_mm(Profile) || Profile <- Profiles]),
    Mm = Body + starl_chassis:widest(Profiles) + ?MARGIN_MM,
    #{walls := Walls, points := Points} =
        Roads = starl_dpp_cells:roads(Floor, #{wall_mm => Mm, tube_radius => ?MESH_MM}),
    [First, Last] = [nearest(P, Points) || P <- [From, To]],
    case shortest(First, Last, Roads) of
        none ->
            {error, "no way from `start' to `goal' is wide enough for a robot"};
        Way ->
            Corners = straight([From | [maps:get(V, Points) || V <- Way]] ++ [To], Mm, Walls),
            {ok, through(sections(Corners, Length), Floor)}
    end;
new(_Floor, _Config) ->
    {error, "a convoy needs the places `start' and `goal' of the floor plan"}.

nearest(P, Points) ->
    {_, V} = lists:min([{starl_geometry:distance(P, Q), V} || {V, Q} <- maps:to_list(Points)]),
    V.

%% Dijkstra's algorithm.
shortest(From, To, #{points := Points, edges := Edges}) ->
    Beside = lists:foldl(
        fun({V, W}, Acc) ->
            Mm = starl_geometry:distance(maps:get(V, Points), maps:get(W, Points)),
            Add = fun(Others) -> [{W, Mm} | Others] end,
            Back = fun(Others) -> [{V, Mm} | Others] end,
            maps:update_with(W, Back, [{V, Mm}], maps:update_with(V, Add, [{W, Mm}], Acc))
        end,
        #{},
        Edges
    ),
    search(gb_sets:singleton({0.0, From, []}), To, Beside, #{}).

search(Open, To, Beside, Seen) ->
    case gb_sets:is_empty(Open) orelse gb_sets:take_smallest(Open) of
        true ->
            none;
        {{_, To, Way}, _} ->
            lists:reverse([To | Way]);
        {{_, V, _}, Rest} when is_map_key(V, Seen) ->
            search(Rest, To, Beside, Seen);
        {{Mm, V, Way}, Rest} ->
            Next = [{Mm + More, W, [V | Way]} || {W, More} <- maps:get(V, Beside, [])],
            search(gb_sets:union(Rest, gb_sets:from_list(Next)), To, Beside, Seen#{V => true})
    end.

%% From each point to the farthest that a straight line reaches.
straight([P, Q | Points], Mm, Walls) ->
    [Next | Rest] = farthest(P, tails([Q | Points]), Mm, Walls),
    [P | straight([Next | Rest], Mm, Walls)];
straight([P], _Mm, _Walls) ->
    [P].

%% The shortest first.
tails(Points) -> [lists:nthtail(N - 1, Points) || N <- lists:seq(length(Points), 1, -1)].

farthest(_P, [Next], _Mm, _Walls) ->
    Next;
farthest(P, [[Q | _] = Tail | Tails], Mm, Walls) ->
    case starl_walls:is_free({P, Q}, Mm, Walls) of
        true -> Tail;
        false -> farthest(P, Tails, Mm, Walls)
    end.

%% -- sections -------------------------------------------------------------------------------

%% The middles of two sections that follow each other are so far apart, as the crow flies: bodies know no
%% lanes. What is left at the end is no section.
sections([From | Corners], Length) -> [[From] | walk(From, From, Corners, [], Length)].

walk(_Here, _Last, [], _Way, _Length) ->
    [];
walk(Here, Last, [Corner | Corners] = Ahead, Way, Length) ->
    {Next, Left} =
        case starl_geometry:distance(Here, Corner) of
            Mm when Mm =< ?STEP_MM -> {Corner, Corners};
            Mm -> {starl_geometry:interpolate(Here, Corner, ?STEP_MM / Mm), Ahead}
        end,
    case starl_geometry:distance(Last, Next) >= Length of
        true -> [lists:reverse([Next | Way]) | walk(Next, Next, Left, [], Length)];
        false when Left =:= Ahead -> walk(Next, Last, Ahead, Way, Length);
        false -> walk(Next, Last, Corners, [Next | Way], Length)
    end.

%% The door that the way of each section leads through.
through([[From] | _] = Sections, #{doors := Doors}) ->
    Numbered = lists:enumerate(Doors),
    {Found, _} = lists:mapfoldl(
        fun(Way, Before) ->
            {{Way, door(sides([Before | Way]), Numbered)}, lists:last(Way)}
        end,
        From,
        Sections
    ),
    Found.

door(Sides, Doors) ->
    case [N || {N, D} <- Doors, S <- Sides, starl_geometry:segment_segment(S, D) == 0] of
        [N | _] -> N;
        [] -> none
    end.

sides([P, Q | Points]) -> [{P, Q} | sides([Q | Points])];
sides([_]) -> [].

%% -- the column -----------------------------------------------------------------------------

starts(Ids, Lane) ->
    case most(Lane) of
        Most when length(Ids) > Most ->
            Why = "before the first door, or behind the last one, is room for ~b robots: use fewer",
            {error, io_lib:format(Why, [Most])};
        _ ->
            Starts = [{Id, start(length(Ids) - K, Lane)} || {K, Id} <- lists:enumerate(Ids)],
            {ok, Lane, maps:from_list(Starts)}
    end.

most(Lane) ->
    Doors = [I || {I, {_, Door}} <- lists:enumerate(0, Lane), Door =/= none],
    case Doors of
        [] -> length(Lane) div 2;
        _ -> min(hd(Doors), length(Lane) - 1 - lists:last(Doors))
    end.

start(I, Lane) ->
    {Way, _} = lists:nth(I + 1, Lane),
    {[Next | _], _} = lists:nth(I + 2, Lane),
    {X, Y} = lists:last(Way),
    {X, Y, starl_geometry:heading({X, Y}, Next)}.

%% @doc The way to a section, from the one before.
-spec section(pos_integer(), t()) -> starl_sections:section().
section(I, Lane) ->
    [{Before, _}, {Way, _}] = lists:sublist(Lane, I, 2),
    Mm = starl_geometry:distance(lists:last(Before), lists:last(Way)),
    #{token => {section, I}, way => Way, free_mm => ?FREE * Mm, within_ms => ?WITHIN_MS}.

%% @doc The way back to the middle of a section.
-spec back(non_neg_integer(), t()) -> starl_sections:section().
back(0, Lane) -> (section(1, Lane))#{token => {section, 0}, way => [middle(0, Lane)]};
back(I, Lane) -> (section(I, Lane))#{way => [middle(I, Lane)]}.

middle(I, Lane) ->
    {Way, _} = lists:nth(I + 1, Lane),
    lists:last(Way).

%% @doc The drawing of the lane.
-spec drawing(t()) -> starl_drawing:shape().
drawing(Lane) -> #{key => lane, line => lists:append([Way || {Way, _} <- Lane]), colour => grey}.
