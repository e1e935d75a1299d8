%% The contract of mutual exclusion (README) in the simulator, under faults; the
%% judge is starl_mutex_monitor. And the planted bugs that it must find.
-module(starl_mutex_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1,
    contract_with_short_leases/1,
    progress_without_crashes/1,
    holder_crash_recovers/1,
    home_crash_recovers/1,
    planted_bugs_are_caught/1,
    long_holds_are_renewed/1
]).

all() ->
    [
        contract_under_faults,
        contract_with_short_leases,
        progress_without_crashes,
        holder_crash_recovers,
        home_crash_recovers,
        planted_bugs_are_caught,
        long_holds_are_renewed
    ].

%% Safety: never two holders, fences grow, under loss, duplicates, delays, drift and crashes.
contract_under_faults(_) -> holds(#{}, 80).

%% The same where leases are lost all the time, with the holders alive.
contract_with_short_leases(_) -> holds(#{hold => 2000, config => #{lease_ms => 300}}, 40).

holds(Options, Cases) ->
    Prop = ?FORALL(
        Storm,
        starl_blocks_storm:storm(mutex),
        starl_platform_ct:safely(fun() ->
            Outcome = starl_blocks_storm:run(starl_mutex_app, Storm, Options),
            starl_blocks_storm:broken(mutex, Outcome) =:= []
        end)
    ),
    starl_platform_ct:property(Prop, Cases).

%% Progress: holders release, nobody crashes: every request is granted within 20 s.
progress_without_crashes(_) ->
    Options = #{patience => 60000, judge => #{bound_us => 20000000, granted => true}},
    [
        begin
            {Seed, Loss, Dup, Delay, Drift, _} = starl_blocks_storm:drawn(N, mutex),
            Quiet = {Seed, min(Loss, 0.2), Dup, Delay, Drift, []},
            Outcome = starl_blocks_storm:run(starl_mutex_app, Quiet, Options),
            ?assertEqual({N, []}, {N, starl_blocks_storm:broken(mutex, Outcome)}),
            ?assertMatch({N, #{ending := done}}, {N, Outcome})
        end
     || N <- lists:seq(1, 20)
    ].

%% A crash of any robot's mutex machine, holder or home: all requests are granted within two
%% leases and the rest.
holder_crash_recovers(_) -> recovers([{30, R, mutex} || R <- [1, 2, 3]]).

home_crash_recovers(_) -> recovers([{10 + 20 * R, R, mutex} || R <- [1, 2, 3, 4]]).

recovers(Strikes) ->
    Options = #{patience => 60000, judge => #{bound_us => 30000000}},
    [
        begin
            Storm = {Seed, 0.1, 0.1, {5, 20}, 10000, Strikes},
            Outcome = starl_blocks_storm:run(starl_mutex_app, Storm, Options),
            ?assertEqual({Seed, []}, {Seed, starl_blocks_storm:broken(mutex, Outcome)}),
            ?assertMatch({Seed, #{ending := done}}, {Seed, Outcome})
        end
     || Seed <- lists:seq(1, 10)
    ].

%% A hold much longer than a lease is not lost: neither one of a token that came for it nor one of a
%% token that was idle here, of this robot as its home or not.
long_holds_are_renewed(_) ->
    Script = fun(R) ->
        Mine = [{token, N, starl:id(R)} || N <- [1, 2, 3, 4]],
        [
            begin
                {ok, _} = starl_mutex:acquire(R, Token, 20000),
                ok = starl_mutex:release(R, Token),
                ok = starl:sleep(R, 200 * Idle),
                {ok, _} = starl_mutex:acquire(R, Token, 20000),
                ok = starl:sleep(R, 5000),
                starl_mutex:release(R, Token)
            end
         || Token <- Mine, Idle <- [0, 1, 2]
        ]
    end,
    Around = #{
        blocks => starl_mutex:machines(#{lease_ms => 1000}),
        monitors => [{starl_mutex_monitor, #{lease_us => 1000000}}]
    },
    #{violations := [], robots := Robots} =
        starl_blocks_script_app:play(Script, Around, #{robots => 2, time => 200, seed => 1}),
    ?assertEqual(
        [{done, lists:duplicate(12, ok)} || _ <- Robots],
        [Result || {_, #{result := Result}} <- Robots]
    ).

%% Each planted bug is found within 100 seeds.
planted_bugs_are_caught(_) ->
    [
        begin
            Found = starl_blocks_storm:caught(
                mutex, starl_mutex_app, mutex, {Extra#{machine => starl_mutex_planted}, 100}
            ),
            ct:pal("~p: ~p", [Extra, Found]),
            ?assertMatch({Extra, {caught, _, _}}, {Extra, Found})
        end
     || Extra <- [
            #{config => #{variant => impatient_home}},
            #{config => #{variant => forgetful_home}},
            #{config => #{variant => trusting}},
            %% these robots are prompt, so the home need not wait for late ones
            #{hold => 2000, config => #{variant => overstaying, lease_ms => 300, lag_ms => 0}}
        ]
    ].
