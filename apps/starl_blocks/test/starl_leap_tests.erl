%% A robot of the team says the largest numbers that a message can hold, in its own name, and to each
%% of the others. Then it stops, and all robots start anew with their stores: the team works again.
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
        {timeout, 60, {title(Who, N), fun() -> barrier(Victims(N), N, fun barrier_lies/1) end}}
     || N <- teams(), {Who, Victims} <- [{"one", fun(_) -> [1] end}, {"all", fun others/1}]
    ].

%% Without lies it passes, so what the test asks for is possible.
honest_barrier_test_() ->
    {timeout, 60, fun() -> barrier(others(3), 3, fun(_) -> [] end) end}.

title(Who, N) -> lists:flatten(io_lib:format("~tp, team of ~b", [Who, N])).

others(N) -> lists:seq(1, N - 1).

barrier_lies(_To) ->
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
    Events = play(N, Victims, fun passes/1, [{barrier, starl_barrier_rounds, #{}}], Lies),
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
    Events = played(N, [], fun greets/1, Around),
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
    {From, To} = ?LIES_MS,
    Insider =
        {insider, starl_leap_insider, #{by => N, from_ms => From, to_ms => To, lies => Lies}},
    played(N, Victims, Script, #{blocks => Blocks ++ [Insider]}).

played(N, Victims, Script, Around) ->
    {From, _} = ?LIES_MS,
    Outcome = starl_blocks_script_app:play(
        Script,
        Around,
        #{
            robots => N,
            time => 40,
            seed => N,
            faults => [reboot(R, From + 500) || R <- Victims] ++
                [reboot(R, ?ALL_MS) || R <- lists:seq(1, N)]
        }
    ),
    starl_blocks_script_app:trace(Outcome).

reboot(Robot, At) ->
    Id = starl_platform_ct:fault_id(lists:concat([reboot_, Robot, "_"]), At),
    {Id, At, At + 500, reboot, Robot, #{}}.
