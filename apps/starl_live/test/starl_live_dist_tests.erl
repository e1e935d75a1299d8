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

%% The former transport of a robot that starts anew ends a moment after its link; another robot with its
%% number does not end.
name_of_the_former_test() ->
    Config = #{robot => 7, participants => [7], fleet => "tests", run => 1, peers => #{}},
    Former = holds(starl_robot_7),
    Test = self(),
    {New, Monitor} = spawn_monitor(fun() ->
        Test ! {self(), element(1, starl_live_dist:open(Config))}
    end),
    ok = watches(New, Former),
    Former ! ends,
    receive
        {New, Opened} -> ?assertEqual(ok, Opened)
    end,
    receive
        {'DOWN', Monitor, process, New, _} -> ok
    end,
    Other = holds(starl_robot_7),
    {error, Why} = starl_live_dist:open(Config),
    ?assertEqual("robot 7 runs on this node already", lists:flatten(Why)),
    Other ! ends.

holds(Name) ->
    Test = self(),
    Pid = spawn(fun() ->
        true = register(Name, self()),
        Test ! {self(), holds},
        receive
            ends -> ok
        end
    end),
    receive
        {Pid, holds} -> Pid
    end.

%% Waits until the first process watches the other one, or has ended.
watches(Pid, Watched) ->
    case process_info(Pid, monitors) of
        {monitors, [{process, Watched}]} -> ok;
        undefined -> ended;
        _ -> watches(Pid, Watched)
    end.
