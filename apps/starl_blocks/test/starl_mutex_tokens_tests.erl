%% How a request finds the token when messages overtake each other.
-module(starl_mutex_tokens_tests).
-include_lib("eunit/include/eunit.hrl").

-define(F, (1 bsl 44)).
-define(HAND_OVER, (1 bsl 8)).

%% Robot 2 of three, which is not the token's home and wants nothing.
robot() ->
    Base = #{
        robot => 2, participants => [1, 2, 3], name => mutex, incarnation => 1, now => 0,
        random => rand:seed_s(exsss, 1)
    },
    {_, Machine} = starl_machine:new(starl_mutex_tokens, #{}, Base),
    Machine.

%% A token whose home is robot 1.
token() -> hd([T || T <- lists:seq(1, 100), erlang:phash2(T, 3) =:= 0]).

%% What robot 2 sends in the end.
sent(Messages) ->
    {Last, _} = lists:foldl(
        fun({From, Message}, {_, Machine}) ->
            Content = {message, From, mutex, Message},
            starl_machine:step(cast, Content, #{now => 1, robot => 2}, Machine)
        end,
        {[], robot()},
        Messages
    ),
    [{To, Body} || {Kind, sap, {send, To, mutex, Body}} <- casts(Last), Kind =:= cast].

casts(Actions) ->
    [case A of {call, M, R, _} -> {cast, M, R}; _ -> A end || A <- Actions, tuple_size(A) > 2].

%% Robot 3's request waits for the token that robot 1 is handing over. An announcement of robot 1's
%% own, earlier hold comes late: the request goes on waiting, and on with the token.
late_announcement_test() ->
    T = token(),
    Next = ?F + ?HAND_OVER,
    Sent = sent([
        {1, {request, T, {3, 1}, Next, home}},
        {1, {owner, T, ?F}},
        {1, {token, T, Next, []}}
    ]),
    ?assertEqual([{3, {token, T, Next + ?HAND_OVER, [{3, 1}]}}], Sent).

%% An announcement of a later hold, by another robot: the request goes there.
newer_announcement_test() ->
    T = token(),
    Next = ?F + ?HAND_OVER,
    Newer = Next + ?HAND_OVER,
    Sent = sent([{1, {request, T, {3, 1}, Next, home}}, {1, {owner, T, Newer}}]),
    ?assertEqual([{1, {request, T, {3, 1}, Newer, home}}], Sent).

%% A request that comes twice waits once, for the later of the hand-overs that its senders knew of:
%% an announcement between the two does not send it on.
twice_test_() ->
    T = token(),
    [First, Second, Third, Next] = [?F + K * ?HAND_OVER || K <- [1, 2, 3, 4]],
    [
        begin
            Asked = [{1, {request, T, {3, 1}, Known, home}} || Known <- Order],
            Told = Asked ++ [{1, {owner, T, Second}}],
            [
                ?_assertEqual([], sent(Told)),
                ?_assertEqual(
                    [{3, {token, T, Next, [{3, 1}]}}], sent(Told ++ [{1, {token, T, Third, []}}])
                )
            ]
        end
     || Order <- [[First, Third], [Third, First]]
    ].
