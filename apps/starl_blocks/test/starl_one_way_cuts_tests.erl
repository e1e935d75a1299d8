%% One-way cuts that last: a robot that hears nobody, one that nobody hears, a single link that is cut one way. The others,
%% who hear each other, get on.
%%
%% Holds: A robot that hears nobody is elected by nobody else; a majority that hears each other
%% elects its highest
%% Red: 961f67c9, run: `deaf`
-module(starl_one_way_cuts_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_app).
-export([blocks/0, options/0, init/2, step/2]).
-export([mutex/2, bully/2, bully_link/2]).

-define(TEAMS, [3, 4, 8]).
-define(SEEDS, 1).
-define(CUT_MS, 10000).
-define(S, 1000000).
%% The lease, the time between two requests and the lag, in the monitor's bound for a token that lies idle; and the time
%% in which a member that does not hear the home repeats its claim, each time for another lease.
-define(IDLE_S, (2 * (8 + 3 + 0.25) + 8 + 25.2)).

%% -- the application -------------------------------------------------------------------------------

blocks() -> [starl_mutex, starl_bully].

options() -> [{use, {one_of, [mutex, bully]}, mutex, "the block that is used"}].

init(_Robot, #{use := Use}) -> {Use, 1}.

step(Robot, {Use, N}) ->
    ok = starl:trace(Robot, {begins, N}),
    ok = starl:trace(Robot, {ends, N, used(Use, Robot, N)}),
    ok = starl:sleep(Robot, 1500),
    case starl:now(Robot) < 70000 of
        true -> {continue, {Use, N + 1}};
        false -> {done, N}
    end.

used(mutex, Robot, _N) ->
    case starl_mutex:acquire(Robot, token(), 120000) of
        {ok, _} -> starl_mutex:release(Robot, token());
        {error, _} = Error -> Error
    end;
used(bully, Robot, N) ->
    %% robots enter one after the other, in an order that changes
    ok = starl:sleep(Robot, 400 * ((starl:id(Robot) + N) rem 3)),
    Elected = starl_election:elect(Robot, N, 20000),
    ok = starl:sleep(Robot, max(1, 5000 * N - starl:now(Robot))),
    Elected.

%% A token whose home is robot 1 of any of the teams.
token() ->
    hd([
        T
     || T <- lists:seq(1, 10000),
        lists:all(fun(N) -> starl_mutex:home(T, lists:seq(1, N)) =:= 1 end, ?TEAMS)
    ]).

run(Use, Robots, Seed, Faults) ->
    {ok, Sim} = starl_sim:start(
        #{
            app => ?MODULE,
            use => Use,
            robots => Robots,
            seed => Seed,
            time => 200,
            faults => Faults
        },
        #{watch => [{starl_blocks_recorder, #{}}]}
    ),
    _ = starl_sim:run(Sim),
    {#{violations := Violations} = Outcome, _} = starl_sim:finish(Sim),
    {[What || #{what := What} <- Violations], starl_blocks_script_app:trace(Outcome)}.

%% The cuts of robot `Robot', which need not be heard by, or hear, robot `Other'.
cuts(Robot, Other, Team) ->
    [
        {deaf, one_way(lists:delete(Robot, Team))},
        {mute, one_way([Robot])},
        {is_not_heard_by_one, link(Robot, Other)},
        {does_not_hear_one, link(Other, Robot)}
    ].

one_way(Group) -> {cut, ?CUT_MS, 3600000, one_way_partition, Group, #{}}.

link(From, To) -> {cut, ?CUT_MS, 3600000, loss, {From, To}, #{part => 1.0}}.

%% The longest time, s, that a robot waited for an answer after the cut.
longest(Robot, Trace) ->
    Begun = [T || {T, R, app, {begins, _}} <- Trace, R =:= Robot],
    Ended = [T || {T, R, app, {ends, _, ok}} <- Trace, R =:= Robot],
    {Last, _, _, _} = lists:last(Trace),
    Waits = [To - From || {From, To} <- zip(Begun, Ended, Last), To > 1000 * ?CUT_MS],
    lists:max([0 | Waits]) / ?S.

zip([B | Begun], [E | Ended], Last) -> [{B, E} | zip(Begun, Ended, Last)];
zip([B | _], [], Last) -> [{B, Last}];
zip([], [], _Last) -> [].

%% -- mutual exclusion ------------------------------------------------------------------------------

%% A member that hears its token's home no more, or is not heard, costs the others the time of its claim and a lease now
%% and then.
a_mutex_goes_on_when_a_member_is_cut_off_one_way_test_() ->
    {timeout, 300, [
        {timeout, 60, fun() -> mutex(Robots, Seed) end}
     || Robots <- ?TEAMS, Seed <- lists:seq(1, ?SEEDS)
    ]}.

mutex(Robots, Seed) ->
    Team = lists:seq(1, Robots),
    [
        begin
            {Violations, Trace} = run(mutex, Robots, Seed, [Cut]),
            ?assertEqual({Name, Robots, Seed, []}, {Name, Robots, Seed, Violations}),
            Late = [
                {Robot, Longest}
             || Robot <- lists:droplast(Team),
                Longest <- [longest(Robot, Trace)],
                Longest > ?IDLE_S
            ],
            ?assertEqual({Name, Robots, Seed, []}, {Name, Robots, Seed, Late})
        end
     || {Name, Cut} <- cuts(Robots, 1, Team)
    ].

%% -- the bully election ------------------------------------------------------------------------------

%% Robots that hear each other, and are a majority, elect the highest of them.
a_majority_elects_the_highest_robot_that_it_hears_and_that_hears_it_test_() ->
    {timeout, 300, [
        {timeout, 60, fun() -> bully(Robots, Seed) end}
     || Robots <- ?TEAMS, Seed <- lists:seq(1, ?SEEDS)
    ]}.

bully(Robots, Seed) ->
    Team = lists:seq(1, Robots),
    Next = Robots - 1,
    %% the cut, who elects, and whom
    Cuts = [
        {deaf, cut(deaf, Robots, 1, Team), lists:droplast(Team), Next},
        {mute, cut(mute, Robots, 1, Team), lists:droplast(Team), Next},
        {deaf_member, cut(deaf, 1, Robots, Team), tl(Team), Robots},
        {mute_member, cut(mute, 1, Robots, Team), tl(Team), Robots}
    ],
    [
        begin
            {Violations, Trace} = run(bully, Robots, Seed, [Cut]),
            ?assertEqual({Name, Robots, Seed, []}, {Name, Robots, Seed, Violations}),
            Elected = [
                {N, Robot, Answer}
             || {T, Robot, app, {ends, N, Answer}} <- Trace,
                T > 1000 * ?CUT_MS + 7 * ?S,
                lists:member(Robot, Electors)
            ],
            ?assert(length(Elected) >= 8 * length(Electors)),
            Others = [Other || {_, _, Answer} = Other <- Elected, Answer =/= {ok, Leader}],
            ?assertEqual({Name, Robots, Seed, []}, {Name, Robots, Seed, Others})
        end
     || {Name, Cut, Electors, Leader} <- Cuts
    ].

%% A link that is cut may take the highest robot, or the one that does not reach it, out of the majority.
a_majority_agrees_when_a_single_link_is_cut_test_() ->
    {timeout, 300, [
        {timeout, 60, fun() -> bully_link(Robots, Seed) end}
     || Robots <- ?TEAMS, Seed <- lists:seq(1, ?SEEDS)
    ]}.

bully_link(Robots, Seed) ->
    Team = lists:seq(1, Robots),
    [
        begin
            {Violations, Trace} = run(bully, Robots, Seed, [cut(Kind, Robot, Robots, Team)]),
            ?assertEqual({Kind, Robot, Robots, Seed, []}, {Kind, Robot, Robots, Seed, Violations}),
            Elected = maps:groups_from_list(
                fun({N, _}) -> N end,
                fun({_, {ok, Leader}}) -> Leader end,
                [
                    {N, Answer}
                 || {T, _, app, {ends, N, Answer}} <- Trace,
                    T > 1000 * ?CUT_MS + 7 * ?S,
                    N < 13
                ]
            ),
            Split = [N || {N, Leaders} <- maps:to_list(Elected), 2 * most(Leaders) =< Robots],
            ?assertEqual({Kind, Robot, Robots, Seed, []}, {Kind, Robot, Robots, Seed, Split})
        end
     || Kind <- [is_not_heard_by_one, does_not_hear_one], Robot <- [1, Robots - 1]
    ].

most(Leaders) -> lists:max([length([L || L <- Leaders, L =:= Leader]) || Leader <- Leaders]).

cut(Kind, Robot, Other, Team) -> proplists:get_value(Kind, cuts(Robot, Other, Team)).
