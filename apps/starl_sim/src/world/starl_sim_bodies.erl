%% @doc Solid bodies on a floor plan: when does a robot next touch a wall or another robot?
%%
%% A robot that gets a new piece of motion is looked at twice. At that moment its own walls are
%% known, and the other robots as of the beginning of the window: a touch within the window is
%% planned, or the piece is blocked from its start. At the end of the window all shards know all new
%% pieces, and plan the touches of later windows alike ({@link meetings/4}); each carries the two
%% pieces, and is void when one of them has changed. So two robots overlap only if both change their
%% motion within one window, and by no more than they drive in it.
%%
%% Only the next second is looked at; a piece that lasts is looked at again then.
-module(starl_sim_bodies).

-export([contact/5, meetings/4, side/2, place/4, walls/2]).

-export_type([with/0, touch/0]).

%% What a robot touches: the wall of this number, or another robot.
-type with() :: {wall, pos_integer()} | {robot, starl:robot_id()}.

%% A planned touch of a robot on this piece: of a wall; of a robot on that piece, and whether this
%% robot drives against it. `look': the next second is to be looked at.
-type touch() ::
    {touch, starl_trajectory:piece(), {wall, pos_integer()}}
    | {touch, starl_trajectory:piece(),
        {robot, starl:robot_id(), starl_trajectory:piece(), Stops :: boolean()}}
    | {look, starl_trajectory:piece()}.

-type world() :: #{
    walls := starl_walls:t(),
    obstacles => starl_obstacles:t(),
    profiles := starl_chassis:profiles(),
    sight => starl_sim_sight:t(),
    atom() => term()
}.

-define(HORIZON_US, 1000000).
%% Who leaves what it touches has this time for it.
-define(MOMENT_US, 1000).

%% @doc The next touch of a robot on a new piece that begins now, in a window that ends then;
%% `blocked': the piece begins with it.
-spec contact(starl:robot_id(), starl_trajectory:piece(), Now, Until, world()) ->
    {blocked, with()} | {Us :: pos_integer(), touch()} | none
when
    Now :: starl_sim_queue:time(), Until :: starl_sim_queue:time().
contact(Id, Piece, Now, Until, World) ->
    case starl_trajectory:is_still(Piece) of
        true ->
            none;
        false ->
            Near = beside(Id, Piece, Now, Until, World),
            Robots = [{At, {robot, Other, P, true}} || {At, Other, P} <- Near],
            next(Piece, Now, lists:sort(wall(Id, Piece, Now, World) ++ Robots))
    end.

next(Piece, Now, []) ->
    case starl_trajectory:rests_from(Piece) of
        Rests when Rests =< Now + ?HORIZON_US -> none;
        _ -> {?HORIZON_US, {look, Piece}}
    end;
next(_Piece, Now, [{Now, {wall, N}} | _]) ->
    {blocked, {wall, N}};
next(_Piece, Now, [{Now, {robot, Other, _, _}} | _]) ->
    {blocked, {robot, Other}};
next(Piece, Now, [{At, With} | _]) ->
    {At - Now, {touch, Piece, With}}.

wall(Id, Piece, Now, World) ->
    Until = Now + ?HORIZON_US,
    Radius = radius(Id, World),
    {{X, Y}, Reach} = starl_trajectory:enclosing(Now, Until, Piece),
    Box = starl_geometry:grow({X, Y, X, Y}, Reach + 1.0),
    first_wall(stretches(Now, Until, World), Piece, Radius, Box).

