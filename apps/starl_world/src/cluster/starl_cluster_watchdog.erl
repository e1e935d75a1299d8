%% @doc The watchdogs of a cluster's nodes. A process for each node asks the link of its robot every
%% second. A watchdog reports when it has missed two answers, and when it has an answer again. It
%% also reports when it has missed more answers than a busy computer can delay; then it ends.
%% ```
%%     {starl_silent, Robot, Watchdog, doubtful | back | silent}
%% '''
%% Misses are counted, not measured: a computer that stood still as a whole misses one answer.
-module(starl_cluster_watchdog).

-export([new/0, watch/3, leave/2, stop/1, is_of/3]).

-export_type([t/0, word/0]).

-type word() :: doubtful | back | silent.

-opaque t() :: #{starl:robot_id() => pid()}.

%% The period, which is also the time for an answer.
-define(PERIOD_MS, 1000).
-define(DOUBTFUL, 2).
-define(SILENT, 10).

%% @doc Nothing is watched.
-spec new() -> t().
new() -> #{}.

%% @doc Watches the node of a robot from now on. If it was watched before, the watch begins again.
-spec watch(starl:robot_id(), node(), t()) -> t().
watch(Robot, Node, Watchdogs) ->
    Owner = self(),
    Pid = spawn_link(fun() -> look(0, {Robot, Node, Owner}) end),
    (leave(Robot, Watchdogs))#{Robot => Pid}.

%% @doc Watches the node of a robot no more.
-spec leave(starl:robot_id(), t()) -> t().
leave(Robot, Watchdogs) ->
    ok = stop(maps:with([Robot], Watchdogs)),
    maps:remove(Robot, Watchdogs).

%% @doc Watches no node any more.
-spec stop(t()) -> ok.
stop(Watchdogs) ->
    lists:foreach(
        fun(Pid) ->
            true = unlink(Pid),
            true = exit(Pid, kill)
        end,
        maps:values(Watchdogs)
    ).

%% @doc Is this the watchdog of a robot? One that was called off may have said its word already.
-spec is_of(starl:robot_id(), pid(), t()) -> boolean().
is_of(Robot, Pid, Watchdogs) -> maps:get(Robot, Watchdogs, none) =:= Pid.

look(?SILENT, Watched) ->
    say(silent, Watched);
look(Missed, {_Robot, Node, _Owner} = Watched) ->
    Next = erlang:start_timer(?PERIOD_MS, self(), look),
    case starl_cluster_node:answers(Node, ?PERIOD_MS) of
        true ->
            _ = Missed >= ?DOUBTFUL andalso say(back, Watched),
            next(Next, 0, Watched);
        false ->
            _ = Missed + 1 =:= ?DOUBTFUL andalso say(doubtful, Watched),
            next(Next, Missed + 1, Watched);
        gone ->
            ok
    end.

next(Timer, Missed, Watched) ->
    receive
        {timeout, Timer, look} -> look(Missed, Watched)
    end.

say(Word, {Robot, _Node, Owner}) ->
    Owner ! {starl_silent, Robot, self(), Word},
    ok.
