%% @doc `./starl chassis': checks that a user's own chassis keeps its contract.
-module(starl_fleet_chassis_command).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, statuses/0, subject/2, run/1]).

-spec name() -> string().
name() -> "chassis".

-spec synopsis() -> string().
synopsis() -> "hold a chassis of your own to its contract".

-spec argument() -> starl_cli_command:argument().
argument() -> {required, "ACTION", {example, "check"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "A robot of your own is driven by a module (FILE.erl) or by any program (exec:PROGRAM, with its "
        "arguments in the same word, as in \"exec:./my_robot.py --port 1\"). doc/chassis.md tells how.",
        {list, "Actions", [
            {"check CHASSIS",
                "drives it, and looks whether it keeps the contract: ends its leg by itself, stops, "
                "is not late, refuses what it cannot do. It moves by less than 200 mm"}
        ]}
    ].

-spec statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses() -> [{0, "it keeps the contract"}, {3, "it does not"}].

-spec subject(string(), [string()]) -> {ok, starl_cli_command:subject(), [string()]}.
subject("check", [[C | _] = Chassis | Args]) when C =/= $- -> {ok, {check, Chassis}, Args};
subject("check", Args) -> {ok, {check, none}, Args};
subject(Word, Args) -> {ok, {unknown, Word}, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := {unknown, Word}}) ->
    {error, [["there is no ", Word, "; there is check"]]};
run(#{subject := {check, none}}) ->
    {error, ["check which chassis? FILE.erl, or exec:PROGRAM"]};
run(#{subject := {check, Text}}) ->
    Name = unicode:characters_to_binary(Text),
    case starl_chassis_choice:own(Name) =/= none andalso driver(Name) of
        false -> {error, [[Text, " is no chassis of your own: FILE.erl, or exec:PROGRAM"]]};
        {ok, Driver, _Code} -> print(starl_live_chassis_check:check(Driver));
        {error, _} = Error -> Error
    end.

driver(Name) -> starl_live_own:driver(Name, fun starl_cli_source:driver/1).

print(Found) ->
    starl_cli_terminal:out([[starl_live_chassis_check:line(F), "\n"] || F <- Found]),
    case starl_live_chassis_check:broken(Found) of
        [] -> 0;
        _ -> 3
    end.
