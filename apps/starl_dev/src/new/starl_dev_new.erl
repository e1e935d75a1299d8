%% @doc `./starl new': begins a project that uses StarL.
-module(starl_dev_new).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, subject/2, flags/1, run/1]).

-spec name() -> string().
name() -> "new".

-spec synopsis() -> string().
synopsis() -> "begin a project of your own".

-spec argument() -> starl_cli_command:argument().
argument() -> {required, "PROJECT", {example, "patrol"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Makes the directory PROJECT with a program for a team of robots, its contract, a scenario, a "
        "test, properties under random faults and a workflow for continuous integration. It depends "
        "on this StarL by one line: on the repository that it was cloned from, at this commit.",
        {lines, "  ./starl new patrol\n  cd patrol\n  rebar3 eunit"}
    ].

-spec subject(string(), [string()]) ->
    {ok, string(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Name, Args) ->
    case starl_new:check_name(Name) of
        ok -> {ok, Name, Args};
        {error, Why} -> {error, [Why]}
    end.

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) ->
    [
        {"Flags", [
            {block, switch, false,
                "a building block of your own, with its contract and its exercise"},
            {chassis, switch, false,
                "a robot with two wheels of your own, with the test of its contract"},
            {elixir, switch, false, "a mix project, with the program in Elixir"}
        ]}
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Name, values := Values}) ->
    case [Kind || Kind <- [block, chassis, elixir], maps:get(Kind, Values)] of
        [] -> project(Name, app);
        [Kind] -> project(Name, Kind);
        Kinds -> {error, [several(Kinds)]}
    end.

several(Kinds) ->
    [
        lists:join(" ", ["--" ++ atom_to_list(Kind) || Kind <- Kinds]),
        ": a project begins with one of them"
    ].

project(Name, Kind) ->
    case starl_new:make(Name, Kind, starl_cli_target:root()) of
        {ok, Files} -> made(Name, Kind, Files);
        {error, Why} -> {error, [Why]}
    end.

made(Name, Kind, Files) ->
    [starl_cli_terminal:out(["* ", File, "\n"]) || File <- Files],
    starl_cli_terminal:out(["next: cd ", Name, " && ", first(Kind), "\n"]),
    0.

first(elixir) -> "mix deps.get && mix test";
first(_Erlang) -> "rebar3 eunit".
