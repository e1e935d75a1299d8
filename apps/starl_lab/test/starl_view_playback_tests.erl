%% What is known of a recording at a time, and what its trace has told of a robot until then.
-module(starl_view_playback_tests).
-include_lib("eunit/include/eunit.hrl").

-define(P, starl_view_playback).

read(Messages, Past) ->
    lists:foldl(fun(M, P) -> element(2, ?P:add(M, P)) end, Past, Messages).

messages() ->
    [
        {scenario, 0, #{machines => #{sap => starl_sap}}},
        {trace, 10, {1, sap, {started, 1}}},
        {trace, 20, {2, sap, {started, 1}}},
        {packets, 30, {1, 2, {data, ping, 1}, 40, {arrives, [{35, intact}]}}},
        {packets, 40, {2, 3, {data, ping, 1}, 40, {lost, loss}}},
        {trace, 50, {1, sap, {called, {1, 1, 1}, one}}},
        {trace, 60, {1, app, {done, ok}}}
    ].

%% The last event of each machine of this robot; its own events and packets only.
look_test() ->
    Seen = ?P:look(1, 60, read(messages(), ?P:watch(1, ?P:new()))),
    ?assertMatch(
        #{
            told := true,
            machines := [
                #{name := app, module := null, at := 60, state := <<"{done,ok}">>},
                #{name := sap, module := starl_sap, at := 50, state := <<"{called,{1,1,1},one}">>}
            ],
            packets := [[30, 1, 2 | _]],
            last := [[60, app, _], [50, sap, _], [10, sap, _]]
        },
        Seen
    ).

%% The last 40 events and 12 packets.
bounded_test() ->
    Many = [
        Message
     || T <- lists:seq(1, 100),
        Message <- [
            {trace, T, {1, sap, {started, T}}},
            {packets, T, {2, 1, x, 1, {lost, loss}}}
        ]
    ],
    #{last := Last, packets := Packets} = ?P:look(1, 100, read(Many, ?P:watch(1, ?P:new()))),
    ?assertEqual({40, 12}, {length(Last), length(Packets)}),
    ?assertMatch({[100 | _], [100 | _]}, {hd(Last), hd(Packets)}).

%% Of real robots only positions are known: each is a standing robot. One with motions has these.
poses_test() ->
    Moved = {trace, 5, {1, chassis, {motion, {piece, 5, 0.0, 0.0, 0.0, 100.0, 0.0}}}},
    Poses =
        {poses, 9, #{robots => [{1, {7.0, 7.0, 0.0}, up, none}, {2, {8.0, 8.0, 0.0}, up, none}]}},
    {Rows, Past} = ?P:add(Poses, read([Moved], ?P:new())),
    ?assertMatch([[<<"m">>, 9, 2, 0, 9, 8.0, 8.0 | _]], Rows),
    ?assertMatch([[<<"m">>, 5, 1 | _], [<<"m">>, 9, 2 | _]], ?P:rows(Past)),
    ?assertEqual({9, 2}, {?P:now_us(Past), ?P:count(Past)}).

%% Faults and crashes are said, for the time line.
said_test() ->
    Fault = {cut, 1, 2, isolate, 1, #{}},
    Past = read([{faults, 1000, {began, Fault}}, {trace, 1500, {2, sap, crashed}}], ?P:new()),
    ?assertMatch([[<<"f">>, 1000, cut | _], [<<"x">>, 1500, 2, sap, crashed]], ?P:said(Past)),
    ?assertEqual(null, ?P:ending(Past)),
    ?assertEqual(
        time, ?P:ending(read([{verdicts, 9, {ended, #{ending => time, violations => []}}}], Past))
    ).
