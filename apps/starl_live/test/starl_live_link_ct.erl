%% The link of a live robot, for its tests: its ports are the test itself, its clock shows what the test sets,
%% and its machines are this module.
-module(starl_live_link_ct).
-behaviour(starl_machine).
-behaviour(starl_live_clock).

-export([with_link/2, with_link/3, tree/1, set/3]).
-export([hears/2, took/2, hung/1, app_hangs/1, handled/0, next/0, sap/0, heard/0]).
-export([init/1, handle_event/5]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

%% -- the machine ------------------------------------------------------------------------------------

init(#{test := Test, name := Name, incarnation := N}) ->
    Test ! {starts, Name, self(), N},
    {up, Test, [{actuate, light, on} || Name =:= app]}.

%% It does what a packet asks for, and tells the test by its clock.
handle_event(packet, hang, up, Test, _Meta) ->
    Test ! {hangs, self()},
    receive
        go_on -> {keep_state, Test, []}
    end;
handle_event(packet, Packet, up, Test, #{now := Now}) ->
    Test ! {took, Packet, Now},
    {keep_state, Test, done(Packet)};
handle_event(info, {located, hang, _Seen}, up, Test, Meta) ->
    handle_event(packet, hang, up, Test, Meta);
handle_event(info, {located, crash, _Seen}, up, _Test, _Meta) ->
    error(planted);
handle_event(info, {located, Tag, Seen}, up, Test, #{now := Now}) ->
    Test ! {located, Tag, Seen, Now},
    {keep_state, Test, []};
handle_event(info, {felt, _, _} = Felt, up, Test, _Meta) ->
    Test ! Felt,
    keep_state_and_data;
handle_event(info, {late, _} = Late, up, Test, _Meta) ->
    Test ! Late,
    keep_state_and_data;
handle_event({timeout, _}, Content, up, Test, _Meta) ->
    Test ! {wakes, Content},
    keep_state_and_data;
handle_event(info, _, up, _Test, _Meta) ->
    keep_state_and_data.

done({wake, Us}) ->
    done({wake, wake, Us});
done({wake, Name, Us}) ->
    [{{timeout, Name}, Us, wake}];
done({drive, Mark}) ->
    [{drive, ?SCRIPT, Mark}];
done({feel, Kind, Tag}) ->
    [{feel, Kind, Tag}];
done({say, Mark, Until, Us}) ->
    [{until, Until, [{trace, {said, Mark}}], Mark}, {{timeout, wake}, Us, wake}];
done({say, First, Then, Until, Us}) ->
    done({say, First, Until, Us}) ++ [{until, Until, [{trace, {said, Then}}], Then}];
done({drive, Mark, Until}) ->
    [{until, Until, [{drive, ?SCRIPT, Mark}], Mark}];
done(_Packet) ->
    [].

%% -- the clock: system time and monotonic time, which the test sets ---------------------------------

system_time(Unit, {Times, _Test}) -> in(Unit, atomics:get(Times, 1)).

time_of_day(Unit, Computer) -> system_time(Unit, Computer).

monotonic_time(Unit, {Times, _Test}) -> in(Unit, atomics:get(Times, 2)).

in(Unit, Us) -> erlang:convert_time_unit(Us, microsecond, Unit).

%% The computer stands still here for as long as the test says.
start_timer(Ms, Message, [{abs, true}], {Times, Test}) ->
    Test ! {timer, Ms, Message},
    ok = atomics:add(Times, 1, atomics:exchange(Times, 3, 0)),
    make_ref().

send_after(Ms, watch, {_Times, Test}) ->
    Test ! {watch_in, Ms},
    make_ref().

clock(SystemUs, MonotonicUs, Pace) ->
    Times = atomics:new(3, [{signed, true}]),
    ok = set(SystemUs, MonotonicUs, Times),
    {Times, starl_live_clock:on({?MODULE, {Times, self()}}, starl_live_clock:new(0, Pace))}.

set(SystemUs, MonotonicUs, Times) ->
    ok = atomics:put(Times, 1, SystemUs),
    atomics:put(Times, 2, MonotonicUs).

%% -- the robot --------------------------------------------------------------------------------------

%% Calls the test with the link of a robot whose machines have all started, and with the clock's times.
with_link(Pace, Test) ->
    with_link(Pace, #{}, Test).

%% ... of a robot with these keys in the place of the usual ones.
with_link(Pace, Given, Test) ->
    starl_platform_ct:quietly(fun() -> linked(Pace, Given, Test) end).

linked(Pace, Given, Test) ->
    process_flag(trap_exit, true),
    Dir = starl_live_robot_ct:dir() ++ "-link",
    _ = file:del_dir_r(Dir),
    {Times, Clock} = clock(0, 0, Pace),
    Usual = #{
        robot => 1,
        tree => tree(self()),
        team_seed => 1,
        profile => #{},
        clock => Clock,
        dir => Dir,
        transport => self(),
        positioning => self(),
        chassis => self(),
        sink => none
    },
    {ok, Robot} = starl_live_robot:start_link(maps:merge(Usual, Given)),
    receive
        {'$gen_cast', {actuate, light, on, none}} -> ok
    end,
    try
        ok = Test(starl_live_robot:link(Robot), Times)
    after
        exit(Robot, shutdown),
        receive
            {'EXIT', Robot, _} -> ok
        end,
        _ = file:del_dir_r(Dir),
        starl_platform_ct:forget()
    end.

tree(Test) ->
    #{
        participants => starl_team:new([1, 2]),
        services => [{sap, ?MODULE, #{test => Test}}],
        blocks => [],
        app => {machine, ?MODULE, #{test => Test}}
    }.

%% -- what it hears and does -------------------------------------------------------------------------

hears(Packet, Link) -> Link ! {starl_heard, self(), [Packet]}.

%% A packet, and the time at which it was taken.
took(Packet, Link) ->
    _ = hears(Packet, Link),
    receive
        {took, Packet, Now} -> Now
    end.

hung(Link) ->
    _ = hears(hang, Link),
    receive
        {hangs, _} -> ok
    end.

app_hangs(Link) ->
    Link ! {starl_located, self(), {app, hang}, []},
    receive
        {hangs, Pid} -> Pid
    end.

%% What the machine has handled next.
handled() ->
    receive
        {took, _, _} = Took -> Took;
        {late, _} = Late -> Late
    end.

next() ->
    receive
        {starts, app, _, _} -> next();
        {watch_in, _} -> next();
        Message -> Message
    end.

sap() ->
    receive
        {starts, sap, Pid, N} -> {Pid, N}
    end.

%% What the test has heard so far.
heard() ->
    receive
        Message -> [Message | heard()]
    after 0 -> []
    end.
