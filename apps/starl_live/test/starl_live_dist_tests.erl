%% The transport by Erlang distribution, without other nodes: what robots of one node hear, and how nodes that nobody
%% reaches are tried.
-module(starl_live_dist_tests).
-include_lib("eunit/include/eunit.hrl").

%% Each test has a process of its own, with which the names of its robots and its monitors go.

one_attempt_at_a_time_test_() -> {spawn, fun one_attempt_at_a_time/0}.

one_attempt_at_a_time() ->
    Dist = opened(1, #{2 => 'nobody@nowhere.invalid'}),
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
    ?assertMatch(#{not_connected := 3}, starl_live_dist:figures(Third)).

%% The end of a robot whose team are those that have a node, and itself.
opened(Robot, Nodes) ->
    {ok, Dist} = starl_live_dist:open(config(Robot, Nodes)),
    Dist.

config(Robot, Nodes) -> (common(Robot, [Robot | maps:keys(Nodes)]))#{peers => Nodes}.

common(Robot, Team) ->
    #{robot => Robot, participants => lists:usort(Team), fleet => "tests", run => 1}.

shout(Dist) -> shout(1, 2, Dist).

shout(From, To, Dist) ->
    {ok, Next} = starl_live_dist:transmit(To, starl_packet:shout(From, dpp, x), Dist),
    Next.

%% The processes that make a connection.
attempts() ->
    {monitors, Monitors} = process_info(self(), monitors),
    [Pid || {process, Pid} <- Monitors].

%% Each second a connection is made to each node of another robot that has none; its own node needs none,
%% whatever the configuration calls it. With no former transport there is nothing to wait for.
connections_are_looked_after_each_second_test_() ->
    {spawn, fun connections_are_looked_after_each_second/0}.

connections_are_looked_after_each_second() ->
    Nodes = #{
        5 => 'own@nowhere.invalid', 6 => 'nobody@nowhere.invalid', 7 => node(), 8 => node()
    },
    Self = self(),
    Second = {erlang, send_after, [1000, Self, {starl_live_dist, connect}]},
    {Dist, Calls} = calls(fun() -> opened(5, Nodes) end),
    ?assertEqual([Second], Calls),
    [Attempt] = attempts(),
    %% while it is made no other is begun
    {{[], Still}, [Second]} = calls(fun() ->
        starl_live_dist:hear({starl_live_dist, connect}, Dist)
    end),
    ?assertEqual([Attempt], attempts()),
    true = exit(Attempt, kill),
    {[], Ended} =
        receive
            {'DOWN', _, process, Attempt, _} = Down -> starl_live_dist:hear(Down, Still)
        end,
    {[], _} = starl_live_dist:hear({starl_live_dist, connect}, Ended),
    ?assertMatch([Next] when Next =/= Attempt, attempts()).

%% What a function answers, and its calls of what takes time.
calls(Fun) ->
    Tracer = spawn_link(fun() -> collects([]) end),
    _ = [
        erlang:trace_pattern({erlang, Name, Arity}, true, [])
     || {Name, Arity} <- [{send_after, 3}, {demonitor, 2}, {send, 3}]
    ],
    1 = erlang:trace(self(), true, [call, {tracer, Tracer}]),
    Answer = Fun(),
    1 = erlang:trace(self(), false, [call]),
    Delivered = erlang:trace_delivered(self()),
    receive
        {trace_delivered, _, Delivered} -> ok
    end,
    Tracer ! {calls, self()},
    receive
        {calls, Calls} -> {Answer, Calls}
    end.

collects(Calls) ->
    receive
        %% those of the module itself may be traced, too, as coverage and mutants count them
        {trace, _Pid, call, {erlang, _, _} = Call} ->
            collects([Call | Calls]);
        {trace, _Pid, call, _} ->
            collects(Calls);
        {calls, Test} ->
            Test ! {calls, lists:reverse(Calls)},
            ok
    end.

%% A robot of this node hears what one of this node sends, and knows when; of a robot without a node, and of
%% what is no packet, nothing comes.
robots_of_a_node_hear_each_other_test_() -> {spawn, fun robots_of_a_node_hear_each_other/0}.

robots_of_a_node_hear_each_other() ->
    Nodes = #{8 => node(), 9 => node()},
    {Process, Nine} = opened_beside(9, Nodes),
    Eight = opened(8, Nodes),
    Packet = starl_packet:shout(8, hello, here),
    {ok, Sent} = starl_live_dist:transmit(all, Packet, Eight),
    ?assertEqual(#{sent => 1}, starl_live_dist:figures(Sent)),
    {ok, Again} = starl_live_dist:transmit(9, Packet, Sent),
    ?assertEqual(#{sent => 2}, starl_live_dist:figures(Again)),
    {refused, _Line, Again} = starl_live_dist:transmit(9, starl_packet:shout(8, a, self()), Again),
    {ok, Unknown} = starl_live_dist:transmit(7, Packet, Again),
    ?assertEqual(#{sent => 3, unknown_peer => 1}, starl_live_dist:figures(Unknown)),
    Never = #{
        robot => 8,
        is_silent => false,
        heard_ms => 0,
        address => none,
        life => none,
        refused => #{},
        why => none
    },
    ?assertEqual([Never], starl_live_dist:peers(Nine)),
    Heard = hears(Packet, hears(Packet, Nine)),
    ?assertMatch(
        [#{robot := 8, heard_ms := Ms, why := none}] when Ms >= 0, starl_live_dist:peers(Heard)
    ),
    ?assertEqual(unknown, starl_live_dist:hear(hello, Heard)),
    ?assertEqual(ok, starl_live_dist:close(Heard)),
    Process ! ends.

%% The end of a robot in a process of its own, which passes on to the test what comes.
opened_beside(Robot, Nodes) ->
    Test = self(),
    Process = spawn_link(fun() ->
        Test ! {opened, opened(Robot, Nodes)},
        passes_on(Test)
    end),
    receive
        {opened, Dist} -> {Process, Dist}
    end.

%% The next frame that comes bears this packet.
hears(Packet, Before) ->
    receive
        Frame when element(1, Frame) =:= starl_frame ->
            {[Packet], After} = starl_live_dist:hear(Frame, Before),
            After
    end.

passes_on(Test) ->
    receive
        ends ->
            ok;
        Message ->
            Test ! Message,
            passes_on(Test)
    end.

%% A node that cannot be reached is why a robot is silent. Without the node of each other robot there is no
%% transport.
a_robot_of_another_node_is_silent_test_() -> {spawn, fun a_robot_of_another_node_is_silent/0}.

a_robot_of_another_node_is_silent() ->
    Dist = opened(4, #{3 => 'nobody@nowhere.invalid'}),
    ?assertMatch(
        [#{robot := 3, is_silent := true, heard_ms := never, why := not_connected}],
        starl_live_dist:peers(Dist)
    ),
    Without = (common(4, [3, 4]))#{peers => #{4 => node()}},
    {error, Line} = starl_live_dist:open(Without),
    ?assertEqual("peers: no node of robot 3", lists:flatten(Line)).

%% A send waits neither for a connection nor for one that is busy.
a_send_never_waits_test_() -> {spawn, fun a_send_never_waits/0}.

a_send_never_waits() ->
    Dist = opened(10, #{4 => 'nobody@nowhere.invalid'}),
    {_, Calls} = calls(fun() -> shout(10, 4, Dist) end),
    ?assertMatch(
        [{erlang, send, [{starl_robot_4, 'nobody@nowhere.invalid'}, _, [noconnect, nosuspend]]}],
        [Call || {erlang, send, _} = Call <- Calls]
    ).

%% A robot that was heard is known to have been, though its node is cut off since.
when_a_robot_was_heard_is_known_test_() -> {spawn, fun when_a_robot_was_heard_is_known/0}.

when_a_robot_was_heard_is_known() ->
    Dist = opened(3, #{4 => 'nobody@nowhere.invalid', 5 => 'nobody@nowhere.invalid'}),
    Heard = lists:foldl(
        fun(Robot, Before) ->
            Ends = starl_live_frame:new(common(Robot, [3, 4, 5])),
            Packet = starl_packet:shout(Robot, dpp, x),
            {ok, Frame, [3], _} = starl_live_frame:write(3, Packet, Ends),
            {[Packet], After} = starl_live_dist:hear(Frame, Before),
            %% what is heard of one is nothing that is heard of the other
            ?assertMatch(
                Ago when length(Ago) =:= Robot - 3,
                [Ms || #{heard_ms := Ms} <- starl_live_dist:peers(After), is_integer(Ms)]
            ),
            After
        end,
        Dist,
        [4, 5]
    ),
    ?assertMatch(
        [
            #{robot := 4, is_silent := true, heard_ms := Four, why := not_connected},
            #{robot := 5, is_silent := true, heard_ms := Five, why := not_connected}
        ] when Four >= Five andalso Five >= 0,
        starl_live_dist:peers(Heard)
    ),
    %% what is refused is counted
    Other = {starl_frame, {<<"others">>, 1}, 4, all, <<>>},
    {[], Refused} = starl_live_dist:hear(Other, Heard),
    ?assertEqual(#{fleet => 1}, starl_live_dist:figures(Refused)).

%% However many there are, robots come in their order.
robots_come_in_order_test_() -> {spawn, fun robots_come_in_order/0}.

robots_come_in_order() ->
    Team = lists:seq(12, 60),
    Dist = opened(12, maps:from_list([{Robot, node()} || Robot <- Team])),
    ?assertEqual(tl(Team), [Robot || #{robot := Robot} <- starl_live_dist:peers(Dist)]).

%% The former transport of a robot that starts anew ends a moment after its link; another robot with its
%% number does not end.
name_of_the_former_test_() -> {spawn, fun name_of_the_former/0}.

name_of_the_former() ->
    Config = config(7, #{}),
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
