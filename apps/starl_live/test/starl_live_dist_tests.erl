%% Connections that a packet asks for: one attempt at a time to a node, and a new one after it.
-module(starl_live_dist_tests).
-include_lib("eunit/include/eunit.hrl").

attempts_test() ->
    {ok, Dist} = starl_live_dist:open(#{
        robot => 1,
        participants => [1, 2],
        fleet => "tests",
        run => 1,
        peers => #{2 => 'nobody@nowhere.invalid'}
    }),
    First = shout(Dist),
    [Attempt] = attempts(),
    Second = shout(First),
    ?assertEqual([Attempt], attempts()),
    true = exit(Attempt, kill),
    {[], Ended} =
        receive
            {'DOWN', _, process, Attempt, _} = Down -> starl_live_dist:hear(Down, Second)
        end,
    Third = shout(Ended),
    ?assertMatch([Next] when Next =/= Attempt, attempts()),
    ?assertMatch(#{not_connected := 3}, starl_live_dist:figures(Third)),
    [exit(Next, kill) || Next <- attempts()],
    true = unregister(starl_robot_1).

shout(Dist) ->
    {ok, Next} = starl_live_dist:transmit(2, starl_packet:shout(1, dpp, x), Dist),
    Next.

%% The processes that make a connection.
attempts() ->
    {monitors, Monitors} = process_info(self(), monitors),
    [Pid || {process, Pid} <- Monitors].