%% Obstacles come and go at known times.
stretches(From, To, #{obstacles := Obstacles}) -> starl_obstacles:stretches(From, To, Obstacles);
stretches(From, To, #{walls := Walls}) -> [{From, To, Walls}].

first_wall([], _Piece, _Radius, _Box) ->
    [];
first_wall([{From, To, Walls} | Stretches], Piece, Radius, Box) ->
    case starl_contact:wall(Piece, Radius, starl_walls:near(Box, Radius, Walls), From, To) of
        {At, N} -> [{At, {wall, N}}];
        none -> first_wall(Stretches, Piece, Radius, Box)
    end.

%% @doc All that is in the way at a time, but the robots.
-spec walls(starl_sim_queue:time(), world()) -> starl_walls:t().
walls(Now, #{obstacles := Obstacles}) -> starl_obstacles:walls(Now, Obstacles);
walls(_Now, #{walls := Walls}) -> Walls.

%% The robots against which it drives in this window.
beside(_Id, _Piece, _Now, _Until, World) when not is_map_key(sight, World) ->
    [];
beside(Id, Piece, Now, Until, #{sight := Sight} = World) ->
    Place = starl_trajectory:position(Now, Piece),
    [
        {At, Other, P}
     || {Other, P} <- starl_sim_sight:pieces(Sight),
        Other =/= Id,
        Sum <- [radius(Id, World) + radius(Other, World)],
        is_near(Place, Piece, P, Sum, Now, Until),
        At <- against(Piece, P, Sum, Now, Until),
        At < Until
    ].

%% Time of first contact. Bodies that touch at the start may separate and meet again.
against(Piece, Other, Sum, Now, Until) ->
    case starl_contact:bodies(Piece, Other, Sum, Now, Until) of
        Now ->
            case starl_contact:towards(starl_trajectory:position(Now, Other), Now, Piece) of
                true -> [Now];
                false -> bends_back(Piece, Other, Sum, Now + ?MOMENT_US, Until)
            end;
        At ->
            [At || is_integer(At), {true, _} <- [stops(At, Piece, Other)]]
    end.

bends_back(_Piece, _Other, _Sum, From, Until) when From >= Until -> [];
bends_back(Piece, Other, Sum, From, Until) ->
    At = starl_contact:bodies(Piece, Other, Sum, From, Until),
    [At || is_integer(At), {true, _} <- [stops(At, Piece, Other)]].

is_near(Place, A, B, Sum, Now, Until) ->
    Reach =
        Sum + 1.0 +
            (starl_trajectory:fastest(A) + starl_trajectory:fastest(B)) * (Until - Now) / 1.0e6,
    starl_geometry:distance2(Place, starl_trajectory:position(Now, B)) =< Reach * Reach.

radius(Id, #{profiles := Profiles}) ->
    starl_chassis:radius_mm(starl_chassis:of_robot(Id, Profiles)).

%% @doc The touches between robots of which one has a new piece, from the end of this window on:
%% events of both, in order. All shards come to the same.
-spec meetings([starl:robot_id()], Now :: starl_sim_queue:time(), starl_sim_sight:t(), world()) ->
    [starl_sim_queue:event()].
meetings(Moved, Now, Sight, World) ->
    All = lists:sort(starl_sim_sight:pieces(Sight)),
    Pieces = maps:from_list(All),
    New = maps:from_list([{Id, true} || Id <- Moved]),
    lists:sort([
        Event
     || Id <- maps:keys(New),
        #{Id := Piece} <- [Pieces],
        Place <- [starl_trajectory:position(Now, Piece)],
        {Other, P} <- All,
        Other < Id orelse Other > Id andalso not is_map_key(Other, New),
        Event <- meeting({Id, Piece, Place}, {Other, P}, Now, World)
    ]).

meeting({Id, A, Place}, {Other, B}, Now, World) ->
    Until = Now + ?HORIZON_US,
    Sum = radius(Id, World) + radius(Other, World),
    case
        is_near(Place, A, B, Sum, Now, Until) andalso starl_contact:bodies(A, B, Sum, Now, Until)
    of
        At when is_integer(At) ->
            {AStops, BStops} = stops(At, A, B),
            [
                {Id, At, 0, Other, 0, {touch, A, {robot, Other, B, AStops}}},
                {Other, At, 0, Id, 0, {touch, B, {robot, Id, A, BStops}}}
            ];
        _ ->
            []
    end.

%% Which of two that touch drive against the other? Where paths bend, they can touch before either
%% does: the next chord leads inwards, the velocity not yet. Then those that move stop; otherwise
%% nobody would, and the pair is looked at again only after a second.
stops(At, A, B) ->
    Towards = fun(P, Other) ->
        starl_contact:towards(starl_trajectory:position(At, Other), At, P)
    end,
    case {Towards(A, B), Towards(B, A)} of
        {false, false} -> {moves(At, A), moves(At, B)};
        Stops -> Stops
    end.

%% An atom is larger than any number.
moves(At, Piece) -> starl_trajectory:rests_from(Piece) > At.

%% @doc The place where a robot is touched.
-spec place(with(), starl:pose(), starl_sim_queue:time(), world()) -> starl_geometry:point().
place({wall, N}, {X, Y, _}, Now, World) ->
    starl_geometry:closest_point({X, Y}, starl_walls:side(N, walls(Now, World)));
place({robot, Other}, _Pose, Now, #{sight := Sight}) ->
    {ok, Piece} = starl_sim_sight:piece(Other, Sight),
    starl_trajectory:position(Now, Piece).

%% @doc The side of its bumper at which a robot feels what is there: it goes around the front half,
%% and within 15 degrees of the middle both switches close.
-spec side(starl_geometry:point(), starl:pose()) -> left | right | both | behind.
side(There, {X, Y, Heading}) ->
    starl_sense_bump:side(starl_sense:bearing(There, {X, Y, Heading}), math:pi() / 12).
