%% The counter's memory: it does not grow with restarts, nor with what a robot with the key invents; and
%% what is invented does not end it.
%%
%% Holds: A counter takes the same memory and packets after 10,000 restarts, and loses no increment
%% that was answered
%% Red: 4ca8e259, run: a message of 109 kB
-module(starl_counter_memory_tests).
%% in this order: both have a macro LET
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-define(META, #{now => 0}).
%% The largest life and number that the shape of messages lets through.
-define(SERIAL, 16#FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF).
-define(COUNT, 16#3FFFFFFFFFFFFFF).
%% The words of a tally with four lives and the largest numbers.
-define(WORDS, 60).

%% -- robots ---------------------------------------------------------------------------------

%% A team of machines with their stores; nothing is lost but by `crash'.
team(N) -> maps:from_list([{R, boot(R, N, 1, none)} || R <- lists:seq(1, N)]).

boot(Robot, N, Life, Stored) ->
    {ready, Data, _} = starl_counter_gossip:init(#{
        robot => Robot, participants => [{1, N}], incarnation => Life, stored => Stored
    }),
    #{data => Data, life => Life, stored => Stored}.

crash(Robot, Team) -> restart(Robot, maps:get(stored, maps:get(Robot, Team)), Team).

damage(Robot, Team) -> restart(Robot, damaged, Team).

restart(Robot, Stored, Team) ->
    #{Robot := #{life := Life}} = Team,
    Team#{Robot := boot(Robot, map_size(Team), Life + 1, Stored)}.

does(Type, Content, #{data := Data} = Robot) ->
    {Next, Actions} =
        case starl_counter_gossip:handle_event(Type, Content, ready, Data, ?META) of
            {keep_state, More} -> {More, []};
            {keep_state, More, Done} -> {More, Done};
            {keep_state_and_data, Done} -> {Data, Done}
        end,
    Stored = [{stored, Term} || {store, Term} <- Actions],
    {lists:foldl(fun(Term, R) -> R#{stored := Term} end, Robot#{data := Next}, Stored), Actions}.

increment(Robot, Team) ->
    {Next, _} = does({call, {app, t}}, increment, maps:get(Robot, Team)),
    Team#{Robot := Next}.

value(Robot, Team) ->
    {_, [_, {reply, _, Value}]} = does({call, {app, t}}, value, maps:get(Robot, Team)),
    Value.

values(Team) -> [value(Robot, Team) || Robot <- lists:sort(maps:keys(Team))].

%% The next gossip of a robot arrives.
gossip(Robot, Team) ->
    {Next, Actions} = does({timeout, gossip}, gossip, maps:get(Robot, Team)),
    lists:foldl(
        fun({To, Body}, T) -> hears(Robot, To, Body, T) end,
        Team#{Robot := Next},
        [{To, Body} || {cast, sap, {send, To, counter, Body}} <- Actions]
    ).

hears(From, To, Body, Team) ->
    ?assertEqual(ok, starl_payload:check(message, Body)),
    ?assert(starl_counter_gossip:accepts(counter, Body)),
    {Heard, _} = does(cast, {message, From, counter, Body}, maps:get(To, Team)),
    Team#{To := Heard}.

%% Each tells each of the others so often.
rounds(Times, Team) ->
    Turns = [
        R
     || _ <- lists:seq(1, Times * (map_size(Team) - 1)), R <- lists:seq(1, map_size(Team))
    ],
    lists:foldl(fun gossip/2, Team, Turns).

words(Robot, Team) -> erts_debug:flat_size(maps:get(data, maps:get(Robot, Team))).

%% -- honest restarts ------------------------------------------------------------------------

%% Ten thousand restarts, with an increment in each: nothing is lost, and nothing grows.
ten_thousand_restarts_test_() -> {timeout, 60, fun ten_thousand_restarts/0}.

ten_thousand_restarts() ->
    Live = fun(_, Team) -> gossip(1, increment(1, crash(1, Team))) end,
    Ten = lists:foldl(Live, team(3), lists:seq(1, 10)),
    Many = lists:foldl(Live, Ten, lists:seq(11, 10000)),
    ?assertEqual([10000, 10000, 10000], values(rounds(1, Many))),
    [?assertEqual(words(R, Ten), words(R, Many)) || R <- [1, 2, 3]].

%% All robots of a large team have restarted often: what one of them tells still fits into messages, and all
%% of it arrives.
a_large_team_tells_in_parts_test_() -> {timeout, 60, fun a_large_team_tells_in_parts/0}.

a_large_team_tells_in_parts() ->
    N = 1000,
    Late = 1 bsl 57,
    Lives = [{Late + L, ?COUNT} || L <- [2, 3, 4, 5]],
    All = [{R, Late + 1, ?COUNT, Lives} || R <- lists:seq(2, N)],
    Heard = lists:foldl(
        fun(Tally, T) -> hears(2, 1, {tallies, [Tally]}, T) end, team(N), All
    ),
    {_, Actions} = does({timeout, gossip}, gossip, maps:get(1, Heard)),
    Bodies = [Body || {cast, sap, {send, 2, counter, Body}} <- Actions],
    ?assert(length(Bodies) > 1),
    Told = lists:foldl(fun(Body, T) -> hears(1, 2, Body, T) end, Heard, Bodies),
    ?assertEqual((N - 1) * 5 * ?COUNT, value(2, Told)).

%% Robots count, tell, and restart with what they have stored: every answered increment counts in the end, and
%% memory is bounded.
prop_nothing_stored_is_lost() ->
    ?FORALL({N, Steps}, {range(1, 4), steps([count, tell, crash])}, begin
        Played = lists:foldl(fun play/2, team(N), Steps),
        Made = length([count || {count, _} <- Steps]),
        {N, Steps, lists:duplicate(N, Made)} =:= {N, Steps, values(rounds(1, Played))}
    end).

%% With stores that are lost, too: a value never exceeds the increments and never goes back, all
%% agree, and who has not lost its store has its own.
prop_lost_stores() ->
    ?FORALL({N, Steps}, {range(2, 4), steps([count, tell, crash, damage])}, begin
        {Played, Fine} = lists:foldl(fun watched/2, {team(N), true}, Steps),
        Made = length([count || {count, _} <- Steps]),
        Ended = rounds(3, Played),
        [Value | _] = All = values(Ended),
        Fine andalso lists:usort(All) =:= [Value] andalso Value =< Made andalso
            Value >= lists:max(values(Played)) andalso
            lists:all(fun(R) -> words(R, Ended) =< 40 + N * ?WORDS end, lists:seq(1, N))
    end).

properties_test_() ->
    [
        {timeout, 60, fun() -> starl_platform_ct:property(Property, 300) end}
     || Property <- [prop_nothing_stored_is_lost(), prop_lost_stores()]
    ].

steps(Kinds) -> proper_types:list({proper_types:oneof(Kinds), proper_types:range(1, 4)}).

play({Kind, R}, Team) ->
    Robot = 1 + R rem map_size(Team),
    case Kind of
        count -> increment(Robot, Team);
        tell -> gossip(Robot, Team);
        crash -> crash(Robot, Team);
        damage -> damage(Robot, Team)
    end.

watched({Kind, _} = Step, {Team, Fine}) ->
    Next = play(Step, Team),
    Back = lists:any(fun({A, B}) -> B < A end, lists:zip(values(Team), values(Next))),
    {Next, Fine andalso (Kind =:= crash orelse Kind =:= damage orelse not Back)}.

%% -- what a robot with the key invents ------------------------------------------------------

%% 250 messages full of invented lives, of the sender, of others, of this robot, and of robots that are not in the team.
invented_lives_test_() -> {timeout, 60, fun invented_lives/0}.

invented_lives() ->
    Claim = fun(Robot, K, I) ->
        Life = K * 5000 + I,
        {Robot, Life, ?COUNT, [{Life + J, ?COUNT} || J <- [1, 2, 3, 4]]}
    end,
    Attack = fun(K, Team) ->
        Body = {tallies, [Claim(1 + I rem 50, K, I) || I <- lists:seq(1, 400)]},
        hears(3, 1, Body, Team)
    end,
    Attacked = lists:foldl(Attack, increment(1, team(3)), lists:seq(1, 250)),
    ?assert(words(1, Attacked) =< 40 + 3 * ?WORDS, words(1, Attacked)),
    works(Attacked).

%% The largest numbers that a message may hold, one by one and together, again and again.
largest_numbers_test_() ->
    Claims = [
        {Horizon, Sum, Lives}
     || Horizon <- [0, 1, ?COUNT, 1 bsl 59, ?SERIAL - 1, ?SERIAL],
        Sum <- [0, ?COUNT],
        Lives <- [[], [{?SERIAL, ?COUNT}], [{?COUNT, ?COUNT}], [{1, ?COUNT}, {2, ?COUNT}]]
    ],
    [
        {timeout, 60, fun() -> largest_numbers(Robot, Claims, Times) end}
     || Robot <- [1, 2, 3], Times <- [1, 20]
    ].

largest_numbers(Robot, Claims, Times) ->
    Attack = fun({Horizon, Sum, Lives}, Team) ->
        gossip(1, hears(3, 1, {tallies, [{Robot, Horizon, Sum, Lives}]}, Team))
    end,
    Begun = rounds(1, increment(2, increment(1, team(3)))),
    Attacked = lists:foldl(Attack, Begun, lists:append(lists:duplicate(Times, Claims))),
    ?assert(words(1, Attacked) =< 60 + 3 * ?WORDS, words(1, Attacked)),
    works(Attacked).

%% The attack has ended: all agree, whatever was claimed. When what was claimed of lives is folded, each
%% increment counts, over restarts, too, also of all robots.
works(Attacked) ->
    Each = fun(Does, T) -> lists:foldl(Does, T, [1, 2, 3]) end,
    Lived = fun(_, T) -> rounds(1, Each(fun increment/2, Each(fun crash/2, T))) end,
    Settled = settled(lists:foldl(Lived, settled(Attacked, 100), lists:seq(1, 6)), 100),
    [Value | _] = values(Settled),
    Counted = Each(fun increment/2, Each(fun increment/2, Settled)),
    ?assertEqual(lists:duplicate(3, Value + 6), values(rounds(2, Counted))),
    Again = lists:foldl(Lived, Counted, lists:seq(1, 10)),
    ?assertEqual(lists:duplicate(3, Value + 36), values(rounds(2, Again))),
    All = rounds(2, Each(fun crash/2, Again)),
    ?assertEqual(lists:duplicate(3, Value + 36), values(All)).

settled(Team, Left) ->
    Next = rounds(1, Team),
    case {Next =:= Team, lists:usort(values(Next))} of
        {true, [_]} -> Next;
        _ when Left > 0 -> settled(Next, Left - 1)
    end.

%% A message with too many lives, or in no order, is none.
malformed_test() ->
    Five = [{L, 1} || L <- [1, 2, 3, 4, 5]],
    [
        ?assertEqual(
            [0, 0], values(hears(2, 1, {tallies, [{2, Horizon, 0, Lives}]}, team(2)))
        )
     || {Horizon, Lives} <- [{0, Five}, {0, [{2, 1}, {1, 1}]}, {0, [{1, 1}, {1, 2}]}, {1, [{1, 1}]}]
    ].
