%% @doc `./starl apps': lists the applications and the purpose of each.
-module(starl_cli_apps).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, about/1, run/1]).

-spec name() -> string().
name() -> "apps".

-spec synopsis() -> string().
synopsis() -> "list the applications".

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Lists your own applications in this directory, those that ship and the examples; ./starl run NAME "
        "runs one."
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(_Call) ->
    starl_cli_terminal:out(starl_cli_usage:items(starl_cli_target:purposes())),
    0.
