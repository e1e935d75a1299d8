-module(starl_lab_findings_tests).
-include_lib("eunit/include/eunit.hrl").

%% Messages to robots that are not there, and of types that nobody listens to.
messages_that_nobody_gets_are_told_test() ->
    Mail = mail([
        {100, 1, sap, {sent, {1, 1, 1}, [7], {app, hello}, 0}},
        {200, 2, sap, {sent, {2, 1, 1}, [7], {app, hello}, 0}},
        {300, 1, sap, {sent, {1, 1, 2}, [7], {app, hello}, 0}},
        {400, 1, sap, {sent, {1, 1, 3}, [2, 3], {app, word}, 0}},
        {500, 2, sap, {delivered, {1, 1, 3}, {app, word}, 0}},
        {600, 3, sap, {delivered, {1, 1, 3}, {app, word}, 0}},
        %% what comes before its listener waits for it, and no longer
        {700, 1, sap, {delivered, {2, 1, 3}, {app, late}, 0}},
        {800, 1, app, {listens, {app, late}}},
        {900, 1, sap, {delivered, {2, 1, 4}, {app, late}, 0}},
        %% blocks have their own types
        {900, 1, sap, {delivered, {2, 1, 5}, ballot, 0}}
    ]),
    ?assertMatch(
        #{
            strangers := [
                #{from := 1, to := 7, count := 2, at_us := 100}, #{from := 2, count := 1}
            ],
            unheard := [#{robot := 2, from := 1, at_us := 500, count := 1}, #{robot := 3}]
        },
        Mail
    ),
    ?assertEqual(
        [
            "there is no robot 7: 3 messages of type hello, first by robot 1 at 0.000 s",
            "robots 2, 3 do not listen to word: 2 messages, first by robot 1 at 0.001 s"
        ],
        lines(Mail, [])
    ).

%% A robot that is gone listens to nothing; that is told elsewhere.
robots_that_are_gone_are_not_told_test() ->
    Mail = mail([{500, 2, sap, {delivered, {1, 1, 3}, {app, word}, 0}}]),
    ?assertEqual([], lines(Mail, [{1, running}, {2, died}])),
    ?assertEqual([], lines(Mail, [{2, given_up}])),
    ?assertEqual(
        ["robot 2 does not listen to word: 1 message, first by robot 1 at 0.001 s"],
        lines(Mail, [{2, running}])
    ).

%% A post that is dropped tells its sender nothing, and a robot that has ended reads no more: both are
%% told once, with the lines that send. A full inbox of a robot at work is no news.
dropped_posts_are_told_once_test() ->
    Mail = mail(
        [{300000, 1, sap, {overload, {app, word}}} || _ <- [1, 2, 3]] ++
            [
                {400000, 3, sap, {full, 1, {app, note}}},
                {500000, 2, app, {done, early}},
                {600000, 2, sap, {full, 1, {app, note}}},
                {700000, 2, sap, {full, 3, {app, note}}},
                {700000, 2, sap, {overload, ballot}}
            ]
    ),
    Source =
        "-module(chatty). -export([f/1]).\n"
        "f(R) ->\n starl:broadcast(R, word, 1),\n starl:post(R, 2, note, 1), starl:post(R, 2, other, 1).\n",
    Notes = starl_lab_findings:make(outcome(Mail, [], #{}), ways([]), [beam(Source)]),
    ?assertEqual(
        [
            "robot 1 did not send 3 messages of type word, too many were under way, first at "
            "0.300 s; chatty.erl:3",
            "robot 2 had ended, with a full inbox: messages of type note are lost after their last "
            "try, first by robot 1 at 0.600 s; chatty.erl:4"
        ],
        texts(Notes)
    ),
    Figures = maps:from_list(starl_lab_findings:figures(Notes)),
    ?assertMatch(
        #{
            messages_not_sent := [[{robot, 1}, {type, <<"word">>}, {at_s, 0.3}, {count, 3}]],
            messages_refused := [[{robot, 2}, {from, 1}, {type, <<"note">>}, _, {count, 2}]]
        },
        Figures
    ).

%% Tokens that nobody can get any more.
tokens_that_nobody_can_get_are_told_test() ->
    Waits = #{
        kept => [#{robot => 3, token => <<"key">>, asked => [1, 2]}],
        circles => [
            #{at_us => 500000, waits => [{2, right}, {1, left}]},
            #{at_us => 600000, waits => [{4, door}]}
        ]
    },
    Outcome = outcome(mail([]), [], #{starl_mutex_waits => Waits}),
    Notes = starl_lab_findings:make(Outcome, ways([]), []),
    ?assertEqual(
        [
            "robot 3 ended with token <<\"key\">>, and keeps it: robots 1, 2 asked for it in vain",
            "robots 1, 2 waited for each other's tokens, at 0.500 s: robot 2 held right and asked for "
            "left, robot 1 held left and asked for right; acquire them as one list",
            "robot 4 asked for token door, which it holds itself, at 0.600 s"
        ],
        texts(Notes)
    ),
    ?assertMatch(
        #{
            tokens_kept := [[{robot, 3}, {token, <<"<<\"key\">>">>}, {asked, [1, 2]}]],
            tokens_in_circle := [[{at_s, 0.5}, {waits, [[_, _], [_, _]]}], _]
        },
        maps:from_list(starl_lab_findings:figures(Notes))
    ).

%% Who keeps others waiting is named, though its application is at work: with a token, or away from a barrier.
who_keeps_others_waiting_is_named_test() ->
    Monitors = #{
        starl_mutex_waits => #{
            kept => [#{robot => 3, token => door, asked => [1, 2], since_us => 500000}],
            circles => []
        },
        starl_barrier_monitor => #{
            missed => [#{name => start, round => 4, absent => [2], waited => [1, 3]}]
        }
    },
    ?assertEqual(
        [
            "robot 3 has held token door since 0.500 s: robots 1, 2 asked for it in vain",
            "robot 2 has not come to round 4 of barrier start: robots 1, 3 waited for it in vain"
        ],
        texts(starl_lab_findings:make(outcome(mail([]), [], Monitors), ways([]), []))
    ).

