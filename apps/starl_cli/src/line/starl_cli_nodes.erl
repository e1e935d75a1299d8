%% @doc Runs over several nodes, as the command line has them: the flags of `./starl run' that
%% say which, and `./starl node', a node that waits for such runs.
-module(starl_cli_nodes).

-export([flags/0, plan/1, options/2, command/1]).

-export_type([plan/0]).

%% Where a run goes; none: it stays in this VM. Peers need no name and no cookie from outside.
-type plan() ::
    none
    | #{
        nodes := starl_sim_nodes:nodes(),
        timeout_ms := pos_integer(),
        name := node() | none,
        cookie := atom()
    }.

-define(MOST_PEERS, 64).
-define(LONGEST_COOKIE, 255).

%% -- flags of ./starl run -------------------------------------------------------------------

%% @doc The flags of a run that goes over nodes.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {nodes, string, none,
            "the run goes over so many further Erlang VMs on this machine, or over nodes that "
            "wait for it (./starl node), as in a@host1,b@host2; its digest is the same"},
        {node_timeout, {number, 0.1, 86400}, 30,
            "a node that keeps the others waiting for longer is lost, s of real time"},
        {cookie, string, none, "the cookie that nodes which wait were started with"},
        {node_name, string, none,
            "this machine's node for the run, as the other nodes can reach it, as in me@10.0.0.5"}
    ].

%% @doc Reads the flags; gives what is wrong, and the plan.
-spec plan(#{atom() => term()}) -> {[unicode:chardata()], plan()}.
plan(#{nodes := Text} = Values) ->
    Ms = round(1000 * maps:get(node_timeout, Values, 30)),
    Plan = #{nodes => 1, timeout_ms => Ms, name => none, cookie => none},
    case {string:to_integer(Text), string:find(Text, "@")} of
        {{N, ""}, _} when N >= 1, N =< ?MOST_PEERS -> needless(Values, Plan#{nodes := N});
        {_, nomatch} -> {[bad(Text)], none};
        _ -> named(string:split(Text, ",", all), Values, Plan)
    end;
plan(Values) ->
    Given = [Key || Key <- [node_timeout, cookie, node_name], is_map_key(Key, Values)],
    {[[starl_cli_flags:flag(Key), " goes with --nodes only"] || Key <- Given], none}.

bad(Text) ->
    io_lib:format(
        "--nodes: a number from 1 to ~b, or nodes as in a@host1,b@host2 expected, not \"~ts\"",
        [?MOST_PEERS, Text]
    ).

needless(Values, Plan) ->
    Given = [Key || Key <- [cookie, node_name], is_map_key(Key, Values)],
    Lines = [[starl_cli_flags:flag(Key), " goes with nodes that run already only"] || Key <- Given],
    {Lines, Plan}.

named(Texts, Values, Plan) ->
    Names = [name(Text) || Text <- Texts],
    Bad = [["--nodes: ", Line] || {error, Line} <- Names] ++ cookie_problems(Values),
    case {Bad, [Node || {ok, Node} <- Names]} of
        {[], Nodes} -> with_own_name(Nodes, Values, Plan#{nodes := Nodes, cookie := cookie(Values)});
        {_, _} -> {Bad, none}
    end.

name(Text) ->
    case {string:find(Text, "@"), starl_sim_net:full_name(Text)} of
        {[_ | _], {ok, Node}} -> {ok, Node};
        {nomatch, _} -> {error, starl_sim_net:format_error({bad_name, Text})};
        {_, {error, Reason}} -> {error, starl_sim_net:format_error(Reason)}
    end.

cookie_problems(#{cookie := Text}) when length(Text) =< ?LONGEST_COOKIE ->
    [];
cookie_problems(#{cookie := _}) ->
    [io_lib:format("--cookie: at most ~b characters", [?LONGEST_COOKIE])];
cookie_problems(#{}) ->
    ["--cookie is needed for nodes that run already: the one that ./starl node has printed there"].

cookie(#{cookie := Text}) -> list_to_atom(Text).

%% Nodes with long names (host.domain, or an address) and with short ones do not mix.
with_own_name(Nodes, Values, Plan) ->
    case own_name(hd(Nodes), Values) of
        {ok, Name} ->
            case [Node || Node <- Nodes, is_long(Node) =/= is_long(Name)] of
                [] -> {[], Plan#{name := Name}};
                [Node | _] -> {[mixed(Node, Name)], none}
            end;
        {error, Line} ->
            {[Line], none}
    end.

own_name(_Node, #{node_name := Text}) ->
    case name(Text) of
        {ok, Name} -> {ok, Name};
        {error, Line} -> {error, ["--node-name: ", Line]}
    end;
own_name(Node, #{}) ->
    Host =
        case {host(Node), is_long(Node)} of
            {"127.0.0.1", _} -> "127.0.0.1";
            {_, true} -> net_adm:localhost();
            {Other, false} -> short_host(Other)
        end,
    {ok, Name} = starl_sim_net:full_name("starl_run_" ++ os:getpid() ++ "@" ++ Host),
    {ok, Name}.

%% Whoever is called `localhost' is reached from there only.
short_host("localhost") ->
    "localhost";
short_host(_) ->
    {ok, Host} = inet:gethostname(),
    Host.

mixed(Node, Name) ->
    io_lib:format(
        "--nodes: ~ts and ~ts do not go together: either all nodes have a host with a dot, or "
        "none; --node-name says how this machine is called", [Node, Name]
    ).

is_long(Node) -> lists:member($., host(Node)).

host(Node) -> lists:last(string:split(atom_to_list(Node), "@")).

%% @doc The simulator's options for a run of a target; makes this VM a node if need be.
-spec options(plan(), starl_cli_target:t()) ->
    {ok, starl_sim:options()} | {error, unicode:chardata()}.
options(none, _Target) ->
    {ok, #{}};
options(#{nodes := Nodes, timeout_ms := Ms, name := Name, cookie := Cookie}, Target) ->
    Code = [maps:get(code, Target) || is_map_key(code, Target)],
    Options = #{nodes => Nodes, node_timeout_ms => Ms, code => Code},
    case Name =:= none orelse starl_sim_net:start(#{name => Name, cookie => Cookie}) of
        {error, Reason} -> {error, ["--nodes: ", starl_sim_net:format_error(Reason)]};
        _ -> {ok, Options}
    end.

%% -- ./starl node ---------------------------------------------------------------------------

%% @doc Waits for runs until Ctrl-C; gives the exit status where that cannot be.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    Flags = node_flags(),
    case {starl_cli_setup:help_wanted(Args), starl_cli_flags:parse(Args, Flags)} of
        {true, _} -> help(Flags);
        {false, {ok, Values}} -> serve(maps:merge(starl_cli_flags:defaults(Flags), Values));
        {false, {error, Problems}} -> starl_cli_terminal:bad_input(starl_cli_setup:flag_lines(Problems))
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
    case {starl_sim_net:full_name(Text), cookie_problems(#{cookie => cookie_text(Given)})} of
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
