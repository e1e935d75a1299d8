%% @doc Measures how long wheels turn after something has been killed, or after the cable was pulled.
%%
%% An emulated Create stands behind a pty, its body in a room ({@link starl_create_room}); another
%% process, or another VM, drives it through the port program with the bytes that the driver writes.
%% Then something happens at a moment by chance. The time is from just before that until the body in
%% the room stands. The emulated body has no mass: it stands as soon as its wheels get the command.
-module(starl_create_stop_times).

-export([rows/0, robots/0, measure/2, drive/2]).

-export_type([row/0, robot/0, standing/0]).

-type row() ::
    vm
    | vm_halted
    | owner
    | line
    | program
    | program_halted
    | terminated
    | guardian
    | guardian_halted
    | pulled
    | put_back.

%% A generation, and how a Create 1 times its slices ({@link starl_create_script}).
-type robot() :: create_2 | create_1 | create_1_short.

%% Microseconds until it stands; it still drove when nobody waited any longer; it had come to rest
%% before, by itself.
-type standing() :: non_neg_integer() | drives_on | stood_before.

-define(SPEED, 200).
%% A leg that does not end meanwhile.
-define(LEG_US, 40000000).
-define(LATE_MS, 20000).
%% So long a robot without a cable is looked at; so long it stands before it is believed to.
-define(LOOK_MS, 1500).
-define(STANDS_MS, 200).
%% Two slices of a Create 1, in which the moment lies.
-define(MOMENT_MS, 210).
-define(FLUSH, 34).

%% @doc What happens.
-spec rows() -> [{row(), string()}].
rows() ->
    [
        {vm, "kill -9 of the VM"},
        {owner, "the link (owner of the line) killed"},
        {line, "the process of the line killed"},
        {program, "kill -9 of the port program"},
        {terminated, "kill (TERM) of the port program"},
        {guardian, "kill -9 of the guardian"},
        {program_halted, "port program halted (STOP; 250 ms)"},
        {guardian_halted, "guardian halted (STOP; 1000 ms)"},
        {pulled, "cable pulled"},
        {put_back, "cable put back"},
        {vm_halted, "VM halted (STOP; heartbeat 250 ms)"}
    ].

%% @doc The robots.
-spec robots() -> [{robot(), string()}].
robots() ->
    [{create_2, "Create 2"}, {create_1, "Create 1"}, {create_1_short, "short waits"}].

%% @doc One measurement.
-spec measure(row(), robot()) -> {ok, standing()} | {error, unicode:chardata()}.
measure(Row, Robot) ->
    {ok, Dir} = starl_private_dir:new("pty"),
    Link = filename:join(Dir, "robot"),
    #{model := Model} = options(Robot),
    Wanted = #{model => Model, robots => 1, arena => {100000, 500}, link => Link},
    Trapped = process_flag(trap_exit, true),
    Result =
        case starl_create_on_ptys:start_link(Wanted) of
            {ok, Room, [{Create, OnPty, Device}]} ->
                ok = starl_create_room:watch(Room, 1),
                Standing = measured(Row, {Room, OnPty}, Device, options(Robot)),
                ok = lists:foreach(fun ended/1, [OnPty, Create, Room]),
                {ok, Standing};
            {error, Reason} ->
                {error, starl_create_on_ptys:format_error(Reason)}
        end,
    _ = process_flag(trap_exit, Trapped),
    ok = starl_private_dir:remove(Dir),
    ok = forget(),
    Result.

%% Nothing of this measurement is taken for one of the next.
forget() ->
    receive
        {told, _} -> forget();
        {moves, _, _, _} -> forget()
    after 0 -> ok
    end.

ended(Pid) ->
    true = exit(Pid, shutdown),
    receive
        {'EXIT', Pid, _} -> ok
    end.

options(create_2) -> #{device => bench, model => 2};
options(create_1) -> #{device => bench, model => 1};
options(create_1_short) -> #{device => bench, model => 1, short_waits => true}.

%% -- what happens -----------------------------------------------------------------------------

measured(put_back, Place, Device, Options) ->
    put_back(Place, Device, Options);
measured(Row, {Room, _}, Device, Options) when Row =:= vm; Row =:= vm_halted ->
    vm_ends(Row, Room, Device, Options);
measured(Row, {Room, OnPty} = Place, Device, Options) ->
    {Owner, Line} = driver(Place, Device, Options),
    Program = program(Line),
    Us = timed(Room, deed(Row, OnPty, Owner, Line), patience(Row)),
    ok = over(Owner, Program),
    Us.

put_back({Room, OnPty} = Place, Device, Options) ->
    {Owner, Line} = driver(Place, Device, Options),
    Program = program(Line),
    ok = starl_create_on_pty:pull(OnPty),
    receive
        {told, {closed, _}} -> ok
    after ?LATE_MS -> error(late)
    end,
    Us =
        case stands(Room, ?LOOK_MS) of
            drives_on -> timed(Room, fun() -> starl_create_on_pty:put_back(OnPty) end);
            _ -> stood_before
        end,
    ok = over(Owner, Program),
    Us.

