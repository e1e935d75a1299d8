%% @doc Starts further nodes for a simulation on this machine. OTP's `peer' controls each node over
%% its standard input and output, so a peer always ends with the process that started it.
%%
%% Peers are also reached by Erlang's distribution. A VM that is not yet a node becomes one for this
%% purpose, with a unique name and cookie, on the loopback interface only. The cookie appears on no
%% command line and in no file.
-module(starl_sim_peers).

-export([start/1, start_as/2, node/1, control/1, os_pid/1, stop/1, kill/1, format_error/1]).
-export([tell_end/1, format_end/1]).

-export_type([t/0, reason/0, told/0]).

-record(peer, {control :: pid(), node :: node(), os_pid :: string()}).

-opaque t() :: #peer{}.

-type reason() :: starl_sim_net:reason() | {no_peer, Why :: term()}.

%% The news of a peer that has ended, if {@link tell_end/1} asked for it: with the status of its process, as a
%% shell has it.
-type told() :: {starl_peer_ended, Control :: pid(), Status :: non_neg_integer()}.

-define(BOOT_MS, 60000).
%% The status of a process that a signal has ended, less its number.
-define(SIGNALLED, 128).
-define(END_MS, 5000).

%% @doc Starts `N' peers, linked to the calling process, which must trap exits.
-spec start(pos_integer()) -> {ok, [t()]} | {error, reason()}.
start(N) -> start_as([unique("starl_peer") || _ <- lists:seq(1, N)], "").

%% @doc Starts a peer for each of these names, without the part after the `@'. A name may be used
%% again when its peer has ended. The process of a peer begins with these commands of a shell, if any,
%% such as `"ulimit -S -c 0; "'.
-spec start_as([string()], Commands :: string()) -> {ok, [t()]} | {error, reason()}.
start_as(Names, Commands) ->
    case distribute() of
        ok -> start_all(Names, Commands);
        {error, _} = Error -> Error
    end.

%% @doc A peer's node.
-spec node(t()) -> node().
node(#peer{node = Node}) -> Node.

%% @doc The process that holds a peer: it ends when the peer ends.
-spec control(t()) -> pid().
control(#peer{control = Control}) -> Control.

%% @doc The number of a peer's process in the operating system.
-spec os_pid(t()) -> string().
os_pid(#peer{os_pid = OsPid}) -> OsPid.

%% @doc Ends a peer; it is gone afterwards.
-spec stop(t()) -> ok.
stop(#peer{control = Control, node = Node} = Peer) ->
    true = monitor_node(Node, true),
    ok = close(Control),
    receive
        {nodedown, Node} -> ok
    after ?END_MS -> kill(Peer)
    end.

%% @doc Ends a peer that does not answer: its process may be suspended and would live on.
-spec kill(t()) -> ok.
kill(#peer{control = Control, os_pid = OsPid}) ->
    %% a suspended peer would not notice the closed channel
    _ = os:cmd("kill -KILL " ++ OsPid),
    close(Control).

close(Control) -> starl_sim_stop:shutdown(Control, ?END_MS).

%% @doc Notifies the calling process with what status a peer ends, before its control ends. OTP's
%% `peer' keeps the status to itself, or crashes with it, with reports of its own.
-spec tell_end(t()) -> ok.
tell_end(#peer{control = Control}) ->
    Self = self(),
    Tell = fun
        (told, {in, {Port, {exit_status, Status}}}, _) when is_port(Port) ->
            Self ! {starl_peer_ended, Control, Status},
            done;
        (told, _Event, _) ->
            told
    end,
    try
        sys:install(Control, {Tell, told})
    catch
        %% it has ended already
        exit:_ -> ok
    end.

%% @doc The end of a peer in words, as a part of a sentence.
-spec format_end(Status :: non_neg_integer()) -> unicode:chardata().
format_end(Status) when Status > ?SIGNALLED ->
    io_lib:format("was ended by signal ~b~ts", [Status - ?SIGNALLED, signal(Status - ?SIGNALLED)]);
format_end(Status) ->
    io_lib:format("has ended with status ~b", [Status]).

%% A VM that gets no memory aborts; the kernel kills when the computer has none left.
signal(4) -> " (SIGILL)";
signal(6) -> " (SIGABRT): for want of memory?";
signal(7) -> " (SIGBUS)";
signal(9) -> " (SIGKILL): by hand, or for want of memory";
signal(11) -> " (SIGSEGV)";
signal(15) -> " (SIGTERM)";
signal(_) -> "".

%% @doc One line on why there are no peers.
-spec format_error(reason()) -> unicode:chardata().
format_error({no_peer, Why}) ->
    io_lib:format("a further Erlang VM could not be started on this machine: ~0tP", [Why, 10]);
format_error(Reason) ->
    starl_sim_net:format_error(Reason).

%% -- internals ------------------------------------------------------------------------------

distribute() ->
    case erlang:node() of
        nonode@nohost ->
            %% one new name in the life of a VM
            starl_sim_net:start(#{
                name => list_to_atom(unique("starl") ++ "@127.0.0.1"),
                cookie => starl_sim_net:random_cookie(),
                loopback => true
            });
        _ ->
            ok
    end.

