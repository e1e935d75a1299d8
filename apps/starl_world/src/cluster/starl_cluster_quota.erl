%% @doc Fills the disk of a cluster's robot, by a limit on the size of files (RLIMIT_FSIZE). The
%% process of the robot's node may then not let a file grow. So each write of its store, its facts
%% or its recording fails, and earlier data stay. This needs no privilege, and no other process
%% notices.
%%
%% The Erlang VM keeps compiled code in memory that the kernel counts as a file, too. A node that
%% needed more of it on a full disk, for new code, would be killed by SIGSEGV. A VM that starts
%% under the limit keeps its code in other memory. So each node starts under it
%% ({@link commands/0}), and the limit is removed when the node is up.
%%
%% Such a write fails with `efbig', a write on a full disk with `enospc'. Both are errors of `file',
%% and StarL distinguishes them only in the text.
-module(starl_cluster_quota).

-export([is_possible/0, commands/0, change/2]).

%% @doc Can a disk be filled on this computer?
-spec is_possible() -> ok | {error, unicode:chardata()}.
is_possible() ->
    case program() of
        false -> {error, "a disk cannot be filled here: apt install util-linux (prlimit)"};
        _Program -> ok
    end.

%% @doc The commands of a shell with which the process of a node begins: its disk is full.
-spec commands() -> string().
commands() ->
    case program() of
        false -> "";
        _ -> "ulimit -S -f 0; "
    end.

%% @doc Fills the disk of a robot, or clears it. A node that is down is filled when it starts.
-spec change({fill | clear, starl:robot_id()}, #{starl:robot_id() => OsPid :: string()}) ->
    ok | {error, unicode:chardata()}.
change({What, Robot}, OsPids) ->
    case {program(), OsPids} of
        {Program, #{Robot := OsPid}} when is_list(Program) -> limited(What, Robot, OsPid, Program);
        {_, #{}} -> is_possible()
    end.

program() -> os:find_executable("prlimit").

%% The limit that holds is the soft one; the hard one stays.
limited(What, Robot, OsPid, Program) ->
    case os:cmd(Program ++ " --pid " ++ OsPid ++ " --fsize=" ++ bytes(What, OsPid) ++ ":") of
        "" -> ok;
        Said -> {error, io_lib:format("the disk of robot ~b: ~ts", [Robot, string:trim(Said)])}
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