%% What path planning has given up, with whoever stands in the way of it.
who_stands_in_the_way_of_lines_is_named_test() ->
    Left = fun(Edges, Robots, CutOff) ->
        Of = #{left => #{edges => Edges, in_the_way => Robots, cut_off => CutOff}},
        starl_lab_findings:make(outcome(mail([]), [], #{starl_dpp_monitor => Of}), ways([]), [])
    end,
    Two = Left(7, [{2, 29880000, 6}, {5, 1000000, 1}], 0),
    ?assertEqual(
        [
            "gave up 7 edges: robot 2, silent since 29.880 s, stands in the way of 6; robot 5, silent since "
            "1.000 s, stands in the way of 1"
        ],
        texts(Two)
    ),
    ?assertEqual(["gave up 1 edge: all ways to 1 edge are closed"], texts(Left(1, [], 1))),
    ?assertEqual(
        "; 2 more robots stand in the way; all ways to 3 edges are closed",
        string:find(hd(texts(Left(10, [{Id, 0, 1} || Id <- lists:seq(1, 7)], 3))), "; 2 more")
    ),
    ?assertMatch(
        #{
            edges_given_up := 7,
            edges_cut_off := 0,
            in_the_way := [[{robot, 2}, {silent_s, 29.88}, {edges, 6}], _]
        },
        maps:from_list(starl_lab_findings:figures(Two))
    ),
    None = outcome(mail([]), [], #{starl_dpp_monitor => #{left => none}}),
    Nothing = starl_lab_findings:make(None, ways([]), []),
    ?assertEqual([], texts(Nothing)),
    ?assertNot(lists:keymember(edges_given_up, 1, starl_lab_findings:figures(Nothing))).

beam(Source) ->
    {ok, Tokens, _} = erl_scan:string(Source),
    Forms = [element(2, erl_parse:parse_form(Form)) || Form <- forms(Tokens)],
    {ok, chatty, Beam} = compile:forms(Forms, [debug_info]),
    Beam.

forms([]) ->
    [];
forms(Tokens) ->
    {Form, [Dot | Others]} = lists:splitwith(fun(T) -> element(1, T) =/= dot end, Tokens),
    [Form ++ [Dot] | forms(Others)].

nothing_is_told_of_a_run_without_findings_test() -> ?assertEqual([], lines(mail([]), [])).

robots_that_touch_are_told_test() ->
    Near = [stands(1, 1000.0, 1000.0), stands(2, 1000.0, 1100.0)],
    ?assertEqual(
        ["robots 1 and 2 came within 100.0 mm (centres; Creates touch at 330), at 0.000 s"],
        noted(Near)
    ),
    Far = [stands(1, 1000.0, 1000.0), stands(2, 1000.0, 1400.0)],
    ?assertEqual(["the closest two robots: 400.0 mm (robots 1 and 2, at 0.000 s)"], noted(Far)),
    Off = [stands(1, -100.0, 1000.0), stands(2, 2000.0, 6250.0), stands(3, 3000.0, 1000.0)],
    ?assertMatch(
        [_, "robot 1 left the floor at 0.000 s, later robot 2; robot 2 by 1250.0 mm"], noted(Off)
    ),
    %% path planning has a contract of distances
    Planned = outcome(mail([]), [], #{starl_dpp_monitor => #{}}),
    ?assertEqual([], texts(starl_lab_findings:make(Planned, ways(Off), []))).

results_are_read_again_test() ->
    Outcome = outcome(mail([]), [{1, {done, #{"Å" => 1}}}, {2, running}], #{}),
    Notes = starl_lab_findings:make(Outcome, ways([]), []),
    File = "results-" ++ os:getpid() ++ ".term",
    ok = file:write_file(File, unicode:characters_to_binary(starl_lab_findings:results(Notes))),
    ?assertEqual({ok, [{1, {done, #{"Å" => 1}}}, {2, running}]}, file:consult(File)),
    ok = file:delete(File),
    #{results := [One, Two]} = maps:from_list(starl_lab_findings:figures(Notes)),
    ?assertMatch([{robot, 1}, {ended, <<"done">>}, {result, _}], One),
    ?assertEqual([{robot, 2}, {ended, <<"running">>}], Two).

mail(Events) ->
    New = starl_run_mail_monitor:init(#{robots => 3}),
    Fed = lists:foldl(
        fun(Event, State) -> element(2, starl_run_mail_monitor:step(Event, State)) end, New, Events
    ),
    {ok, Mail} = starl_run_mail_monitor:finish(1000, Fed),
    Mail.

lines(Mail, Robots) -> texts(starl_lab_findings:make(outcome(Mail, Robots, #{}), ways([]), [])).

noted(Pieces) -> texts(starl_lab_findings:make(outcome(mail([]), [], #{}), ways(Pieces), [])).

texts(Notes) -> [lists:flatten(Line) || Line <- starl_lab_findings:lines(Notes)].

outcome(Mail, Robots, More) ->
    #{
        monitors => More#{starl_run_mail_monitor => Mail},
        robots => [{Id, #{result => Result}} || {Id, Result} <- Robots]
    }.

stands(Id, X, Y) -> {Id, starl_trajectory:standing(0, {X, Y}, 0.0)}.

ways(Pieces) ->
    Ways = #{pieces => Pieces, until_us => 1000000, is_whole => true},
    starl_lab_ways:new(Ways, {4000, 5000}).
