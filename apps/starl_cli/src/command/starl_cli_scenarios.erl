%% @doc `./starl scenarios': lists the shipped scenarios and the purpose of each.
-module(starl_cli_scenarios).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, about/1, run/1]).

-spec name() -> string().
name() -> "scenarios".

-spec synopsis() -> string().
synopsis() -> "list the scenarios".

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) -> ["Lists the scenarios that ship; ./starl run NAME runs one."].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(_Call) ->
    Found = [{Name, Doc} || {Name, _, Doc} <- starl_cli_target:scenarios()],
    starl_cli_terminal:out(starl_cli_usage:items(Found)),
    0.
