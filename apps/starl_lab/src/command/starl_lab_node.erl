%% @doc `./starl node': starts a node that takes part in runs over several nodes.
-module(starl_lab_node).

-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "node",
        synopsis => "a node that waits for runs with --nodes",
        about => [
            "An Erlang node that waits for simulations: ./starl run TARGET --nodes NAME@HOST,... on "
            "another machine or this one spreads its robots over such nodes. All need the same StarL "
            "and reach each other by Erlang's distribution: port 4369 (epmd) and one more a node. "
            "It is not encrypted: use it in a network that you trust. Ctrl-C ends the node."
        ],
        flags => fun flags/1,
        run => fun run/1
    }.

flags(_Subject) ->
    [
        {"Flags", [
            {name, string, "starl", "the node's name, NAME or NAME@HOST as the others reach it"},
            starl_lab_cookie:flag()
        ]}
    ].

%% Waits for runs until Ctrl-C.
-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := Values}) -> serve(Values).

serve(#{name := Text, cookie_file := File}) ->
    case {starl_sim_net:full_name(Text), starl_lab_cookie:made(File)} of
        {{error, Reason}, _} -> {error, [starl_sim_net:format_error(Reason)]};
        {{ok, _}, {error, Line}} -> {error, [Line]};
        {{ok, Name}, {ok, Cookie}} -> wait(Name, Cookie)
    end.

wait(Name, Cookie) ->
    case starl_sim_net:start(#{name => Name, cookie => Cookie}) of
        ok ->
            starl_cli_terminal:out(
                "node ~ts waits for runs; Ctrl-C ends it. Where the run is started, with the same secret "
                "(~~/.config/starl/cookie, --cookie-file), type\n"
                "  ./starl run painting --nodes ~ts\n",
                [Name, Name]
            ),
            receive
            after infinity -> 0
            end;
        {error, Reason} ->
            {error, [starl_sim_net:format_error(Reason)]}
    end.
