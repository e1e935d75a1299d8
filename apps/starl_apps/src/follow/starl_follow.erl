%% @doc Follow the leader: one robot drives round a course, and the others follow it in a column,
%% each at its own distance. When the leader dies, another robot leads ({@link starl_leadership}).
%% With every heartbeat the leader sends where it is and to which corner it drives.
%%
%% Measure: `error_mm', the distance of a follower from its place in the column. Trace:
%% {@link starl_leadership:event()} (see {@link starl_follow_monitor}).
-module(starl_follow).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, blocks/0, monitors/1, guarantees/0, measures/0, report/2, knows_walls/0]).
-export([rank/3]).

%% `goals': a leader's corners. `goal': the corner to which the leader drives. `trails': where the present one
%% was, the latest first, to where the robot was when it began to follow it.
-type state() :: #{
    team := starl_leadership:t(),
    until := integer(),
    gap := number(),
    goals => [starl_geometry:point(), ...],
    goal => starl_geometry:point(),
    trails := #{starl_leadership:leader() => [starl_geometry:point(), ...]}
}.

-define(SPEED, 200).
-define(FASTEST, 350).
%% From where a robot avoids another (mm).
-define(SHY_MM, 700).

%% A corner of the course is passed at this distance (mm).
-define(NEAR_MM, 200).

-spec options() -> [starl_options:option()].
options() ->
    [
        {gap, {number, 400, 5000}, 700,
            "the distance of one robot from the next along the trail, mm"},
        {duration, {integer, 1, 86400}, 60, "how long they drive, s"}
    ].

-spec blocks() -> [starl_block:entry()].
blocks() -> [starl_bully].

-spec monitors(starl_scene:context()) -> [{module(), map()}].
monitors(#{robots := Ids}) -> [{starl_follow_monitor, #{robots => Ids}}].

-spec measures() -> [{atom(), string()}].
measures() -> [{error_mm, "distance from the place in the column, mm"}].

%% @doc Robots drive as if the floor were free.
-spec knows_walls() -> false.
knows_walls() -> false.

%% @doc What a team that follows may rely on.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {onwards, safety, "a robot never turns from a later term to an earlier one in one life",
            []},
        {led, progress, "while robots live one of them leads: at most a minute without a leader", [
            delivery, quick
        ]}
    ].