vm_ends(Row, Room, Device, Options) ->
    Paths = lists:append([
        ["-pa", Dir]
     || Dir <- code:get_path(), string:find(Dir, "starl") =/= nomatch
    ]),
    {ok, Peer, _} = peer:start(#{connection => standard_io, args => Paths}),
    ok = peer:call(Peer, ?MODULE, drive, [Device, Options]),
    driving(Room),
    Pid = peer:call(Peer, os, getpid, []),
    Us = timed(Room, fun() -> kill(signal(Row), Pid) end),
    _ = [kill("KILL", Pid) || Row =:= vm_halted],
    Us.

%% No program waits for a cable that never comes back.
over(Owner, Program) ->
    true = exit(Owner, kill),
    "" = kill("KILL", Program ++ " 2>/dev/null"),
    ok.

patience(pulled) -> ?LOOK_MS;
patience(_Row) -> ?LATE_MS.

signal(vm) -> "KILL";
signal(vm_halted) -> "STOP".

deed(pulled, OnPty, _Owner, _Line) -> fun() -> starl_create_on_pty:pull(OnPty) end;
deed(owner, _OnPty, Owner, _Line) -> fun() -> exit(Owner, kill) end;
deed(line, _OnPty, _Owner, Line) -> fun() -> exit(Line, kill) end;
deed(program, _OnPty, _Owner, Line) -> killer("KILL", program(Line));
deed(terminated, _OnPty, _Owner, Line) -> killer("TERM", program(Line));
deed(guardian, _OnPty, _Owner, Line) -> killer("KILL", guardian(program(Line)));
deed(program_halted, _OnPty, _Owner, Line) -> killer("STOP", program(Line));
deed(guardian_halted, _OnPty, _Owner, Line) -> killer("STOP", guardian(program(Line))).

killer(Signal, Pid) -> fun() -> kill(Signal, Pid) end.

kill(Signal, Pid) -> os:cmd("kill -" ++ Signal ++ " " ++ Pid).

program(Line) ->
    {links, Links} = process_info(Line, links),
    [Port] = [Link || Link <- Links, is_port(Link)],
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    integer_to_list(Pid).

guardian(Program) ->
    {ok, Children} = file:read_file("/proc/" ++ Program ++ "/task/" ++ Program ++ "/children"),
    Pids = string:lexemes(binary_to_list(Children), " \n"),
    [Guardian] = [Pid || Pid <- Pids, is_named("starl_guardian", Pid)],
    Guardian.

is_named(Name, Pid) ->
    file:read_file("/proc/" ++ Pid ++ "/comm") =:= {ok, list_to_binary(Name ++ "\n")}.

%% -- the other side ---------------------------------------------------------------------------

%% An owner of a line, on which a robot drives.
driver({Room, _}, Device, Options) ->
    Self = self(),
    Owner = spawn(fun() -> owner(Device, Options, Self) end),
    receive
        {line, Owner, Line} ->
            driving(Room),
            {Owner, Line}
    after ?LATE_MS -> error(late)
    end.

%% @private In a VM that will be killed.
-spec drive(Device :: string(), starl_create_options:t()) -> ok.
drive(Device, Options) ->
    Self = self(),
    _ = spawn(fun() -> owner(Device, Options, Self) end),
    receive
        {line, _, _} -> ok
    end.

%% What the driver writes, without what it hears.
owner(Device, #{model := Model} = Options, Parent) ->
    {ok, Line} = starl_create_port:start_link(self(), #{}),
    Line ! {stop_bytes, starl_create_instructions:resting(Options)},
    Line ! {open, Device, starl_create_options:baud(Options)},
    Flush = binary:copy(starl_create_command:encode(start, Model), ?FLUSH),
    Line ! {send, [Flush, starl_create_instructions:take(Options)]},
    Steps = [{Bytes, Us} || {_, Bytes, Us} <- steps(Options)],
    Line ! {drive_script, 1, Steps, starl_create_script:rest()},
    receive
        {sent, 1, _} -> Parent ! {line, self(), Line}
    end,
    tell(Parent).

steps(#{model := Model} = Options) ->
    Way =
        case Model of
            1 -> {on_robot, starl_create_options:waits(Options), rest};
            2 -> {by_port, 5000}
        end,
    starl_create_script:steps([{?SPEED, ?SPEED, ?LEG_US}], Way).

tell(Parent) ->
    receive
        Event ->
            Parent ! {told, Event},
            tell(Parent)
    end.

%% -- the body ---------------------------------------------------------------------------------

%% It has driven for a time by chance.
driving(Room) ->
    receive
        {moves, Room, 1, _Piece} -> ok
    after ?LATE_MS -> error(late)
    end,
    receive
    after rand:uniform(?MOMENT_MS) -> ok
    end.

timed(Room, Deed) -> timed(Room, Deed, ?LATE_MS).

timed(Room, Deed, Ms) ->
    Begin = erlang:system_time(microsecond),
    _ = Deed(),
    case stands(Room, Ms) of
        drives_on -> drives_on;
        At -> max(0, At - Begin)
    end.

%% Since when does it stand? Between two slices a Create 1 does, for no time.
stands(Room, Ms) -> stands(Room, Ms, none).

stands(Room, Ms, Since) ->
    Begin = erlang:monotonic_time(millisecond),
    receive
        {moves, Room, 1, Piece} ->
            Left = max(0, Ms - (erlang:monotonic_time(millisecond) - Begin)),
            stands(Room, Left, since(Piece))
    after patience(Since, Ms) ->
        case Since of
            none -> drives_on;
            At -> At
        end
    end.

patience(none, Ms) -> Ms;
patience(_At, _Ms) -> ?STANDS_MS.

since(Piece) ->
    case starl_trajectory:is_still(Piece) of
        true -> starl_trajectory:start_us(Piece);
        false -> none
    end.
