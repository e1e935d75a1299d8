%% What the check of a chassis finds: of one whose commands are heard late, by itself or since its computer is busy.
%%
%% Holds: `chassis check` finds a chassis that hears its commands late, and excuses what the
%% computer loses
%% Red: a chassis that says so, schedulers that are busy
-module(starl_live_chassis_check_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_live_chassis).
-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, look/1]).

%% A chassis that never moves. It says of each command that it was heard so much later (us) than it was.
open(Own) -> {ok, Own#{job => none}}.

drive({starl_chassis_differential, Legs}, _Until, Mark, #{clock := Clock, late := Late} = Chassis) ->
    {LaterUs, Next} = Late(),
    Job = {Mark, starl_live_clock:now_us(Clock) + LaterUs},
    Us = lists:sum([Us || {_, _, Us} <- Legs]),
    _ = erlang:send_after(ceil(Us / 1000), self(), Job),
    {[], Chassis#{job := Job, late := Next}};
drive({_Other, Commands}, _Until, Mark, Chassis) ->
    {[{Mark, {not_understood, Commands}}], Chassis}.

actuate(_Device, _Value, _Mark, Chassis) -> {[], Chassis}.

stop(Chassis) -> Chassis#{job := none}.

hear({Mark, Heard} = Job, #{job := Job} = Chassis) ->
    {[{Mark, {driven, Heard}}], stop(Chassis)};
hear(look, #{clock := Clock} = Chassis) ->
    {[{posed, starl_live_clock:now_us(Clock), {0.0, 0.0, 0.0}}], Chassis};
hear(_Message, Chassis) ->
    {[], Chassis}.

look(Chassis) ->
    self() ! look,
    Chassis.

close(_Chassis) -> ok.

%% What the check says of the times of its commands.
times(Late) ->
    Found = starl_live_chassis_check:check({?MODULE, #{late => Late}}),
    [
        {How, Clause, lists:flatten(Text)}
     || {How, Clause, Text} <- Found, lists:member(Clause, [leg, turn, replaces])
    ].

in_time() -> {0, fun in_time/0}.

each_late() -> {2_000_000, fun each_late/0}.

one_late() -> {2_000_000, fun in_time/0}.

%% Its computer is busy for a while, so that nothing else runs, the check neither.
busy() ->
    End = erlang:monotonic_time(millisecond) + 150,
    Busy = fun Busy() ->
        case erlang:monotonic_time(millisecond) < End of
            true -> Busy();
            false -> ok
        end
    end,
    _ = [
        spawn_opt(Busy, [{priority, max}, link])
     || _ <- lists:seq(1, erlang:system_info(schedulers_online))
    ],
    true = erlang:yield(),
    {0, fun busy/0}.

a_command_is_heard_in_time_but_for_what_the_computer_loses_test_() ->
    {inparallel, [
        {timeout, 60, fun() ->
            ?assertMatch([{How, leg, _}, {How, turn, _}, {How, replaces, _}], times(Late))
        end}
     || {How, Late} <- [
            {ok, fun in_time/0},
            {ok, fun one_late/0},
            {ok, fun busy/0},
            {broken, fun each_late/0}
        ]
    ]}.
