%% @doc The help of `./starl setup'. The script `./starl' itself runs this command.
-module(starl_dev_setup).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, about/1, statuses/0, run/1]).

-spec name() -> string().
name() -> "setup".

-spec synopsis() -> string().
synopsis() -> "set up and build, nothing else".

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Installs Erlang/OTP and the libraries where they are missing and builds what has changed, as "
        "every command does first."
    ].

-spec statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses() -> [{0, "all is there"}].

-spec run(starl_cli_command:call()) -> {error, [string(), ...]}.
run(_Call) -> {error, ["only the script ./starl runs this"]}.
