%% A team with a leader, under one-way cuts that last: the robots that are not cut off follow one leader, and keep it.
-module(starl_leadership_cuts_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_monitor).
-export([init/1, step/2, finish/2, interests/0]).
-export([keeps/2]).

-define(S, 1000000).
-define(SEEDS, 1).

%% A monitor that keeps who has followed whom.
interests() -> all.

init(_) -> [].

step({T, Robot, app, {leads, Term}}, Seen) -> {ok, note(T, Robot, {Term, Robot}, Seen)};
step({T, Robot, app, {follows, Term, Leader}}, Seen) -> {ok, note(T, Robot, {Term, Leader}, Seen)};
step(_Event, Seen) -> {ok, Seen}.

%% A leader says so with every beat.
note(T, Robot, Whom, Seen) ->
    case lists:keyfind(Robot, 2, Seen) of
        {_, Robot, Whom} -> Seen;
        _ -> [{T, Robot, Whom} | Seen]
    end.

finish(_, Seen) -> {ok, #{seen => lists:reverse(Seen)}}.

a_majority_keeps_one_leader_under_a_one_way_cut_that_lasts_test_() ->
    {timeout, 300, [
        {timeout, 100, fun() -> keeps(Robots, Seed) end}
     || Robots <- [3, 4, 8], Seed <- lists:seq(1, ?SEEDS)
    ]}.

keeps(N, Seed) ->
    Team = lists:seq(1, N),
    [
        begin
            {Violations, Seen} = run(N, Seed, Fault),
            ?assertEqual({Name, N, Seed, []}, {Name, N, Seed, Violations}),
            Last = fun(Robot) -> lists:last([{T, W} || {T, R, W} <- Seen, R =:= Robot]) end,
            {Times, Whom} = lists:unzip([Last(Robot) || Robot <- Team, Robot =/= Beside]),
            ?assertMatch({Name, N, Seed, [_]}, {Name, N, Seed, lists:usort(Whom)}),
            ?assert(lists:max(Times) < 45 * ?S)
        end
     || {Name, Beside, Fault} <- [
            {deaf, N, one_way(lists:droplast(Team))},
            {mute, N, one_way([N])},
            {deaf_member, 1, one_way(tl(Team))},
            {mute_member, 1, one_way([1])},
            {is_not_heard, 1, link(1, N)},
            {does_not_hear, 1, link(N, 1)},
            {next_is_not_heard, N - 1, link(N - 1, N)},
            {next_does_not_hear, N - 1, link(N, N - 1)}
        ]
    ].

run(N, Seed, Fault) ->
    {ok, Sim} = starl_sim:start(
        #{
            app => starl_follow,
            robots => N,
            seed => Seed,
            time => 120,
            duration => 90,
            faults => [Fault]
        },
        #{watch => [{?MODULE, #{}}]}
    ),
    _ = starl_sim:run(Sim),
    {#{violations := Violations, monitors := #{?MODULE := #{seen := Seen}}}, _} =
        starl_sim:finish(Sim),
    {[What || #{what := What} <- Violations], Seen}.

one_way(Group) -> {cut, 20000, 3600000, one_way_partition, Group, #{}}.

link(From, To) -> {cut, 20000, 3600000, loss, {From, To}, #{part => 1.0}}.
