%% A team with a leader, and a robot with the fleet's key that says beats with any term: nobody crashes, and after
%% that all follow one leader.
-module(starl_leadership_insider_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_monitor).
-export([init/1, step/2, finish/2, interests/0]).

-define(S, 1000000).
-define(BEAT, {{1000.0, 1000.0}, {2000.0, 2000.0}}).

%% A monitor that keeps whom each robot follows, and which applications have crashed.
interests() -> [app].

init(_) -> {#{}, []}.

step({_, Robot, app, {leads, Term}}, {Whom, Crashed}) ->
    {ok, {Whom#{Robot => {Term, Robot}}, Crashed}};
step({_, Robot, app, {follows, Term, Leader}}, {Whom, Crashed}) ->
    {ok, {Whom#{Robot => {Term, Leader}}, Crashed}};
step({_, Robot, app, crashed}, {Whom, Crashed}) ->
    {ok, {Whom, [Robot | Crashed]}};
step(_Event, Seen) ->
    {ok, Seen}.

finish(_, {Whom, Crashed}) -> {ok, #{whom => Whom, crashed => Crashed}}.

beats_with_any_term_end_nothing_test_() ->
    [
        {timeout, 60, fun() -> goes_on(N, Beats, Faults, Seed) end}
     || Beats <- beats(),
        {N, Seed} <- [{2, 1}, {3, 2}, {4, 3}],
        Faults <- [[], reboots(N)]
    ].

beats() ->
    %% the largest that an application can send
    Largest = (1 bsl 2040) - 1,
    [
        [{Largest, ?BEAT}],
        [{(1 bsl 90) + (1 bsl 32), ?BEAT}],
        [{(1 bsl 90) + (K bsl 32), ?BEAT} || K <- lists:seq(1, 20)],
        [{T, ?BEAT} || T <- [infinity, -1, 1.0e300, {2}, <<2>>, #{}]],
        [beat, 2, {2}, {2, ?BEAT, 3}, []]
    ].

goes_on(N, Beats, Faults, Seed) ->
    {ok, Sim} = starl_sim:start(
        #{
            app => starl_leadership_insider,
            attack => {20000, Beats},
            robots => N,
            seed => Seed,
            time => 150,
            duration => 110,
            faults => Faults
        },
        #{watch => [{?MODULE, #{}}]}
    ),
    _ = starl_sim:run(Sim),
    {#{violations := Violations, monitors := #{?MODULE := Seen}}, _} = starl_sim:finish(Sim),
    #{whom := Whom, crashed := Crashed} = Seen,
    %% a reboot shows as a crash, once
    Unexplained = Crashed -- [Robot || {_, _, _, reboot, Robot, _} <- Faults],
    ?assertEqual({[], []}, {[What || #{what := What} <- Violations], Unexplained}, {N, Seed}),
    ?assertMatch({_, [_]}, {N, lists:usort(maps:values(Whom))}, {N, Seed, Whom}).

%% All reboot while the insider has just spoken.
reboots(N) ->
    [
        {starl_platform_ct:fault_id(fault, Robot), 25000, 27000, reboot, Robot, #{}}
     || Robot <- lists:seq(1, N)
    ].
