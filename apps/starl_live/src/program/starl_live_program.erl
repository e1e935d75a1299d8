%% @doc Runs a program beside the VM, and exchanges lines with it over its standard input and
%% output. What it prints to its standard error goes to the terminal.
%% ```
%%     {ok, Program} = starl_live_program:start(["./my_robot.py"]),
%%     ok = starl_live_program:send("{\"op\":\"ping\",\"n\":1}", Program),
%%     receive Message -> starl_live_program:hear(Message, Program) end     % {[{line, Line}], Program1}
%% '''
%% Everything that comes from the program is bounded: the length of a line, and the lines in a
%% second. The program should end when its standard input closes, at the latest when the VM ends. If
%% it does not, {@link stop/1} kills it with all its children.
-module(starl_live_program).

-export([start/1, words/1, send/2, hear/2, stop/1, kill/1]).

-export_type([t/0, line/0]).

-record(program, {
    port :: port(),
    os_pid :: non_neg_integer() | none,
    %% the beginning of a line whose end has not come; `long': it is too long already
    part = <<>> :: binary() | long,
    %% lines in this second
    second = 0 :: integer(),
    lines = 0 :: non_neg_integer()
}).

-opaque t() :: #program{}.

%% A line without its end; one that was too long, and was dropped.
-type line() :: {line, binary()} | long.

-define(LINE_BYTES, 4096).
-define(LINES_A_SECOND, 2000).
%% The time that it has to end by itself, in looks.
-define(LOOK_MS, 20).
-define(LOOKS, 50).

%% @doc Splits a command into words at blanks. There are no quotes.
-spec words(string()) -> [string()].
words(Command) -> string:lexemes(Command, " \t").

%% @doc Starts a program, with its arguments. The calling process gets its messages.
-spec start([string(), ...]) -> {ok, t()} | {error, unicode:chardata()}.
start([Name | Args]) ->
    case found(Name) of
        {ok, Path} -> opened(Path, Args);
        {error, _} = Error -> Error
    end.

found(Name) ->
    Path =
        case lists:member($/, Name) of
            true -> filename:absname(Name);
            false -> os:find_executable(Name)
        end,
    case Path =/= false andalso filelib:is_regular(Path) of
        true -> {ok, Path};
        false -> {error, [Name, ": there is no such program", beside(Name)]}
    end.

beside(Name) ->
    case filelib:is_regular(Name) of
        true -> ["; did you mean ./", Name, "?"];
        false -> ""
    end.

%% A Python would else keep its lines until it ends.
opened(Path, Args) ->
    Options = [
        {args, Args},
        {env, [{"PYTHONUNBUFFERED", "1"}]},
        binary,
        exit_status,
        use_stdio
    ],
    try open_port({spawn_executable, Path}, Options) of
        Port -> {ok, #program{port = Port, os_pid = os_pid(Port)}}
    catch
        error:eacces -> {error, [Path, ": is not executable; say: chmod +x ", Path]};
        error:Why -> {error, io_lib:format("~ts: ~0tp", [Path, Why])}
    end.

os_pid(Port) ->
    case erlang:port_info(Port, os_pid) of
        {os_pid, Pid} when Pid > 1 -> Pid;
        undefined -> none
    end.

%% @doc Sends a line. `hung': the program has read nothing for so long that its pipe is full.
-spec send(iodata(), t()) -> ok | hung.
send(Line, #program{port = Port}) ->
    try port_command(Port, [Line, $\n], [nosuspend]) of
        true -> ok;
        false -> hung
    catch
        %% it has ended; its end is in the mailbox
        error:badarg -> ok
    end.

%% @doc Handles a message of the process: whole lines; or why nothing more comes.
-spec hear(term(), t()) -> {[line()], t()} | {ended, unicode:chardata()} | unknown.
hear({Port, {data, Data}}, #program{port = Port} = Program) ->
    counted(heard(Data, Program));
hear({Port, {exit_status, Status}}, #program{port = Port}) ->
    {ended, ended(Status)};
%% With a command under way to it there is no status.
hear({'EXIT', Port, _Why}, #program{port = Port}) ->
    {ended, "has ended, or reads no more"};
hear(_Message, _Program) ->
    unknown.

ended(0) -> "has ended";
ended(Status) when Status > 128 -> io_lib:format("was killed by signal ~b", [Status - 128]);
ended(Status) -> io_lib:format("has ended with status ~b", [Status]).

heard(Data, #program{part = long} = Program) ->
    case binary:split(Data, <<"\n">>) of
        [_Rest, More] -> long(heard(More, Program#program{part = <<>>}));
        [_More] -> {[], Program}
    end;
heard(Data, #program{part = Part} = Program) ->
    All = binary:split(<<Part/binary, Data/binary>>, <<"\n">>, [global]),
    {Whole, Rest} = {lists:droplast(All), lists:last(All)},
    Lines = [line(trimmed(Line)) || Line <- Whole],
    Left =
        case byte_size(Rest) > ?LINE_BYTES of
            true -> long;
            false -> Rest
        end,
    {[Line || Line <- Lines, Line =/= {line, <<>>}], Program#program{part = Left}}.

long({Lines, Program}) -> {[long | Lines], Program}.

line(Line) when byte_size(Line) > ?LINE_BYTES -> long;
line(Line) -> {line, Line}.

trimmed(Line) -> string:trim(Line, both, "\r\t ").

%% A part of a line counts, too.
counted({Lines, #program{second = Second, lines = N} = Program}) ->
    Count = max(1, length(Lines)),
    case erlang:monotonic_time(second) of
        Second when N + Count > ?LINES_A_SECOND ->
            {ended, io_lib:format("says more than ~b lines in a second", [?LINES_A_SECOND])};
        Second ->
            {Lines, Program#program{lines = N + Count}};
        Later ->
            {Lines, Program#program{second = Later, lines = Count}}
    end.

%% @doc Closes its standard input, and kills it with its children if it does not end by that.
-spec stop(t()) -> ended | killed.
stop(#program{port = Port, os_pid = Pid}) ->
    true = unlink(Port),
    _ =
        try
            port_close(Port)
        catch
            error:badarg -> true
        end,
    apart(fun() -> gone(?LOOKS, Pid) end).

%% The mailbox of this process may be full of what the program has said.
apart(Do) ->
    {Parent, Mark} = {self(), make_ref()},
    {_, Ref} = spawn_monitor(fun() -> Parent ! {Mark, Do()} end),
    receive
        {Mark, Answer} ->
            true = erlang:demonitor(Ref, [flush]),
            Answer;
        {'DOWN', Ref, process, _, Reason} ->
            exit(Reason)
    end.

%% @doc Kills it with its children, at once. It is heard of as of any other end.
-spec kill(t()) -> ok.
kill(#program{os_pid = none}) ->
    ok;
kill(#program{os_pid = Pid}) ->
    killed = apart(fun() -> killed(Pid) end),
    ok.

%% Each program leads a group of its own.
killed(Pid) ->
    _ = os:cmd("kill -9 -" ++ integer_to_list(Pid)),
    killed.

gone(_Looks, none) ->
    ended;
gone(0, Pid) ->
    killed(Pid);
gone(Looks, Pid) ->
    case os:cmd("kill -0 -" ++ integer_to_list(Pid) ++ " 2>&1") of
        "" ->
            receive
            after ?LOOK_MS -> gone(Looks - 1, Pid)
            end;
        _NoSuchProcess ->
            ended
    end.
