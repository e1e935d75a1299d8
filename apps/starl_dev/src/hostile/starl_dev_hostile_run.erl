%% @doc The directory of an attacked cluster, and the facts that its robots left there.
-module(starl_dev_hostile_run).

-export([with_dir/1, facts/2, last_facts/2]).

-type facts() :: [starl_monitor:trace_event()].

%% @doc Does something with a directory that is gone afterwards.
-spec with_dir(fun((file:filename()) -> Result)) -> Result.
with_dir(Do) ->
    ok = starl_private_dir:clean("hostile"),
    {ok, Dir} = starl_private_dir:new("hostile"),
    try
        Do(Dir)
    after
        starl_private_dir:remove(Dir)
    end.

%% @doc The facts of these robots, of all their lives.
-spec facts(file:filename(), [starl:robot_id()]) -> #{starl:robot_id() => facts()}.
facts(Dir, Robots) ->
    maps:from_list([{R, lists:append([read(File) || File <- files(Dir, R)])} || R <- Robots]).

%% @doc The facts of a robot's last life.
-spec last_facts(file:filename(), starl:robot_id()) -> {Lives :: non_neg_integer(), facts()}.
last_facts(Dir, Robot) ->
    case files(Dir, Robot) of
        [] -> {0, []};
        Files -> {length(Files), read(lists:last(Files))}
    end.

files(Dir, Robot) ->
    starl_live_record:starts(filename:join(Dir, "robot-" ++ integer_to_list(Robot))).

read(File) -> starl_live_record:read(File, 0).
