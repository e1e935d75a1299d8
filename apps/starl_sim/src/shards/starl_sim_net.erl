%% @doc Makes this VM a node of Erlang's distribution, with a name and a cookie. It starts the port
%% mapper `epmd' if none runs.
-module(starl_sim_net).

-export([start/1, random_cookie/0, full_name/1, format_error/1]).

-export_type([wish/0, reason/0]).

%% The identity of the node. `loopback' keeps it off the network: only nodes of this machine
%% reach it. Without a cookie it uses the user's own, from `~/.erlang.cookie'.
-type wish() :: #{name := node(), cookie => atom(), loopback => boolean()}.

-type reason() ::
    {bad_name, string()}
    | no_epmd
    | {epmd, file:filename()}
    | {epmd_here_alone, Host :: string()}
    | {no_distribution, node()}
    | {is_named, node()}.

%% A fresh epmd listens after a few waits of this length.
-define(EPMD_TRIES, 60).
-define(EPMD_WAIT_MS, 50).
-define(LONGEST_NAME, 200).

%% @doc Starts distribution under a name.
-spec start(wish()) -> ok | {error, reason()}.
start(#{name := Name} = Wish) ->
    case node() of
        Name -> set_cookie(Wish);
        nonode@nohost -> with_epmd(Wish);
        Other -> {error, {is_named, Other}}
    end.

%% @doc A random cookie that nobody can guess; made once in the life of a VM.
-spec random_cookie() -> atom().
random_cookie() ->
    binary_to_atom(binary:encode_hex(crypto:strong_rand_bytes(16))).

%% @doc A node's name from text, completed with this machine's name where that is missing. The text
%% is bounded and typed by the user, a few names in the life of a VM: hence atoms.
-spec full_name(string()) -> {ok, node()} | {error, reason()}.
full_name(Text) when length(Text) =< ?LONGEST_NAME ->
    case string:split(Text, "@", all) of
        [Name] -> named(Name, hostname(), Text);
        [Name, Host] -> named(Name, Host, Text);
        _ -> {error, {bad_name, Text}}
    end;
full_name(Text) ->
    {error, {bad_name, Text}}.

named(Name, Host, Text) ->
    Is = fun(Part, Pattern) ->
        re:run(Part, Pattern, [{capture, none}, dollar_endonly]) =:= match
    end,
    case Is(Name, "^[A-Za-z0-9_-]+$") andalso Is(Host, "^[A-Za-z0-9_.:-]+$") of
        true -> {ok, list_to_atom(Name ++ "@" ++ Host)};
        false -> {error, {bad_name, Text}}
    end.

hostname() ->
    {ok, Host} = inet:gethostname(),
    Host.

%% @doc One line on a problem: what is wrong and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({bad_name, Text}) ->
    ["\"", Text, "\" is no name of a node; a node is called like robots@host1"];
format_error(no_epmd) ->
    "nodes need Erlang's port mapper epmd, which is not in PATH; it comes with Erlang/OTP";
format_error({epmd, Exe}) ->
    ["nodes need Erlang's port mapper; ", Exe, " -daemon does not answer on port 4369"];
format_error({epmd_here_alone, Host}) ->
    [
        "Erlang's port mapper runs here for this computer alone, not at ",
        Host,
        "; end its nodes, say epmd -kill, and try again"
    ];
format_error({no_distribution, Node}) ->
    io_lib:format(
        "this machine cannot be node ~ts: its name is taken, its host is not this machine, or "
        "~~/.erlang.cookie cannot be read",
        [Node]
    );
format_error({is_named, Node}) ->
    io_lib:format("this VM is node ~ts already", [Node]).

%% -- internals ------------------------------------------------------------------------------

with_epmd(Wish) ->
    case erl_epmd:names() of
        {ok, _} -> with_running(Wish);
        {error, _} -> with_exe(epmd(), Wish)
    end.

%% One that was started for this computer alone is not heard of by others.
with_running(#{name := Name} = Wish) ->
    Host = host(Name),
    Is = maps:get(loopback, Wish, false) orelse {inet:getaddr(Host, inet), erl_epmd:names(Host)},
    case Is of
        {{ok, _}, {error, _}} -> {error, {epmd_here_alone, Host}};
        _ -> distribute(Wish)
    end.

%% Where the port mapper listens, beside 127.0.0.1: where the node does. Once it runs it serves all nodes here.
epmd_env(#{name := Name} = Wish) ->
    Host = host(Name),
    case
        {os:getenv("ERL_EPMD_ADDRESS"), maps:get(loopback, Wish, false), inet:getaddr(Host, inet)}
    of
        {[_ | _], _, _} -> [];
        {_, true, _} -> [{"ERL_EPMD_ADDRESS", "127.0.0.1"}];
        {_, false, {ok, Ip}} -> [{"ERL_EPMD_ADDRESS", inet:ntoa(Ip)}];
        {_, false, {error, _}} -> []
    end.

%% The epmd of this Erlang, or of another one: all versions speak one protocol.
epmd() ->
    Erts = "erts-" ++ erlang:system_info(version),
    Own = filename:join([code:root_dir(), Erts, "bin", "epmd"]),
    case filelib:is_regular(Own) of
        true -> Own;
        false -> os:find_executable("epmd")
    end.

with_exe(false, _Wish) ->
    {error, no_epmd};
with_exe(Exe, Wish) ->
    Options = [{args, ["-daemon"]}, {env, epmd_env(Wish)}, exit_status, hide],
    Port = open_port({spawn_executable, Exe}, Options),
    receive
        {Port, {exit_status, _}} -> ok
    end,
    case answers(?EPMD_TRIES) of
        true -> distribute(Wish);
        false -> {error, {epmd, Exe}}
    end.

%% The daemon does not announce when it is ready.
answers(0) ->
    false;
answers(Tries) ->
    case erl_epmd:names() of
        {ok, _} ->
            true;
        {error, _} ->
            receive
            after ?EPMD_WAIT_MS -> answers(Tries - 1)
            end
    end.

distribute(#{name := Name} = Wish) ->
    ok = listen_on(maps:get(loopback, Wish, false), host(Name)),
    case quietly(fun() -> net_kernel:start([Name, domain(Name)]) end) of
        {ok, _} -> set_cookie(Wish);
        {error, _} -> {error, {no_distribution, Name}}
    end.

%% OTP reports an invalid name at length; the user gets one line from the caller instead.
quietly(Start) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    try
        Start()
    after
        ok = logger:set_primary_config(level, Level)
    end.

host(Name) -> lists:last(string:split(atom_to_list(Name), "@")).

%% A node that is named by an address is reached at that address alone.
listen_on(IsLoopback, Host) when IsLoopback; Host =:= "localhost" ->
    application:set_env(kernel, inet_dist_use_interface, {127, 0, 0, 1});
listen_on(false, Host) ->
    case inet:parse_ipv4strict_address(Host) of
        {ok, Ip} -> application:set_env(kernel, inet_dist_use_interface, Ip);
        {error, einval} -> ok
    end.

%% The host of a long name, behind the @, contains a dot.
domain(Name) ->
    case lists:member($., atom_to_list(Name)) of
        true -> longnames;
        false -> shortnames
    end.

set_cookie(#{cookie := Cookie}) ->
    true = erlang:set_cookie(node(), Cookie),
    ok;
set_cookie(#{}) ->
    ok.
