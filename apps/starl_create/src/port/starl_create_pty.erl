%% @doc A serial line without a cable: owns a pty, at the robot's end. An emulator sits behind it;
%% programs open its name, or its link, like a device.
%%
%% It passes bytes on unchanged. It reports the speed that the other side has set, because a robot
%% receives and sends garbage at a wrong speed. It also lets the cable be pulled and put back.
-module(starl_create_pty).

-export([start_link/2, name/1, send/2, sync/1, pull/1, put_back/1, stop/1]).
-export([init/3]).

-export_type([event/0, reason/0]).

%% To the owner, as `{pty, Pty, Event}'. `attached': a program has opened the line. `baud': its
%% speed; `hung_up': the control lines are released, as by a pulse. `upto': all bytes until then were
%% told before. `AtUs' is of `erlang:monotonic_time(microsecond)'.
-type event() ::
    attached
    | detached
    | {baud, pos_integer() | hung_up}
    | {data, binary(), AtUs :: integer()}
    | {upto, AtUs :: integer()}
    | {error, unicode:chardata()}.

-type reason() :: starl_create_program:reason() | {program, integer()} | {link, unicode:chardata()}.

-record(pty, {owner :: pid(), program :: port(), name :: string()}).

%% @doc Makes a pty, and a link to it if one is named. It lives as long as its owner.
-spec start_link(Owner :: pid(), Link :: file:filename() | none) -> {ok, pid()} | {error, reason()}.
start_link(Owner, Link) -> proc_lib:start_link(?MODULE, init, [self(), Owner, Link]).

%% @doc The name of the line, of the link if there is one.
-spec name(pid()) -> string().
name(Pty) ->
    Ref = monitor(process, Pty),
    Pty ! {name, self(), Ref},
    receive
        {Ref, Name} ->
            true = demonitor(Ref, [flush]),
            Name;
        {'DOWN', Ref, process, Pty, Reason} ->
            error(Reason)
    end.

%% @doc Sends bytes to the program at the other end; lost if there is none.
-spec send(pid(), iodata()) -> ok.
send(Pty, Bytes) -> told(Pty, {command, [$W, Bytes]}).

%% @doc Asks for the time up to which all bytes have been reported: `upto'.
-spec sync(pid()) -> ok.
sync(Pty) -> told(Pty, {command, <<$T>>}).

%% @doc Pulls the cable: the line and its link are gone.
-spec pull(pid()) -> ok.
pull(Pty) -> told(Pty, {command, <<$P>>}).

%% @doc Puts the cable back: another pty under the same link.
-spec put_back(pid()) -> ok.
put_back(Pty) -> told(Pty, {command, <<$R>>}).

%% @doc Ends the line and takes the link away.
-spec stop(pid()) -> ok.
stop(Pty) -> told(Pty, stop).

told(Pty, Message) ->
    Pty ! Message,
    ok.

%% @private
-spec init(pid(), pid(), file:filename() | none) -> no_return().
init(Parent, Owner, Link) ->
    _ = process_flag(trap_exit, true),
    _ = process_flag(priority, high),
    _ = monitor(process, Owner),
    Args = ["pty" | [Link || Link =/= none]],
    case starl_create_program:start(Args) of
        {ok, Program} -> begun(Parent, #pty{owner = Owner, program = Program, name = ""}, Link);
        {error, _} = Error -> refused(Parent, Error)
    end.

begun(Parent, #pty{program = Program} = Pty, Link) ->
    receive
        {Program, {data, <<$n, Name/binary>>}} ->
            ok = proc_lib:init_ack(Parent, {ok, self()}),
            loop(Pty#pty{name = shown(Link, Name)});
        {Program, {data, <<$e, Error/binary>>}} ->
            refused(Parent, {error, {link, detail(Error, Link)}});
        {Program, {exit_status, Status}} ->
            refused(Parent, unable(starl_create_program:ended(Status), Status))
    end.

unable({error, _} = Error, _Status) -> Error;
unable(ended, Status) -> {error, {program, Status}}.

shown(none, Name) -> binary_to_list(Name);
shown(Link, _Name) -> Link.

-spec refused(pid(), {error, reason()}) -> no_return().
refused(Parent, Error) ->
    ok = proc_lib:init_ack(Parent, Error),
    exit(normal).

detail(Error, Link) ->
    [_Word, Detail] = binary:split(Error, <<0>>),
    io_lib:format("~ts: ~ts~ts", [Link, string:lowercase(Detail), remedy(Detail)]).

%% What stands there is nobody's link.
remedy(<<"File exists">>) -> ", and is no link; name another one";
remedy(_) -> "".

loop(#pty{owner = Owner, program = Program, name = Name} = Pty) ->
    receive
        {Program, {data, Message}} ->
            _ = tell(Owner, event(Message)),
            loop(Pty);
        {name, From, Ref} ->
            From ! {Ref, Name},
            loop(Pty);
        {command, Bytes} ->
            true = port_command(Program, Bytes),
            loop(Pty);
        stop ->
            exit(normal);
        {'DOWN', _, process, Owner, _} ->
            exit(normal);
        {Program, {exit_status, Status}} ->
            exit({shutdown, {program, Status}});
        {'EXIT', _, Reason} ->
            exit({shutdown, Reason})
    end.

tell(_Owner, none) -> ok;
tell(Owner, Event) -> Owner ! {pty, self(), Event}.

event(<<$d, At:64, Bytes/binary>>) -> {data, Bytes, starl_create_program:us(At)};
event(<<$t, At:64>>) -> {upto, starl_create_program:us(At)};
event(<<$b, 0:32>>) -> {baud, hung_up};
event(<<$b, Baud:32>>) -> {baud, Baud};
event(<<$a>>) -> attached;
event(<<$h>>) -> detached;
event(<<$n, _/binary>>) -> none;
event(<<$e, Error/binary>>) -> {error, detail(Error, "pty")}.
