%% @doc `./starl faults': lists the kinds of faults, one line each.
-module(starl_cli_faults).
-behaviour(starl_cli_command).

-export([command/0]).
-export([values/2, worlds/1]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "faults",
        synopsis => "list the kinds of faults",
        about => [
            "Lists what can go wrong in a simulation: class, kind, whom it hits, parameters, and what it "
            "does. A scenario has faults as {Id, FromMs, ToMs, Kind, Target, Params}:",
            {lines,
                "  faults => [{away, 2000, 9000, isolate, 3, #{}},\n"
                "             {bad, 0, 60000, loss, all, #{part => 0.2}}]"},
            "or, drawn from the seed, random_faults => [network, kill_machine], classes and kinds. "
            "Targets: robots is all or one Robot; robot a Robot; machine {Robot, Machine}; link all, the "
            "Robot that sends, or {From, To}; group a list of robots; two {A, B}; floor all. Kinds that are "
            "marked can be played in real time, too: live by ./starl run --live and ./starl cluster, nodes by "
            "the latter alone."
        ],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(_Call) ->
    Width = starl_cli_terminal:columns(),
    Classes = [class(Class, Width) || Class <- starl_run_fault:classes()],
    starl_cli_terminal:out(lists:join("\n", Classes)),
    0.

class(Class, Width) ->
    [atom_to_list(Class), ":\n" | [kind(Spec, Width) || Spec <- starl_run_fault:kinds_of(Class)]].

%% The kind with its target and parameters, and what it does, which may need lines of its own.
kind({Kind, _Class, Target, Specs, Doc}, Width) ->
    Texts = [[atom_to_list(Key), " ", values(Key, Type)] || {Key, Type, _} <- Specs],
    Params = starl_cli_terminal:wrap(lists:join(", ", Texts), 30, Width),
    Head = [string:pad(atom_to_list(Target), 9), Params],
    [
        io_lib:format("  ~-18ts ", [Kind]),
        string:trim(Head, trailing),
        "\n      ",
        starl_cli_terminal:wrap([Doc, in_real_time(worlds(Kind))], 6, Width),
        "\n"
    ].

in_real_time("") -> "";
in_real_time(Worlds) -> [" [", Worlds, "]"].

%% @doc Where a kind can be played in real time: `live', here and on nodes; `nodes', on nodes only; or nowhere.
-spec worlds(starl_run_fault:kind()) -> string().
worlds(Kind) ->
    case
        [lists:keymember(Kind, 1, starl_run_manual_fault:kinds(World)) || World <- [one_vm, nodes]]
    of
        [true, _] -> "live";
        [false, true] -> "nodes";
        [false, false] -> ""
    end.

%% @doc The values of a parameter, with their unit.
-spec values(Key :: atom(), starl_options:type()) -> iolist().
values(Key, Type) -> [type(Type), unit(Key)].

type({one_of, Atoms}) -> lists:join("|", [atom_to_list(Atom) || Atom <- Atoms]);
type({_, Low, High}) -> io_lib:format("~b..~b", [Low, High]).

%% A key ends with its unit. A key without a unit is a fraction or a number.
unit(Key) ->
    case lists:last(string:lexemes(atom_to_list(Key), "_")) of
        "ms" -> " ms";
        "mm" -> " mm";
        "ppm" -> " ppm";
        _ -> ""
    end.
