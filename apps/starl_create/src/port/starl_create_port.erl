%% @doc A serial line: the process that owns the port program. The program writes drive scripts by
%% its own clock. It stops the wheels when this process, the VM, the program itself or its heartbeat
%% ends.
%%
%% Its messages are those of the package erlang-serial (`{open, Device}', `{speed, Baud}', `{send,
%% Bytes}', `{data, Bytes}', ...), so that it serves any serial work. {@link request()} and
%% {@link event()} list all of them. The line lives as long as its owner.
-module(starl_create_port).

-export([start_link/2]).
-export([init/2]).

-export_type([request/0, event/0, options/0, reason/0, step/0, priority/0]).

%% Bytes to write, and the time to wait before the next ones.
-type step() :: {Bytes :: iodata(), WaitUs :: 0..16#FFFFFFFF}.

%% `drive_script' replaces the one that runs, of which the rest is void; `Stop' ends it, at once if
%% there is no step. `stop_bytes' is what stops the wheels when all else ends. `pulse' and
%% `break' wake a robot. `{open, Device}' opens with the speed of the last `open' or `speed'.
-type request() ::
    {open, Device :: string(), Baud :: pos_integer()}
    | {open, Device :: string()}
    | {send, iodata()}
    | {drive_script, Mark :: non_neg_integer(), [step()], Stop :: iodata()}
    | {stop_bytes, iodata()}
    | {pulse, dtr | rts, LowMs :: 0..65535, Times :: 0..255}
    | {break, Ms :: 0..65535}
    | {break}
    | {speed, pos_integer()}
    | {speed, In :: pos_integer(), Out :: pos_integer()}
    | {connect}
    | {disconnect}
    | {close}
    | close.

%% `opened' comes again after `closed' when the device is back; the stop bytes have then been
%% written first. `sent' and `ended': the first bytes of a script and the last (its `Stop') have
%% left, at a moment of `erlang:monotonic_time(microsecond)'. `stopped': the wheels were stopped
%% because the heartbeat or the guardian failed, or the program had been halted, and the script is void.
%% `priority': how soon the computer lets the program run.
-type event() ::
    {priority, priority()}
    | {opened, Device :: string()}
    | {data, binary()}
    | {sent, Mark :: non_neg_integer(), AtUs :: integer()}
    | {ended, Mark :: non_neg_integer(), AtUs :: integer()}
    | {stopped, heartbeat | guardian | halted, AtUs :: integer()}
    | {closed, unplugged | unguarded | {program, Status :: non_neg_integer()}}
    | {error, {reason(), unicode:chardata()}}.

%% Real-time scheduling; else the highest ordinary priority; else none of its own.
-type priority() :: realtime | raised | ordinary.

-type reason() ::
    starl_create_program:reason()
    | no_device
    | permission
    | busy
    | not_serial
    | speed
    | unguarded
    | io
    | closed
    | bad_message.

%% `heartbeat_ms': without a sign of life for this time the wheels are stopped; 0: never.
-type options() :: #{heartbeat_ms => non_neg_integer(), baud => pos_integer()}.

-record(line, {
    owner :: pid(),
    program :: port() | {none, starl_create_program:reason()},
    device = none :: string() | none,
    baud :: pos_integer(),
    heartbeat_ms :: non_neg_integer()
}).

-define(HEARTBEAT_MS, 250).
%% So often within the time a sign of life is given.
-define(SIGNS, 5).
-define(BAUD, 115200).
-define(BREAK_MS, 250).

