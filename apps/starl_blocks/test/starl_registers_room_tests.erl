%% The room for registers: it is bounded for each robot of the team, whatever one of them writes; the others
%% go on, and agree.
-module(starl_registers_room_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NOW, 1000000).

start(Robot) -> start(Robot, #{}).

start(Robot, Config) ->
    {_, Machine} = starl_machine:new(starl_registers_lww, Config, #{
        robot => Robot,
        participants => [{1, 3}],
        name => registers,
        incarnation => 1,
        random => rand:seed_s(exsss, Robot),
        now => ?NOW
    }),
    Machine.

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => ?NOW, robot => 1}, Machine).

hears(From, Body, Machine) ->
    ?assertEqual(ok, starl_payload:check(message, Body)),
    step(cast, {message, From, registers, Body}, Machine).

heard(From, Body, Machine) -> element(2, hears(From, Body, Machine)).

put(Name, Value, Machine) ->
    {Actions, Next} = step({call, {app, x}}, {put, Name, Value}, Machine),
    {hd([Answer || {reply, _, Answer} <- Actions]), Next}.

get(Name, Machine) ->
    {Actions, _} = step({call, {app, x}}, {get, Name}, Machine),
    hd([Answer || {reply, _, Answer} <- Actions]).

posts(Actions) -> [Body || {cast, sap, {send, _, registers, Body}} <- Actions].

write(Name, Value, Time, Writer) -> {write, Name, Value, {Time, 0, Writer}}.

bytes(Machine) -> erlang:external_size(Machine).

%% -- what another robot writes ----------------------------------------------------------------

%% A robot of the team writes more and more: small registers, and the largest. What is kept of them is bounded.
%% The robots that hear it in other orders agree; and what they write themselves is taken.
fills_its_own_room_test_() ->
    [
        {timeout, 60, fun() -> fills_its_own_room(Size, Count) end}
     || {Size, Count} <- [{1, 10000}, {900, 2000}, {49000, 60}]
    ].

