%% @doc The help of `./starl shell'. The script `./starl' itself runs this command.
-module(starl_lab_shell).
-behaviour(starl_cli_command).

-export([command/0]).
-export([prepare/1]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "shell",
        synopsis => "an Erlang shell with StarL loaded",
        argument => {optional, "ARGS...", {example, "-sname a"}},
        subject => fun subject/2,
        about => [
            "An Erlang shell with the code of StarL on its path. doc/commands.md has first "
            "steps; arguments are those of erl."
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) -> {ok, string(), [string()]}.
subject(Word, Args) -> {ok, Word, Args}.

-spec run(starl_cli_command:call()) -> {error, [string(), ...]}.
run(_Call) -> {error, ["only the script ./starl runs this"]}.

%% @doc Prepares the shell, at its start: the applications of StarL are loaded, and a robot's crash or
%% end is one line on the screen.
-spec prepare([atom()]) -> ok.
prepare(Apps) ->
    _ = [application:load(App) || App <- Apps],
    {Id, Filter} = starl_cli_log:filter(),
    _ = logger:add_handler_filter(default, Id, Filter),
    Own = {fun logger_filters:domain/2, {log, sub, [starl]}},
    _ = logger:add_handler_filter(default, starl, Own),
    _ = logger:update_formatter_config(default, #{
        legacy_header => false, single_line => true, template => [msg, "\n"]
    }),
    ok.
