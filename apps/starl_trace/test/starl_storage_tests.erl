%% Recordings in a storage: rclone's own WebDAV server, behind a line that is cut.
-module(starl_storage_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PATIENCE_S, 270).
-define(PIECE, 65536).
-define(CUTS, 20).
-define(PIECES, 21).
%% A connection that is cut has carried so much of a piece.
-define(CUT_AT, 40000).
-define(OPTIONS, #{piece_bytes => ?PIECE, tries => 3, pause_ms => 1}).

%% Skipped with a line where rclone is absent.
all_test_() ->
    case starl_storage_rclone:find() of
        {ok, _} ->
            [
                {Name, {timeout, ?PATIENCE_S, Test}}
             || {Name, Test} <- [
                    {"cut twenty times", fun cut_twenty_times/0},
                    {"while it is written", fun while_it_is_written/0},
                    {"many robots, by run", fun by_run/0},
                    {"damaged", fun damaged/0},
                    {"wrong remotes", fun wrong_remotes/0}
                ]
            ];
        {error, Reason} ->
            io:format(user, "storage: skipped, ~ts~n", [starl_storage:format_error(Reason)]),
            []
    end.

without_rclone_test() ->
    Path = os:getenv("PATH"),
    try
        true = os:putenv("PATH", "/nowhere"),
        in_directory(fun(Dir) ->
            {error, no_rclone = Reason} = starl_storage:upload(
                file(Dir, "a.mcap", 1, 10), Dir, #{}
            ),
            ?assertMatch(
                {match, _}, re:run(starl_storage:format_error(Reason), "apt install rclone")
            )
        end)
    after
        true = os:putenv("PATH", Path)
    end.

%% Every piece but the last is cut once in the middle, then a try gets through: the result is equal,
%% each cut costs one piece, and what has its name is whole at every moment that is looked at.
cut_twenty_times() ->
    in_directory(fun(Dir) ->
        File = file(Dir, "run.mcap", 1, ?PIECES * ?PIECE - 100),
        Store = filename:join(Dir, "store"),
        ok = file:make_dir(Store),
        served(Store, ?CUTS, fun(Remote, Cuts) ->
            Tries = counters:new(1, []),
            Sent = fun(_Bytes) ->
                ?assertEqual([], half_written(Store)),
                counters:add(Tries, 1, 1)
            end,
            {ok, #{pieces := ?PIECES, sent := ?PIECES}} =
                starl_storage:upload(File, Remote, ?OPTIONS#{sent => Sent}),
            ?assertEqual(?CUTS, counters:get(Cuts, 1)),
            ?assertEqual(?PIECES + ?CUTS, counters:get(Tries, 1)),
            ?assertEqual([], half_written(Store)),
            ?assertEqual([], filelib:wildcard(Store ++ "/**/*.part")),
            {ok, [Entry]} = starl_storage:list(Remote),
            Copy = filename:join(Dir, "copy.mcap"),
            {ok, fetched} = starl_storage:download(Entry, Remote, Copy, ?OPTIONS),
            ?assertEqual(file:read_file(File), file:read_file(Copy)),
            {ok, is_there} = starl_storage:download(Entry, Remote, Copy, ?OPTIONS),
            {ok, #{sent := 0}} = starl_storage:upload(File, Remote, ?OPTIONS)
        end)
    end).

%% A file under its final name that is not what it should be.
half_written(Store) ->
    [
        File
     || File <- filelib:wildcard(Store ++ "/pieces/*"),
        filename:extension(File) =/= ".part",
        hash(File) =/= filename:basename(File)
    ].

hash(File) ->
    {ok, Bytes} = file:read_file(File),
    string:lowercase(binary_to_list(binary:encode_hex(crypto:hash(sha256, Bytes)))).

%% What is whole of a file that grows is there before its end is written, and is not sent again; the line is
%% cut meanwhile. A storage that is not reached is told, and tried again.
%% Holds: `--upload` sends what is whole while the run goes on, over a line that is cut, and the
%% rest at its end
%% Red: with a sender that sends nothing, run (the first); without the end of `tell/2`, run (the
%% second)
while_it_is_written() ->
    in_directory(fun(Dir) ->
        Whole = file(Dir, "whole.mcap", 1, 5 * ?PIECE + 100),
        {ok, Bytes} = file:read_file(Whole),
        File = filename:join(Dir, "run.mcap"),
        Store = filename:join(Dir, "store"),
        ok = file:make_dir(Store),
        served(Store, 2, fun(Remote, Cuts) ->
            Never = ?OPTIONS#{every_ms => 3_600_000},
            {ok, Sender} = starl_storage_sender:start(fun() -> [File] end, Remote, Never),
            ?assertMatch(#{trouble := {file, File, enoent}}, starl_storage_sender:look(Sender)),
            ok = file:write_file(File, binary:part(Bytes, 0, 3 * ?PIECE + 50)),
            ?assertEqual(#{sent => 3, trouble => none}, starl_storage_sender:look(Sender)),
            ?assertEqual(3, length(filelib:wildcard(Store ++ "/pieces/*"))),
            ?assertEqual([], filelib:wildcard(Store ++ "/runs/*")),
            ok = file:write_file(File, Bytes),
            ?assertEqual(#{sent => 5, trouble => none}, starl_storage_sender:look(Sender)),
            ?assertEqual(#{sent => 5, trouble => none}, starl_storage_sender:stop(Sender)),
            ?assertEqual(2, counters:get(Cuts, 1)),
            ?assertEqual([], half_written(Store)),
            {ok, #{pieces := 6, sent := 1}} = starl_storage:upload(File, Remote, ?OPTIONS)
        end)
    end).

%% A directory is a remote, too. Robots of one run are together; a file that has grown costs its end.
by_run() ->
    in_directory(fun(Dir) ->
        Store = filename:join(Dir, "store"),
        Up = fun(File) ->
            {ok, Done} = starl_storage:upload(File, Store, ?OPTIONS),
            Done
        end,
        #{run := Run1} = Up(file(Dir, "robot-1.mcap", 1, 100)),
        #{run := Run1} = Up(file(Dir, "robot-2.mcap", 1, 3 * ?PIECE)),
        #{run := Run2} = Up(file(Dir, "robot-3.mcap", 2, 100)),
        ?assertNotEqual(Run1, Run2),
        {ok, Entries} = starl_storage:list(Store),
        ?assertEqual(
            lists:sort([
                {Run1, "robot-1.mcap"}, {Run1, "robot-2.mcap"}, {Run2, "robot-3.mcap"}
            ]),
            lists:sort([{R, N} || #{run := R, name := N} <- Entries])
        ),
        Grown = filename:join(Dir, "robot-2.mcap"),
        ok = file:write_file(Grown, <<"more">>, [append]),
        #{pieces := Pieces, sent := 1} = Up(Grown),
        ?assert(Pieces > 2)
    end).

damaged() ->
    in_directory(fun(Dir) ->
        Store = filename:join(Dir, "store"),
        File = file(Dir, "a.mcap", 1, 2 * ?PIECE),
        {ok, _} = starl_storage:upload(File, Store, ?OPTIONS),
        {ok, [Entry]} = starl_storage:list(Store),
        [Piece | _] = filelib:wildcard(Store ++ "/pieces/*"),
        {ok, <<Byte, Rest/binary>>} = file:read_file(Piece),
        ok = file:write_file(Piece, <<(Byte bxor 1), Rest/binary>>),
        Copy = filename:join(Dir, "copy.mcap"),
        {error, {damaged, _}} = starl_storage:download(Entry, Store, Copy, ?OPTIONS),
        ?assertNot(filelib:is_file(Copy)),
        %% what is of the right length is taken to be right; what is not is sent again
        ok = file:write_file(Piece, Rest),
        {ok, #{sent := 1}} = starl_storage:upload(File, Store, ?OPTIONS),
        {ok, fetched} = starl_storage:download(Entry, Store, Copy, ?OPTIONS),
        ok = file:write_file(Copy, <<"another">>),
        {error, {file, Copy, eexist}} = starl_storage:download(Entry, Store, Copy, ?OPTIONS)
    end).

wrong_remotes() ->
    in_directory(fun(Dir) ->
        File = file(Dir, "a.mcap", 1, 10),
        {error, {refused, "starlnowhere:a", _} = Refused} =
            starl_storage:upload(File, "starlnowhere:a", ?OPTIONS),
        ?assertMatch(
            {match, _}, re:run(starl_storage:format_error(Refused), "rclone config adds one")
        ),
        {ok, Socket} = gen_tcp:listen(0, [{ip, {127, 0, 0, 1}}]),
        {ok, Port} = inet:port(Socket),
        ok = gen_tcp:close(Socket),
        at(Port, fun(Remote) ->
            {error, {lost, Remote, _} = Lost} = starl_storage:upload(File, Remote, ?OPTIONS),
            ?assertMatch({match, _}, re:run(starl_storage:format_error(Lost), "start again later"))
        end),
        NoFile = filename:join(Dir, "b.mcap"),
        {error, Reason} = starl_storage:upload(NoFile, Dir, ?OPTIONS),
        ?assertMatch({match, _}, re:run(starl_storage:format_error(Reason), "b.mcap"))
    end).

%% -- recordings -------------------------------------------------------------------------------

%% A recording of a run with at least so many bytes.
file(Dir, Name, Run, Bytes) ->
    Facts = #{
        kind => live,
        app => made,
        scenario => #{seed => 1},
        robots => [{1, {0.0, 0.0, 0.0}}],
        monitors => [],
        machines => #{},
        waypoints => #{},
        run => Run
    },
    {Head, Writer0} = starl_trace_writer:new(),
    {Begun, Writer} = starl_trace_writer:messages([{scenario, 0, Facts}], Writer0),
    Whole = iolist_to_binary([Head, Begun, starl_trace_writer:finish(Writer)]),
    _ = rand:seed(exsss, {Run, Bytes, length(Name)}),
    Rest = rand:bytes(max(0, Bytes - byte_size(Whole))),
    File = filename:join(Dir, Name),
    ok = file:write_file(File, [Whole, Rest]),
    File.

in_directory(Test) ->
    Dir = filename:join("/tmp", "starl-storage-tests-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Test(Dir)
    after
        ok = file:del_dir_r(Dir)
    end.

%% -- the server and the line ------------------------------------------------------------------

served(Store, Cuts, Test) ->
    {ok, Program} = starl_storage_rclone:find(),
    Args = ["serve", "webdav", Store, "--addr", "127.0.0.1:0", "--dir-cache-time", "0s"],
    Server = open_port({spawn_executable, Program}, [{args, Args}, exit_status, stderr_to_stdout]),
    try
        Done = counters:new(1, []),
        Line = line(port_of(Server, ""), Cuts, Done),
        at(Line, fun(Remote) -> Test(Remote, Done) end)
    after
        {os_pid, Pid} = erlang:port_info(Server, os_pid),
        os:cmd("kill " ++ integer_to_list(Pid))
    end.

port_of(Server, Text) ->
    receive
        {Server, {data, More}} ->
            All = Text ++ More,
            case re:run(All, "http://127.0.0.1:([0-9]+)/", [{capture, [1], list}]) of
                {match, [Port]} -> list_to_integer(Port);
                nomatch -> port_of(Server, All)
            end
    end.

at(Port, Test) ->
    Variables = [
        {"RCLONE_WEBDAV_URL", "http://127.0.0.1:" ++ integer_to_list(Port)},
        {"RCLONE_WEBDAV_VENDOR", "other"},
        {"RCLONE_CONFIG", "/dev/null"}
    ],
    [true = os:putenv(Key, Value) || {Key, Value} <- Variables],
    try
        Test(":webdav:")
    after
        [true = os:unsetenv(Key) || {Key, _} <- Variables]
    end.

%% A line to a port of this computer that is cut so many times: of the connections that carry much
%% every second one.
line(To, Cuts, Done) ->
    Self = self(),
    spawn_link(fun() ->
        Options = [binary, {active, false}, {ip, {127, 0, 0, 1}}, {reuseaddr, true}],
        {ok, Listen} = gen_tcp:listen(0, Options),
        Self ! {line, inet:port(Listen)},
        Turn = atomics:new(1, []),
        accepts(Listen, To, {Cuts, Done, Turn})
    end),
    receive
        {line, {ok, Port}} -> Port
    end.

accepts(Listen, To, Cutting) ->
    {ok, Client} = gen_tcp:accept(Listen),
    Pid = spawn(fun() ->
        receive
            yours -> ok
        end,
        {ok, Server} = gen_tcp:connect({127, 0, 0, 1}, To, [binary, {active, true}]),
        ok = inet:setopts(Client, [{active, true}]),
        carries(Client, Server, 0, Cutting)
    end),
    ok = gen_tcp:controlling_process(Client, Pid),
    Pid ! yours,
    accepts(Listen, To, Cutting).

carries(Client, Server, Carried, Cutting) ->
    receive
        {tcp, Client, Bytes} ->
            Now = Carried + byte_size(Bytes),
            case Carried < ?CUT_AT andalso Now >= ?CUT_AT andalso is_cut(Cutting) of
                true ->
                    _ = gen_tcp:send(Server, binary:part(Bytes, 0, byte_size(Bytes) div 2)),
                    _ = gen_tcp:close(Server),
                    gen_tcp:close(Client);
                false ->
                    _ = gen_tcp:send(Server, Bytes),
                    carries(Client, Server, Now, Cutting)
            end;
        {tcp, Server, Bytes} ->
            _ = gen_tcp:send(Client, Bytes),
            carries(Client, Server, Carried, Cutting);
        {tcp_closed, _} ->
            _ = gen_tcp:close(Server),
            gen_tcp:close(Client)
    end.

is_cut({Cuts, Done, Turn}) ->
    case atomics:add_get(Turn, 1, 1) rem 2 =:= 1 andalso counters:get(Done, 1) < Cuts of
        true ->
            ok = counters:add(Done, 1, 1),
            true;
        false ->
            false
    end.