%% @doc Starts a line that belongs to `Owner'. Without the program every request is an error
%% message.
-spec start_link(Owner :: pid(), options()) -> {ok, pid()}.
start_link(Owner, Options) -> proc_lib:start_link(?MODULE, init, [Owner, Options]).

%% @private
-spec init(pid(), options()) -> no_return().
init(Owner, Options) ->
    _ = process_flag(trap_exit, true),
    %% a sign of life that comes late stops the wheels
    _ = process_flag(priority, high),
    _ = monitor(process, Owner),
    Program =
        case starl_create_program:start([]) of
            {ok, Port} -> Port;
            {error, Reason} -> {none, Reason}
        end,
    Ms = maps:get(heartbeat_ms, Options, ?HEARTBEAT_MS),
    Baud = maps:get(baud, Options, ?BAUD),
    Line = #line{owner = Owner, program = Program, baud = Baud, heartbeat_ms = Ms},
    ok = proc_lib:init_ack({ok, self()}),
    loop(beat(Line)).

beat(#line{heartbeat_ms = 0} = Line) ->
    Line;
beat(#line{heartbeat_ms = Ms} = Line) ->
    _ = erlang:send_after(max(1, Ms div ?SIGNS), self(), heartbeat),
    Line.

loop(#line{owner = Owner, program = Program} = Line) ->
    receive
        {Program, {data, Message}} ->
            ok = tell(event(Message, Line), Line),
            loop(Line);
        {Program, {exit_status, Status}} ->
            loop(ended(Status, Line));
        {'DOWN', _, process, Owner, _} ->
            exit(normal);
        {'EXIT', Program, epipe} ->
            loop(ended(starl_create_program:broken(), Line));
        {'EXIT', Ended, _} when is_port(Ended) ->
            loop(Line);
        {'EXIT', _, Reason} ->
            exit({shutdown, Reason});
        heartbeat ->
            ok = command(Line, <<$H>>),
            loop(beat(Line));
        Request ->
            loop(request(Request, Line))
    end.

%% One that cannot run here never will.
ended(Status, Line) ->
    case starl_create_program:ended(Status) of
        {error, Reason} ->
            ok = tell(failed(Reason, "", Line), Line),
            Line#line{program = {none, Reason}};
        ended ->
            ok = tell({closed, {program, Status}}, Line),
            exit(normal)
    end.

%% The program may have ended a moment ago; its exit status is on the way. Of more bytes than the line
%% takes the rest is lost, and that is said; other requests wait their turn.
command(#line{program = {none, _}}, _Bytes) ->
    ok;
command(#line{program = Program} = Line, <<Kind, _/binary>> = Bytes) ->
    try port_command(Program, Bytes, [nosuspend || Kind =:= $W orelse Kind =:= $H]) of
        true -> ok;
        false when Kind =:= $H -> ok;
        false -> tell(failed(io, "more is sent than the line takes; the rest is lost", Line), Line)
    catch
        error:badarg -> ok
    end.

tell(Event, #line{owner = Owner}) ->
    Owner ! Event,
    ok.

request(Request, #line{program = {none, Reason}} = Line) ->
    ok =
        case is_open(Request) of
            true -> tell(failed(Reason, "", Line), Line);
            false -> ok
        end,
    Line;
request(Request, Line) ->
    try encoded(Request, Line) of
        {Bytes, Next} when byte_size(Bytes) =< 65535 ->
            ok = command(Line, Bytes),
            Next;
        {_, _} ->
            ok = tell(
                failed(bad_message, [name(Request), ": longer than 65535 bytes"], Line), Line
            ),
            Line
    catch
        error:Reason when Reason =:= function_clause; Reason =:= badarg ->
            ok = tell(failed(bad_message, [name(Request), ": no such request"], Line), Line),
            Line
    end.

is_open({open, _}) -> true;
is_open({open, _, _}) -> true;
is_open({connect}) -> true;
is_open(_) -> false.

name(Request) when is_tuple(Request), tuple_size(Request) > 0 -> name(element(1, Request));
name(Name) -> io_lib:format("~tp", [Name]).

encoded({open, Device, Baud}, Line) when is_integer(Baud), Baud > 0, Baud < 1 bsl 32 ->
    opened(Line#line{device = unicode:characters_to_list(Device), baud = Baud});
encoded({open, Device}, #line{baud = Baud} = Line) ->
    encoded({open, Device, Baud}, Line);
encoded({connect}, #line{device = [_ | _]} = Line) ->
    opened(Line);
encoded({send, Bytes}, Line) ->
    {iolist_to_binary([$W, Bytes]), Line};
encoded({drive_script, Mark, Steps, Stop}, Line) ->
    {script($D, Mark, Steps, Stop), Line};
encoded({join_script, Mark, Steps, Stop}, Line) ->
    {script($J, Mark, Steps, Stop), Line};
encoded({stop_bytes, Bytes}, Line) ->
    {iolist_to_binary([$Z, Bytes]), Line};
encoded(Close, Line) when Close =:= close; Close =:= {close}; Close =:= {disconnect} ->
    {<<$C>>, Line};
encoded(Control, Line) ->
    control(Control, Line).

%% The line itself.
control({pulse, Which, LowMs, Times}, Line) ->
    {<<$L, (control_line(Which)), LowMs:16, Times>>, Line};
control({break}, Line) ->
    {<<$B, ?BREAK_MS:16>>, Line};
control({break, Ms}, Line) ->
    {<<$B, Ms:16>>, Line};
control({speed, Baud}, Line) ->
    {<<$S, Baud:32>>, Line#line{baud = Baud}};
control({speed, Baud, Baud}, Line) ->
    control({speed, Baud}, Line).

opened(#line{device = Device, baud = Baud, heartbeat_ms = Ms} = Line) ->
    {<<$O, Baud:32, Ms:32, (unicode:characters_to_binary(Device))/binary>>, Line}.

script(Tag, Mark, Steps, Stop) ->
    End = iolist_to_binary(Stop),
    Script = [step(Step) || Step <- Steps],
    iolist_to_binary([Tag, <<Mark:64, (byte_size(End)):16>>, End, Script]).

step({Bytes, WaitUs}) when is_integer(WaitUs), WaitUs >= 0, WaitUs < 1 bsl 32 ->
    [<<WaitUs:32, (iolist_size(Bytes)):16>>, Bytes].

control_line(dtr) -> 0;
control_line(rts) -> 1.

event(<<$d, _At:64, Bytes/binary>>, _Line) ->
    {data, Bytes};
event(<<$s, Mark:64, At:64>>, _Line) ->
    {sent, Mark, starl_create_program:us(At)};
event(<<$n, Mark:64, At:64>>, _Line) ->
    {ended, Mark, starl_create_program:us(At)};
event(<<$x, At:64, Why/binary>>, _Line) ->
    {stopped, word(Why), starl_create_program:us(At)};
event(<<$o, _At:64, Device/binary>>, _Line) ->
    {opened, unicode:characters_to_list(Device)};
event(<<$p, _At:64, Priority/binary>>, _Line) ->
    {priority, word(Priority)};
event(<<$c, _At:64, Why/binary>>, _Line) ->
    {closed, word(Why)};
event(<<$e, Error/binary>>, Line) ->
    [Word, Detail] = binary:split(Error, <<0>>),
    failed(word(Word), Detail, Line).

word(Word) ->
    hd([Known || Known <- words(), atom_to_binary(Known, utf8) =:= Word]).

words() ->
    [no_device, permission, busy, not_serial, speed, io, closed, bad_message] ++
        [heartbeat, guardian, halted, unplugged, unguarded, realtime, raised, ordinary].

failed(Reason, Detail, #line{device = Device} = Line) ->
    Named =
        case Device of
            none -> "no device";
            _ -> Device
        end,
    {error,
        {Reason, unicode:characters_to_list(format_error({Reason, Named, Detail, Line#line.baud}))}}.

%% What is wrong and what to do, in a line.
-spec format_error({reason(), Device :: string(), Detail :: unicode:chardata(), Baud}) ->
    unicode:charlist()
when
    Baud :: pos_integer().
format_error({Reason, _, _, _}) when Reason =:= no_program; Reason =:= other_processor ->
    starl_create_program:format_error(Reason);
format_error({unguarded, Device, Detail, _}) ->
    [
        Device,
        ": this computer starts no process that guards the line (",
        decapital(Detail),
        "), so nothing would stop the wheels; end other processes, or raise the user's limit of them"
    ];
format_error({Reason, Device, Detail, Baud}) ->
    [Device, ": ", why(Reason, Detail, Baud)].

why(no_device, Detail, _Baud) ->
    [decapital(Detail), "; plug the adapter in; ", candidates()];
why(permission, _Detail, _Baud) ->
    "this user may not open it; join its group (sudo usermod -aG dialout $USER), log in again";
why(busy, Holder, _Baud) ->
    ["in use by ", Holder, "; end that first"];
why(not_serial, _Detail, _Baud) ->
    ["not a serial line; ", candidates()];
why(speed, _Detail, Baud) ->
    ["its driver does not do ", integer_to_list(Baud), " baud; try another adapter"];
why(closed, _Detail, _Baud) ->
    "not open; send {open, Device, Baud} first";
why(Reason, Detail, _Baud) when Reason =:= io; Reason =:= bad_message ->
    Detail.

decapital(Text) -> string:lowercase(Text).

%% The names that serial adapters get.
candidates() ->
    Patterns = ["/dev/ttyUSB*", "/dev/ttyACM*", "/dev/serial0", "/dev/ttyAMA*", "/dev/create*"],
    case lists:append([filelib:wildcard(Pattern) || Pattern <- Patterns]) of
        [] -> "this computer shows no serial adapter (/dev/ttyUSB*, ttyACM*, serial0)";
        Found -> ["there are ", lists:join(", ", Found)]
    end.
