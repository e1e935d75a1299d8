%% Hands at a simulation: whatever they do, the saved scenario ends with the digest of the run, and a run
%% that is only looked at ends with its own.
-module(starl_lab_player_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, init_per_suite/1, end_per_suite/1]).
-export([view_changes_nothing/1, hands_replay/1, a_hand_in_the_middle_of_a_window/1]).
-export([going_back/1, healing/1, healing_the_schedule/1, bad_commands/1, at_a_violation/1]).
-export([found_at_the_end/1, viewers_see_hands/1, timers_are_due/1]).
-export([a_page_that_is_loaded_anew_finds_the_run/1, a_run_that_nobody_looks_at_ends/1]).
-export([an_end_is_told_once/1, an_answer_names_who_asked/1]).

all() ->
    [
        view_changes_nothing,
        hands_replay,
        a_hand_in_the_middle_of_a_window,
        going_back,
        healing,
        healing_the_schedule,
        bad_commands,
        at_a_violation,
        found_at_the_end,
        viewers_see_hands,
        timers_are_due,
        a_page_that_is_loaded_anew_finds_the_run,
        a_run_that_nobody_looks_at_ends,
        an_end_is_told_once,
        an_answer_names_who_asked
    ].

init_per_suite(Config) -> Config.

end_per_suite(Config) -> Config.

scenario() -> #{app => painting, robots => 4, seed => 1}.

%% The digest of the run without a window.
view_changes_nothing(_Config) ->
    {Digest, _, _} = played(scenario(), []),
    ?assertEqual(digest(scenario()), Digest).

