%% The driver's state of a live robot, for its tests. Its ports are the test itself, its clock shows what
%% the test sets, and this module is a machine of it whose calls have a history.
-module(starl_live_driver_ct).
-behaviour(starl_live_clock).

-export([with_driver/2, dir/0, sent/0, does/2, packet/0, observer/0]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).
-export([has_history/0]).

has_history() -> true.

%% -- the clock --------------------------------------------------------------------------------------

system_time(Unit, Time) -> erlang:convert_time_unit(atomics:get(Time, 1), microsecond, Unit).
time_of_day(Unit, Time) -> system_time(Unit, Time).
monotonic_time(Unit, Time) -> system_time(Unit, Time).

start_timer(Ms, Message, [{abs, true}], _Time) ->
    self() ! {timer, Ms, Message},
    make_ref().

send_after(_Ms, _Message, _Time) -> make_ref().

%% -- the driver's state -----------------------------------------------------------------------------

%% Calls a test with the driver's state of robot 1 of three, and a function that sets its clock. Its store is in a
%% directory of its own.
with_driver(Given, Test) ->
    starl_platform_ct:quietly(fun() ->
        starl_platform_ct:forget(),
        Dir = dir(),
        _ = file:del_dir_r(Dir),
        Time = atomics:new(1, [{signed, true}]),
        Clock = starl_live_clock:on({?MODULE, Time}, starl_live_clock:new(0, 1)),
        case maps:get(commissioned, Given, true) of
            true -> ok = starl_live_store:commission(Dir);
            false -> ok
        end,
        {ok, Store} = starl_live_store:open(Dir),
        Usual = #{
            robot => 1,
            participants => starl_team:new([1, 2, 3]),
            team_seed => 77,
            clock => Clock,
            store => Store,
            transport => self(),
            positioning => self(),
            chassis => self(),
            senses => #{},
            sink => self(),
            record => none,
            parts => #{sap => lists, app => ?MODULE, mutex => ?MODULE}
        },
        Driver = starl_live_driver:new(maps:merge(Usual, Given)),
        try
            ok = Test(Driver, fun(Us) -> atomics:put(Time, 1, Us) end)
        after
            _ = file:del_dir_r(Dir),
            starl_platform_ct:forget()
        end
    end).

dir() -> starl_live_robot_ct:dir() ++ "-driver".

%% What the driver has sent to the test; tests before this one may have left other messages.
sent() ->
    receive
        {'$gen_cast', Cast} ->
            [Cast | sent()];
        Message when
            element(1, Message) =:= starl_traced;
            element(1, Message) =:= starl_ended;
            element(1, Message) =:= starl_reloaded;
            element(1, Message) =:= observed;
            element(1, Message) =:= timer
        ->
            [Message | sent()]
    after 0 -> []
    end.

%% What a step of machine `app' with these actions sends, and what was late.
does(Actions, Driver) ->
    Next = lists:foldl(
        fun(Action, B) ->
            {[], Done} = starl_live_driver:perform(Action, app, B),
            Done
        end,
        Driver,
        Actions
    ),
    {Late, Flushed} = starl_live_driver:flush(Next),
    {sent(), Late, Flushed}.

packet() -> starl_packet:shout(1, hello, here).

%% The observer is a function: it tells this process.
observer() ->
    Test = self(),
    fun(News) ->
        Test ! {observed, News},
        ok
    end.
