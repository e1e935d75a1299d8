%% @doc The clock of an emulated Create. Every 15 ms the robot reads its sensors, sends a frame of
%% its stream, and checks whether a wait is over.
-module(starl_create_tick).

-export([us/0, next/2, floor_div/2]).

-define(TICK_US, 15000).

%% @doc The time between two looks.
-spec us() -> pos_integer().
us() -> ?TICK_US.

%% @doc The next look after this time; looks are at multiples of 15 ms plus the phase.
-spec next(Us :: integer(), PhaseUs :: 0..14999) -> integer().
next(Now, Phase) -> floor_div(Now - Phase, ?TICK_US) * ?TICK_US + ?TICK_US + Phase.

%% @doc Divides and rounds down: times may be negative.
-spec floor_div(integer(), pos_integer()) -> integer().
floor_div(A, B) when A >= 0 -> A div B;
floor_div(A, B) -> -((-A + B - 1) div B).
