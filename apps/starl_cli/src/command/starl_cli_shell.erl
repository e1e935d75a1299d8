%% @doc The help of `./starl shell'. The script `./starl' itself runs this command.
-module(starl_cli_shell).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, subject/2, run/1]).

-spec name() -> string().
name() -> "shell".

-spec synopsis() -> string().
synopsis() -> "an Erlang shell with StarL loaded".

-spec argument() -> starl_cli_command:argument().
argument() -> {optional, "ARGS...", {example, "-sname a"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "An Erlang shell with the code of StarL on its path. README, \"In the shell\", has first "
        "steps; arguments are those of erl."
    ].

-spec subject(string(), [string()]) -> {ok, string(), [string()]}.
subject(Word, Args) -> {ok, Word, Args}.

-spec run(starl_cli_command:call()) -> {error, [string(), ...]}.
run(_Call) -> {error, ["only the script ./starl runs this"]}.
