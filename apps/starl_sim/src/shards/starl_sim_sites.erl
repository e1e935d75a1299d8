%% @doc Opens and closes the node parts of a simulation over several nodes ({@link starl_sim_site}).
%% It starts or connects the nodes, checks that each runs the same code as this one, and opens a
%% part on each. It closes all parts at the end.
%%
%% A run over several nodes has the digest of a run in one VM only if every module that takes part
%% is the same on all nodes. A module is identified by the MD5 of its code, which the compiler
%% stores in it. OTP's own modules are not compared: nodes may run different releases, as long as
%% they run the same build of StarL.
-module(starl_sim_sites).

-export([start/1, open/2, close/1, format_error/1]).
-export([digests/1]).

-export_type([reason/0]).

-type reason() ::
    not_distributed
    | {bad_nodes, term()}
    | {twice, node()}
    | {unreachable, node()}
    | {silent, node()}
    | {no_code, node()}
    | {other_code, node(), [module()], OtpHere :: string(), OtpThere :: string()}
    | {peers, starl_sim_peers:reason()}.

-define(CLOSE_MS, 10000).
%% The check makes a node load all the code, which takes time.
-define(LEAST_CHECK_MS, 5000).
-define(TRIES, 12).
-define(MOST_NAMES, 3).

%% @doc The names of the requested nodes ({@link starl_sim_nodes:nodes()}), or the
%% problem with them; peers are started, linked to the calling process, which must trap exits and
%% has to stop them.
-spec start(Wanted :: term()) ->
    {ok, [node(), ...], [starl_sim_peers:t()]} | {error, reason()}.
start(N) when is_integer(N), N > 0 ->
    case starl_sim_peers:start(N) of
        {ok, Peers} -> {ok, [starl_sim_peers:node(Peer) || Peer <- Peers], Peers};
        {error, Reason} -> {error, {peers, Reason}}
    end;
start([_ | _] = Names) ->
    case {lists:all(fun is_atom/1, Names), Names -- lists:usort(Names)} of
        {false, _} -> {error, {bad_nodes, Names}};
        {true, [Node | _]} -> {error, {twice, Node}};
        {true, []} when Names =:= [node()] -> {ok, Names, []};
        {true, []} when node() =:= nonode@nohost -> {error, not_distributed};
        {true, []} -> {ok, Names, []}
    end;
start(Other) ->
    {error, {bad_nodes, Other}}.

%% @doc Checks the nodes and opens a site on each, in their order, for as long as the calling
%% process lives. If one node cannot be used, no site stays open.
-spec open([node(), ...], starl_sim_nodes:options()) ->
    {ok, [starl_sim_site:t()]} | {error, reason()}.
