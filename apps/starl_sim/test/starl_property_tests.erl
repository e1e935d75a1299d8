%% Generators of scenarios and faults, and what holds.
-module(starl_property_tests).
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_app).
-export([options/0, init/2, step/2]).

%% -- an application that crashes where it hears nothing ------------------------------------------

options() ->
    [
        {patience, {integer, 1, 100}, 60, "seconds"},
        {gain, {number, -1, 1}, 0.5, "nothing"},
        {pair, {between, {number, 1, 9}}, {1, 2}, "nothing"},
        {some, {optional, {integer, 3, 5}}, none, "nothing"},
        {what, {one_of, [a, b]}, a, "nothing"},
        {text, string, "x", "nothing"}
    ].

init(Robot, #{patience := Seconds}) ->
    starl:listen(Robot, hello),
    Seconds.

step(Robot, Seconds) ->
    starl:broadcast(Robot, hello, #{}),
    case length(starl:participants(Robot)) of
        1 -> {done, alone};
        _ -> {done, element(1, {ok, _, _} = starl:await(Robot, hello, 1000 * Seconds))}
    end.

%% -- faults ----------------------------------------------------------------------------------------

%% Faults of all kinds are well formed, fit their team, and are over in time.
faults_test() ->
    [
        starl_platform_ct:property(
            ?FORALL(
                Faults,
                starl_property:faults([all], #{app => ?MODULE, robots => Robots, heal => 30}),
                begin
                    Problems = starl_run_fault:check(Faults),
                    Targets = lists:append([starl_run_fault:targets(F) || F <- Faults]),
                    Problems =:= [] andalso length(Faults) =< 6 andalso
                        lists:all(fun(R) -> R =< Robots end, Targets) andalso
                        lists:all(fun(F) -> element(3, F) =< 30000 end, Faults)
                end
            ),
            100
        )
     || Robots <- [1, 2, 3, 7]
    ].

%% All kinds are drawn, but those of a floor plan, and that of two robots in a team of one.
all_kinds_test() ->
    Drawn = fun(Robots) ->
        Generator = starl_property:faults([all], #{app => ?MODULE, robots => Robots}),
        [
            K
         || _ <- lists:seq(1, 1000),
            {ok, Fs} <- [proper_gen:pick(Generator)],
            {_, _, _, K, _, _} <- Fs
        ]
    end,
    Kinds = lists:usort([Kind || {Kind, C, _, _, _} <- starl_run_fault:kinds(), C =/= floor]),
    ?assertEqual(Kinds, lists:usort(Drawn(3))),
    ?assertEqual(Kinds -- [location_swap], lists:usort(Drawn(1))).

%% -- scenarios -------------------------------------------------------------------------------------

%% A scenario can be run as it is drawn; what is varied lies in its range.
scenario_test() ->
    Team = #{
        app => ?MODULE,
        robots => {2, 4},
        random_faults => [network],
        most_faults => 2,
        vary => [patience, gain, pair, some, what, loss],
        speed => proper_types:oneof([100, 200]),
        text => "y"
    },
    starl_platform_ct:property(
        ?FORALL(
            #{robots := Robots, faults := Faults, speed := Speed, text := Text} = Scenario,
            starl_property:scenario(Team),
            Robots >= 2 andalso Robots =< 4 andalso length(Faults) =< 2 andalso
                lists:member(Speed, [100, 200]) andalso Text =:= "y" andalso
                element(1, starl_run_scenario:check(Scenario, options())) =:= ok
        ),
        100
    ).

seeds_differ_test() ->
    Generator = starl_property:scenario(#{app => ?MODULE}),
    Seeds = [S || _ <- lists:seq(1, 20), {ok, #{seed := S}} <- [proper_gen:pick(Generator)]],
    ?assertEqual(20, length(lists:usort(Seeds))).

%% -- properties ------------------------------------------------------------------------------------

a_sound_property_test() ->
    ?assert(quietly(#{app => ?MODULE, robots => {1, 3}}, #{complete => true})).

%% The application crashes where nothing is heard. Nothing is needed for that but the loss.
a_crash_is_found_and_shrunk_test() ->
    Dir = dir("crash"),
    Team = #{
        app => ?MODULE,
        robots => {1, 5},
        loss => 1.0,
        random_faults => [all],
        patience => 1,
        time => 60
    },
    ?assertNot(quietly(Team, #{dir => Dir})),
    ?assert(quietly(Team, #{dir => Dir, crashes => true})),
    {ok, [Left]} = file:consult(filename:join(Dir, hd(filelib:wildcard("*.term", Dir)))),
    ?assertMatch(#{app := ?MODULE, robots := 2, loss := 1.0}, Left),
    ?assertEqual([], maps:get(faults, Left, [])).

%% What is demanded of the outcome.
an_outcome_is_refused_test() ->
    Team = #{app => ?MODULE, robots => 2},
    Few = fun(#{events := Events}) -> Events < 3 end,
    ?assertNot(quietly(Team, #{dir => dir("outcome"), outcome => Few})).

%% An application that is not done when its time is up.
incomplete_test() ->
    Team = #{app => ?MODULE, robots => 2, loss => 1.0, time => 5},
    ?assertNot(quietly(Team, #{dir => dir("incomplete"), complete => true, crashes => true})),
    ?assert(quietly(Team, #{crashes => true})).

%% A failing case has thousands of neighbours that hold: PropEr does not try them all.
shrinking_ends_test_() ->
    {timeout, 300, fun() ->
        Runs = counters:new(1, []),
        Few = fun(#{scenario := #{faults := Faults, loss := Loss}}) ->
            ok = counters:add(Runs, 1, 1),
            length(Faults) < 4 orelse Loss < 0.3
        end,
        Team = #{app => ?MODULE, robots => {1, 2}, random_faults => [all], vary => [loss]},
        Demand = #{dir => dir("shrinking"), crashes => true, outcome => Few},
        ?assertNot(quietly(Team, Demand, 100)),
        ?assert(counters:get(Runs, 1) =< 100 + 300 + 1, counters:get(Runs, 1))
    end}.

quietly(Team, Demand) -> quietly(Team, Demand, 5).

quietly(Team, Demand, Cases) ->
    Property = ?FORALL(S, starl_property:scenario(Team), starl_property:holds(S, Demand)),
    starl_property:quickcheck(Property, #{cases => Cases}).

dir(Name) ->
    Dir = filename:join(["_build", "test", "starl_property", Name]),
    _ = file:del_dir_r(Dir),
    Dir.
