%% @doc `./starl chassis': checks that a user's own chassis keeps its contract.
-module(starl_fleet_chassis_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "chassis",
        synopsis => "hold a chassis of your own to its contract",
        argument => {required, "ACTION", {example, "check"}},
        subject => fun subject/2,
        about => [
            "A robot of your own is driven by a module (FILE.erl) or by any program (exec:PROGRAM, with its "
            "arguments in the same word, as in \"exec:./my_robot.py --port 1\"). doc/chassis.md tells how.",
            {list, "Actions", [
                {"check CHASSIS",
                    "drives it, and looks whether it keeps the contract: ends its leg by itself, stops, "
                    "is not late, refuses what it cannot do. It moves by less than 200 mm"}
            ]}
        ],
        statuses => [{0, "it keeps the contract"}, {3, "it does not"}],
        run => fun run/1
    }.

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
