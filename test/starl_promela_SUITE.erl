%% Traces of soak, replayed against models in Promela that somebody else could have written: what home and
%% owners of a token may say, and leaders of terms. Spin is optional, as other tools are.
%%
%% Holds: Traces of soak are those of a lock and of terms, in the words of another model;
%% deviations are refused at their fact
%% Red: each deviation is one
-module(starl_promela_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([locks_of_a_soak_are_accepted/1, terms_of_a_soak_are_accepted/1]).
-export([deviations_of_a_lock_are_refused/1, deviations_of_terms_are_refused/1]).
-export([a_long_trace_takes_no_time/1]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        locks_of_a_soak_are_accepted,
        terms_of_a_soak_are_accepted,
        deviations_of_a_lock_are_refused,
        deviations_of_terms_are_refused,
        a_long_trace_takes_no_time
    ].

init_per_suite(Config) ->
    case starl_promela:find() of
        ok ->
            Dir = proplists:get_value(priv_dir, Config),
            Made = [
                {Model, starl_promela:build(Model, filename:join(Dir, Model))}
             || Model <- ["lock", "terms"]
            ],
            starl_platform_ct:without_log([{models, Made} | Config]);
        {missing, Why} ->
            {skip, Why}
    end.

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

verifier(Model, Config) -> proplists:get_value(Model, proplists:get_value(models, Config)).

%% -- traces of soak -------------------------------------------------------------------------

%% Clocks keep to what is assumed of them: the model has no excuses.
trace(Block, Classes, Seed) ->
    Scenario = starl_lab_soak:scenario(Block, none, Seed),
    Faults = #{random_faults => Classes},
    Self = self(),
    Observe = fun
        ({judged, Trace, _}) ->
            Self ! {trace, Trace},
            ok;
        (_) ->
            ok
    end,
    {ok, Sim} = starl_sim:start(
        maps:merge(Scenario, Faults#{mode => inline, shards => 1}), #{observe => Observe}
    ),
    _ = starl_sim:run(Sim),
    {#{violations := []}, _} = starl_sim:finish(Sim),
    received().

received() ->
    receive
        {trace, Trace} -> Trace ++ received()
    after 0 -> []
    end.

locks_of_a_soak_are_accepted(Config) ->
    Dir = verifier("lock", Config),
    Seed = starl_platform_ct:seed() rem 1000000,
    Replayed = lists:append([
        begin
            Trace = trace(mutex, [network, process, store], N),
            [
                {N, Token, length(Facts), starl_promela:replay(Facts, Dir)}
             || Token <- starl_promela:tokens(Trace), Facts <- [starl_promela:lock(Token, Trace)]
            ]
        end
     || N <- lists:seq(Seed, Seed + 5)
    ]),
    ct:pal("~p", [Replayed]),
    ?assertEqual([], [One || {_, _, _, Answer} = One <- Replayed, Answer =/= accepted]),
    ?assert(length(Replayed) > 0).

%% Where stores are set back a lower term may follow one that has ended.
terms_of_a_soak_are_accepted(Config) ->
    Dir = verifier("terms", Config),
    Seed = starl_platform_ct:seed() rem 1000000,
    Replayed = [
        {N, length(Facts), starl_promela:replay(Facts, Dir)}
     || N <- lists:seq(Seed, Seed + 4),
        Facts <- [starl_promela:terms(trace(dpp, [network, process], N))]
    ],
    ct:pal("~p", [Replayed]),
    ?assertEqual([], [One || {_, _, Answer} = One <- Replayed, Answer =/= accepted]),
    ?assert(lists:sum([Length || {_, Length, _} <- Replayed]) > 100).

%% -- planted deviations ---------------------------------------------------------------------

granted(Hand, To) -> {1, Hand, Hand, To, 0}.
leased(Hold, Hand, R, Until) -> {2, Hold, Hand, R, Until}.
acquired(Hold, Hand, R, At) -> {3, Hold, Hand, R, At}.
released(Hold, Hand, R, At) -> {4, Hold, Hand, R, At}.
lost(Hold, Hand, R, At) -> {5, Hold, Hand, R, At}.
crashed(R) -> {6, 0, 0, R, 0}.

hold(Hold, Hand, R, At) -> [leased(Hold, Hand, R, At + 100), acquired(Hold, Hand, R, At)].

deviations_of_a_lock_are_refused(Config) ->
    Dir = verifier("lock", Config),
    First = [granted(1, 1) | hold(1, 1, 1, 10)],
    Right = First ++ [released(1, 1, 1, 20), granted(3, 2)] ++ hold(3, 3, 2, 30),
    ?assertEqual(accepted, starl_promela:replay(Right, Dir)),
    %% its lease has run out, and it does not know: the hidden step
    Late = First ++ [granted(3, 2)] ++ hold(3, 3, 2, 150) ++ [lost(1, 1, 1, 160)],
    ?assertEqual(accepted, starl_promela:replay(Late, Dir)),
    [
        ?assertEqual({Name, {refused, At}}, {Name, starl_promela:replay(Facts, Dir)})
     || {Name, At, Facts} <- [
            {hand_over_goes_back, 1, [granted(3, 1), granted(1, 2)]},
            {acquired_without_a_grant, 1, hold(1, 1, 1, 10)},
            {acquired_by_another, 2, [granted(1, 1) | hold(1, 1, 2, 10)]},
            {without_a_lease, 1, [granted(1, 1), acquired(1, 1, 1, 10)]},
            {two_holders, 5, First ++ [granted(3, 2)] ++ hold(3, 3, 2, 50)},
            {a_number_comes_twice, 5, First ++ [released(1, 1, 1, 20) | hold(1, 1, 1, 30)]},
            {released_by_another, 3, First ++ [released(1, 1, 2, 20)]},
            {released_twice, 4, First ++ [released(1, 1, 1, 20), released(1, 1, 1, 21)]},
            {released_after_its_lease_while_another_holds, 6,
                First ++ [granted(3, 2)] ++ hold(3, 3, 2, 150) ++ [released(1, 1, 1, 160)]},
            {released_after_a_crash, 4, First ++ [crashed(1), released(1, 1, 1, 20)]}
        ]
    ].

deviations_of_terms_are_refused(Config) ->
    Dir = verifier("terms", Config),
    Claims = fun(Term, R) -> {1, Term, 0, R, 0} end,
    Leads = fun(Term, R) -> {2, Term, 0, R, 0} end,
    Assigns = fun(Term, R) -> {3, Term, 0, R, 0} end,
    Down = fun(Term, R) -> {4, Term, 0, R, 0} end,
    Crashed = {5, 0, 0, 1, 0},
    First = [Claims(1, 1), Leads(1, 1), Assigns(1, 1), Assigns(0, 1)],
    Second = [Claims(2, 2), Leads(2, 2)],
    Right = First ++ Second ++ [Assigns(2, 2), Down(1, 1), Assigns(0, 2)],
    ?assertEqual(accepted, starl_promela:replay(Right, Dir)),
    %% a leader that was late claims anew (soak, seed 311475)
    Anew = First ++ [Claims(2, 1)],
    ?assertEqual(accepted, starl_promela:replay(Anew ++ [Leads(2, 1), Assigns(2, 1)], Dir)),
    [
        ?assertEqual({Name, {refused, At}}, {Name, starl_promela:replay(Facts, Dir)})
     || {Name, At, Facts} <- [
            {assigns_while_it_claims_anew, 5, Anew ++ [Assigns(0, 1)]},
            {leads_without_a_claim, 0, [Leads(1, 1)]},
            {leads_in_the_term_of_another, 1, [Claims(1, 1), Leads(1, 2)]},
            {a_lower_term_after_a_higher, 3, [Claims(1, 1) | Second] ++ [Leads(1, 1)]},
            {claims_a_term_twice, 3, [Claims(1, 1), Leads(1, 1), Down(1, 1), Claims(1, 1)]},
            {assigns_before_it_leads, 1, [Claims(1, 1), Assigns(1, 1)]},
            {assigns_beside_the_next_one, 6, First ++ Second ++ [Assigns(0, 1)]},
            {assigns_after_a_crash, 5, First ++ [Crashed, Assigns(0, 1)]},
            {steps_down_without_leading, 1, [Claims(1, 1), Down(1, 1)]}
        ]
    ].

%% Data, not code: 15,000 facts.
a_long_trace_takes_no_time(Config) ->
    Facts = lists:append([
        [granted(N, 1 + N rem 3)] ++ hold(N, N, 1 + N rem 3, 10 * N) ++
            [released(N, N, 1 + N rem 3, 10 * N + 5)]
     || N <- lists:seq(1, 3750)
    ]),
    ?assertEqual(accepted, starl_promela:replay(Facts, verifier("lock", Config))).
