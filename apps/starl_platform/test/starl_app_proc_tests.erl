%% The process of a sequential application: its protocol with the driver, which is played here.
-module(starl_app_proc_tests).
-include_lib("eunit/include/eunit.hrl").

-export([init/2, step/2]).

%% The application: its state is a function.
init(_Robot, Step) -> Step.
step(Robot, Step) -> Step(Robot).

%% The driver may rely on it that an application has attached when it has been started, as the
%% other machines have: a supervisor's start_child returns then.
attached_when_started_test() ->
    process_flag(priority, max),
    Missing = [K || K <- lists:seq(1, 2000), not attached(K)],
    process_flag(priority, normal),
    ?assertEqual(0, length(Missing)).

attached(K) ->
    {ok, Pid} = starl_app_proc:start_link(spec(K, fun(_) -> {done, ok} end)),
    Attached =
        receive
            {starl_attach, K, app, Pid} -> true
        after 0 -> false
        end,
    Attached orelse
        receive
            {starl_attach, K, app, Pid} -> ok
        end,
    stop(Pid),
    Attached.

%% Actions are handed back when the application blocks, in their order.
actions_in_order_test() ->
    Pid = start(fun(R) ->
        starl:trace(R, a),
        starl:actuate(R, pen, down),
        starl:trace(R, b),
        starl:sleep(R, 7),
        {done, x}
    end),
    [A, B, C, {{timeout, T}, 7000, call}] = boot(Pid),
    ?assertEqual([{trace, a}, {actuate, pen, down}, {trace, b}], [A, B, C]),
    ?assertEqual([{done, x}], event({timeout, T}, call, Pid)),
    stop(Pid).

%% Time is the clock at the beginning of the turn.
now_is_the_events_time_test() ->
    Pid = start(fun(R) ->
        First = starl:now(R),
        starl:sleep(R, 1),
        {done, {First, starl:now(R)}}
    end),
    [{{timeout, T}, 1000, call}] = boot(Pid),
    ?assertEqual([{done, {5, 42}}], event({timeout, T}, call, 42000, Pid)),
    stop(Pid).

%% Messages that come too early wait, in their order; those beyond the bound are traced.
inbox_is_bounded_test() ->
    Pid = start(fun(R) ->
        starl:sleep(R, 1),
        {done, [
            begin
                {ok, 2, K} = starl:await(R, a),
                K
            end
         || _ <- lists:seq(1, 1000)
        ]}
    end),
    [{{timeout, T}, _, call}] = boot(Pid),
    [?assertEqual([], event(cast, {message, 2, a, K}, Pid)) || K <- lists:seq(1, 1000)],
    ?assertEqual([{trace, {inbox_full, 2, a}}], event(cast, {message, 2, a, 1001}, Pid)),
    ?assertEqual([{done, lists:seq(1, 1000)}], event({timeout, T}, call, Pid)),
    stop(Pid).

%% What the robot's body feels is a message of its own to an application that listens to it; others are
%% not troubled.
senses_test() ->
    Pid = start(fun(R) ->
        starl:listen(R, sense),
        starl:sleep(R, 1),
        {ok, Own, First} = starl:await(R, sense),
        {ok, Own, Second} = starl:await(R, sense, 1000),
        {done, [Own =:= starl:id(R), First, Second]}
    end),
    [_, _, {{timeout, T}, _, call}] = boot(Pid),
    ?assertEqual([], event(info, {sensed, {bump, left}}, Pid)),
    [{{timeout, _}, _, call}] = event({timeout, T}, call, Pid),
    ?assertMatch(
        [_, {done, [true, {bump, left}, {battery, low}]}],
        event(info, {sensed, {battery, low}}, Pid)
    ),
    stop(Pid),
    Deaf = start(fun(R) -> starl:await(R, sense) end),
    [] = boot(Deaf),
    [?assertEqual([], event(info, {sensed, {buttons, N}}, Deaf)) || N <- lists:seq(1, 2000)],
    stop(Deaf).

%% An event that nobody knows is never fatal and never silent.
unknown_event_is_traced_test() ->
    Pid = start(fun(R) -> starl:await(R, a) end),
    [] = boot(Pid),
    ?assertEqual([{trace, {unknown_event, packet, x}}], event(packet, x, Pid)),
    stop(Pid).

%% What an application keeps goes out in its place among the other actions; it reads what an
%% earlier life kept until it keeps something itself.
stored_test() ->
    Pid = start(fun(R) ->
        Found = starl:stored(R),
        starl:trace(R, a),
        starl:store(R, new),
        starl:trace(R, b),
        {done, {Found, starl:stored(R)}}
    end),
    ?assertEqual(
        [{trace, a}, {store, new}, {trace, b}, {done, {{stored, old}, {stored, new}}}],
        boot(Pid, {stored, old})
    ),
    stop(Pid).

%% An answer that comes after the time-out of its call is not taken for the next one's.
late_reply_test() ->
    Pid = start(fun(R) ->
        {done, {starl:call(R, m, one, 10), starl:call(R, m, two, 10)}}
    end),
    [{call, m, one, T1}, {{timeout, T1}, 10000, call}] = boot(Pid),
    [_, {call, m, two, T2}, _] = event({timeout, T1}, call, Pid),
    [] = event({reply, T1}, late, Pid),
    ?assertMatch([_, {done, {{error, timeout}, {ok, right}}}], event({reply, T2}, right, Pid)),
    stop(Pid).

%% Listening anew does not let the memory grow, and is told to a new SAP once.
listening_twice_is_listening_once_test() ->
    Listen = fun(N) ->
        Pid = start(fun(R) ->
            [starl:listen(R, a) || _ <- lists:seq(1, N)],
            starl:sleep(R, 1),
            {done, ok}
        end),
        [_ | _] = boot(Pid),
        %% the event takes the actions of the turn away
        [] = event(cast, {message, 2, a, x}, Pid),
        {dictionary, Dictionary} = erlang:process_info(Pid, dictionary),
        Again = event(info, {restarted, sap}, Pid),
        stop(Pid),
        {Again, erts_debug:flat_size(Dictionary)}
    end,
    {Once, Small} = Listen(1),
    {Often, Large} = Listen(1000),
    %% one message is in the inbox
    ?assertEqual([{trace, {listens, {app, a}}}, {cast, sap, {listen, {app, a}, app, 999}}], Once),
    ?assertEqual(Once, Often),
    ?assert(Large < Small + 100).

%% -- the driver -----------------------------------------------------------------------------

spec(Id, Step) ->
    #{
        robot => Id,
        handle => starl:robot(Id, [1, 2]),
        module => ?MODULE,
        args => Step,
        driver => self()
    }.

start(Step) ->
    {ok, Pid} = starl_app_proc:start_link(spec(1, Step)),
    receive
        {starl_attach, 1, app, Pid} -> Pid
    end.

boot(Pid) ->
    boot(Pid, none).

boot(Pid, Stored) ->
    Random = rand:seed_s(exsss, 1),
    Pid ! {starl_boot, #{now => 5000, random => Random, incarnation => 1, stored => Stored}},
    done().

event(Type, Content, Pid) -> event(Type, Content, 6000, Pid).

event(Type, Content, Now, Pid) ->
    Pid ! {starl_step, Type, Content, #{now => Now, robot => 1}},
    done().

done() ->
    receive
        {starl_done, 1, _Pid, Actions} -> Actions
    end.

stop(Pid) ->
    unlink(Pid),
    Ref = monitor(process, Pid),
    exit(Pid, kill),
    receive
        {'DOWN', Ref, process, Pid, _} -> ok
    end.
