%% A robot of the team says the largest numbers that a message can hold, in its own name, and to each
%% of the others. Then it stops, and all robots start anew with their stores: the team works again.
%%
%% Holds: A robot with the key that says the largest numbers ends no block for good: barrier,
%% lives, mutex, registers, geocast, election
%% Red: 4ca8e259, run: 18 of 42
-module(starl_leap_tests).
-include_lib("eunit/include/eunit.hrl").

%% The largest number of most messages, and of those that begin with an incarnation.
-define(MOST, 16#7FFFFFFFFFFFFFF).
-define(MOST_SERIAL, 16#FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF).

-define(LIES_MS, {4000, 8000}).
-define(ALL_MS, 10000).

teams() -> [2, 3, 4].

%% -- the barrier ----------------------------------------------------------------------------

%% It says that it has reached the last round, and that the others have; robots start anew meanwhile,
%% so they ask how far they were.
barrier_test_() ->
    [
        {timeout, 60, {title(Who, N), fun() -> barrier(Victims(N), N, fun barrier_lies/2) end}}
     || N <- teams(), {Who, Victims} <- [{"one", fun(_) -> [1] end}, {"all", fun others/1}]
    ].

%% Without lies it passes, so what the test asks for is possible.
honest_barrier_test_() ->
    {timeout, 60, fun() -> barrier(others(3), 3, fun(_, _) -> [] end) end}.

title(Who, N) -> lists:flatten(io_lib:format("~tp, team of ~b", [Who, N])).

others(N) -> lists:seq(1, N - 1).

barrier_lies(_To, _Now) ->
    Largest = [{K, Known} || K <- [0, 1, ?MOST], Known <- [0, 1, ?MOST]],
    Words = [
        {barrier, {reached, gate, K, Known, Answer}}
     || {K, Known} <- Largest, Answer <- [true, false]
    ],
    Told = [
        {barrier, {told, 1, Certain, [{gate, K, Known, ?MOST}]}}
     || {K, Known} <- Largest, Certain <- [true, false]
    ],
    Words ++ Told.

%% Many rounds are passed afterwards, each by all robots.
barrier(Victims, N, Lies) ->
    Events = play(N, Victims, fun passes/1, [{barrier, starl_barrier_rounds, #{}}], {20, Lies}),
    Passed = [
        {K, R}
     || {T, R, barrier, {passed, gate, K}} <- Events, T > 1000 * (?ALL_MS + 2000)
    ],
    Whole = [
        K
     || K <- lists:usort([K || {K, _} <- Passed]),
        lists:sort([R || {Round, R} <- Passed, Round =:= K]) =:= lists:seq(1, N)
    ],
    ?assertMatch({_, Rounds} when Rounds > 15, {Passed, length(Whole)}).

%% Goes through rounds until its time is up.
passes(Robot) ->
    case starl:now(Robot) < 25000 of
        true ->
            _ = starl_barrier:sync(Robot, gate, 2000),
            starl:sleep(Robot, 300),
            passes(Robot);
        false ->
            %% nobody has to wait for one whose time is up
            _ = starl_barrier:sync(Robot, gate, 5000)
    end.

%% -- mutual exclusion -----------------------------------------------------------------------

%% It claims, renews, returns and announces tokens with the largest numbers, and hands them to those
%% that wait. Afterwards each robot gets each token again, whether anybody starts anew or not.
mutex_test_() ->
    [
        {timeout, 60, {title(When, N), fun() -> mutex(N, When, fun mutex_lies/2) end}}
     || N <- teams(), When <- [all_start_anew, nobody_starts_anew]
    ].

honest_mutex_test_() ->
    {timeout, 60, fun() -> mutex(3, nobody_starts_anew, fun(_, _) -> [] end) end}.

tokens() -> [a, b, c, d, e].

mutex_lies(To, _Now) ->
    Fences = [?MOST_SERIAL, starl_mutex_home:hand_over(?MOST_SERIAL), 1 bsl 127, ?MOST bsl 44],
    [
        {mutex, Body}
     || Token <- tokens(),
        F <- Fences,
        Body <- [
            {owner, Token, F},
            {ask, claim, Token, F, {1, 1}},
            {ask, renew, Token, F, {1, 1}},
            {return, Token, F, [{To, ?MOST}]},
            {request, Token, {To, ?MOST}, F, home},
            {refused, Token, F, {1, 1}}
            | [{token, Token, F, [{To, Job}, {To, Job + 1}]} || Job <- [1, 3, 5, 7, 9]]
        ]
    ].

mutex(N, When, Lies) ->
    Block = {mutex, starl_mutex_tokens, #{lease_ms => 1000, retry_ms => 500}},
    Events = play(N, When, [], fun takes_turns/1, [Block], {250, Lies}),
    Acquired = [
        {R, Token}
     || {T, R, mutex, {acquired, Token, _}} <- Events, T > 1000 * (?ALL_MS + 5000)
    ],
    All = [{R, Token} || R <- lists:seq(1, N), Token <- tokens()],
    ?assertEqual(All, lists:usort(Acquired)).

takes_turns(Robot) ->
    case starl:now(Robot) < 25000 of
        true ->
            [take(Token, Robot) || Token <- tokens()],
            takes_turns(Robot);
        false ->
            ok
    end.

take(Token, Robot) ->
    case starl_mutex:acquire(Robot, Token, 2000) of
        {ok, _} ->
            starl:sleep(Robot, 20),
            _ = starl_mutex:release(Robot, Token);
        {error, _} ->
            starl:sleep(Robot, 20)
    end.

%% -- registers ------------------------------------------------------------------------------

%% It writes with the latest stamps that are taken, and the largest count within them. What the others
%% write meanwhile, and later, is read by all.
registers_test_() ->
    [
        {timeout, 60, {title(When, N), fun() -> registers(N, When, fun register_lies/2) end}}
     || N <- teams(), When <- [all_start_anew, nobody_starts_anew]
    ].

honest_registers_test_() ->
    {timeout, 60, fun() -> registers(3, nobody_starts_anew, fun(_, _) -> [] end) end}.

register_lies(To, Now) ->
    Stamps = [
        {Time, ?MOST_SERIAL, Writer}
     || Time <- [Now, Now + 5000000, Now + 9990000], Writer <- [9, To, {9, ?MOST_SERIAL}]
    ],
    [
        {registers, Body}
     || Stamp <- Stamps,
        Body <- [
            {write, lie, 1, Stamp},
            {entries, [{lie, 2, Stamp}, {{lie, To}, 3, Stamp}]},
            {beyond, Stamp}
        ]
    ].

registers(N, When, Lies) ->
    Events = play(N, When, [], fun writes/1, [{registers, starl_registers_lww, #{}}], {250, Lies}),
    %% what was written before they all started anew is gone
    Keys = [later | [once || When =:= nobody_starts_anew]],
    Names = [{Key, Of} || Key <- lists:sort(Keys), Of <- lists:seq(1, N - 1)],
    Read = lists:usort([
        {R, Name}
     || {_, R, app, {read, Name, {ok, mine}}} <- Events, lists:member(Name, Names)
    ]),
    ?assertEqual([{R, Name} || R <- lists:seq(1, N), Name <- Names], Read).

%% Each writes a register of its own while the last one lies, and another one later; in the end each
%% reads those of all.
writes(Robot) ->
    wait(6000, Robot),
    _ = put_again({once, starl:id(Robot)}, Robot),
    wait(14000, Robot),
    _ = put_again({later, starl:id(Robot)}, Robot),
    wait(32000, Robot),
    [
        starl:trace(Robot, {read, {Key, Of}, starl_registers:get(Robot, {Key, Of})})
     || Key <- [once, later], Of <- starl:participants(Robot)
    ].

wait(Ms, Robot) -> starl:sleep(Robot, max(1, Ms - starl:now(Robot))).

put_again(Name, Robot) ->
    case starl_registers:put(Robot, Name, mine) of
        ok ->
            ok;
        {error, _} ->
            starl:sleep(Robot, 500),
            put_again(Name, Robot)
    end.

%% -- election -------------------------------------------------------------------------------

%% It casts the largest ballots, and announces leaders, one to each of the others. Elections of which it has
%% not spoken elect one leader, and when all have started anew the others do, too.
election_test_() ->
    [
        {timeout, 60, {title(When, N), fun() -> election(N, When) end}}
     || N <- teams(), When <- [all_start_anew, nobody_starts_anew]
    ].

election(N, When) ->
    Spoken = [spoken || When =:= nobody_starts_anew] ++ [other || When =:= all_start_anew],
    Lies = fun(To, _Now) ->
        [
            {Type, Body}
         || Name <- Spoken,
            {Type, Body} <- [
                {ballot, {Name, {?MOST, N}}}, {ballot, {Name, {To, N}}}, {leader, {Name, To}}
            ]
        ]
    end,
    Block = {election, starl_election_ballots, #{}},
    Events = play(N, When, [], fun elects/1, [Block], {250, Lies}),
    Elected = [{R, Leader} || {_, R, app, {elected, {ok, Leader}}} <- Events],
    ?assertEqual(lists:seq(1, N), lists:sort([R || {R, _} <- Elected])),
    ?assertMatch([_], lists:usort([Leader || {_, Leader} <- Elected])).

elects(Robot) ->
    wait(15000, Robot),
    starl:trace(Robot, {elected, starl_election:elect(Robot, other, 15000)}).

%% -- geocast --------------------------------------------------------------------------------

%% It gives messages in its own name with the longest lifetimes and the most hops there are, more than a robot
%% keeps. When that has stopped, messages are delivered again.
geocast_test_() ->
    [
        {timeout, 60, {title(When, N), fun() -> geocast(N, When) end}}
     || N <- teams(), When <- [all_start_anew, nobody_starts_anew]
    ].

geocast(N, When) ->
    Lies = fun(To, Now) ->
        [
            {geocast,
                {give, {{N, ?MOST, K}, everywhere(), other, x, ?MOST, ?MOST, ?MOST}, [
                    {To, {1, Now}}
                ]}}
         || K <- lists:seq(1, 300)
        ] ++ [{geocast, {offer, {N, ?MOST, K}, ?MOST, ?MOST, ?MOST}} || K <- lists:seq(1, 300)]
    end,
    Block = {geocast, starl_geocast_flood, #{listeners => #{news => app}}},
    Events = play(N, When, [], fun tells_all/1, [Block], {2000, Lies}),
    ?assertEqual(
        lists:seq(2, N), lists:sort([R || {_, R, app, {heard, {ok, 1, hello}}} <- Events])
    ).

everywhere() -> {circle, {0.0, 0.0}, 1.0e6}.

tells_all(Robot) ->
    wait(15000, Robot),
    case starl:id(Robot) of
        1 ->
            wait(16000, Robot),
            starl_geocast:send(Robot, everywhere(), news, hello, #{lifetime_ms => 8000});
        _ ->
            starl:trace(Robot, {heard, starl:await(Robot, news, 12000)})
    end.

%% -- lives ----------------------------------------------------------------------------------

%% It says that the others have lived before with the largest number there is. They start anew with a
%% later one, and are heard.
lives_test_() ->
    [
        {timeout, 60, {title(Lives, N), fun() -> lives(Lives, N) end}}
     || N <- teams(), Lives <- [{?MOST - 1, ?MOST}, {(1 bsl 58) - 2, (1 bsl 58) - 1}, {0, 1 bsl 57}]
    ].

lives(Lives, N) ->
    {From, To} = ?LIES_MS,
    Around = #{
        sap_machine => starl_leap_sap,
        sap => #{by => N, from_ms => From, to_ms => To, lives => Lives}
    },
    Events = played(N, all_start_anew, [], fun greets/1, Around),
    Greeted = [
        {R, Other}
     || {T, R, app, {greeted, Other, ok}} <- Events, T > 1000 * (?ALL_MS + 5000)
    ],
    Pairs = [{R, Other} || R <- lists:seq(1, N), Other <- lists:seq(1, N), R =/= Other],
    ?assertEqual(Pairs, lists:usort(Greeted)).

%% Sends the others messages until its time is up.
greets(Robot) ->
    case starl:now(Robot) < 25000 of
        true ->
            [
                starl:trace(Robot, {greeted, Other, starl:send(Robot, Other, greeting, hello)})
             || Other <- starl:participants(Robot), Other =/= starl:id(Robot)
            ],
            starl:sleep(Robot, 500),
            greets(Robot);
        false ->
            ok
    end.

%% -- a run ----------------------------------------------------------------------------------

%% The events of a run in which the last robot lies. The victims start anew while it does, all robots
%% when it has stopped.
play(N, Victims, Script, Blocks, Lies) ->
    play(N, all_start_anew, Victims, Script, Blocks, Lies).

play(N, When, Victims, Script, Blocks, {Every, Lies}) ->
    {From, To} = ?LIES_MS,
    Lying = #{by => N, from_ms => From, to_ms => To, every_ms => Every, lies => Lies},
    Insider = {insider, starl_leap_insider, Lying},
    played(N, When, Victims, Script, #{blocks => Blocks ++ [Insider]}).

played(N, When, Victims, Script, Around) ->
    {From, _} = ?LIES_MS,
    All = [reboot(R, ?ALL_MS) || R <- lists:seq(1, N), When =:= all_start_anew],
    Outcome = starl_blocks_script_app:play(
        Script,
        Around,
        #{
            robots => N,
            time => 40,
            seed => N,
            faults => [reboot(R, From + 500) || R <- Victims] ++ All
        }
    ),
    starl_blocks_script_app:trace(Outcome).

reboot(Robot, At) ->
    Id = starl_platform_ct:fault_id(lists:concat([reboot_, Robot, "_"]), At),
    {Id, At, At + 500, reboot, Robot, #{}}.
