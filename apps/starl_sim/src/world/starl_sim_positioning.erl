%% @doc The simulated positioning system as one robot sees it: with its error and its faults.
-module(starl_sim_positioning).

-export([poses/2, blur/3]).

-export_type([look/0]).

%% A look at robots: the robot that looks, the present faults, the key of its draws, a function for
%% the view without a fault (one pose or none), and the poses seen last.
-type look() :: #{
    robot := starl:robot_id(),
    faults := [starl_run_fault:compiled() | tuple()],
    key := term(),
    see := fun((starl:robot_id()) -> [starl:pose()]),
    seen := #{starl:robot_id() => starl:pose()}
}.

%% @doc The poses of these robots, if they are seen, and all poses seen so far.
-spec poses([starl:robot_id()], look()) ->
    {[{starl:robot_id(), starl:pose()}], #{starl:robot_id() => starl:pose()}}.
poses(Robots, #{robot := Self, faults := All, seen := Seen} = Look) ->
    Own = [F || F <- All, kind(F) =/= location_swap, starl_run_fault:hits(Self, F)],
    Kinds = [kind(F) || F <- Own],
    case {lists:member(location_dropout, Kinds), lists:member(location_frozen, Kinds)} of
        {true, _} ->
            {[], Seen};
        {false, true} ->
            {[{Robot, maps:get(Robot, Seen)} || Robot <- Robots, is_map_key(Robot, Seen)], Seen};
        {false, false} ->
            Poses = [
                {R, blurred(R, Pose, Own, Look)}
             || R <- Robots, Pose <- look_at(R, All, Look)
            ],
            {Poses, maps:merge(Seen, maps:from_list(Poses))}
    end.

kind({_, _, _, Kind, _, _}) -> Kind.

look_at(Robot, Faults, #{see := See}) ->
    Swaps = [Two || {_, _, _, location_swap, Two, _} <- Faults],
    See(lists:foldl(fun swap/2, Robot, Swaps)).

swap({A, B}, A) -> B;
swap({A, B}, B) -> A;
swap(_, Robot) -> Robot.

blurred(Robot, Pose, Faults, #{key := Key}) ->
    lists:foldl(fun(Fault, P) -> shift(Fault, {Key, Robot}, P) end, Pose, Faults).

shift({Id, _, _, location_noise, _, #{mm := Mm}}, Key, {X, Y, Heading}) ->
    Radius = Mm * starl_run_draw:uniform({Key, Id, radius}),
    Angle = 2 * math:pi() * starl_run_draw:uniform({Key, Id, angle}),
    {X + Radius * math:cos(Angle), Y + Radius * math:sin(Angle), Heading};
shift({Id, _, _, location_bias, _, #{mm := Mm}}, _Key, {X, Y, Heading}) ->
    Angle = 2 * math:pi() * starl_run_draw:uniform({Id, bias}),
    {X + Mm * math:cos(Angle), Y + Mm * math:sin(Angle), Heading};
shift(_, _Key, Pose) ->
    Pose.

%% @doc A pose with the positioning system's error: within a disk, and within a quarter of the bound
%% on the heading.
-spec blur(starl:pose(), Key, starl_chassis:profile()) -> starl:pose() when
    Key :: {Seed :: integer(), Self :: starl:robot_id(), starl:robot_id(), non_neg_integer()}.
blur({X, Y, Heading}, Key, #{position_error_mm := Error, heading_error := HeadingError}) ->
    Radius = Error * starl_run_draw:uniform({Key, radius}),
    Angle = 2 * math:pi() * starl_run_draw:uniform({Key, angle}),
    Turn = 0.25 * HeadingError * starl_run_draw:signed({Key, heading}),
    {X + Radius * math:cos(Angle), Y + Radius * math:sin(Angle), Heading + Turn}.
