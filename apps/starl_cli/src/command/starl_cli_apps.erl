%% @doc `./starl apps': lists the applications and the purpose of each.
-module(starl_cli_apps).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "apps",
        synopsis => "list the applications",
        about => [
            "Lists your own applications in this directory, those that ship and the examples; ./starl run NAME "
            "runs one."
        ],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(_Call) ->
    starl_cli_terminal:out(starl_cli_usage:items(starl_cli_target:purposes())),
    0.
