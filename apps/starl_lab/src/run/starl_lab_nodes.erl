%% @doc Reads and checks the flags of `./starl run' that spread a run over several nodes.
-module(starl_lab_nodes).

-export([flags/0, plan/1, options/2]).

-export_type([plan/0]).

%% The nodes of a run; `none': the run stays in this VM. Peers need neither a name nor a cookie from
%% the user.
-type plan() ::
    none
    | #{
        nodes := starl_sim_nodes:nodes(),
        timeout_ms := pos_integer(),
        name := node() | none,
        cookie := atom()
    }.

-define(MOST_PEERS, 64).

%% @doc The flags for a run over several nodes.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {nodes, string, none,
            "number of further Erlang VMs on this machine that share the run, or the waiting nodes "
            "(./starl node) that do, as in a@host1,b@host2; the digest is the same"},
        {node_timeout, {number, 0.1, 86400}, 30,
            "the longest wait for a node, s of real time; then the node counts as lost"},
        starl_lab_cookie:flag(),
        {node_name, string, none,
            "this machine's node for the run, as the other nodes can reach it, as in me@10.0.0.5"}
    ].

%% @doc Reads the flags; gives the problems and the plan.
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
    Given = [Key || Key <- [node_timeout, cookie_file, node_name], is_map_key(Key, Values)],
    {[[starl_cli_flags:flag(Key), " goes with --nodes only"] || Key <- Given], none}.

bad(Text) ->
    io_lib:format(
        "--nodes: a number from 1 to ~b, or nodes as in a@host1,b@host2 expected, not \"~ts\"",
        [?MOST_PEERS, Text]
    ).

needless(Values, Plan) ->
    Given = [Key || Key <- [cookie_file, node_name], is_map_key(Key, Values)],
    {[[starl_cli_flags:flag(K), " goes with nodes that run already only"] || K <- Given], Plan}.

named(Texts, Values, Plan) ->
    Names = [name(Text) || Text <- Texts],
    Cookie = starl_lab_cookie:read(maps:get(cookie_file, Values, none)),
    Bad = [["--nodes: ", Line] || {error, Line} <- Names ++ [Cookie]],
    case {Bad, [Node || {ok, Node} <- Names], Cookie} of
        {[], Nodes, {ok, Secret}} ->
            with_own_name(Nodes, Values, Plan#{nodes := Nodes, cookie := Secret});
        {_, _, _} ->
            {Bad, none}
    end.

name(Text) ->
    case {string:find(Text, "@"), starl_sim_net:full_name(Text)} of
        {[_ | _], {ok, Node}} -> {ok, Node};
        {nomatch, _} -> {error, starl_sim_net:format_error({bad_name, Text})};
        {_, {error, Reason}} -> {error, starl_sim_net:format_error(Reason)}
    end.

%% Nodes with long names (host.domain, or an address) cannot connect to nodes with short names.
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

%% A node named `localhost' can be reached only from its own machine.
short_host("localhost") ->
    "localhost";
short_host(_) ->
    {ok, Host} = inet:gethostname(),
    Host.

mixed(Node, Name) ->
    io_lib:format(
        "--nodes: ~ts and ~ts do not go together: either all nodes have a host with a dot, or "
        "none; --node-name says how this machine is called",
        [Node, Name]
    ).

is_long(Node) -> lists:member($., host(Node)).

host(Node) -> lists:last(string:split(atom_to_list(Node), "@")).

%% @doc The simulator's options for a run of a target; makes this VM a node if necessary.
-spec options(plan(), starl_cli_target:t()) ->
    {ok, starl_sim:options()} | {error, unicode:chardata()}.
options(none, _Target) ->
    {ok, #{}};
options(#{nodes := Nodes, timeout_ms := Ms, name := Name, cookie := Cookie}, Target) ->
    Code = maps:get(code, Target, []),
    Options = #{nodes => Nodes, node_timeout_ms => Ms, code => Code},
    case Name =:= none orelse starl_sim_net:start(#{name => Name, cookie => Cookie}) of
        {error, Reason} -> {error, ["--nodes: ", starl_sim_net:format_error(Reason)]};
        _ -> {ok, Options}
    end.
