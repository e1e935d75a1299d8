%% @doc The chassis of a robot that has none: it never moves, and has no other actuators. It answers
%% each command to move like a drive that does not obey.
-module(starl_fleet_no_chassis).
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1]).

-spec open(starl_live_chassis:config()) -> {ok, starl_live_clock:t()}.
open(#{clock := Clock}) -> {ok, Clock}.

-spec drive(starl_chassis:script(), integer(), term(), starl_live_clock:t()) ->
    {[{term(), starl_live_chassis:answer()}], starl_live_clock:t()}.
drive({_Chassis, []}, _Until, Mark, Clock) ->
    {[{Mark, {driven, starl_live_clock:now_us(Clock)}}], Clock};
drive({Chassis, Commands}, _Until, Mark, Clock) ->
    {[{Mark, {stalled, Chassis:last(Commands)}}], Clock}.

-spec actuate(atom(), term(), {mark, term()} | none, starl_live_clock:t()) ->
    {[{term(), starl_live_chassis:answer()}], starl_live_clock:t()}.
actuate(_Device, _Value, none, Clock) -> {[], Clock};
actuate(Device, Value, {mark, Mark}, Clock) -> {[{Mark, {actuated, Device, Value}}], Clock}.

-spec stop(starl_live_clock:t()) -> starl_live_clock:t().
stop(Clock) -> Clock.

-spec hear(term(), starl_live_clock:t()) -> unknown.
hear(_Message, _Clock) -> unknown.

-spec close(starl_live_clock:t()) -> ok.
close(_Clock) -> ok.
