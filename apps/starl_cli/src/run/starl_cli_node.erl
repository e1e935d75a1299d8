%% @doc `./starl node': a node that waits for runs over several nodes.
-module(starl_cli_node).

-export([command/1]).

%% @doc Waits for runs until Ctrl-C; gives the exit status where that cannot be.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    Flags = node_flags(),
    case {starl_cli_setup:help_wanted(Args), starl_cli_flags:parse(Args, Flags)} of
        {true, _} -> help(Flags);
        {false, {ok, Values}} -> serve(maps:merge(starl_cli_flags:defaults(Flags), Values));
        {false, {error, Problems}} ->
            starl_cli_terminal:bad_input(starl_cli_setup:flag_lines(Problems))
    end.

node_flags() ->
    [
        {name, string, "starl", "the node's name, NAME or NAME@HOST as the others reach it"},
        {cookie, string, none, "who has it may run anything here; without it a random one"},
        {help, switch, false, "this help"}
    ].

help(Flags) ->
    starl_cli_terminal:out([
        "Usage: ./starl node [FLAGS]\n\n",
        "An Erlang node that waits for simulations: ./starl run TARGET --nodes NAME@HOST,... on\n"
        "another machine or this one spreads its robots over such nodes. All need the same StarL\n"
        "and reach each other by Erlang's distribution: port 4369 (epmd) and one more a node.\n"
        "It is not encrypted: use it in a network that you trust. Ctrl-C ends the node.\n\n",
        starl_cli_flags:help(Flags, starl_cli_terminal:columns())
    ]),
    0.

serve(#{name := Text, cookie := Given}) ->
    Problems = starl_cli_nodes:cookie_problems(#{cookie => cookie_text(Given)}),
    case {starl_sim_net:full_name(Text), Problems} of
        {{error, Reason}, _} -> refuse(starl_sim_net:format_error(Reason));
        {{ok, _}, [Line | _]} -> starl_cli_terminal:bad_input([Line]);
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
                [Name, Name, starl_cli_flags:shell(atom_to_list(Cookie))]
            ),
            receive
            after infinity -> 0
            end;
        {error, Reason} ->
            refuse(starl_sim_net:format_error(Reason))
    end.

refuse(Line) -> starl_cli_terminal:bad_input([["node: ", Line]]).
