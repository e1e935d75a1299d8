%% Two runs that should be equal and are not are led back to the first event that differs.
-module(starl_sim_divergence_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    same/1,
    planted_self/1,
    planted_late/1,
    first_of_many_robots/1,
    one_ends_earlier/1,
    gone/1,
    never_the_same_place/1
]).

-define(APP, starl_sim_script_app).

suite() -> [{timetrap, {minutes, 1}}].

all() ->
    [
        same,
        planted_self,
        planted_late,
        first_of_many_robots,
        one_ends_earlier,
        gone,
        never_the_same_place
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

same(_) ->
    Run = runner(fun(R) -> starl:sleep(R, 100 * starl:id(R)) end, #{robots => 3}),
    ?assertEqual(same, starl_sim_divergence:find(Run, Run)).

%% A decision by self(): the robot sends one of very many numbers. The first event that differs is
%% the request that its application makes of SAP, right after the same event in both.
planted_self(_) ->
    Run = runner(
        fun(R) ->
            ok = starl:listen(R, a),
            ok = starl:sleep(R, 1000),
            Decision =
                case starl:id(R) of
                    2 -> erlang:phash2(self());
                    _ -> 7
                end,
            starl:send(R, 3, a, {decided, Decision}),
            starl:sleep(R, 1000)
        end,
        #{robots => 3, shards => 2}
    ),
    {differ, #{robot := 2, n := N, first := A, second := B, before := Before}} =
        starl_sim_divergence:find(Run, Run),
    #{machine := sap, n := N, type := {call, {app, _}}, content := CA, at_us := At} = A,
    #{machine := sap, n := N, type := {call, {app, _}}, content := CB, at_us := At} = B,
    ?assertNotEqual(CA, CB),
    [?assertNotEqual(nomatch, string:find(text(C), "decided")) || C <- [CA, CB]],
    ?assertMatch(#{machine := app, type := {timeout, _}}, lists:last(Before)).

%% Far behind the first checkpoint, with other robots at work. What differs is known: it is the
%% first thing after the 1,500th nap.
planted_late(_) ->
    Run = fun(Way) ->
        runner(
            fun(R) ->
                [starl:sleep(R, 10) || _ <- lists:seq(1, 1500)],
                starl:id(R) =:= 3 andalso starl:sleep(R, Way),
                [starl:sleep(R, 10) || _ <- lists:seq(1, 500)]
            end,
            #{robots => 3, clock_drift => 0}
        )
    end,
    {differ, #{robot := 3, n := N, first := A, second := B, before := Before}} =
        starl_sim_divergence:find(Run(7), Run(8)),
    ?assert(N > 1500),
    ?assertEqual(1000, maps:get(at_us, B) - maps:get(at_us, A)),
    ?assertEqual(7000, maps:get(at_us, A) - maps:get(at_us, lists:last(Before))),
    ?assertMatch(#{machine := app, type := {timeout, _}}, A).

%% One robot starts it; what it sends makes a hundred others differ, all of them later.
first_of_many_robots(_) ->
    Run = fun(Way) ->
        runner(
            fun(R) ->
                ok = starl:listen(R, a),
                case starl:id(R) of
                    77 ->
                        ok = starl:sleep(R, 500),
                        starl:broadcast(R, a, Way);
                    _ ->
                        {ok, 77, _} = starl:await(R, a)
                end
            end,
            #{robots => 100, mode => inline, shards => 3}
        )
    end,
    {differ, #{robot := 77, first := A, second := B}} = starl_sim_divergence:find(Run(a), Run(b)),
    ?assertMatch({#{machine := sap}, #{machine := sap}}, {A, B}).

%% A run that has no such event any more.
one_ends_earlier(_) ->
    Run = fun(Naps) ->
        runner(fun(R) -> [starl:sleep(R, 10) || _ <- lists:seq(1, Naps)] end, #{robots => 1})
    end,
    {differ, #{robot := 1, first := none, second := #{n := N}, n := N}} =
        starl_sim_divergence:find(Run(20), Run(21)).

%% A difference that does not come back is not made up.
gone(_) ->
    Run = runner(fun starl:id/1, #{robots => 2}),
    #{digest := <<A, Rest/binary>>, chains := [{1, Chain, N, Cs}, Other]} = Result = Run(#{}),
    Odd = Result#{digest := <<(A bxor 1), Rest/binary>>, chains := [{1, Chain + 1, N, Cs}, Other]},
    ?assertEqual(gone, starl_sim_divergence:find(Result, Odd, Run, Run)).

%% Runs that differ each time, and each time elsewhere: found all the same, in the runs that the
%% events are from.
never_the_same_place(_) ->
    Count = atomics:new(1, []),
    Run = runner(
        fun(R) ->
            Naps = 1 + atomics:add_get(Count, 1, 1) * 1237 rem 3000,
            [starl:sleep(R, 10) || _ <- lists:seq(1, Naps)],
            starl:sleep(R, 3)
        end,
        #{robots => 4}
    ),
    {differ, #{robot := Id, first := A, second := B}} = starl_sim_divergence:find(Run, Run),
    ?assert(Id >= 1 andalso Id =< 4),
    ?assertNotEqual(A, B).

%% -- helpers --------------------------------------------------------------------------------

runner(Script, Scenario) ->
    Full = maps:merge(#{app => ?APP, script => Script, time => 600}, Scenario),
    fun(Record) -> starl_sim_divergence:run(Full, Record) end.

text(Term) -> lists:flatten(io_lib:format("~0p", [Term])).
