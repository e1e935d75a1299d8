%% What the interface of the election asks its machine, and what it makes of the answers.
-module(starl_election_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_blocks_driver, [play/2]).

%% Half a minute's patience, or so much; the machine counts in microseconds.
elect_test() ->
    Elect = fun(R) -> starl_election:elect(R, chief) end,
    Asked = [{election, {elect, chief, 30000000}, infinity}],
    [
        ?assertEqual({Asked, Answer}, play(Elect, [{answer, Answer}]))
     || Answer <- [{ok, 7}, {error, timeout}]
    ],
    ?assertEqual({Asked, {error, restarted}}, play(Elect, [restarted])),
    ?assertEqual(
        {[{election, {elect, chief, 5000}, infinity}], {ok, 2}},
        play(fun(R) -> starl_election:elect(R, chief, 5) end, [{answer, {ok, 2}}])
    ).

%% The mistake in a call is told with the function that was called, before anything is asked.
mistake_test() ->
    Robot = starl:robot(1, [1, 2]),
    [
        ?assertError(
            {bad_argument, #{function := {starl_election, elect, 3}, argument := Argument}},
            starl_election:elect(Robot, Election, Ms)
        )
     || {Argument, Election, Ms} <- [{'Ms', chief, 0}, {'Election', self(), 7}]
    ].

block_test() ->
    ?assertEqual([{election, starl_election_ballots, #{}}], starl_election:machines(#{})),
    ?assertEqual([{election, starl_election_bully, #{}}], starl_bully:machines(#{})),
    ?assertEqual(
        [{election, starl_election_bully, #{rounds => 7}}],
        starl_bully:machines(#{rounds => 7, patience_ms => 9})
    ).

declared_test() ->
    ?assertMatch([{patience_ms, {integer, 1, 1000000000}, 600000, _}], starl_election:options()),
    %% a call may last a second longer than its patience
    ?assertEqual(
        [
            {starl_election_monitor, #{
                robots => [1, 2], bound_us => 1007000, again_us => 3000000, complete => true
            }}
        ],
        starl_election:monitors(#{patience_ms => 7}, #{robots => [1, 2]})
    ),
    ?assertEqual(
        [
            {agree, []},
            {announced, [prompt]},
            {ends, [clock_rate, prompt]},
            {elected, [no_loss, alive, {sap, delivered}]}
        ],
        [{Name, Needs} || {Name, _, _, Needs} <- starl_election:guarantees()]
    ),
    ?assert(starl_election_ballots:has_history()),
    #{workload := #{turns := 1}, operations := elections, packets := Packets} =
        starl_election:benchmark(),
    ?assertEqual([2, 50], [Packets(N) || N <- [1, 5]]).

%% The model: all elect once, with one ballot, so the robot's number decides and the last one is no other's
%% like; machines and applications crash; who has a leader keeps it.
model_test() ->
    [{election, _, Model}] = starl_election:models(),
    #{script := Script, inert := Inert} = Made = Model(#{robots => [4, 5, 6]}),
    ?assertMatch(
        #{
            blocks := [{election, starl_election_ballots, #{ballots := 1}}],
            crash := [election, app],
            monitor := {starl_election_monitor, #{robots := [4, 5, 6], bound_us := 1}},
            fixed := [3]
        },
        Made
    ),
    ?assertEqual([{call, election, {elect, first, 30000000}}], Script(4)),
    ?assertEqual(
        [true, false, false], [Inert(leader, {e, 1}), Inert(ballot, {e, 1}), Inert(leader, x)]
    ).
