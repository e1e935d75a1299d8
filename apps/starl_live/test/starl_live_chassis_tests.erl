%% What a chassis' process takes from its link. This module is a driver that tells the test.
-module(starl_live_chassis_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, rest/1, condition/1]).

open(#{test := Test}) -> {ok, Test}.
drive(Script, _Until, Mark, Test) ->
    Test ! {drives, Script},
    {[{Mark, {driven, 7}}], Test}.
actuate(_Device, _Value, _Mark, Test) -> {[], Test}.
stop(Test) ->
    Test ! stops,
    Test.
hear({feels, Sense}, Test) -> {[{sensed, Sense}], Test};
hear(_Message, _Test) -> unknown.
rest(Test) ->
    Test ! rests,
    Test.
condition(_Test) -> #{charge => 83}.
close(Test) ->
    Test ! closed,
    ok.

-define(SCRIPT, {some_chassis, [{go, 1}]}).

%% A script that comes in time is driven and answered; one that comes late is not; to stop never is.
late_test() ->
    logger:set_primary_config(level, none),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Config = #{robot => 1, clock => Clock, profile => #{}, test => self()},
    {ok, Chassis} = starl_live_chassis:start_link(?MODULE, Config, self()),
    Never = -1,
    InTime = starl_live_clock:now_us(Clock) + 3_600_000_000,
    ok = starl_live_chassis:drive(Chassis, ?SCRIPT, Never, late),
    ok = starl_live_chassis:drive(Chassis, {some_chassis, []}, Never, rest),
    ok = starl_live_chassis:drive(Chassis, ?SCRIPT, InTime, now),
    ?assertEqual([rest, now], [heard(Chassis), heard(Chassis)]),
    ?assertEqual([{some_chassis, []}, ?SCRIPT], [driven(), driven()]),
    true = unlink(Chassis),
    ok = gen_server:stop(Chassis),
    logger:set_primary_config(level, notice),
    ?assertEqual([stops, closed], [flushed(), flushed()]).

%% What the body feels goes to the link; how it is, to who asks; that there is nothing more to do, to it.
sense_test() ->
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Config = #{robot => 1, clock => Clock, profile => #{}, test => self()},
    {ok, Chassis} = starl_live_chassis:start_link(?MODULE, Config, self()),
    Chassis ! {feels, {bump, left}},
    ok = starl_live_chassis:rest(Chassis),
    ?assertEqual(#{charge => 83}, starl_live_chassis:condition(Chassis)),
    ?assertEqual(
        [{starl_chassis, Chassis, sensed, {bump, left}}, rests], [flushed(), flushed()]
    ),
    true = unlink(Chassis),
    ok = gen_server:stop(Chassis),
    ?assertEqual([stops, closed], [flushed(), flushed()]).

heard(Chassis) ->
    receive
        {starl_chassis, Chassis, Mark, {driven, 7}} -> Mark
    end.

driven() ->
    receive
        {drives, Script} -> Script
    end.

%% Of what others have sent to this process nothing.
flushed() ->
    receive
        What when What =:= stops; What =:= rests; What =:= closed -> What;
        {starl_chassis, _, sensed, _} = What -> What
    end.
