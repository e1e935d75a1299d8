%% @doc `./starl node': starts a node that takes part in runs over several nodes.
-module(starl_lab_node).

-behaviour(starl_cli_command).

-export([name/0, synopsis/0, about/1, flags/1, run/1]).

-spec name() -> string().
name() -> "node".

-spec synopsis() -> string().
synopsis() -> "a node that waits for runs with --nodes".

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "An Erlang node that waits for simulations: ./starl run TARGET --nodes NAME@HOST,... on "
        "another machine or this one spreads its robots over such nodes. All need the same StarL "
        "and reach each other by Erlang's distribution: port 4369 (epmd) and one more a node. "
        "It is not encrypted: use it in a network that you trust. Ctrl-C ends the node."
    ].

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) ->
    [
        {"Flags", [
            {name, string, "starl", "the node's name, NAME or NAME@HOST as the others reach it"},
            {cookie, string, none,
                "the secret that lets other nodes run anything here; without it a random one"}
        ]}
    ].

%% Waits for runs until Ctrl-C.
-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := Values}) -> serve(Values).

serve(#{name := Text, cookie := Given}) ->
    Problems = starl_lab_nodes:cookie_problems(#{cookie => cookie_text(Given)}),
    case {starl_sim_net:full_name(Text), Problems} of
        {{error, Reason}, _} -> {error, [starl_sim_net:format_error(Reason)]};
        {{ok, _}, [_ | _]} -> {error, Problems};
        {{ok, Name}, []} -> wait(Name, list_to_atom(cookie_text(Given)))
    end.

cookie_text(none) -> atom_to_list(starl_sim_net:random_cookie());
cookie_text(Given) -> Given.

wait(Name, Cookie) ->
    case starl_sim_net:start(#{name => Name, cookie => Cookie}) of
        ok ->
            starl_cli_terminal:out(
                "node ~ts waits for runs; Ctrl-C ends it. Where the run is started, type\n"
                "  ./starl run painting --nodes ~ts --cookie ~ts\n",
                [Name, Name, starl_cli_terminal:quoted(atom_to_list(Cookie))]
            ),
            receive
            after infinity -> 0
            end;
        {error, Reason} ->
            {error, [starl_sim_net:format_error(Reason)]}
    end.
