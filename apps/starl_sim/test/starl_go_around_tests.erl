%% Robots that drive around walls: they arrive without touching anything, or say why they do not.
-module(starl_go_around_tests).
-include_lib("eunit/include/eunit.hrl").

%% Violations of contracts, and what the robot says of its errands.
played(Scenario) ->
    {ok, Sim} = starl_sim:start(
        maps:merge(#{app => starl_errand, robots => 1, time => 120}, Scenario)
    ),
    _ = starl_sim:run(Sim),
    {#{violations := Violations, robots := [{1, #{result := Result, pose := Pose}}]}, _} =
        starl_sim:finish(Sim),
    {Violations, Result, Pose}.

it_drives_to_the_other_room_and_back_test_() ->
    {timeout, 60, [
        fun() ->
            {[], {done, [ok, ok]}, {X, Y, _}} = played(#{
                errands => [east, {600, 2500}], seed => Seed, position_error => Error
            }),
            ?assert(starl_geometry:distance({X, Y}, {600, 2500}) < 30.0)
        end
     || Seed <- lists:seq(1, 10), Error <- [0, 5]
    ]}.

who_cannot_get_there_says_so_at_once_test() ->
    {[], {done, [{error, unreachable}]}, {X, Y, _}} = played(#{errands => [closet]}),
    ?assertEqual({600.0, 500.0}, {X, Y}),
    ?assertMatch(
        {[], {done, [{error, unreachable}]}, _}, played(#{errands => [east], door_mm => 300})
    ),
    ?assertMatch({[], {done, [{error, unknown}]}, _}, played(#{errands => [nowhere]})).

%% The plan shows an open door; it is shut for two minutes. `go_to' would push for ever.
a_closed_door_blocks_test() ->
    Shut = {shut, 0, 119000, closed, all, #{door => 1}},
    ?assertMatch(
        {[], {done, [{error, blocked}]}, _}, played(#{errands => [east], faults => [Shut]})
    ).

%% The floor of a run without a plan has no walls, nor a border.
without_a_plan_it_goes_straight_test() ->
    Play = #{errands => [{3000, 2000}, {-500, -500}], walls => false},
    ?assertMatch({[], {done, [ok, ok]}, _}, played(Play)).
