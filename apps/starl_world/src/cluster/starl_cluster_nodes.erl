%% @doc Starts and restarts the nodes of a cluster, an operating system process for each robot.
%% OTP's `peer' controls them, and they are linked to the calling process.
%% {@link starl_cluster_node} carries out the work on a node.
%% ```
%%     up -- lost (it has ended), drop (its robot cannot be opened) --> down -- again --> up
%% '''
%% <em>Full disks.</em> The disk of a robot is filled by a limit on the size of files
%% (RLIMIT_FSIZE). The process of the robot's node may then not let a file grow. So each write of its
%% store, its facts or its recording fails, and earlier data stay. This needs no privilege, and no
%% other process notices. Such a write fails with `efbig', a write on a full disk with `enospc'. Both
%% are errors of `file', and StarL distinguishes them only in the text.
%%
%% The Erlang VM keeps compiled code in memory that the kernel counts as a file, too. A node that
%% needed more of it on a full disk, for new code, would be killed by SIGSEGV. A VM that starts
%% under the limit keeps its code in other memory. So each node starts under it, and the limit is
%% removed when the node is up.
-module(starl_cluster_nodes).

-export([start/2, specified/3, again/3, kill/2, lost/2, drop/2, stop/1, disk/3, has_disks/0]).
-export([up/1, names/1, name/2, spec/2, code/1, of_control/2, restarts/1, os_pids/1]).
-export([known_end/3, ended/3, place/2]).

-export_type([t/0, code/0]).

%% Modules that were compiled in memory, or reloaded.
-type code() :: [{module(), file:filename(), Beam :: binary()}].

-record(node, {
    name :: string(),
    peer :: starl_sim_peers:t() | none,
    restarts = 0 :: non_neg_integer(),
    %% was it killed from here?
    doomed = false :: boolean(),
    %% what its robot starts with
    spec = #{} :: starl_live_robot:spec()
}).

-record(nodes, {
    nodes :: #{starl:robot_id() => #node{}},
    code = [] :: code()
}).

-opaque t() :: #nodes{}.

%% The time within which the end of a node's process is known after its connection has gone.
-define(END_MS, 2000).

%% @doc Starts a node for each robot; the code that the nodes get. Their disks have room.
-spec start([starl:robot_id()], code()) -> {ok, t()} | {error, starl_sim_peers:reason()}.
start(Ids, Code) ->
    Run = peer:random_name("starl"),
    Names = [Run ++ "-robot" ++ integer_to_list(Id) || Id <- Ids],
    case starl_sim_peers:start_as(Names, full()) of
        {ok, Peers} ->
            ok = lists:foreach(fun starl_sim_peers:tell_end/1, Peers),
            All = [#node{name = Name, peer = Peer} || {Name, Peer} <- lists:zip(Names, Peers)],
            Nodes = #nodes{nodes = maps:from_list(lists:zip(Ids, All)), code = Code},
            _ = [disk(clear, Id, Nodes) || Id <- Ids],
            {ok, Nodes};
        {error, _} = Error ->
            Error
    end.

%% @doc Keeps what a robot starts with.
-spec specified(starl:robot_id(), starl_live_robot:spec(), t()) -> t().
specified(Id, Spec, #nodes{nodes = All} = Nodes) ->
    put_node(Id, (maps:get(Id, All))#node{spec = Spec}, Nodes).

%% @doc Restarts a robot's node, on a disk that is full or clear. The calling process is notified of
%% its end, as of the others' ({@link starl_sim_peers:told()}).
-spec again(starl:robot_id(), fill | clear, t()) -> {ok, t()} | {error, starl_sim_peers:reason()}.
again(Id, Disk, #nodes{nodes = All} = Nodes) ->
    #{Id := #node{name = Name, restarts = N} = Node} = All,
    case starl_sim_peers:start_as([Name], full()) of
        {ok, [Peer]} ->
            ok = starl_sim_peers:tell_end(Peer),
            Again = Node#node{peer = Peer, restarts = N + 1, doomed = false},
            Up = put_node(Id, Again, Nodes),
            _ = disk(Disk, Id, Up),
            {ok, Up};
        {error, _} = Error ->
            Error
    end.

%% @doc Kills the node of a robot by SIGKILL. Its end is not reported as an error.
-spec kill(starl:robot_id(), t()) -> t().
kill(Id, #nodes{nodes = All} = Nodes) ->
    _ = [os:cmd("kill -KILL " ++ OsPid) || #{Id := OsPid} <- [os_pids(Nodes)]],
    put_node(Id, (maps:get(Id, All))#node{doomed = true}, Nodes).

%% @doc The node of a robot has ended.
-spec lost(starl:robot_id(), t()) -> t().
lost(Id, #nodes{nodes = All} = Nodes) ->
    #{Id := Node} = All,
    put_node(Id, Node#node{peer = none}, Nodes).

%% @doc Ends the node of a robot.
-spec drop(starl:robot_id(), t()) -> t().
drop(Id, #nodes{nodes = All} = Nodes) ->
    #{Id := #node{peer = Peer}} = All,
    ok = starl_sim_peers:kill(Peer),
    lost(Id, Nodes).

put_node(Id, Node, #nodes{nodes = All} = Nodes) -> Nodes#nodes{nodes = All#{Id := Node}}.

%% @doc Ends all nodes.
-spec stop(t()) -> ok.
stop(Nodes) -> lists:foreach(fun({_, Peer}) -> starl_sim_peers:kill(Peer) end, peers(Nodes)).

%% -- full disks -----------------------------------------------------------------------------

%% @doc Fills the disk of a robot, or clears it. A node that is down is filled when it starts.
-spec disk(fill | clear, starl:robot_id(), t()) -> ok | {error, unicode:chardata()}.
disk(Change, Id, Nodes) ->
    case {prlimit(), os_pids(Nodes)} of
        {Program, #{Id := OsPid}} when is_list(Program) -> limit(Change, Id, OsPid, Program);
        {_, #{}} -> has_disks()
    end.

%% @doc Can a disk be filled on this computer?
-spec has_disks() -> ok | {error, unicode:chardata()}.
has_disks() ->
    case prlimit() of
        false -> {error, "a disk cannot be filled here: apt install util-linux (prlimit)"};
        _Program -> ok
    end.

prlimit() -> os:find_executable("prlimit").

%% The commands of a shell with which the process of a node begins: its disk is full.
full() ->
    case prlimit() of
        false -> "";
        _ -> "ulimit -S -f 0; "
    end.

%% The limit that holds is the soft one; the hard one stays.
limit(Change, Id, OsPid, Program) ->
    case os:cmd(Program ++ " --pid " ++ OsPid ++ " --fsize=" ++ bytes(Change, OsPid) ++ ":") of
        "" -> ok;
        Output -> {error, io_lib:format("the disk of robot ~b: ~ts", [Id, string:trim(Output)])}
    end.

bytes(fill, _OsPid) -> "0";
bytes(clear, OsPid) -> hard(file:read_file(filename:join(["/proc", OsPid, "limits"]))).

hard({ok, Limits}) ->
    {match, [Hard]} = re:run(Limits, "Max file size +\\S+ +(\\S+)", [
        {capture, all_but_first, list}
    ]),
    Hard;
hard({error, _}) ->
    "unlimited".

%% -- questions ------------------------------------------------------------------------------

%% @doc The robots whose nodes are up, ascending, with these.
-spec up(t()) -> [{starl:robot_id(), node()}].
up(Nodes) -> [{Id, starl_sim_peers:node(Peer)} || {Id, Peer} <- peers(Nodes)].

peers(#nodes{nodes = All}) ->
    [{Id, Peer} || {Id, #node{peer = Peer}} <- lists:sort(maps:to_list(All)), Peer =/= none].

%% @doc The names of the nodes that are up.
-spec names(t()) -> #{starl:robot_id() => node()}.
names(Nodes) -> maps:from_list(up(Nodes)).

%% @doc The name of a robot's node, if it is up.
-spec name(starl:robot_id(), t()) -> node() | none.
name(Id, Nodes) -> proplists:get_value(Id, up(Nodes), none).

%% @doc What a robot starts with.
-spec spec(starl:robot_id(), t()) -> starl_live_robot:spec().
spec(Id, #nodes{nodes = All}) -> (maps:get(Id, All))#node.spec.

%% @doc The code that every node gets.
-spec code(t()) -> code().
code(#nodes{code = Code}) -> Code.

%% @doc The robot whose node is held by this process.
-spec of_control(pid(), t()) -> {ok, starl:robot_id()} | none.
of_control(Pid, Nodes) ->
    case [Id || {Id, Peer} <- peers(Nodes), starl_sim_peers:control(Peer) =:= Pid] of
        [Id] -> {ok, Id};
        [] -> none
    end.

%% @doc Where a robot is: its node, and its end of the transport.
-spec place(starl:robot_id(), t()) ->
    {ok, #{node := node() | none, transport := starl_live_link:adapter()}}
    | {error, unicode:chardata()}.
place(Id, #nodes{nodes = All} = Nodes) ->
    case All of
        #{Id := #node{spec = #{transport := Line}}} ->
            {ok, #{node => name(Id, Nodes), transport => Line}};
        #{} ->
            {error, io_lib:format("there is no robot ~b", [Id])}
    end.

%% @doc The reason why a robot could not be opened, in words. If its node has just ended, this
%% process is about to be notified.
-spec known_end(starl:robot_id(), Why :: ended | unicode:chardata(), t()) -> unicode:chardata().
known_end(Id, ended, Nodes) ->
    Control = proplists:get_value(Id, [{R, starl_sim_peers:control(P)} || {R, P} <- peers(Nodes)]),
    receive
        {starl_peer_ended, Control, Status} -> line(Status)
    after ?END_MS -> "its node has ended"
    end;
known_end(_Id, Why, _Nodes) ->
    Why.

line(Status) -> ["its node ", starl_sim_peers:format_end(Status)].

%% @doc The report on a node whose process has ended in this way. A signal is an error, unless it
%% came from here.
-spec ended(Control :: pid(), Status :: non_neg_integer(), t()) ->
    [{starl:robot_id(), logger:level(), unicode:chardata()}].
ended(Control, Status, #nodes{nodes = All} = Nodes) ->
    case of_control(Control, Nodes) of
        {ok, Id} ->
            #{Id := #node{doomed = IsDoomed}} = All,
            [{Id, level(Status, IsDoomed), line(Status)}];
        none ->
            []
    end.

level(Status, false) when Status > 128 -> error;
level(_Status, _IsDoomed) -> notice.

%% @doc The number of restarts of each node.
-spec restarts(t()) -> #{starl:robot_id() => non_neg_integer()}.
restarts(#nodes{nodes = All}) -> maps:map(fun(_, #node{restarts = N}) -> N end, All).

%% @doc The numbers of the nodes' processes in the operating system.
-spec os_pids(t()) -> #{starl:robot_id() => string()}.
os_pids(Nodes) ->
    maps:from_list([{Id, starl_sim_peers:os_pid(Peer)} || {Id, Peer} <- peers(Nodes)]).
