%% @doc `./starl scenarios': lists the shipped scenarios and the purpose of each.
-module(starl_cli_scenarios).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "scenarios",
        synopsis => "list the scenarios",
        about => ["Lists the scenarios that ship; ./starl run NAME runs one."],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(_Call) ->
    Found = [{Name, Doc} || {Name, _, Doc} <- starl_cli_target:scenarios()],
    starl_cli_terminal:out(starl_cli_usage:items(Found)),
    0.
