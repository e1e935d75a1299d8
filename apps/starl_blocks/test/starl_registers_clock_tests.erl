%% A clock that was once far ahead: once it is right, what is written is read by all, and what is refused is
%% reported to the robot that writes.
%%
%% Holds: A clock that was an hour ahead costs the registers only the time in which it was wrong,
%% also after a reboot; who is refused hears of it
%% Red: 961f67c9, run: 25 of 25
-module(starl_registers_clock_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_app).
-export([blocks/0, init/2, step/2, run/3]).

-define(HOUR_MS, 3600000).
-define(SEEDS, 3).

%% -- the application: robot 1 writes a number each second, the others read it ---------------------

blocks() -> [starl_registers].

init(_Robot, _Options) -> 0.

step(Robot, N) when N < 90 ->
    ok = starl:sleep(Robot, 1000),
    case starl:id(Robot) of
        1 -> ok = starl:trace(Robot, {wrote, N, starl_registers:put(Robot, board, N)});
        _ -> ok = starl:trace(Robot, {read, starl_registers:get(Robot, board)})
    end,
    {continue, N + 1};
step(_Robot, N) ->
    {done, N}.

run(Robots, Seed, Faults) ->
    {ok, Sim} = starl_sim:start(
        #{
            app => ?MODULE, robots => Robots, seed => Seed, time => 130, faults => Faults
        },
        #{watch => [{starl_blocks_recorder, #{}}]}
    ),
    _ = starl_sim:run(Sim),
    {#{violations := Violations} = Outcome, _} = starl_sim:finish(Sim),
    {[What || #{what := What} <- Violations], starl_blocks_script_app:trace(Outcome)}.

ahead() -> {ahead, 5000, 20000, clock_offset, 1, #{ms => ?HOUR_MS}}.
%% Timers of a clock that is set back by an hour are late by an hour, so the robot reboots.
again(From) -> {again, From, From + 5000, reboot, 1, #{}}.

%% -- the contract ----------------------------------------------------------------------------------

once_the_clock_is_right_what_is_written_is_read_by_all_test_() ->
    {timeout, 300, [
        {timeout, 60, fun() -> read_by_all(Robots, Seed, Faults) end}
     || Robots <- [2, 3, 4, 8],
        Seed <- lists:seq(1, ?SEEDS),
        Faults <- [[ahead(), again(40000)], [ahead(), again(18000)]]
    ]}.

read_by_all(Robots, Seed, Faults) ->
    {Violations, Trace} = run(Robots, Seed, Faults),
    Written = [N || {T, 1, app, {wrote, N, ok}} <- Trace, T > 50000000, T < 80000000],
    ?assert(length(Written) >= 29),
    Last = fun(Robot) ->
        lists:last([-1 | [N || {_, R, app, {read, {ok, N}}} <- Trace, R =:= Robot]])
    end,
    Behind = [Robot || Robot <- lists:seq(2, Robots), Last(Robot) < lists:last(Written)],
    ?assertEqual({Robots, Seed, []}, {Robots, Seed, Behind}),
    ?assertEqual({Robots, Seed, []}, {Robots, Seed, Violations}).

%% While the clock is wrong nobody takes what the robot writes, and it is not told `ok'.
what_is_refused_is_reported_to_its_writer_test_() ->
    {timeout, 60, fun() ->
        {_, Trace} = run(3, 1, [ahead()]),
        Answers = [A || {T, 1, app, {wrote, _, A}} <- Trace, T > 6500000, T < 19000000],
        ?assertEqual([{error, refused}], lists:usort(Answers))
    end}.
