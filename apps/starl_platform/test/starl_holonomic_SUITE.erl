%% The course of a robot that drives in any direction, in a closed loop with a body and a positioning
%% system whose errors are bounded as the profile says, at random and at the worst: it stays within
%% r(v) of its line, arrives, and begins and ends a given line as exactly as promised.
-module(starl_holonomic_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    stays_near_the_line_and_arrives/1,
    draws_lines_from_end_to_end/1,
    the_worst_errors/1,
    far_off_the_line/1,
    tells_no_more_than_its_limits/1,
    scripts_and_tries/1
]).

all() ->
    [
        stays_near_the_line_and_arrives,
        draws_lines_from_end_to_end,
        the_worst_errors,
        far_off_the_line,
        tells_no_more_than_its_limits,
        scripts_and_tries
    ].

stays_near_the_line_and_arrives(_) ->
    Prop = ?FORALL(
        {Seed, Goal, Profile},
        {choose(1, 1000000), goal(), profile()},
        starl_platform_ct:safely(fun() -> arrives(uniform(Seed), Goal, Profile) end)
    ),
    starl_platform_ct:property(Prop, 400),
    %% a robot off its line was told a leg a little longer than the bound allows
    ?assert(
        arrives(
            uniform(35552),
            {4749.0, -4000.0},
            profile(#{
                speed => 50.0,
                acceleration => 9000.0,
                leg_s => 0.3,
                heading_error => 0.05,
                distance_error => 0.01,
                position_error_mm => 0.0
            })
        )
    ).

%% To where a line begins, to its very beginning, along it to its end; one line after the other.
draws_lines_from_end_to_end(_) ->
    Prop = ?FORALL(
        {Seed, Lines, Profile},
        {choose(1, 1000000), vector(5, stroke()), profile()},
        starl_platform_ct:safely(fun() -> drawn(Lines, {0.0, 0.0, 0.7}, uniform(Seed), Profile) end)
    ),
    starl_platform_ct:property(Prop, 200),
    %% a leg may come out longer than it was told, and is farther off then
    Short = {{0.0, 0.0}, {1.0, 0.0}},
    Long = {{-733.0, -537.0}, {-1425.994747620312, -438.215994358093}},
    ?assert(
        drawn(
            [Short, Short, Short, Long, Short],
            {0.0, 0.0, 0.7},
            uniform(37),
            profile(#{
                speed => 50.0,
                acceleration => 100.0,
                leg_s => 0.3,
                heading_error => 0.05,
                position_error_mm => 0.0
            })
        )
    ),
    %% where legs are short, the last one of a line was half as long again, and drove too far
    ?assert(
        drawn(
            [Short, Short, {{-5.0, 7.0}, {7.764798345845181, -36.15159235984123}}],
            {0.0, 0.0, 0.7},
            uniform(1),
            profile(#{
                speed => 350.0,
                acceleration => 100.0,
                leg_s => 0.1,
                heading_error => 0.0,
                distance_error => 0.05,
                position_error_mm => 0.0
            })
        )
    ).