fills_its_own_room(Size, Count) ->
    Most = 100000,
    Value = binary:copy(<<1>>, Size),
    Write = fun(N, M) -> heard(3, write({junk, N}, Value, N, 3), M) end,
    Fill = fun(Ns, Robot) -> lists:foldl(Write, start(Robot, #{bytes => Most}), Ns) end,
    All = lists:seq(1, Count),
    One = Fill(All, 1),
    %% names and stamps stand twice in a machine
    [?assert(bytes(M) < 3 * Most, bytes(M)) || M <- [One, Fill(lists:reverse(All), 1)]],
    {Odd, Even} = lists:partition(fun(N) -> N rem 2 =:= 1 end, All),
    Two = Fill(Even ++ Odd, 2),
    {ok, Mine} = put(mine, 1, One),
    {ok, Yours} = put(yours, 2, Two),
    {A, B} = agreed(Mine, Yours, 20),
    ?assertEqual([{ok, 1}, {ok, 2}], [get(N, A) || N <- [mine, yours]]),
    ?assertEqual([{ok, 1}, {ok, 2}], [get(N, B) || N <- [mine, yours]]),
    ?assertEqual({ok, Value}, get({junk, Count}, A)),
    ?assertEqual([get({junk, N}, A) || N <- All], [get({junk, N}, B) || N <- All]).

%% Both exchange until each has the other's registers.
agreed(A, B, Left) when Left > 0 ->
    {Sync, A1} = step({timeout, sync}, sync, A),
    case talk(posts(Sync), A1, B) of
        {A2, B2, 0} ->
            {A2, B2};
        {A2, B2, _} ->
            {B3, A3} = agreed_turn(B2, A2, Left),
            {A3, B3}
    end.

agreed_turn(B, A, Left) -> agreed(B, A, Left - 1).

%% A's messages to B, and so on; the number of answers.
talk([], A, B) ->
    {A, B, 0};
talk(Bodies, A, B) ->
    {Answers, Heard} = lists:foldl(
        fun(Body, {Sent, M}) ->
            {Actions, Next} = hears(3, Body, M),
            {Sent ++ posts(Actions), Next}
        end,
        {[], B},
        Bodies
    ),
    {B1, A1, More} = talk(Answers, Heard, A),
    {A1, B1, length(Answers) + More}.

%% Others' registers make no robot full.
others_make_nobody_full_test() ->
    Full = lists:foldl(
        fun(N, M) -> heard(3, write(N, 1, N, 3), M) end, start(1, #{limit => 2}), lists:seq(1, 9)
    ),
    {ok, One} = put(a, 1, Full),
    {ok, Two} = put(b, 1, One),
    ?assertMatch({{error, full}, _}, put(c, 1, Two)),
    ?assertMatch({ok, _}, put(9, 1, Two)).

%% What no application may write is not taken, nor what a robot writes that is not in the team.
not_taken_test() ->
    Long = binary:copy(<<0>>, 1001),
    Large = binary:copy(<<0>>, 50001),
    Stamp = {1, 0, 3},
    [
        ?assertNot(starl_registers_lww:accepts(registers, Body))
     || Body <- [
            {write, Long, 1, Stamp},
            {write, a, Large, Stamp},
            {entries, [{a, Large, Stamp}]},
            {part, [{Long, 1, Stamp}]},
            {digest, [{Long, Stamp}]},
            {want, [Long]}
        ]
    ],
    ?assertEqual({error, unset}, get(a, heard(3, write(a, 1, 1, 4), start(1)))),
    ?assertEqual({error, unset}, get(a, heard(3, {entries, [{a, 1, {1, 0, {77, 5}}}]}, start(1)))).

%% The largest register of all goes on to others.
largest_test() ->
    Name = binary:copy(<<0>>, 990),
    Value = binary:copy(<<0>>, 49990),
    ?assertEqual([ok, ok], [
        starl_payload:check(K, T)
     || {K, T} <- [{label, Name}, {content, Value}]
    ]),
    {ok, Machine} = put(Name, Value, start(1)),
    {Actions, _} = hears(2, {digest, []}, Machine),
    [Body] = posts(Actions),
    ?assertEqual({ok, Value}, get(Name, heard(1, Body, start(2)))).

%% -- what another robot asks for --------------------------------------------------------------

%% A few bytes ask for all registers, or for one again and again: the answers between two exchanges are bounded.
answers_test_() ->
    Value = binary:copy(<<0>>, 49000),
    Filled = lists:foldl(
        fun(N, M) -> element(2, put(N, Value, M)) end, start(1), lists:seq(1, 40)
    ),
    Asked = fun(Body) ->
        lists:foldl(
            fun(_, {Sent, M}) ->
                {Actions, Next} = hears(3, Body, M),
                {Sent ++ posts(Actions), Next}
            end,
            {[], Filled},
            lists:seq(1, 20)
        )
    end,
    [
        {timeout, 30, fun() ->
            {Bodies, Machine} = Asked(Body),
            ?assert(length(Bodies) =< 32, length(Bodies)),
            %% others get theirs, and after the next exchange so does this one
            ?assertMatch([_ | _], posts(element(1, hears(2, Body, Machine)))),
            {_, Later} = step({timeout, sync}, sync, Machine),
            ?assertMatch([_ | _], posts(element(1, hears(3, Body, Later))))
        end}
     || Body <- [{digest, []}, {want, lists:duplicate(10000, 1)}]
    ].

%% -- what the application writes --------------------------------------------------------------

%% Its registers have their bytes, too; a smaller value may always take the place of a larger one.
own_bytes_test() ->
    Value = binary:copy(<<0>>, 900),
    {ok, One} = put(a, Value, start(1, #{bytes => 2000})),
    ?assertMatch({{error, full}, _}, put(b, Value, One)),
    ?assertMatch({{error, full}, _}, put(a, binary:copy(<<0>>, 2000), One)),
    {ok, Small} = put(a, <<>>, One),
    {ok, Both} = put(b, Value, Small),
    %% another robot's value takes the room of that robot
    Theirs = heard(2, write(b, 1, ?NOW + 5, 2), Both),
    ?assertMatch({ok, _}, put(c, Value, Theirs)).
