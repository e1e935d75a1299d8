%% The transport between robots of one VM.
-module(starl_live_local_tests).
-include_lib("eunit/include/eunit.hrl").

%% An end in a process of its own, which tells the test what it hears.
robot(Robot, Run) ->
    Test = self(),
    spawn_link(fun() ->
        {ok, Local} = starl_live_local:open(config(Robot, Run)),
        Test ! {opened, self()},
        hears(Robot, Test, Local)
    end).

config(Robot, Run) ->
    #{
        robot => Robot,
        participants => starl_team:new([1, 2, 3]),
        fleet => "local tests",
        run => Run
    }.

hears(Robot, Test, Local) ->
    receive
        stop ->
            Test ! {stopped, Robot, starl_live_local:close(Local)};
        Message ->
            case starl_live_local:hear(Message, Local) of
                {Packets, Next} ->
                    Test ! {heard, Robot, Packets},
                    hears(Robot, Test, Next);
                unknown ->
                    Test ! {unknown, Robot, Message},
                    hears(Robot, Test, Local)
            end
    end.

opened(Pid) ->
    receive
        {opened, Pid} -> Pid
    end.

%% What is not of its run is counted.
what_is_refused_is_counted_test() ->
    {ok, Local} = starl_live_local:open(config(1, 1)),
    Frame = {starl_frame, {<<"local tests">>, 2}, 2, all, <<>>},
    {[], Refused} = starl_live_local:hear(Frame, Local),
    ?assertEqual(#{run => 1}, starl_live_local:figures(Refused)),
    ok = starl_live_local:close(Refused).

%% A packet for one comes to that one, for all to all others of the same run; what cannot travel is refused.
packets_come_to_robots_of_the_run_test() ->
    [Two, Three, Other] = [opened(robot(R, Run)) || {R, Run} <- [{2, 1}, {3, 1}, {2, 2}]],
    {ok, One} = starl_live_local:open(config(1, 1)),
    Packet = starl_packet:shout(1, hello, here),
    {ok, Next} = starl_live_local:transmit(2, Packet, One),
    ?assertEqual({2, [Packet]}, next()),
    {ok, Last} = starl_live_local:transmit(all, Packet, Next),
    ?assertEqual([{2, [Packet]}, {3, [Packet]}], lists:sort([next(), next()])),
    ?assertEqual(#{sent => 2}, starl_live_local:figures(Last)),
    {refused, _Line, Last} = starl_live_local:transmit(2, starl_packet:shout(1, a, self()), Last),
    %% nobody is robot 3 of another run
    {ok, Alone} = starl_live_local:open(config(1, 2)),
    {ok, _} = starl_live_local:transmit(3, Packet, Alone),
    Two ! hello,
    receive
        {unknown, 2, hello} -> ok
    end,
    [Pid ! stop || Pid <- [Two, Three, Other]],
    Stopped = [
        receive
            {stopped, R, ok} -> R
        end
     || _ <- [1, 2, 3]
    ],
    ?assertEqual([2, 2, 3], lists:sort(Stopped)),
    ?assertEqual([], heard()).

next() ->
    receive
        {heard, Robot, Packets} -> {Robot, Packets}
    end.

heard() ->
    receive
        {heard, _, _} = Message -> [Message | heard()]
    after 0 -> []
    end.

%% Modules of tests share a process: those after this one find nothing of it.
nothing_is_left_test() -> starl_platform_ct:forget().
