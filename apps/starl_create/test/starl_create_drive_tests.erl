%% The driver drives an emulated Create over a line, in virtual time.
-module(starl_create_drive_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

ready(Options) ->
    starl_create_bench:until(fun is_ready/1, 10 * ?S, starl_create_bench:new(Options)).

is_ready(Bench) -> starl_create_driver:is_ready(starl_create_bench:driver(Bench)).

both_models_come_under_control_test() ->
    [
        begin
            Bench = ready(#{model => Model, latency => Latency}),
            ?assertEqual([], starl_create_bench:said(Bench)),
            ?assertEqual(safe, starl_create_emulator:mode(starl_create_bench:create(Bench)))
        end
     || Model <- [1, 2], Latency <- [{0, 0}, {0, 20000}]
    ].

%% -- legs -----------------------------------------------------------------------------------

legs_test_() ->
    [
        {
            lists:flatten(io_lib:format("create ~b, latency ~b ms", [Model, Ms])),
            {timeout, 120, fun() ->
                legs(Model, Ms, 250)
            end}
        }
     || Model <- [1, 2], Ms <- [0, 20]
    ].

legs(Model, Ms, N) -> legs(Model, Ms, N, starl_platform_ct:seed()).

%% With this seed a command at 500 mm/s over a late line ended more than r(v) off.
a_late_line_ends_no_leg_too_far_test_() ->
    {timeout, 60, fun() -> legs(2, 20, 250, 5) end}.

legs(Model, Ms, N, Seed) ->
    Bench = ready(#{model => Model, latency => {0, 1000 * Ms}, seed => Seed}),
    {Worst, _, _} = lists:foldl(
        fun leg/2, {{0.0, 0.0}, rand:seed_s(exsss, Seed), Bench}, lists:seq(1, N)
    ),
    io:format(
        "create ~b, latency ~b ms: ~b legs, at most ~.1f mm off the line, ~.1f off its end, "
        "r(v) ~.1f",
        [
            Model,
            Ms,
            N,
            element(1, Worst),
            element(2, Worst),
            starl_chassis:tracking_radius(starl_create_bench:profile(Model))
        ]
    ).

%% From where it stands to a point 20 to 1500 mm away.
leg(_, {Worst, Random0, Bench}) ->
    {A, Random1} = rand:uniform_s(Random0),
    {B, Random2} = rand:uniform_s(Random1),
    {X, Y, _} = starl_create_bench:pose(Bench),
    Length = 20 + 1480 * A,
    Angle = 2 * math:pi() * B,
    Line = {{X, Y}, {X + Length * math:cos(Angle), Y + Length * math:sin(Angle)}},
    {Off, Arrived} = follow(Line, none, 0.0, 60, Bench),
    {PX, PY, _} = starl_create_bench:pose(Arrived),
    End = starl_geometry:distance({PX, PY}, element(2, Line)),
    Radius = starl_chassis:tracking_radius(starl_create_bench:profile(x)),
    ?assert(Off =< Radius),
    ?assert(End =< Radius),
    {WorstOff, WorstEnd} = Worst,
    {{max(WorstOff, Off), max(WorstEnd, End)}, Random2, Arrived}.

%% What starl_motion does with its chassis: looks, and drives the next step.
follow(_Line, _Memo, _Off, 0, _Bench) ->
    error(never_arrives);
follow(Line, Memo, Off, N, Bench) ->
    Profile = starl_create_bench:profile(x),
    Pose = starl_create_bench:pose(Bench),
    Step =
        case Memo of
            none -> starl_chassis_differential:next(to, Pose, Line, Profile);
            _ -> starl_chassis_differential:resume(Pose, Memo, Profile)
        end,
    case Step of
        arrived -> {Off, Bench};
        {drive, Commands} -> follow(Line, none, Off, N - 1, driven(Commands, Bench), Line);
        {{look, Leg}, Commands} -> follow(Line, Leg, Off, N - 1, driven(Commands, Bench), Line)
    end.

follow(Line, Memo, Off, N, Bench, Line) ->
    {X, Y, _} = starl_create_bench:pose(Bench),
    Now = starl_geometry:distance({X, Y}, starl_geometry:closest_point({X, Y}, Line)),
    follow(Line, Memo, max(Off, Now), N, Bench).

%% Carries out a script, and waits until the robot stands.
driven(Commands, Bench0) ->
    Mark = make_ref(),
    Bench = starl_create_bench:drive({Commands, Mark}, Bench0),
    Answered = starl_create_bench:until(
        fun(B) -> lists:keymember(Mark, 2, starl_create_bench:answers(B)) end, 5 * ?S, Bench
    ),
    {_, Mark, {driven, _}} = lists:keyfind(Mark, 2, starl_create_bench:answers(Answered)),
    starl_create_bench:until(
        fun(B) -> starl_create_bench:wheels(B) == {0.0, 0.0} end, ?S, Answered
    ).
