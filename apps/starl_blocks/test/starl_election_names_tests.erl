%% The names of elections: a robot of the team that makes up names takes no room of others.
-module(starl_election_names_tests).
-include_lib("eunit/include/eunit.hrl").

-define(META, #{now => 0}).

start(Module) ->
    {ready, Data, _} = Module:init(#{
        robot => 1, participants => [{1, 3}], incarnation => 1, team_seed => 7, stored => none
    }),
    Data.

does(Module, Type, Content, Data) ->
    case Module:handle_event(Type, Content, ready, Data, ?META) of
        {keep_state, Next, Actions} -> {Next, Actions};
        {keep_state, Next} -> {Next, []};
        {keep_state_and_data, Actions} -> {Data, Actions};
        keep_state_and_data -> {Data, []}
    end.

hears(Module, From, Type, Body, Data) ->
    ?assert(Module:accepts(Type, Body)),
    does(Module, cast, {message, From, Type, Body}, Data).

%% The result of an election outlives 2,000 names that another robot makes up; who asks for it late is told.
ballots_test_() -> {timeout, 60, fun ballots/0}.

ballots() ->
    M = starl_election_ballots,
    {Known, _} = hears(M, 3, leader, {mine, 2}, start(M)),
    Bodies = [
        {ballot, fun(N) -> {{x, N}, {5, 2}} end},
        {leader, fun(N) -> {{x, N}, 3} end}
    ],
    [
        begin
            Attacked = attacked(M, Type, Body, Known),
            ?assertMatch(
                {_, [{cast, sap, {send, 3, leader, {mine, 2}}}]},
                hears(M, 3, ballot, {mine, {1, 3}}, Attacked)
            ),
            {Entered, _} = does(M, {call, {app, t}}, {elect, own, 1000}, Attacked),
            {_, Last} = hears(M, 3, leader, {own, 3}, attacked(M, Type, Body, Entered)),
            ?assertEqual([{reply, {app, t}, {ok, 3}}], [R || {reply, _, _} = R <- Last])
        end
     || {Type, Body} <- Bodies
    ].

bully_test_() -> {timeout, 60, fun bully/0}.

bully() ->
    M = starl_election_bully,
    {Known, _} = hears(M, 3, bully_leader, {mine, 3, heard}, start(M)),
    Bodies = [
        {bully_challenge, fun(N) -> {x, N} end},
        {bully_leader, fun(N) -> {{x, N}, 2, heard} end}
    ],
    [
        ?assertMatch(
            {_, [{cast, sap, {send, 3, bully_leader, {mine, 3, few}}}]},
            hears(M, 3, bully_challenge, mine, attacked(M, Type, Body, Known))
        )
     || {Type, Body} <- Bodies
    ].

attacked(Module, Type, Body, Data) ->
    Attacked = lists:foldl(
        fun(N, D) -> element(1, hears(Module, 2, Type, Body(N), D)) end, Data, lists:seq(1, 2000)
    ),
    ?assert(erlang:external_size(Attacked) < 1100 * 300, erlang:external_size(Attacked)),
    Attacked.

%% What no application may call an election is taken from nobody.
too_long_test() ->
    Long = binary:copy(<<0>>, 1001),
    [
        ?assertNot(Module:accepts(Type, Body))
     || {Module, Type, Body} <- [
            {starl_election_ballots, ballot, {Long, {1, 1}}},
            {starl_election_ballots, leader, {Long, 1}},
            {starl_election_bully, bully_challenge, Long},
            {starl_election_bully, bully_alive, Long},
            {starl_election_bully, bully_leader, {Long, 1, heard}}
        ]
    ].
