%% @doc Locates a convoy's robot on the lane, and decides what it does when it cannot advance. Wrong
%% positions may have led it astray, or have changed the order of the column. A pure module; lengths
%% are millimetres.
-module(starl_convoy_place).

-export([locate/2, progress/2, next/2]).

-export_type([seen/0, next/0]).

%% `at': the section where the robot takes itself to be; `here': where it is, and where the `others' are; `waited_ms': since it came to
%% its section.
-type seen() :: #{
    lane := starl_convoy_route:t(),
    floor := starl_floor:t(),
    at := non_neg_integer(),
    here := starl_geometry:point(),
    others := [starl_geometry:point()],
    waited_ms := integer()
}.

%% It waits on where it stands, or has come to stay; it begins anew with this section, drives back to the middle of its own,
%% or leaves that to another one.
-type next() ::
    stay
    | arrived
    | {at, Section :: non_neg_integer()}
    | {back, starl_sections:section()}
    | leave.

%% Who is nearer to the middle of a section has come there.
-define(THERE_MM, 60).
%% Who is no farther from the middle of a section stands in it, not between two.
-define(STAYS_MM, 150).
%% A body that drives by a wall is farther from it, also if positions are a little off; who stands at one may only get away
%% from it.
-define(BODY_MM, 167.0).
-define(SLACK_MM, 0.2).
%% So far apart two robots touch at most.
-define(TOUCH_MM, 340).
-define(HELD_UP_MS, 20000).

%% @doc The last section to whose middle a robot on the lane at this place has come.
-spec locate(starl_geometry:point(), starl_convoy_route:t()) -> non_neg_integer().
locate(Place, Lane) ->
    {I, Left, _} = nearest(Place, Lane),
    case Left =< ?THERE_MM of
        true -> I;
        false -> I - 1
    end.

%% @doc How far along the lane a place is, in sections.
-spec progress(starl_geometry:point(), starl_convoy_route:t()) -> float().
progress(Place, Lane) ->
    {I, Left, Mm} = nearest(Place, Lane),
    I - min(1.0, Left / Mm).

%% The section whose way is nearest, how far away its middle is, and how far the one before it from that.
nearest(Place, Lane) ->
    Ends = [lists:last(Way) || {Way, _} <- Lane],
    {_, I, Before, Way} = lists:min([
        {
            lists:min([starl_geometry:point_segment(Place, S) || S <- sides([Before | Way])]),
            I,
            Before,
            Way
        }
     || {I, Before, {Way, _}} <- lists:zip3(
            lists:seq(1, length(Lane) - 1), lists:droplast(Ends), tl(Lane)
        )
    ]),
    Middle = lists:last(Way),
    {I, starl_geometry:distance(Place, Middle), starl_geometry:distance(Before, Middle)}.

sides([P, Q | Points]) -> [{P, Q} | sides([Q | Points])];
sides([_]) -> [].

%% @doc What a robot does that did not come to the next section: it was occupied, or it stuck on the way.
-spec next(occupied | stuck, seen()) -> next().
next(stuck, #{here := Here, floor := Floor, lane := Lane, at := At}) ->
    moved(reach(Here, Floor, Lane), At, stay);
next(occupied, #{here := Here, others := Others, lane := Lane, at := At} = Seen) ->
    case is_full(At + 1, Others, Lane) of
        true -> arrived;
        false -> moved(locate(Here, Lane), At, makes_room(Seen))
    end.

moved(At, At, Else) -> Else;
moved(Other, _At, _Else) -> {at, Other}.

%% Its way ends behind those that have come to stay, in whatever order: does a robot stand in the middle of each section
%% from this one on?
is_full(I, Robots, Lane) ->
    lists:all(
        fun({Way, _}) ->
            Middle = lists:last(Way),
            lists:any(fun(P) -> starl_geometry:distance(P, Middle) =< ?STAYS_MM end, Robots)
        end,
        lists:nthtail(I, Lane)
    ).

%% Two robots that stand beside each other between two sections are in each other's way for ever: the one that can
%% drives back, and has the token of the section for it.
makes_room(#{waited_ms := Ms}) when Ms < ?HELD_UP_MS ->
    stay;
makes_room(#{here := Here, others := Others, lane := Lane, at := At}) ->
    #{way := [Middle]} = Back = starl_convoy_route:back(At, Lane),
    Clear = lists:all(fun(Other) -> leaves(Other, Here, Middle) end, Others),
    case starl_geometry:distance(Here, Middle) =< ?STAYS_MM of
        true -> stay;
        false when Clear -> {back, Back};
        false -> leave
    end.

%% Does this way touch the other robot only where it begins, if at all?
leaves(Other, From, To) ->
    Least = min(?TOUCH_MM, starl_geometry:distance(Other, From)),
    starl_geometry:point_segment(Other, {From, To}) >= Least - 1.0.

%% The section before the nearest one to whose middle a straight line leads past all walls; without any, as `locate'. A
%% robot that wrong positions have led astray, beside a wall even, drives on from there.
reach(Place, Floor, [_ | Sections] = Lane) ->
    Walls = starl_walls:new(Floor),
    Near = lists:sort([
        {starl_geometry:distance(Place, lists:last(Way)), I, lists:last(Way)}
     || {I, {Way, _}} <- lists:enumerate(Sections)
    ]),
    Mm = starl_walls:clearance({Place, Place}, ?BODY_MM, Walls) - ?SLACK_MM,
    Free = fun({_, _, Middle}) -> starl_walls:is_free({Place, Middle}, Mm, Walls) end,
    case lists:search(Free, Near) of
        {value, {Left, I, _}} when Left =< ?THERE_MM -> I;
        {value, {_, I, _}} -> I - 1;
        false -> locate(Place, Lane)
    end.
