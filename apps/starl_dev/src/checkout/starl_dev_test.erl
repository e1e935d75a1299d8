%% @doc The help of `./starl test'. The script `./starl' itself runs this command.
-module(starl_dev_test).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, flags/1, statuses/0, subject/2, run/1]).

-spec name() -> string().
name() -> "test".

-spec synopsis() -> string().
synopsis() -> "run every test, or some".

-spec argument() -> starl_cli_command:argument().
argument() -> {optional, "MODULE...", {example, "starl_sap_SUITE"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Runs xref, then EUnit, then Common Test, and ends with the line 'N passed, N failed'. With "
        "names, only those modules run: NAME_SUITE is a Common Test suite, any other is a module for "
        "EUnit. Error reports of crashes that tests provoke go to _build/starl/errors.log."
    ].

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) ->
    [
        {"Flags", [
            {quick, switch, false, "only xref and the quick tests of EUnit, in less than a minute"}
        ]}
    ].

-spec statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses() -> [{0, "all passed"}, {1, "some failed, or a call goes upwards"}].

-spec subject(string(), [string()]) -> {ok, string(), [string()]}.
subject(Word, Args) -> {ok, Word, Args}.

-spec run(starl_cli_command:call()) -> {error, [string(), ...]}.
run(_Call) -> {error, ["only the script ./starl runs this"]}.