-spec init(starl:robot(), map()) -> state().
init(Robot, #{gap := Gap, duration := Seconds}) ->
    Team = starl_leadership:new(Robot),
    #{team => Team, gap => Gap, until => starl:now(Robot) + 1000 * Seconds, trails => #{}}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, starl_leadership:term_no()}.
step(Robot, #{team := Team, until := Until} = State) ->
    case starl:now(Robot) >= Until of
        true ->
            _ = starl:stop(Robot),
            {Term, _} = starl_leadership:leader(Team),
            {done, Term};
        false ->
            {continue, act(starl_leadership:turn(Robot, Team), Robot, State)}
    end.

act({elected, Team}, Robot, State) ->
    State#{team := Team, goals => course(Robot, State)};
act({leads, Team}, Robot, State) ->
    Next = lead(Robot, State#{team := Team}),
    act(starl_leadership:listen(Robot, Team), Robot, Next);
act({heard, {At, Goal}, Team}, Robot, State) ->
    behind(Robot, At, State#{team := Team, goal => Goal});
act({nothing, Team}, _Robot, State) ->
    State#{team := Team}.

lead(Robot, #{team := Team, goals := [Goal | _] = Goals} = State) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            ok = starl_leadership:beat(Robot, {{X, Y}, Goal}, Team),
            ok = starl_leadership:draw(Robot, {X + 250, Y + 250}, Team),
            _ = drive(Robot, Goal, ?SPEED, State),
            State#{goals := passed({X, Y}, Goals)};
        {error, _} ->
            State
    end.

%% Drives to the place on the trail that is as far behind the leader as the robot's rank says. The place goes on, and within a second's way of its
%% goal a robot drives slower: so it aims at where its place will be in a second.
behind(Robot, At, #{team := Team, gap := Gap, trails := Trails} = State) ->
    {_, Id} = Leader = starl_leadership:leader(Team),
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            Trail = [At | maps:get(Leader, Trails, [{X, Y}])],
            Back =
                Gap * rank(starl:id(Robot), Id, starl:participants(Robot)),
            {Place, Kept} = along(Trail, Back),
            ok = starl:measure(Robot, error_mm, starl_geometry:distance({X, Y}, Place)),
            ok = starl:draw(Robot, #{key => way, line => [{X, Y}, Place], seconds => 1}),
            {Aim, _} = along(Trail, Back - in_a_second(Trail)),
            _ = drive(Robot, Aim, ?FASTEST, State),
            State#{trails := #{Leader => Kept}};
        {error, _} ->
            State
    end.

%% As from the leader's last beat to this one: nothing when it stands.
in_a_second([At, Before | _]) ->
    min(?SPEED, starl_geometry:distance(At, Before) * 1000 / starl_leadership:beat_ms()).

drive(Robot, Goal, Speed, #{gap := Gap}) ->
    Shy = min(?SHY_MM, 0.8 * Gap),
    Ms = 3 * starl_leadership:beat_ms(),
    starl_avoidance:drive(Robot, Goal, #{speed => Speed, shy_mm => Shy, ms => Ms}).

%% It goes on with the corner to which the leader before drove, or begins at the nearest.
course(Robot, State) ->
    case {starl:floor(Robot), starl:position(Robot)} of
        {{ok, #{size := Size}}, {ok, {X, Y, _}}} ->
            Corners = corners(Size),
            Shape = #{key => course, line => Corners ++ [hd(Corners)], colour => grey},
            ok = starl:draw(Robot, Shape),
            nearest_first(maps:get(goal, State, {X, Y}), Corners);
        _ ->
            ok = starl:sleep(Robot, starl_leadership:beat_ms()),
            course(Robot, State)
    end.

%% -- the report -----------------------------------------------------------------------------

%% @doc How many robots have led, and the longest time without a leader.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{monitors := #{starl_follow_monitor := #{leaders := N, longest_us := Us}}}) ->
    Label = "longest time without a leader, s",
    #{
        figures => [{leaders, N}, {leaderless_s, Us / 1.0e6}],
        formats => #{leaderless_s => #{decimals => 1, label => Label, plotted => true}},
        done => io_lib:format("leaders: ~b, at most ~.1f s without one", [N, Us / 1.0e6])
    }.

%% -- the course -------------------------------------------------------------------------------

%% The course of a leader, and the trail that it leaves for its followers; lengths are millimetres.

%% The corners of the course on a floor of this size.
-spec corners({WidthMm :: number(), HeightMm :: number()}) -> [starl_geometry:point(), ...].
corners({W, H}) ->
    [{0.2 * W, 0.2 * H}, {0.8 * W, 0.2 * H}, {0.8 * W, 0.8 * H}, {0.2 * W, 0.8 * H}].

%% The corners, that which is nearest to a point first.
-spec nearest_first(starl_geometry:point(), Corners) -> Corners when
    Corners :: [starl_geometry:point(), ...].
nearest_first(Point, Corners) ->
    {_, First} = lists:min([{starl_geometry:distance(Point, C), C} || C <- Corners]),
    {Before, After} = lists:splitwith(fun(C) -> C =/= First end, Corners),
    After ++ Before.

%% The corners from now on, the next one first, of a leader that is here.
-spec passed(starl_geometry:point(), Corners) -> Corners when
    Corners :: [starl_geometry:point(), ...].
passed(Point, [Corner | Corners]) ->
    case starl_geometry:distance(Point, Corner) < ?NEAR_MM of
        true -> Corners ++ [Corner];
        false -> [Corner | Corners]
    end.

%% @doc The place of a robot in the column, 1 behind the leader. The robot with the highest number
%% below the leader's comes first, because it would lead next. Robots above the leader come last:
%% they have died and may be back.
-spec rank(starl:robot_id(), Leader :: starl:robot_id(), [starl:robot_id(), ...]) -> pos_integer().
rank(Id, Leader, Ids) when Id < Leader -> 1 + length([R || R <- Ids, R > Id, R < Leader]);
rank(Id, Leader, Ids) -> 1 + length([R || R <- Ids, R < Leader orelse R > Id]).

%% The point of a trail at this distance from its beginning, or its end if it is shorter; and the trail up
%% to there.
-spec along(Trail, Mm :: number()) -> {starl_geometry:point(), Trail} when
    Trail :: [starl_geometry:point(), ...].
along(Trail, Mm) -> along(Trail, Mm, []).

along([Last], _Mm, Before) ->
    {Last, lists:reverse(Before, [Last])};
along([A, B | Trail], Mm, Before) ->
    case starl_geometry:distance(A, B) of
        D when D >= Mm, D > 0 ->
            {starl_geometry:interpolate(A, B, Mm / D), lists:reverse(Before, [A, B])};
        D ->
            along([B | Trail], Mm - D, [A | Before])
    end.
