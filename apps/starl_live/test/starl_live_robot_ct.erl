%% A live robot for tests: its machines are this module, and do what they are told; its lines are the test, if
%% no others are given; its clock shows what the test sets.
-module(starl_live_robot_ct).
-behaviour(starl_machine).
-behaviour(starl_live_clock).
-include_lib("eunit/include/eunit.hrl").

-export([
    with_robot/2,
    with_dir/1,
    dir/0,
    spec/2,
    boots/1,
    lit/0,
    tells/3,
    does/3,
    hangs/2,
    next/1,
    heard/1,
    ends/1
]).
-export([init/1, handle_event/5]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

%% -- a machine: a word of the positioning system says what it does --------------------------------------

init(#{name := Name, incarnation := N} = Config) ->
    ?MODULE ! {boots, Name, self(), N, Config},
    {up, {Name, maps:get(keeps, Config, none)}, [{actuate, light, on} || Name =:= app]}.

handle_event(info, {located, {do, Actions}, _Seen}, up, _Data, _Meta) ->
    {keep_state_and_data, Actions};
handle_event(info, {located, hang, _Seen}, up, {Name, _}, _Meta) ->
    ?MODULE ! {hangs, Name, self()},
    receive
        {go_on, Actions} -> {keep_state_and_data, Actions}
    end;
handle_event(info, {located, crash, _Seen}, up, _Data, _Meta) ->
    error(planted);
handle_event(Type, Content, up, {Name, _}, _Meta) ->
    ?MODULE ! {took, Name, Type, Content},
    keep_state_and_data.

%% -- the clock: all its times are one ---------------------------------------------------------------------

system_time(Unit, Time) -> erlang:convert_time_unit(atomics:get(Time, 1), microsecond, Unit).
time_of_day(Unit, Time) -> system_time(Unit, Time).
monotonic_time(Unit, Time) -> system_time(Unit, Time).

start_timer(Ms, Message, [{abs, true}], _Time) ->
    ?MODULE ! {timer, Ms, Message},
    make_ref().

send_after(_Ms, _Message, _Time) -> make_ref().

%% -- the robot --------------------------------------------------------------------------------------------

%% Calls a test with the link of robot 1 of a team of two, which has never run, when all its machines have
%% started, and with its time (us), an atomic.
with_robot(Given, Test) ->
    with_dir(fun(Dir) ->
        ok = starl_live_store:commission(Dir),
        {Time, Spec} = spec(Dir, Given),
        {ok, Robot} = starl_live_robot:start_link(Spec),
        [{_, _} = boots(Name) || Name <- [sap, app]],
        _ = map_get(chassis, Spec) =:= self() andalso lit(),
        try
            ok = Test(starl_live_robot:link(Robot), Time)
        after
            ends(Robot)
        end
    end).

%% Calls a test with a directory, in silence, as the process of this module's name; nothing is left behind.
with_dir(Test) ->
    Dir = dir(),
    _ = file:del_dir_r(Dir),
    starl_platform_ct:forget(),
    true = register(?MODULE, self()),
    Before = process_flag(trap_exit, true),
    try
        starl_platform_ct:quietly(fun() -> Test(Dir) end)
    after
        process_flag(trap_exit, Before),
        true = unregister(?MODULE),
        _ = file:del_dir_r(Dir),
        starl_platform_ct:forget()
    end.

%% The directory of the robot: in memory where there is such a file system, since a store syncs each file, and
%% a busy disk takes long for that.
dir() ->
    Memory = "/dev/shm",
    Root =
        case filelib:is_dir(Memory) of
            true -> Memory;
            false -> os:getenv("TMPDIR", "/tmp")
        end,
    filename:join(Root, "starl-live-robot-" ++ os:getpid()).

%% A robot with these keys in the place of the usual ones, and its time.
spec(Dir, Given) ->
    Time = atomics:new(1, [{signed, true}]),
    Usual = #{
        robot => 1,
        tree => #{
            participants => starl_team:new([1, 2]),
            services => [{sap, ?MODULE, #{}}],
            blocks => [],
            app => {machine, ?MODULE, #{}}
        },
        team_seed => 1,
        profile => #{},
        clock => starl_live_clock:on({?MODULE, Time}, starl_live_clock:new(0, 1)),
        dir => Dir,
        transport => self(),
        positioning => self(),
        chassis => self(),
        sink => none
    },
    {Time, maps:merge(Usual, Given)}.

%% A process that this one is linked with ends.
ends(Pid) ->
    exit(Pid, shutdown),
    receive
        {'EXIT', Pid, Why} -> Why
    end.

%% The application has started, and is at rest. Here and below: a robot that has ended is waited for in vain.
lit() ->
    receive
        {'$gen_cast', {actuate, light, on, none}} -> ok;
        {'EXIT', Pid, Why} when Why =/= normal -> error({has_ended, Pid, Why})
    end.

%% The next start of a machine: its process and number.
boots(Name) ->
    receive
        {boots, Name, Pid, N, _} -> {Pid, N};
        {'EXIT', Robot, Why} when Why =/= normal -> error({has_ended, Robot, Why})
    end.

%% Its machine is told this by the positioning system, which is the test.
tells(Name, What, Link) ->
    Link ! {starl_located, self(), {Name, What}, []},
    ok.

does(Name, Actions, Link) -> tells(Name, {do, Actions}, Link).

hangs(Name, Link) ->
    ok = tells(Name, hang, Link),
    receive
        {hangs, Name, Pid} -> Pid;
        {'EXIT', Robot, Why} when Why =/= normal -> error({has_ended, Robot, Why})
    end.

%% What the machine takes next.
next(Name) ->
    receive
        {took, Name, Type, Content} -> {Type, Content};
        {'EXIT', Robot, Why} when Why =/= normal -> error({has_ended, Robot, Why})
    end.

%% What this process has heard so far of the link, of this kind.
heard(Kind) ->
    receive
        Message when element(1, Message) =:= Kind -> [Message | heard(Kind)]
    after 0 -> []
    end.
