%% @doc The disk of a robot of a cluster, as something that can be full: the process of its node may not let a
%% file grow any more (RLIMIT_FSIZE), so each write of its store, its facts or its recording fails, and
%% what was written before stays. No right is needed for that, and no other process notices.
%%
%% The Erlang VM keeps compiled code in memory that is a file to the kernel, too: a node that wanted more of it
%% on a full disk, for new code, would be ended by SIGSEGV. A VM that starts under the limit keeps its code
%% in other memory, so each node does ({@link commands/0}), and the limit goes when it is up.
%%
%% Such a write fails with `efbig', that on a full disk with `enospc': both are errors of `file', and
%% StarL tells them apart in the text alone.
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
