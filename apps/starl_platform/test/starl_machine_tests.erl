%% The runner of machines: gen_statem's vocabulary, without a process.
-module(starl_machine_tests).
-behaviour(starl_machine).
-include_lib("eunit/include/eunit.hrl").

-export([init/1, handle_event/5]).

%% A machine of its own: the event is the result.
init(#{first := First} = Config) -> {First, maps:get(robot, Config), [{trace, begun}]}.

handle_event(cast, Result, _State, _Data, #{now := 5, robot := 1}) -> Result;
handle_event(_, _, _, _, _) -> unknown_event.

starts_with_its_actions_test() ->
    {Actions, M} = new(),
    ?assertEqual([{trace, begun}], Actions),
    ?assertEqual({?MODULE, one, 1}, {
        starl_machine:module(M), starl_machine:state(M), starl_machine:data(M)
    }).

%% What the platform says of the robot stands above the machine's own configuration.
platform_configuration_wins_test() ->
    {_, M} = starl_machine:new(?MODULE, #{first => one, robot => 9}, base()),
    ?assertEqual(1, starl_machine:data(M)).

results_test_() ->
    Act = [{trace, x}],
    [
        ?_assertEqual({R, Expected}, {R, told(cast, R)})
     || {R, Expected} <- [
            {keep_state_and_data, {[], one, 1}},
            {{keep_state_and_data, Act}, {Act, one, 1}},
            {{keep_state, 2}, {[], one, 2}},
            {{keep_state, 2, Act}, {Act, one, 2}},
            {{next_state, one, 2}, {[], one, 2}},
            {{next_state, one, 2, Act}, {Act, one, 2}}
        ]
    ].

%% As in gen_statem, a state time-out does not outlive its state; one that is set with the change
%% comes after the cancellation.
state_timeout_is_cancelled_on_a_change_test() ->
    Set = [{state_timeout, 10, x}],
    ?assertEqual({[{state_timeout, cancel}], two, 2}, told(cast, {next_state, two, 2})),
    ?assertEqual({[{state_timeout, cancel} | Set], two, 2}, told(cast, {next_state, two, 2, Set})),
    ?assertEqual({Set, one, 2}, told(cast, {next_state, one, 2, Set})).

%% An unknown event is never fatal and never silent.
unknown_event_is_traced_test() ->
    [
        ?assertEqual({[{trace, {unknown_event, Type, what}}], one, 1}, told(Type, what))
     || Type <- [info, packet, state_timeout, {timeout, a}, {reply, b}, {call, {app, c}}]
    ].

%% Every platform machine keeps to that.
machines_know_what_they_do_not_know_test_() ->
    Configs = [
        {starl_sap, #{}},
        {starl_location, #{}},
        {starl_motion, #{profiles => [starl_chassis:profile(starl_chassis_differential, #{})]}}
    ],
    [
        {atom_to_list(Module), fun() ->
            {_, M} = starl_machine:new(Module, Config, base()),
            Meta = #{now => 5, robot => 1},
            [
                ?assertEqual(
                    {[{trace, {unknown_event, Type, {no, such}}}], M},
                    starl_machine:step(Type, {no, such}, Meta, M)
                )
             || Type <- [cast, info, packet, state_timeout, {timeout, a}, {call, {app, c}}]
            ],
            ?assertMatch({[], _}, starl_machine:step(info, {restarted, other}, Meta, M))
        end}
     || {Module, Config} <- Configs
    ].

new() -> starl_machine:new(?MODULE, #{first => one}, base()).

base() ->
    #{
        robot => 1,
        participants => [1, 2],
        name => test,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 0
    }.

told(Type, Content) ->
    {_, M} = new(),
    {Actions, Next} = starl_machine:step(Type, Content, #{now => 5, robot => 1}, M),
    {Actions, starl_machine:state(Next), starl_machine:data(Next)}.
