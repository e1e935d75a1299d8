%% @doc The watchdog of a live robot's processes. It logs an application that is slow, with its
%% place in the code. It kills a machine that has not answered for a whole period.
-module(starl_live_watch).

-export([new/0, period_ms/0, answered/2, longest_s/1, look/3]).

-export_type([t/0]).

-define(WATCH_MS, 5000).
%% After this many watches in one step, an application is logged.
-define(LONG_STEP, 3).

-record(watch, {
    %% the processes beside the link that were at work at the last watches, on the same order, and at how many
    long = #{} :: #{pid() => pos_integer()},
    %% the robot's turn at the last watch, if a process was at work then
    turn = none :: non_neg_integer() | none
}).

-opaque t() :: #watch{}.

%% @doc Nothing was seen yet.
-spec new() -> t().
new() -> #watch{}.

%% @doc The period.
-spec period_ms() -> pos_integer().
period_ms() -> ?WATCH_MS.

%% @doc A process beside the link has answered.
-spec answered(pid(), t()) -> t().
answered(Pid, #watch{long = Long} = Watch) -> Watch#watch{long = maps:remove(Pid, Long)}.

%% @doc How long a process has been seen in one step, s.
-spec longest_s(t()) -> non_neg_integer().
longest_s(#watch{long = Long}) -> lists:max([0 | [watched_s(N) || N <- maps:values(Long)]]).

%% The time from the first of these watches to the last.
watched_s(Watches) -> (Watches - 1) * ?WATCH_MS div 1000.

%% @doc Looks at the machine at work in the robot's turn of this number, and at the processes at work beside
%% the link: is that machine to be killed?
-spec look({Turn :: non_neg_integer(), starl_machine:name() | none}, Beside, t()) ->
    {kill | ok, t()}
when
    Beside :: [{pid(), starl_machine:name()}].
look(AtWork, Beside, #watch{long = Long} = Watch) ->
    Watched = maps:from_list([{Pid, 1 + maps:get(Pid, Long, 0)} || {Pid, _} <- Beside]),
    _ = [log_long(Pid, Name) || {Pid, Name} <- Beside, map_get(Pid, Watched) =:= ?LONG_STEP],
    waited(AtWork, Watch#watch{long = Watched}).

log_long(Pid, Name) ->
    At = place(starl_crash:place(starl_crash:frames_of(Pid))),
    Text = io_lib:format("in one step for ~b s~ts", [watched_s(?LONG_STEP), At]),
    starl_live_log:of_machine(error, long_step, Name, Text).

place(none) -> "";
place({_, _, _, File, Line}) -> io_lib:format(" at ~ts:~b; an endless loop?", [File, Line]).

waited({_Turn, none}, Watch) ->
    {ok, Watch#watch{turn = none}};
waited({Turn, Name}, #watch{turn = Turn} = Watch) ->
    logger:error(#{what => no_answer, machine => Name}),
    {kill, Watch#watch{turn = none}};
waited({Turn, _Name}, Watch) ->
    {ok, Watch#watch{turn = Turn}}.
