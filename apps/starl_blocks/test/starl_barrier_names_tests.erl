%% The names of a barrier: they are bounded for each robot of the team, and what many or long names tell
%% after a restart fits into messages.
%%
%% Holds: Names, entries and tokens are bounded for each robot of the team; who fills its own share
%% takes none of others'
%% Red: 4ca8e259, run
-module(starl_barrier_names_tests).
-include_lib("eunit/include/eunit.hrl").

-define(META, #{now => 0}).

start(Robot) -> start(Robot, #{}).

start(Robot, Config) ->
    {ready, Data, Actions} = starl_barrier_rounds:init(
        maps:merge(
            #{robot => Robot, participants => [{1, 3}], incarnation => 1, stored => none}, Config
        )
    ),
    {Data, Actions}.

does(Type, Content, Data) ->
    case starl_barrier_rounds:handle_event(Type, Content, ready, Data, ?META) of
        {keep_state, Next, Actions} -> {Next, Actions};
        {keep_state_and_data, Actions} -> {Data, Actions};
        keep_state_and_data -> {Data, []}
    end.

hears(From, Body, Data) ->
    ?assertEqual(ok, starl_payload:check(message, Body)),
    ?assert(starl_barrier_rounds:accepts(barrier, Body)),
    does(cast, {message, From, barrier, Body}, Data).

reached(From, Name, Data) -> element(1, hears(From, {reached, Name, 1, 0, false}, Data)).

%% The application syncs, as far as it may.
sync(Name, Data) ->
    case does({call, {app, Name}}, {round, Name}, Data) of
        {Same, [{reply, _, {error, _} = Error}]} ->
            {Same, Error};
        {Same, [{reply, _, Progress}]} ->
            does({call, {app, Name}}, {sync, Name, Progress, 1000000}, Same)
    end.

long(N) -> <<N:32, 0:(8 * 985)>>.

%% Long binaries included.
bytes(Data) -> erlang:external_size(Data).

%% A robot of the team says ten thousand of the longest names. Twice its share are kept; those of the
%% application and of the others have their room, and rounds are passed.
made_up_names_test_() -> {timeout, 60, fun made_up_names/0}.

made_up_names() ->
    ?assertEqual(ok, starl_payload:check(label, long(1))),
    {Start, _} = start(1),
    Attacked = lists:foldl(
        fun(N, D) -> reached(3, long(N), D) end, Start, lists:seq(1, 10000)
    ),
    %% 512 names, each kept twice, with a gate
    ?assert(bytes(Attacked) < 512 * 2200, bytes(Attacked)),
    Told = {told, 1, true, [{long(N), 1, 1, 0} || N <- lists:seq(20001, 20050)]},
    {Again, _} = hears(3, Told, Attacked),
    ?assert(bytes(Again) < 512 * 2200, bytes(Again)),
    %% another robot's name is known, and a round of it passes
    Heard = reached(2, mine, Again),
    {Reached, Actions} = sync(mine, Heard),
    ?assertEqual([mine], [Name || {trace, {reached, Name, 1}} <- Actions]),
    %% the store holds what the application has used
    ?assertEqual([{complete, #{mine => {1, 0, 0}}}], [Term || {store, Term} <- Actions]),
    {Known, _} = does({reply, {announced, mine, 1}}, ok, Reached),
    {_, Passed} = hears(3, {reached, mine, 1, 1, false}, Known),
    ?assert(lists:member({trace, {passed, mine, 1}}, Passed)).

%% What is too long for a name of this robot is not taken from another one.
too_long_test() ->
    Long = binary:copy(<<0>>, 1001),
    [
        ?assertNot(starl_barrier_rounds:accepts(barrier, Body))
     || Body <- [
            {reached, Long, 1, 0, false},
            {told, 1, true, [{Long, 1, 1, 1}]},
            {part, 1, [{Long, 1, 1, 1}]},
            {who, 1, Long}
        ]
    ].

%% A name for which there was no room can be used all the same: the others are asked for it.
not_kept_test() ->
    {Start, _} = start(1, #{names => 1}),
    Full = lists:foldl(fun(Name, D) -> reached(2, Name, D) end, Start, [a, b, c]),
    {Synced, Actions} = sync(c, Full),
    ?assert(lists:member({trace, {reached, c, 1}}, Actions)),
    {_, Asked} = does({timeout, {again, c}}, again, Synced),
    ?assertEqual([2, 3], [To || {cast, sap, {send, To, barrier, {reached, c, 1, 0, true}}} <- Asked]).

%% The application may use as many names as its block is given, over restarts, too; one more is refused.
full_test() ->
    {Start, _} = start(1, #{names => 2}),
    {A, _} = sync(a, reached(2, x, Start)),
    {B, Actions} = sync(b, A),
    ?assertMatch({_, {error, full}}, sync(c, B)),
    ?assertMatch({_, [_ | _]}, sync(a, B)),
    {store, Kept} = lists:keyfind(store, 1, Actions),
    {Again, _} = start(1, #{names => 2, incarnation => 2, stored => {stored, Kept}}),
    ?assertMatch({_, {error, full}}, sync(c, Again)).

%% A robot with the most and the longest names restarts with a damaged store: the others answer in
%% parts, though a third one has told them names of its own invention; it knows its rounds again.
parts_test_() -> {timeout, 60, fun parts/0}.

parts() ->
    Names = [long(N) || N <- lists:seq(1, 256)],
    {Start, _} = start(2),
    Heard = lists:foldl(fun(Name, D) -> reached(1, Name, D) end, Start, Names),
    Used = lists:foldl(fun(Name, D) -> element(1, sync(Name, D)) end, Heard, Names),
    Attacked = lists:foldl(
        fun(N, D) -> reached(3, long(N), D) end, Used, lists:seq(1001, 2000)
    ),
    {Lost, Asks} = start(1, #{incarnation => 5, life => {0, 5}, stored => damaged}),
    [Who] = [Body || {cast, sap, {send, 2, barrier, Body}} <- Asks],
    {Told, Messages} = talk(Who, Attacked, Lost, 0),
    ?assert(Messages > 4),
    {Settled, _} = hears(3, {told, 5, true, []}, Told),
    {_, [{reply, _, Progress}]} = does({call, {app, t}}, {round, long(256)}, Settled),
    %% nobody has passed the round: not all have reached it
    ?assertEqual({1, 0}, Progress),
    %% and what it was told is not lost if it crashes before its application goes on
    {_, Actions} = sync(new, Settled),
    {store, Kept} = lists:keyfind(store, 1, Actions),
    {Again, _} = start(1, #{incarnation => 6, life => {0, 5}, stored => {stored, Kept}}),
    {_, Recalled} = does({call, {app, t}}, {round, long(1)}, Again),
    ?assertEqual([], Recalled),
    ?assertMatch({complete, #{}, #{2 := #{}}}, Kept).

%% Robot 1 asks robot 2 until that has told all; the number of answers.
talk(Who, Two, One, Count) ->
    {_, [{cast, sap, {send, 1, barrier, Answer}}]} = hears(1, Who, Two),
    case hears(2, Answer, One) of
        {Next, [{cast, sap, {send, 2, barrier, More}}]} -> talk(More, Two, Next, Count + 1);
        {Next, []} -> {Next, Count + 1}
    end.
