%% @doc The help of `./starl setup'. The script `./starl' itself runs this command.
-module(starl_dev_setup).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "setup",
        synopsis => "set up and build, nothing else",
        about => [
            "Installs Erlang/OTP and the libraries where they are missing and builds what has changed, as "
            "every command does first."
        ],
        statuses => [{0, "all is there"}],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> {error, [string(), ...]}.
run(_Call) -> {error, ["only the script ./starl runs this"]}.