open(Names, #{modules := Seeds, code := Code, timeout_ms := Ms}) ->
    InMemory = [Module || {Module, _, _} <- Code],
    Modules = modules([starl_sim | Seeds]) -- InMemory,
    Ours = digests(Modules),
    CheckMs = max(?LEAST_CHECK_MS, Ms),
    sites_on(Names, #{modules => Modules, digests => Ours, code => Code, ms => CheckMs}, []).

sites_on([], _Wanted, Sites) ->
    {ok, lists:reverse(Sites)};
sites_on([Node | Rest], Wanted, Sites) ->
    case site_on(Node, Wanted) of
        {ok, Site} ->
            sites_on(Rest, Wanted, [Site | Sites]);
        {error, _} = Error ->
            ok = close(Sites),
            Error
    end.

site_on(Node, Wanted) ->
    case node() =:= Node orelse net_kernel:connect_node(Node) of
        true -> checked(Node, Wanted);
        _ -> {error, {unreachable, Node}}
    end.

checked(Node, #{modules := Modules, digests := Ours, ms := Ms} = Wanted) ->
    try
        case answer(Node, ?MODULE, digests, [Modules], Ms) of
            Ours -> {ok, site(Node, Wanted)};
            Theirs -> {error, other_code(Node, differing(Ours, Theirs), Ms)}
        end
    catch
        error:{exception, undef, _} -> {error, {no_code, Node}};
        error:{erpc, timeout} -> {error, {silent, Node}};
        error:{erpc, noconnection} -> {error, {unreachable, Node}}
    end.

%% The answer of a call on a node that may be repeated. A busy computer takes long to load code: silent is
%% only a node that does not even say its name within the time limit.
answer(Node, Module, Function, Args, Ms) -> answer(Node, Module, Function, Args, Ms, ?TRIES).

answer(Node, Module, Function, Args, Ms, Tries) ->
    try
        erpc:call(Node, Module, Function, Args, Ms)
    catch
        error:{erpc, timeout} when Tries > 1 ->
            Node = erpc:call(Node, erlang, node, [], Ms),
            answer(Node, Module, Function, Args, Ms, Tries - 1)
    end.

other_code(Node, Modules, Ms) ->
    There = answer(Node, erlang, system_info, [otp_release], Ms),
    {other_code, Node, Modules, erlang:system_info(otp_release), There}.

site(Node, #{code := Code, ms := Ms}) ->
    _ = [
        {module, Module} = answer(Node, code, load_binary, [Module, File, Beam], Ms)
     || {Module, File, Beam} <- Code, Node =/= node()
    ],
    starl_sim_site:open(Node, self(), Ms).

%% @doc Closes all sites at once and waits for their end, up to a time limit. The calling
%% process must ignore messages `{timeout, _, close}', which may arrive later.
-spec close([starl_sim_site:t()]) -> ok.
close(Sites) ->
    Refs = [
        {erlang:monitor(process, Server), starl_sim_site:close(Site)}
     || #{server := Server} = Site <- Sites
    ],
    Timer = erlang:start_timer(?CLOSE_MS, self(), close),
    ok = closed([Ref || {Ref, ok} <- Refs], Timer),
    _ = erlang:cancel_timer(Timer),
    ok.

closed([], _Timer) ->
    ok;
closed([Ref | Refs] = Waiting, Timer) ->
    receive
        {'DOWN', Ref, process, _, _} -> closed(Refs, Timer);
        {timeout, Timer, close} -> lists:foreach(fun erlang:demonitor/1, Waiting)
    end.

%% -- code -----------------------------------------------------------------------------------

%% All modules that take part, given some of them: the modules of their applications, and of
%% the applications that these need, without OTP's.
modules(Seeds) ->
    Apps = lists:usort([App || Module <- Seeds, App <- application_of(Module)]),
    Found = [M || App <- closure(Apps, []), M <- modules_of(App)],
    lists:usort(Seeds ++ Found).

%% @doc The digests of modules on this node.
-spec digests([module()]) -> [{module(), MD5 :: binary() | missing}].
digests(Modules) -> [{Module, digest(Module)} || Module <- Modules].

differing(Ours, Theirs) -> [Module || {Module, _} <- Ours -- Theirs].

digest(Module) ->
    case code:ensure_loaded(Module) of
        {module, Module} -> Module:module_info(md5);
        {error, _} -> missing
    end.

%% The application in whose folder a module lies; a user's own application, or a module
%% that was compiled in memory, lies in none.
application_of(Module) ->
    case code:which(Module) of
        File when is_list(File), File =/= "" ->
            Files = filelib:wildcard(filename:join(filename:dirname(File), "*.app")),
            %% the folder of code that runs here: a bounded number of atoms, one per application
            [list_to_atom(filename:basename(App, ".app")) || App <- Files];
        _ ->
            []
    end.

closure([], Seen) ->
    Seen;
closure([App | Apps], Seen) ->
    case lists:member(App, Seen) orelse is_of_otp(App) of
        true -> closure(Apps, Seen);
        false -> closure(key(App, applications) ++ Apps, [App | Seen])
    end.

is_of_otp(App) ->
    case code:lib_dir(App) of
        {error, bad_name} -> true;
        Dir -> lists:prefix(code:lib_dir(), Dir)
    end.

modules_of(App) -> key(App, modules).

key(App, Key) ->
    _ = application:load(App),
    case application:get_key(App, Key) of
        {ok, Value} -> Value;
        undefined -> []
    end.

%% -- problems -------------------------------------------------------------------------------

%% @doc One line on why the nodes cannot be used, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error(not_distributed) ->
    "nodes: this VM is no node itself; start it with a name, as in erl -sname me";
format_error({bad_nodes, What}) ->
    io_lib:format("nodes: a number from 1 or a list of nodes expected, not ~tP", [What, 20]);
format_error({twice, Node}) ->
    io_lib:format("nodes: ~ts is named twice", [Node]);
format_error({unreachable, Node}) ->
    io_lib:format(
        "node ~ts cannot be reached: is it up (./starl node), with the same cookie, under this "
        "very name, and its port mapper's port 4369 open?",
        [Node]
    );
format_error({silent, Node}) ->
    io_lib:format("node ~ts is connected but does not answer; restart it or leave it out", [Node]);
format_error({no_code, Node}) ->
    io_lib:format("node ~ts has no StarL code; start it with ./starl node", [Node]);
format_error({other_code, Node, Modules, Here, There}) ->
    [
        io_lib:format("node ~ts has other code than this one: ~ts; ", [Node, names(Modules)]),
        same_code(Here, There)
    ];
format_error({peers, Reason}) ->
    starl_sim_peers:format_error(Reason).

same_code(Otp, Otp) ->
    "bring both to the same version and build, then start the node anew";
same_code(Here, There) ->
    Text = "it was built by OTP ~ts there and ~ts here: install one release of OTP on both",
    io_lib:format(Text, [There, Here]).

names(Modules) ->
    {Shown, More} = lists:split(min(?MOST_NAMES, length(Modules)), Modules),
    Tail = [io_lib:format(" and ~b more", [length(More)]) || More =/= []],
    [lists:join(", ", [atom_to_list(M) || M <- Shown]), Tail].