%% Each kind of fault that the page offers, one after the other.
hands_replay(_Config) ->
    Hands = [
        {until, 10},
        {fault, #{kind => kill_machine, target => [2, sap]}},
        {until, 14},
        {fault, #{kind => reboot, target => 3, seconds => 3}},
        {fault, #{kind => cut, target => [1, 2], seconds => 5}},
        {until, 25},
        {fault, #{kind => location_frozen, target => 1, seconds => 4}},
        {fault, #{kind => pause, target => 4, seconds => 2}},
        {until, 33},
        {fault, #{kind => partition, target => [1, 3], seconds => 6}},
        {fault, #{kind => loss, target => all, params => #{part => 0.3}, seconds => 20}},
        {until, 40},
        {fault, #{kind => kill_robot, target => 2}},
        {until, 60},
        {fault, #{
            kind => wheel_slow,
            target => 1,
            seconds => 3,
            params => #{wheel => left, factor => 0.5}
        }}
    ],
    {Digest, Scenario, _} = played(scenario(), Hands),
    ?assertEqual(10, length(maps:get(faults, Scenario))),
    ?assertEqual([], [Said || {no, Said} <- said()]),
    ?assertNotEqual(digest(scenario()), Digest),
    ?assertEqual(digest(Scenario), Digest).

%% After a step the run rests within a window; a fault then begins with the next one.
a_hand_in_the_middle_of_a_window(_Config) ->
    Hands = [
        {until, 12},
        {step, 2},
        {step, 2},
        {step, 3},
        {fault, #{kind => kill_machine, target => [2, app]}},
        {step, 1},
        {fault, #{kind => isolate, target => 1, seconds => 2.5}}
    ],
    {Digest, Scenario, _} = played(scenario(), Hands),
    ?assertEqual(2, length(maps:get(faults, Scenario))),
    ?assertEqual(digest(Scenario), Digest).

%% The rows of a run that went back are those of one that did not.
going_back(_Config) ->
    {Digest, _, Straight} = played(scenario(), []),
    {Same, _, Again} = played(scenario(), [{until, 30}, {until, 5}, {step, 1}, {until, 3}]),
    ?assertEqual(Digest, Same),
    ?assert(motions(Straight) =:= motions(Again)),
    %% a hand tells nothing twice
    Hands = [{until, 30}, {fault, #{kind => isolate, target => 1, seconds => 0}}],
    {Digest, _, Handled} = played(scenario(), Hands),
    ?assert(motions(Straight) =:= motions(Handled)).

healing(_Config) ->
    Hands = [
        {until, 10},
        {fault, #{kind => isolate, target => 1}},
        {until, 12},
        {heal, <<"manual_1">>},
        {heal, <<"manual_1">>}
    ],
    {Digest, #{faults := Faults} = Scenario, _} = played(scenario(), Hands),
    ?assertMatch([{manual_1, 10000, 12000, isolate, 1, #{}}], Faults),
    ?assertMatch([_], [No || {no, No} <- said()]),
    ?assertEqual(digest(Scenario), Digest).

%% A fault of the schedule that is healed makes the run another one, so its record must be, too.
healing_the_schedule(_Config) ->
    Faulty = (scenario())#{faults => [{own, 9000, 60000, isolate, 1, #{}}]},
    {Digest, #{faults := Faults} = Scenario, _} =
        played(Faulty, [{until, 12}, {heal, <<"own">>}]),
    ?assertEqual([{own, 9000, 12000, isolate, 1, #{}}], Faults),
    ?assertEqual(digest(Scenario), Digest),
    ?assert(get(is_changed)).

%% Nothing that a page may send ends or changes the run.
bad_commands(_Config) ->
    Bad = [
        #{},
        #{do => 7},
        #{do => nothing},
        #{do => go, speed => -1},
        #{do => go, speed => <<"fast">>},
        #{do => until, at => -1},
        #{do => until, at => <<"x">>},
        #{do => step, robot => 99},
        #{do => step, robot => #{}},
        #{do => look, robot => 0},
        #{do => look, robot => [1]},
        #{do => fault},
        #{do => fault, kind => nothing, target => 1},
        #{do => fault, kind => clock_step, target => 1, params => #{ms => 5}},
        #{do => fault, kind => kill_robot, target => 5},
        #{do => fault, kind => kill_robot, target => all},
        #{do => fault, kind => kill_machine, target => [1, nothing]},
        #{do => fault, kind => cut, target => [1, 1]},
        #{do => fault, kind => cut, target => [1, 2, 3]},
        #{do => fault, kind => loss, target => [1, 2], params => #{part => 2}},
        #{do => fault, kind => loss, target => [1, 2]},
        #{do => fault, kind => loss, target => [1, 2], params => #{part => 1, other => 2}},
        #{do => fault, kind => pause, target => 1, seconds => -5, params => 5},
        #{do => fault, kind => partition, target => []},
        #{do => fault, kind => partition, target => [0]},
        #{do => heal, id => <<"manual_1">>},
        #{do => heal, id => #{}},
        #{do => save, name => <<"../x">>}
    ],
    Commands = [{raw, jsoned(C)} || C <- Bad],
    {Digest, #{faults := Faults}, _} = played(scenario(), [{until, 5} | Commands]),
    ?assertEqual([], Faults),
    ?assertEqual(length(Bad), length([No || {no, No} <- said()])),
    ?assertEqual(digest(scenario()), Digest).

%% The page is told of the violation that ends a run.
at_a_violation(_Config) ->
    Scenario = #{app => starl_lab_crasher, robots => 2, seed => 1},
    {_, _, Rows} = played(Scenario, []),
    ?assertMatch([[<<"v">>, _, <<"sleep">>, _, [1]] | _], [R || [<<"v">> | _] = R <- Rows]).

%% What shows only at the end of a run is told before the run is finished, once; and no more after the
%% run has begun anew.
found_at_the_end(_Config) ->
    Late = #{app => painting, robots => 2, seed => 1, converge => 15},
    {_, _, Rows} = played(Late, []),
    Broken = [{Contract, Robots} || [<<"v">>, _, Contract, _, Robots] <- Rows],
    ?assertEqual([{<<"progress">>, [1, 2]}], Broken),
    {ok, Hub} = starl_view_hub:start_link(#{}),
    {ok, Run} = starl_lab_player_run:start(#{hub => Hub, scenario => Late}),
    Over = starl_lab_player_run:judge(starl_lab_player_run:run(7200000000, Run)),
    ?assertEqual(1, violations(Hub)),
    ?assertEqual(1, violations(Hub, starl_lab_player_run:judge(Over))),
    Anew = starl_lab_player_run:changed([], Over),
    ?assertEqual(0, violations(Hub)),
    ?assertEqual(1, violations(Hub, starl_lab_player_run:judge(Anew))),
    ok = starl_lab_player_run:close(Anew).

violations(Hub, _Run) -> violations(Hub).

%% What a new page is told.
violations(Hub) ->
    ok = starl_view_hub:clock(Hub, #{now_us => 0}),
    {ok, _, _} = starl_view_hub:join(Hub),
    ok = starl_view_hub:want(Hub, {0, 0}),
    receive
        {frames, Frames, _} ->
            {ok, Rows} = starl_json:decode(iolist_to_binary([$[, Frames, $]])),
            length([v || [<<"v">> | _] <- lists:foldl(fun kept/2, [], Rows)])
    end.

%% A hand is told under the topic of faults, with its beginning and its end.
viewers_see_hands(_Config) ->
    {ok, Feed} = starl_view_foxglove_feed:start_link(#{}),
    {ok, _, _, _} = starl_view_foxglove_feed:join(Feed),
    ok = starl_view_foxglove_feed:channels(Feed, [faults]),
    _ = put(feed, Feed),
    Cut = {fault, #{kind => cut, target => [1, 2], seconds => 5}},
    {_, _, _} = played(scenario(), [{until, 10}, Cut, {until, 12}, {heal, <<"manual_1">>}]),
    _ = erase(feed),
    ok = starl_view_foxglove_feed:want(Feed),
    receive
        {updates, Updates, 0, _} ->
            Told = [{At, decoded(Text)} || {faults, At, Text} <- Updates],
            ?assertMatch(
                [
                    {10000000, #{<<"what">> := <<"began">>, <<"fault">> := <<"manual_1">>}},
                    {10000000, #{<<"what">> := <<"began">>, <<"fault">> := <<"manual_1_back">>}},
                    {12000000, #{<<"what">> := <<"ended">>, <<"fault">> := <<"manual_1">>}},
                    {15000000, #{<<"what">> := <<"ended">>, <<"fault">> := <<"manual_1_back">>}}
                ],
                lists:sort(Told)
            )
    end.

decoded(Text) ->
    {ok, Value} = starl_json:decode(Text),
    Value.

%% Each timer of each machine with the time at which it expires, none of which is past; also within a
%% window.
timers_are_due(_Config) ->
    {ok, Sim} = starl_sim:start(scenario()),
    #{now_us := Now} = starl_sim:run(Sim, 10),
    due(Now, Sim),
    [{1, #{events := N}} | _] = starl_sim:robots(Sim),
    {ok, #{now_us := Later}} = starl_sim:run_until_event(Sim, 1, N + 3),
    due(Later, Sim),
    ok = starl_sim:close(Sim).

due(Now, Sim) ->
    Timers = starl_sim:timers(Sim, 1),
    ?assertMatch([_ | _], Timers),
    [?assert(is_integer(Due) andalso Due >= Now, Timer) || {_, _, Due} = Timer <- Timers].

%% A page that is loaded anew is away for a moment: a run that is over waits for it.
a_page_that_is_loaded_anew_finds_the_run(_Config) ->
    {ok, Hub} = starl_view_hub:start_link(#{}),
    ok = starl_view_hub:tap(Hub, tapped()),
    Page = looking(Hub),
    Player = lingering(Hub),
    receive
        {over, _} -> ok
    end,
    leaves(Page, Hub),
    %% it has looked twice whether a page is there
    ok = clocks(2, Player),
    Anew = looking(Hub),
    ok = starl_view_hub:command(Hub, #{<<"do">> => <<"stop">>}),
    ?assertEqual({played, 1}, ending(Player)),
    leaves(Anew, Hub).

a_run_that_nobody_looks_at_ends(_Config) ->
    {ok, Hub} = starl_view_hub:start_link(#{grace_ms => 0}),
    Page = looking(Hub),
    Player = lingering(Hub),
    receive
        {over, _} -> ok
    end,
    leaves(Page, Hub),
    ?assertEqual({played, 1}, ending(Player)),
    %% and nobody was there at all
    {ok, Alone} = starl_view_hub:start_link(#{}),
    ?assertEqual({played, 1}, ending(lingering(Alone))).

%% Results are told at the end of the run, and not again when it is looked at once more; but when it was changed.
an_end_is_told_once(_Config) ->
    {ok, Hub} = starl_view_hub:start_link(#{}),
    ok = starl_view_hub:tap(Hub, tapped()),
    Page = looking(Hub),
    Player = lingering(Hub),
    First = over(),
    ?assertMatch(#{again := false, is_changed := false, scenario := #{faults := []}}, First),
    Back = #{<<"do">> => <<"until">>, <<"at">> => 5},
    Go = #{<<"do">> => <<"go">>},
    [ok = starl_view_hub:command(Hub, Command) || Command <- [Back, Go]],
    ok = ended_again(),
    Kill = #{<<"do">> => <<"fault">>, <<"kind">> => <<"kill_robot">>, <<"target">> => 2},
    [ok = starl_view_hub:command(Hub, Command) || Command <- [Back, Kill, Go]],
    ?assertMatch(#{again := true, is_changed := true, scenario := #{faults := [_]}}, over()),
    ok = starl_view_hub:command(Hub, #{<<"do">> => <<"stop">>}),
    ?assertEqual({played, 2}, ending(Player)),
    leaves(Page, Hub).

%% The page has more than one form.
an_answer_names_who_asked(_Config) ->
    Asked = [
        {raw, #{<<"do">> => <<"heal">>, <<"id">> => <<"x">>, <<"of">> => <<"fault">>}},
        {raw, #{<<"do">> => <<"heal">>, <<"id">> => <<"x">>}},
        {raw, #{<<"do">> => <<"heal">>, <<"id">> => <<"x">>, <<"of">> => 7}}
    ],
    {_, _, _} = played(scenario(), [{until, 5} | Asked]),
    ?assertEqual([[<<"fault">>], [], []], lists:reverse(get(askers))).

%% The clocks of the run come to this test.
tapped() ->
    Test = self(),
    spawn_link(fun() -> tapped(Test) end).

tapped(Test) ->
    receive
        {'$gen_call', From, {clock, Clock}} ->
            gen_server:reply(From, ok),
            Test ! {clock, Clock};
        {'$gen_call', From, _} ->
            gen_server:reply(From, ok);
        _ ->
            ok
    end,
    tapped(Test).

clocks(0, _Player) ->
    ok;
clocks(N, {Pid, Monitor} = Player) ->
    receive
        {'DOWN', Monitor, process, Pid, Reason} -> {ended, Reason};
        {clock, #{ending := Ending}} when Ending =/= null, Ending =/= none -> clocks(N - 1, Player)
    end.

%% The run is at a time before its end, and then at its end.
ended_again() ->
    receive
        {clock, #{ending := null}} -> ended_again_now()
    end.

ended_again_now() ->
    receive
        {clock, #{ending := null}} -> ended_again_now();
        {clock, #{ending := _}} -> ok
    end.

over() ->
    receive
        {over, Ran} ->
            forget_clocks(),
            Ran
    end.

forget_clocks() ->
    receive
        {clock, _} -> forget_clocks()
    after 0 -> ok
    end.

looking(Hub) ->
    Test = self(),
    Page = spawn_link(fun() ->
        {ok, _, _} = starl_view_hub:join(Hub),
        Test ! {looks, self()},
        receive
            leave -> ok
        end
    end),
    receive
        {looks, Page} -> Page
    end.

leaves(Page, Hub) ->
    Page ! leave,
    gone(Hub),
    forget_clocks().

gone(Hub) ->
    case starl_view_hub:pages(Hub) of
        0 -> ok;
        _ -> gone(Hub)
    end.

%% A player that lingers; its `over' counts.
lingering(Hub) ->
    Test = self(),
    Over = fun(Ran) ->
        Test ! {over, Ran},
        put(overs, 1 + counted(get(overs)))
    end,
    spawn_monitor(fun() ->
        {ok, #{sim := Sim}} = starl_lab_player:play(#{
            hub => Hub, scenario => scenario(), speed => max, linger => true, over => Over
        }),
        ok = starl_sim:close(Sim),
        exit({played, get(overs)})
    end).

counted(undefined) -> 0;
counted(N) -> N.

ending({Pid, Monitor}) ->
    receive
        {'DOWN', Monitor, process, Pid, Reason} -> Reason
    end.

%% -- helpers --------------------------------------------------------------------------------

digest(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {#{digest := Digest}, _} = starl_sim:finish(Sim),
    Digest.

%% Plays as fast as it can; the hands' commands wait for the player from the beginning, each behind
%% the one before it. Gives the digest, the scenario with the faults, and all rows.
played(Scenario, Hands) ->
    Test = self(),
    {ok, Hub} = starl_view_hub:start_link(#{}),
    _ = get(feed) =/= undefined andalso starl_view_hub:tap(Hub, get(feed)),
    Page = spawn_link(fun() -> page(Test, Hub, Hands) end),
    {ok, #{sim := Sim, scenario := Faulty, is_changed := IsChanged}} = starl_lab_player:play(#{
        hub => Hub,
        scenario => Scenario,
        speed => max,
        paused => Hands =/= [],
        save => fun(_, _) -> {error, "not here"} end
    }),
    {#{digest := Digest}, _} = starl_sim:finish(Sim),
    _ = put(is_changed, IsChanged),
    Page ! {over, Test},
    receive
        {rows, Rows, Said} ->
            _ = put(said, Said),
            _ = put(askers, askers([])),
            {Digest, Faulty, Rows}
    end.

said() -> get(said).

%% The parts of the page that got an answer, the last one first.
askers(Seen) ->
    receive
        {asker, Of} -> askers([Of | Seen])
    after 0 -> Seen
    end.

%% A page that does one thing after the other, each when the one before it is done.
page(Test, Hub, Hands) ->
    {ok, _, Place} = starl_view_hub:join(Hub),
    ok = starl_view_hub:want(Hub, Place),
    paged(Test, Hub, Hands, waits, [], []).

paged(Test, Hub, Hands, Waits, Rows, Said) ->
    receive
        {frames, Frames, Place} ->
            ok = starl_view_hub:want(Hub, Place),
            {ok, New} = starl_json:decode(iolist_to_binary([$[, Frames, $]])),
            All = lists:foldl(fun kept/2, Rows, New),
            {Left, Next} = next(Hands, Waits, New, Hub),
            paged(Test, Hub, Left, Next, All, Said);
        {tell, [What, Text | Of]} when What =:= <<"no">>; What =:= <<"yes">> ->
            Test ! {asker, Of},
            paged(Test, Hub, Hands, Waits, Rows, [{binary_to_atom(What), Text} | Said]);
        {over, Test} ->
            self() ! {last, Test},
            %% what is left comes before the answer
            ok = starl_view_hub:flush(Hub),
            paged(Test, Hub, Hands, Waits, Rows, Said);
        {last, Test} ->
            ok = starl_view_hub:flush(Hub),
            case erlang:process_info(self(), message_queue_len) of
                {_, 0} ->
                    Test ! {rows, lists:reverse(Rows), Said};
                _ ->
                    self() ! {last, Test},
                    paged(Test, Hub, Hands, Waits, Rows, Said)
            end
    end.

kept([<<"reset">>], _Rows) -> [];
kept([<<"t">> | _], Rows) -> Rows;
kept(Row, Rows) -> [Row | Rows].

%% The run rests: the next command, or, without one, it goes on.
next(Hands, Waits, New, Hub) ->
    Rests = [T || [<<"t">>, T, #{<<"paused">> := true}] <- New],
    case {Rests, Hands, Waits} of
        {[], _, _} ->
            {Hands, Waits};
        {_, [], gone} ->
            {[], gone};
        {_, [], _} ->
            ok = starl_view_hub:command(Hub, #{<<"do">> => <<"go">>}),
            {[], gone};
        {_, [{until, S} | _], {until, S}} ->
            case abs(lists:last(Rests) - S * 1000000) < 10000 of
                true -> next(tl(Hands), waits, New, Hub);
                false -> {Hands, Waits}
            end;
        {_, [{until, S} | _], _} ->
            ok = starl_view_hub:command(Hub, #{<<"do">> => <<"until">>, <<"at">> => S}),
            {Hands, {until, S}};
        {_, [Hand | More], _} ->
            ok = starl_view_hub:command(Hub, command(Hand)),
            {More, waits}
    end.

command({step, Robot}) -> #{<<"do">> => <<"step">>, <<"robot">> => Robot};
command({heal, Id}) -> #{<<"do">> => <<"heal">>, <<"id">> => Id};
command({fault, Fault}) -> jsoned(Fault#{do => fault});
command({raw, Command}) -> Command.

jsoned(Value) ->
    {ok, Decoded} = starl_json:decode(iolist_to_binary(starl_json:encode(Value))),
    Decoded.

motions(Rows) -> [Row || [<<"m">> | _] = Row <- Rows].
