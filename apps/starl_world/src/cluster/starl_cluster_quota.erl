%% @doc The disk of a robot of a cluster, as something that can be full: the process of its node may not let a
%% file grow any more (RLIMIT_FSIZE), so each write of its store, its facts or its recording fails, and
%% what was written before stays. No right is needed for that, and no other process notices.
%%
%% One thing is not as on a full disk: the Erlang VM keeps compiled code in memory that is a file to the kernel. A
%% node that wants more of it meanwhile, for new code, is ended by SIGSEGV, and starts anew.
%%
%% Such a write fails with `efbig', that on a full disk with `enospc': both are errors of `file', and
%% StarL tells them apart in the text alone.
-module(starl_cluster_quota).

-export([change/2]).

%% @doc Fills the disk of a robot, or clears it. A node that is down is filled when it starts.
-spec change({fill | clear, starl:robot_id()}, #{starl:robot_id() => OsPid :: string()}) ->
    ok | {error, unicode:chardata()}.
change({What, Robot}, OsPids) ->
    case {os:find_executable("prlimit"), OsPids} of
        {false, _} -> {error, "a disk cannot be filled here: apt install util-linux (prlimit)"};
        {Program, #{Robot := OsPid}} -> limited(What, Robot, OsPid, Program);
        {_, #{}} -> ok
    end.

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
