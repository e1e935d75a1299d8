%% @doc What a simulated robot drives on: how its wheels were told to turn, the piece of motion that
%% it is in ({@link starl_sim_chassis}, faults of actuation), and what the positioning system shows
%% of it and of others ({@link starl_sim_sense}, faults of location).
%%
%% All draws are stateless: a hash of the seed, the robot, a count and a purpose. Other robots are
%% seen as they were at the beginning of the present window (`sight' in the world).
-module(starl_sim_vehicle).

-export([new/3, piece/1, drive/3, turn_wheels/2, stop/2, sense/3]).

-export_type([t/0, change/0]).

-record(vehicle, {
    id :: starl:robot_id(),
    world :: starl_sim_platform:world(),
    piece :: starl_trajectory:piece(),
    %% as last told
    command = {0.0, 0.0} :: starl_sim_chassis:speeds(),
    draws = 0 :: non_neg_integer(),
    %% where robots were last seen, if sight may freeze
    seen = #{} :: #{starl:robot_id() => starl:pose()}
}).

-opaque t() :: #vehicle{}.

%% The vehicle, and whether it is in a new piece of motion.
-type change() :: {moved | same, t()}.

%% @doc A vehicle at rest at a pose.
-spec new(starl:robot_id(), starl:pose(), starl_sim_platform:world()) -> t().
new(Id, {X, Y, Heading}, World) ->
    #vehicle{id = Id, world = World, piece = starl_trajectory:standing(0, {X, Y}, Heading)}.

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#vehicle{piece = Piece}) -> Piece.

%% -- wheels ---------------------------------------------------------------------------------

%% @doc The wheels are told to turn at these speeds.
-spec drive(starl_sim_chassis:speeds(), starl_sim_queue:time(), t()) -> change().
drive({Left, Right}, Now, #vehicle{id = Id, draws = N, world = #{seed := Seed}} = Vehicle) ->
    Faults = held(Now, Vehicle),
    Lost = [
        F
     || {Name, _, _, command_lost, _, #{part := Part}} = F <- Faults,
        starl_sim_draw:uniform({Seed, Id, N, Name}) < Part
    ],
    case Lost of
        [] ->
            Command = starl_sim_chassis:command(Left, Right),
            Told = Vehicle#vehicle{command = Command, draws = N + length(Faults)},
            turn_wheels(Faults, Now, Told);
        [_ | _] ->
            {same, Vehicle#vehicle{draws = N + 1}}
    end.

%% @doc The wheels as they turn from now on, since a fault of theirs begins or ends.
-spec turn_wheels(starl_sim_queue:time(), t()) -> change().
turn_wheels(Now, Vehicle) -> turn_wheels(held(Now, Vehicle), Now, Vehicle).

%% @doc The wheels stop, whatever the faults.
-spec stop(starl_sim_queue:time(), t()) -> change().
stop(Now, Vehicle) -> turn_wheels([], Now, Vehicle#vehicle{command = {0.0, 0.0}}).

held(_Now, #vehicle{world = #{actuation := []}}) ->
    [];
held(Now, #vehicle{id = Id, world = #{actuation := All}}) ->
    [F || F <- starl_sim_fault:holding(Now, All), starl_sim_fault:hits(Id, F)].

turn_wheels(Faults, Now, #vehicle{command = Command, piece = Old, draws = N} = Vehicle) ->
    #vehicle{id = Id, world = #{seed := Seed, profile := Profile}} = Vehicle,
    Speeds = starl_sim_chassis:wheels(Command, Faults),
    case starl_sim_chassis:turn(Speeds, Now, Old, {Seed, Id, N}, Profile) of
        same -> {same, Vehicle};
        {Piece, Draws} -> {moved, Vehicle#vehicle{piece = Piece, draws = N + Draws}}
    end.

%% -- positioning ----------------------------------------------------------------------------

%% @doc The poses of these robots, as far as they are seen, now or, others, as of the beginning of
%% the window.
-spec sense([starl:robot_id()], {Now, WindowFrom}, t()) ->
    {[{starl:robot_id(), starl:pose()}], t()}
when
    Now :: starl_sim_queue:time(), WindowFrom :: starl_sim_queue:time().
sense(Robots, When, #vehicle{draws = N, world = #{location := []}} = Vehicle) ->
    Poses = [{Robot, Pose} || Robot <- Robots, Pose <- see(Robot, When, Vehicle)],
    {Poses, Vehicle#vehicle{draws = N + 1}};
sense(Robots, {Now, _} = When, #vehicle{id = Id, draws = N, world = World} = Vehicle) ->
    {Poses, Seen} = starl_sim_sense:poses(Robots, #{
        robot => Id,
        faults => starl_sim_fault:holding(Now, maps:get(location, World)),
        key => {maps:get(seed, World), Id, N},
        see => fun(Robot) -> see(Robot, When, Vehicle) end,
        seen => Vehicle#vehicle.seen
    }),
    {Poses, Vehicle#vehicle{draws = N + 1, seen = Seen}}.

see(Id, {Now, _From}, #vehicle{id = Id, piece = Piece} = Vehicle) ->
    [blur(Id, starl_trajectory:pose(Now, Piece), Vehicle)];
see(Other, {_Now, From}, #vehicle{world = #{sight := Sight}} = Vehicle) ->
    case starl_sim_sight:piece(Other, Sight) of
        {ok, Piece} -> [blur(Other, starl_trajectory:pose(From, Piece), Vehicle)];
        unknown -> []
    end.

blur(Robot, Pose, #vehicle{id = Id, draws = N, world = #{seed := Seed, profile := Profile}}) ->
    starl_sim_sense:blur(Pose, {Seed, Id, Robot, N}, Profile).
