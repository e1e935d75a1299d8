%% The command line in a VM of its own: its exit status and what it prints.
-module(starl_cli_vm).
-include_lib("eunit/include/eunit.hrl").

-export([
    says/3,
    contains/2,
    narrow/1,
    start/1,
    rest/2,
    until/3,
    interrupt/1,
    signal/2,
    printed/2,
    in_directory/1
]).

says(Status, Part, Args) ->
    {Got, Text} = rest(start(Args), ""),
    ?assertEqual({Status, Args, Text}, {Got, Args, Text}),
    contains(Part, Text),
    Text.

contains(Part, Text) ->
    ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text}).

%% Fails with the lines that are wider than 80 columns.
narrow(Text) -> ?assertEqual([], [L || L <- string:split(Text, "\n", all), string:length(L) > 80]).

start(Args) ->
    Paths = lists:append([["-pa", Dir] || Dir <- code:get_path(), filelib:is_dir(Dir)]),
    Main = "starl_cli:main(init:get_plain_arguments()).",
    open_port({spawn_executable, os:find_executable("erl")}, [
        {args, ["-noshell", "+fnu" | Paths] ++ ["-eval", Main, "-extra" | Args]},
        exit_status,
        stderr_to_stdout,
        hide
    ]).

rest(Port, Text) ->
    receive
        {Port, {data, More}} -> rest(Port, Text ++ More);
        {Port, {exit_status, Status}} -> {Status, Text}
    end.

until(Part, Port, Text) ->
    case string:find(Text, Part) of
        nomatch ->
            receive
                {Port, {data, More}} -> until(Part, Port, Text ++ More);
                {Port, {exit_status, Status}} -> error({ended, Status, Text})
            end;
        _ ->
            Text
    end.

%% The arguments of a command that was printed behind a word, as a shell takes them.
printed(Key, Text) ->
    [_, Rest] = string:split(Text, "\n" ++ Key),
    [Line | _] = string:split(Rest, "\n"),
    ["./starl" | Args] = string:lexemes(
        os:cmd("for a in " ++ Line ++ "; do printf '%s\\n' \"$a\"; done"), "\n"
    ),
    Args.

in_directory(Test) ->
    Dir = filename:join("/tmp", "starl-cli-vm-" ++ os:getpid()),
    _ = file:del_dir_r(Dir),
    ok = file:make_dir(Dir),
    try
        Test(Dir)
    after
        ok = file:del_dir_r(Dir)
    end.

%% The script sends the first Ctrl-C on as SIGUSR1.
interrupt(Port) -> signal("USR1", Port).

signal(Signal, Port) ->
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    "" = os:cmd("kill -" ++ Signal ++ " " ++ integer_to_list(Pid)),
    ok.