unique(Prefix) -> peer:random_name(Prefix).

%% All peers boot at the same time.
start_all(Names, Commands) ->
    try [boot(Commands) || _ <- Names] of
        Boots -> named([{await(Boot), Name} || {Boot, Name} <- lists:zip(Boots, Names)], [])
    catch
        error:Why -> {error, {no_peer, Why}}
    end.

boot(Commands) ->
    Tag = make_ref(),
    Options = #{
        connection => standard_io,
        wait_boot => {self(), Tag},
        shutdown => close,
        exec => exec(Commands),
        %% who started it says why it has ended
        env => [{"ERL_CRASH_DUMP_SECONDS", "0"}],
        args => args()
    },
    {ok, Control} = peer:start_link(Options),
    {Control, Tag}.

%% The same Erlang as this one. A file that may not grow any more is an error of the write, not the end of
%% the peer.
exec(Commands) ->
    Own = filename:join([code:root_dir(), "bin", "erl"]),
    Erl =
        case filelib:is_regular(Own) of
            true -> Own;
            false -> "erl"
        end,
    {"/bin/sh", ["-c", "trap '' XFSZ; " ++ Commands ++ "exec \"$0\" \"$@\"", Erl]}.

%% The code path is this VM's own; the peer finds OTP's code itself. Ctrl-C of a
%% terminal reaches every VM: peers leave it to the first one (+Bi). A node that loses another one
%% must stay connected to the rest, which OTP's global would prevent.
args() ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(Dir)] || Dir <- Own, filelib:is_dir(Dir)]),
    Global = ["-kernel", "prevent_overlapping_partitions", "false"],
    Loopback = ["-kernel", "inet_dist_use_interface", "{127,0,0,1}"],
    ["+Bi", "+fnu", "+sbwt", "none", "+sbwtdcpu", "none", "+sbwtdio", "none", "-nocookie"] ++
        Global ++ [Arg || Arg <- Loopback, is_on_loopback()] ++ Paths.

is_on_loopback() -> host() =:= "127.0.0.1".

host() -> lists:last(string:split(atom_to_list(erlang:node()), "@")).

await({Control, Tag}) ->
    receive
        {Tag, {started, _Node, Control}} -> {ok, Control};
        {Tag, {boot_failed, Why, Control}} -> {error, Why}
    after ?BOOT_MS -> {error, timeout}
    end.

named([], Peers) ->
    {ok, lists:reverse(Peers)};
named([{{ok, Control}, Name} | Rest], Peers) ->
    %% an atom for each started peer: a few in a run, never from input
    Node = list_to_atom(Name ++ "@" ++ host()),
    case name(Control, Node) of
        {ok, OsPid} ->
            named(Rest, [#peer{control = Control, node = Node, os_pid = OsPid} | Peers]);
        {error, Why} ->
            failed(Why, [Control | controls(Rest)], Peers)
    end;
named([{{error, Why}, _Name} | Rest], Peers) ->
    failed(Why, controls(Rest), Peers).

controls(Booted) -> [Control || {{ok, Control}, _Name} <- Booted].

failed(Why, Controls, Peers) ->
    lists:foreach(fun close/1, Controls ++ [C || #peer{control = C} <- Peers]),
    {error, {no_peer, Why}}.

name(Control, Node) ->
    Domain =
        case net_kernel:longnames() of
            true -> longnames;
            false -> shortnames
        end,
    try
        {ok, _} = peer:call(Control, net_kernel, start, [[Node, Domain]]),
        true = peer:call(Control, erlang, set_cookie, [Node, erlang:get_cookie()]),
        {ok, peer:call(Control, os, getpid, [])}
    catch
        Class:Why -> {error, {Class, Why}}
    end.
