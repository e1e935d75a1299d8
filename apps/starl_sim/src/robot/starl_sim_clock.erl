%% @doc A robot's own clock: a piecewise linear function of virtual time. It has an offset and a
%% drift from the beginning; faults set it, change its drift or stop it.
-module(starl_sim_clock).

-export([new/3, local/2, due/3]).

-export_type([t/0]).

%% Pieces, latest first: from `From' on the clock shows `Local' and gains `Ppb' microseconds in
%% 1e9; a clock that stands still gains -1e9.
-opaque t() :: [{From :: starl_sim_queue:time(), Local :: integer(), Ppb :: integer()}, ...].

-define(BILLION, 1000000000).

%% @doc A clock with an offset, a drift, and its own faults.
-spec new(OffsetUs :: integer(), DriftPpb :: integer(), [starl_run_fault:compiled()]) -> t().
new(Offset, Drift, Faults) ->
    Times = lists:usort(lists:append([[From, To] || {_, From, To, _, _, _} <- Faults])),
    lists:foldl(
        fun(Time, Clock) -> change(Time, Drift, Faults, Clock) end, [{0, Offset, Drift}], Times
    ).

change(Time, Drift, Faults, Clock) ->
    Jump = lists:sum([jump(Time, Fault) || Fault <- Faults]),
    Rates = [rate(Fault) || Fault <- starl_run_fault:holding(Time, Faults)],
    Rate =
        case lists:member(stopped, Rates) of
            true -> -?BILLION;
            false -> Drift + lists:sum(Rates)
        end,
    Piece = {Time, local(Time, Clock) + Jump, Rate},
    case Clock of
        [{Time, _, _} | Earlier] -> [Piece | Earlier];
        _ -> [Piece | Clock]
    end.

jump(Time, {_, Time, Time, clock_offset, _, _}) -> 0;
jump(Time, {_, Time, _, clock_offset, _, #{ms := Ms}}) -> 1000 * Ms;
jump(Time, {_, _, Time, clock_offset, _, #{ms := Ms}}) -> -1000 * Ms;
jump(Time, {_, Time, _, clock_step, _, #{ms := Ms}}) -> 1000 * Ms;
jump(_, _) -> 0.

rate({_, _, _, clock_freeze, _, _}) -> stopped;
rate({_, _, _, clock_drift, _, #{ppm := Ppm}}) -> round(1000 * Ppm);
rate(_) -> 0.

%% @doc What the clock shows at a virtual time, in microseconds.
-spec local(starl_sim_queue:time(), t()) -> integer().
local(Time, [{From, Local, Ppb} | _]) when
    is_integer(Time), is_integer(From), is_integer(Local), Time >= From
->
    Local + (Time - From) + (Time - From) * Ppb div ?BILLION;
local(Time, [_, Before | Earlier]) ->
    local(Time, [Before | Earlier]).

%% @doc The first virtual time from Now on at which the clock has advanced by this many
%% microseconds: a timer never fires before its time on the robot's clock.
-spec due(Now :: starl_sim_queue:time(), Us :: non_neg_integer(), t()) -> starl_sim_queue:time().
due(Now, Us, [{From, _, Ppb}]) when is_integer(Now), Now >= From ->
    Now + up(Us, Ppb);
due(Now, Us, Clock) ->
    later(Now, local(Now, Clock) + Us, lists:reverse(Clock)).

later(Now, Goal, [{From, Local, Ppb} | [{Next, _, _} | _] = Later]) ->
    Begin = max(Now, From),
    case Next > Now andalso reach(Begin, Goal, From, Local, Ppb) of
        Time when is_integer(Time), Time < Next -> Time;
        _ -> later(Now, Goal, Later)
    end;
later(Now, Goal, [{From, Local, Ppb}]) ->
    case reach(max(Now, From), Goal, From, Local, Ppb) of
        Time when is_integer(Time) -> Time;
        never -> error({clock_stands_still_for_ever, From})
    end.

%% The time at which this piece, from Begin on, first shows the goal.
reach(Begin, Goal, From, Local, Ppb) ->
    case local(Begin, [{From, Local, Ppb}]) of
        Shown when Shown >= Goal -> Begin;
        _ when Ppb =< -?BILLION -> never;
        _ -> From + up(Goal - Local, Ppb)
    end.

%% The virtual time in which the clock advances this far, rounded up.
up(Us, Ppb) ->
    Rate = ?BILLION + Ppb,
    (Us * ?BILLION + Rate - 1) div Rate.
