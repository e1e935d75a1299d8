%% @doc The chassis of a simulated robot: two wheels that turn as they were told to, as far as the
%% faults of actuation let them, the piece of motion that comes of it, and what the positioning
%% system shows of this robot and of others.
%%
%% All draws are stateless: a hash of the seed, the robot, a count and a purpose. Other robots are
%% seen as they were at the beginning of the present window (`sight' in the world). Speeds are
%% mm/s, times microseconds.
-module(starl_sim_chassis).

-export([new/3, piece/1, drive/3, turn_wheels/2, stop/2, sense/3]).

-export_type([t/0, change/0]).

-record(chassis, {
    id :: starl:robot_id(),
    world :: starl_sim_platform:world(),
    piece :: starl_trajectory:piece(),
    %% the speeds of the wheels as last told
    command = {0.0, 0.0} :: {Left :: float(), Right :: float()},
    draws = 0 :: non_neg_integer(),
    %% where robots were last seen, if sight may freeze
    seen = #{} :: #{starl:robot_id() => starl:pose()}
}).

-opaque t() :: #chassis{}.

%% The chassis, and whether it is in a new piece of motion.
-type change() :: {moved | same, t()}.

-define(MAX_WHEEL, 500.0).

%% @doc A chassis at rest at a pose.
-spec new(starl:robot_id(), starl:pose(), starl_sim_platform:world()) -> t().
new(Id, {X, Y, Heading}, World) ->
    #chassis{id = Id, world = World, piece = starl_trajectory:standing(0, {X, Y}, Heading)}.

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#chassis{piece = Piece}) -> Piece.

%% -- wheels ---------------------------------------------------------------------------------

%% @doc The wheels are told to turn at these speeds.
-spec drive({Left :: float(), Right :: float()}, starl_sim_queue:time(), t()) -> change().
drive({Left, Right}, Now, #chassis{id = Id, draws = N, world = #{seed := Seed}} = Chassis) ->
    Faults = held(Now, Chassis),
    Lost = [
        F
     || {Name, _, _, command_lost, _, #{part := Part}} = F <- Faults,
        starl_sim_draw:uniform({Seed, Id, N, Name}) < Part
    ],
    case Lost of
        [] ->
            Told = Chassis#chassis{
                command = {limit(Left), limit(Right)}, draws = N + length(Faults)
            },
            turn_wheels(Faults, Now, Told);
        [_ | _] ->
            {same, Chassis#chassis{draws = N + 1}}
    end.

%% @doc The wheels as they turn from now on, since a fault of theirs begins or ends.
-spec turn_wheels(starl_sim_queue:time(), t()) -> change().
turn_wheels(Now, Chassis) -> turn_wheels(held(Now, Chassis), Now, Chassis).

%% @doc The wheels stop, whatever the faults.
-spec stop(starl_sim_queue:time(), t()) -> change().
stop(Now, Chassis) -> turn_wheels([], Now, Chassis#chassis{command = {0.0, 0.0}}).

held(_Now, #chassis{world = #{actuation := []}}) ->
    [];
held(Now, #chassis{id = Id, world = #{actuation := All}}) ->
    [F || F <- starl_sim_fault:holding(Now, All), starl_sim_fault:hits(Id, F)].

turn_wheels(Faults, Now, #chassis{command = Command, piece = Piece, world = World} = Chassis) ->
    {Left, Right} = lists:foldl(fun wheels/2, Command, Faults),
    Rate = (Right - Left) / maps:get(axle_mm, maps:get(profile, World)),
    move((Left + Right) / 2, Rate, starl_trajectory:pose(Now, Piece), Now, Chassis).

wheels({_, _, _, wheel_stuck, _, #{wheel := Wheel}}, Speeds) -> slowed(Wheel, 0.0, Speeds);
wheels({_, _, _, wheel_slow, _, #{wheel := Wheel, factor := Factor}}, Speeds) ->
    slowed(Wheel, Factor, Speeds);
wheels({_, _, _, slip, _, #{factor := F}}, {Left, Right}) -> {F * Left, F * Right};
wheels(_, Speeds) -> Speeds.

slowed(left, Factor, {Left, Right}) -> {Factor * Left, Right};
slowed(right, Factor, {Left, Right}) -> {Left, Factor * Right}.

move(Speed, Rate, {X, Y, Heading}, Now, #chassis{piece = Old} = Chassis) when
    Speed == 0, Rate == 0
->
    case starl_trajectory:is_still(Old) of
        true -> {same, Chassis};
        false -> moved(starl_trajectory:standing(Now, {X, Y}, Heading), Chassis)
    end;
move(Speed, Rate, {X, Y, Heading}, Now, Chassis) when Speed == 0 ->
    moved(starl_trajectory:piece(Now, {X, Y}, Heading, 0.0, Rate), Chassis);
move(Speed, Rate, {X, Y, Heading}, Now, #chassis{id = Id, draws = N, world = World} = Chassis) ->
    #{seed := Seed, profile := #{heading_error := Turn, distance_error := Part}} = World,
    Skew = 0.75 * Turn * starl_sim_draw:signed({Seed, Id, N, skew}),
    Slip = 1.0 + Part * starl_sim_draw:signed({Seed, Id, N, slip}),
    Piece = starl_trajectory:piece(Now, {X, Y}, Heading + Skew, Speed * Slip, Rate),
    moved(Piece, Chassis#chassis{draws = N + 1}).

moved(Piece, Chassis) -> {moved, Chassis#chassis{piece = Piece}}.

limit(Speed) -> max(-?MAX_WHEEL, min(?MAX_WHEEL, Speed)).

%% -- positioning ----------------------------------------------------------------------------

%% @doc The poses of these robots, as far as they are seen, now or, others, as of the beginning of
%% the window.
-spec sense([starl:robot_id()], {Now, WindowFrom}, t()) ->
    {[{starl:robot_id(), starl:pose()}], t()}
when
    Now :: starl_sim_queue:time(), WindowFrom :: starl_sim_queue:time().
sense(Robots, When, #chassis{draws = N, world = #{location := []}} = Chassis) ->
    Poses = [{Robot, Pose} || Robot <- Robots, Pose <- see(Robot, When, Chassis)],
    {Poses, Chassis#chassis{draws = N + 1}};
sense(Robots, {Now, _} = When, #chassis{id = Id, draws = N, world = World} = Chassis) ->
    {Poses, Seen} = starl_sim_sense:poses(Robots, #{
        robot => Id,
        faults => starl_sim_fault:holding(Now, maps:get(location, World)),
        key => {maps:get(seed, World), Id, N},
        see => fun(Robot) -> see(Robot, When, Chassis) end,
        seen => Chassis#chassis.seen
    }),
    {Poses, Chassis#chassis{draws = N + 1, seen = Seen}}.

see(Id, {Now, _From}, #chassis{id = Id, piece = Piece} = Chassis) ->
    [blur(Id, starl_trajectory:pose(Now, Piece), Chassis)];
see(Other, {_Now, From}, #chassis{world = #{sight := Sight}} = Chassis) ->
    case starl_sim_sight:piece(Other, Sight) of
        {ok, Piece} -> [blur(Other, starl_trajectory:pose(From, Piece), Chassis)];
        unknown -> []
    end.

%% The positioning system's error: within a disk, and a quarter of the bound on the heading.
blur(Robot, {X, Y, Heading}, #chassis{id = Id, draws = N, world = World}) ->
    #{seed := Seed, profile := Profile} = World,
    #{position_error_mm := Error, heading_error := HeadingError} = Profile,
    Key = {Seed, Id, Robot, N},
    Radius = Error * starl_sim_draw:uniform({Key, radius}),
    Angle = 2 * math:pi() * starl_sim_draw:uniform({Key, angle}),
    Turn = 0.25 * HeadingError * starl_sim_draw:signed({Key, heading}),
    {X + Radius * math:cos(Angle), Y + Radius * math:sin(Angle), Heading + Turn}.