%% All errors at their bounds, to the left, to the right and to and fro.
the_worst_errors(_) ->
    Zigzag = fun(Key) -> 2.0 * erlang:phash2(Key, 2) - 1.0 end,
    Short = [{{10.0 * N, 7.0 * N}, {10.0 * N + 6.0, 7.0 * N}} || N <- lists:seq(0, 20)],
    [
        begin
            Profile = profile(#{speed => Speed}),
            ?assert(arrives(Noise, Goal, Profile)),
            ?assert(drawn(Short ++ [{{0.0, 0.0}, Goal}], {0.0, 0.0, 2.0}, Noise, Profile))
        end
     || Noise <- [fun(_) -> 1.0 end, fun(_) -> -1.0 end, Zigzag],
        Goal <- [{5000.0, 0.0}, {-3000.0, 4000.0}, {10.0, -8000.0}],
        Speed <- [100.0, 500.0]
    ].

%% One that finds itself far off, as by another one's position, goes straight back, but not all the
%% way without a look; one that is hardly off goes on along its line.
far_off_the_line(_) ->
    Profile = profile(#{}),
    Line = {{0.0, 0.0}, {5000.0, 0.0}},
    Step = fun(Y) ->
        {drive, [{F, L, Us}]} = starl_chassis_holonomic:next(
            along, {1000.0, Y, 0.0}, Line, Profile
        ),
        {F * Us / 1.0e6, L * Us / 1.0e6}
    end,
    {Fx, Fy} = Step(3000.0),
    ?assert(abs(Fx) < 1.0e-3 andalso abs(Fy + 145.0) < 1.0, {Fx, Fy}),
    {Bx, By} = Step(30.0),
    ?assert(abs(Bx) < 1.0e-3 andalso abs(By + 30.0) < 0.1, {Bx, By}),
    {Nx, Ny} = Step(3.0),
    ?assert(Nx > 200.0 andalso abs(Ny + 3.0) < 0.1, {Nx, Ny}).

tells_no_more_than_its_limits(_) ->
    Prop = ?FORALL(
        {X, Y, Goal, Way, #{speed := Speed} = Profile},
        {choose(-3000, 3000), choose(-3000, 3000), goal(), oneof([to, along, face]), profile()},
        starl_platform_ct:safely(fun() ->
            Pose = {float(X), float(Y), 1.0},
            case starl_chassis_holonomic:next(Way, Pose, {{0.0, 0.0}, Goal}, Profile) of
                arrived ->
                    true;
                {drive, Script} ->
                    {Least, Most} = starl_chassis_holonomic:duration_us(Script, Profile),
                    ok =:= starl_chassis_holonomic:check(Script) andalso Least =< Most andalso
                        lists:all(
                            fun({F, L, _}) -> math:sqrt(F * F + L * L) =< Speed + 1.0e-9 end, Script
                        )
            end
        end)
    ),
    starl_platform_ct:property(Prop, 300).

scripts_and_tries(_) ->
    Check = fun starl_chassis_holonomic:check/1,
    ?assertEqual([ok, ok], [Check(S) || S <- [[], [{-500, 500.0, 15000}]]]),
    [
        ?assertMatch({error, _}, Check(S))
     || S <- [stop, [{fast, 0.0, 5}], [{1.0e300, 0.0, 5}], [{1.0, 1.0, 0}], [{1.0, 1.0, 5} | x]]
    ],
    ?assertEqual(none, starl_chassis_holonomic:undo({0, -0.0})),
    ?assertEqual(unknown, starl_chassis_holonomic:undo({fast, 0.0})),
    ?assertEqual({ok, [{-6.0, 8.0, 20000}]}, starl_chassis_holonomic:undo({300.0, -400.0})),
    ?assertEqual({ok, [{-3.0, 4.0, 20000}]}, starl_chassis_holonomic:undo({3.0, -4.0})),
    ?assertEqual({300.0, 1.0}, starl_chassis_holonomic:last([{1.0, 1.0, 5}, {300.0, 1.0, 7}])).

%% -- the loop -------------------------------------------------------------------------------

%% What it does at a way: where it stands in the end, and how far it was from the line.
follow(Way, Pose, Line, Noise, Profile) -> follow(Way, Pose, Line, Noise, Profile, 1, 0.0).

follow(Way, {X, Y, _} = Pose, Line, Noise, Profile, N, Off) when N < 3000 ->
    Furthest = max(Off, starl_geometry:point_segment({X, Y}, Line)),
    case
        starl_chassis_holonomic:next(
            Way, blurred(Pose, {Way, Line, N}, Noise, Profile), Line, Profile
        )
    of
        arrived ->
            {Pose, Furthest};
        {drive, [{F, L, Us}]} ->
            Next = moved(Pose, {F, L}, Us / 1.0e6, {Way, Line, N}, Noise, Profile),
            follow(Way, Next, Line, Noise, Profile, N + 1, Furthest)
    end.

%% The path is straight, so that its ends tell how far off it is.
moved({X, Y, Heading}, {F, L}, S, Key, Noise, Profile) ->
    #{heading_error := Turn, distance_error := Part} = Profile,
    Towards = Heading + 0.75 * Turn * Noise({Key, skew}),
    Mm = S * (1.0 + Part * Noise({Key, slip})),
    {
        X + Mm * (F * math:cos(Towards) - L * math:sin(Towards)),
        Y + Mm * (F * math:sin(Towards) + L * math:cos(Towards)),
        Heading
    }.

blurred({X, Y, Heading}, Key, Noise, #{heading_error := Turn, position_error_mm := Error}) ->
    Angle = math:pi() * Noise({Key, angle}),
    Radius = Error * abs(Noise({Key, radius})),
    {
        X + Radius * math:cos(Angle),
        Y + Radius * math:sin(Angle),
        Heading + 0.25 * Turn * Noise({Key, heading})
    }.

arrives(Noise, Goal, #{goal_mm := Enough, position_error_mm := Error} = Profile) ->
    {{X, Y, _}, Off} = follow(to, {0.0, 0.0, 0.3}, {{0.0, 0.0}, Goal}, Noise, Profile),
    Left = starl_geometry:distance({X, Y}, Goal),
    good(Left =< Enough + Error andalso Off =< room(Profile), {Goal, Left, Off, Profile}).

drawn([], _Pose, _Noise, _Profile) ->
    true;
drawn([{Start, Goal} = Line | Lines], {X, Y, _} = Pose, Noise, Profile) ->
    {There, _} = follow(along, Pose, {{X, Y}, Start}, Noise, Profile),
    {Begun, _} = follow(face, There, Line, Noise, Profile),
    {Ended, Off} = follow(along, Begun, Line, Noise, Profile),
    Ends = starl_chassis:ends_mm(Profile) + 1.0e-6,
    Towards = starl_geometry:heading(Start, Goal),
    Along = [along(Begun, Start, Towards), along(Ended, Goal, Towards)],
    good(
        Off =< room(Profile) andalso lists:all(fun(Mm) -> abs(Mm) =< Ends end, Along),
        {Line, Off, Along, Profile}
    ) andalso drawn(Lines, Ended, Noise, Profile).

%% Nothing fails here: what is kept for that may not be needed.
room(#{goal_mm := Enough, position_error_mm := Error}) -> Enough + Error + 1.0e-6.

along({X, Y, _}, {X0, Y0}, Heading) -> (X - X0) * math:cos(Heading) + (Y - Y0) * math:sin(Heading).

good(true, _What) ->
    true;
good(false, What) ->
    ct:log("~p", [What]),
    false.

uniform(Seed) -> fun(Key) -> 2.0 * erlang:phash2({Seed, Key}, 1 bsl 27) / (1 bsl 27) - 1.0 end.

goal() -> ?LET({X, Y}, {choose(-9000, 9000), choose(-9000, 9000)}, {float(X), float(Y)}).

stroke() ->
    ?LET(
        {X, Y, Length, Turn},
        {
            choose(-3000, 3000),
            choose(-3000, 3000),
            oneof([1, 3, 6, 7, 20, 45, 100, 300, 700]),
            choose(0, 6)
        },
        {{float(X), float(Y)}, {X + Length * math:cos(Turn), Y + Length * math:sin(Turn)}}
    ).

profile(Overrides) -> starl_chassis:profile(starl_chassis_holonomic, Overrides).

profile() ->
    ?LET(
        {Speed, Acceleration, LegS, Heading, Part, Position},
        {
            oneof([50.0, 200.0, 350.0, 500.0]),
            oneof([100.0, 500.0, 2000.0, 9000.0]),
            oneof([0.1, 0.3, 0.7]),
            oneof([0.0, 0.01, 0.05]),
            oneof([0.0, 0.01, 0.05]),
            oneof([0.0, 1.0, 5.0])
        },
        profile(#{
            speed => Speed,
            acceleration => Acceleration,
            leg_s => LegS,
            heading_error => Heading,
            distance_error => Part,
            position_error_mm => Position
        })
    ).
