%% @doc Fits a picture to a floor with walls: finds the parts of its lines that robots can paint.
%% The rest is in a wall, too near to one, or out of reach. Lengths are millimetres.
-module(starl_painting_walls).

-export([fit/3, left_out/1]).

-export_type([lost/0]).

%% The lines that cannot be painted: at walls; those out of reach, with the rooms that they are in.
-type lost() :: #{walls_mm := float(), far_mm := float(), rooms := [atom()]}.

%% A line is looked at in such steps; parts that are shorter than the second are left out.
-define(STEP_MM, 20.0).
-define(SHORTEST_MM, 60.0).

%% @doc The ways of the floor for the lines of a picture, the picture with the lines that robots can paint,
%% and what is lost of it.
-spec fit(starl_picture:t(), starl_floor:t(), starl_dpp_floor:config()) ->
    {ok, starl_dpp_floor:t(), starl_picture:t(), lost()} | {error, unicode:chardata()}.
fit(Picture, Floor, #{wall_mm := Mm} = Config) ->
    Walls = starl_walls:new(Floor),
    All = starl_picture:segments(Picture),
    Free = lists:append([free(Line, Mm, Walls) || Line <- All]),
    case starl_dpp_floor:new(Floor, Config#{lines => Free}) of
        {ok, _, #{reached := []}} ->
            {error,
                "no line of the picture can be painted: all are in walls, too near to them or out of reach"};
        {ok, Ways, #{reached := Reached, lost := Far}} ->
            Lost = #{
                walls_mm => mm(All) - mm(Free),
                far_mm => mm(Far),
                rooms => lists:usort([Room || Line <- Far, Room <- room(Line, Floor)])
            },
            {ok, Ways, starl_picture:only(Reached, Picture), Lost};
        {error, Reason} ->
            {error, starl_dpp_floor:format_error(Reason)}
    end.

mm(Lines) -> lists:sum([0.0 | [starl_geometry:length(Line) || Line <- Lines]]).

room({A, B}, Floor) ->
    case starl_floor:room_at(starl_geometry:interpolate(A, B, 0.5), Floor) of
        {ok, Room} -> [Room];
        none -> []
    end.

%% The parts of a line along which there is room for a robot.
free({A, B} = Line, Mm, Walls) ->
    case starl_walls:is_free(Line, Mm, Walls) of
        true ->
            [Line];
        false ->
            N = ceil(starl_geometry:length(Line) / ?STEP_MM),
            Points = [starl_geometry:interpolate(A, B, I / N) || I <- lists:seq(0, N)],
            Steps = lists:zip(lists:droplast(Points), tl(Points)),
            [
                Part
             || Part <- joined([S || S <- Steps, starl_walls:is_free(S, Mm, Walls)]),
                starl_geometry:length(Part) >= ?SHORTEST_MM
            ]
    end.

joined([{A, B}, {B, C} | Steps]) -> joined([{A, C} | Steps]);
joined([Step | Steps]) -> [Step | joined(Steps)];
joined([]) -> [].

%% @doc The text on what is left out, in one line or none.
-spec left_out(lost() | none) -> [unicode:chardata()].
left_out(none) ->
    [];
left_out(#{walls_mm := Walls, far_mm := Far, rooms := Rooms}) ->
    Parts =
        [[metres(Walls), " m in walls or too near to them"] || Walls >= 1] ++
            [[metres(Far), " m out of reach", rooms(Rooms)] || Far >= 1],
    [["cannot be painted: ", lists:join("; ", Parts)] || Parts =/= []].

rooms([]) -> "";
rooms(Rooms) -> [", in ", lists:join(", ", [atom_to_list(Room) || Room <- Rooms])].

metres(Mm) -> float_to_list(Mm / 1000, [{decimals, 1}]).
