%% Actions are checked where they are given: the machine that gives a malformed one crashes, with a
%% reason that shows it.
-module(starl_action_tests).
-behaviour(starl_machine).
-include_lib("eunit/include/eunit.hrl").

-export([init/1, handle_event/5]).

%% A machine whose actions are the event.
init(#{actions := Actions}) -> {ready, none, Actions}.

handle_event(cast, Result, _, _, _) -> Result.

-define(WHEELS(Commands), {starl_chassis_differential, Commands}).

good() ->
    [
        {cast, a, b},
        {cast, a, {b, c}},
        {call, a, b, t},
        {reply, {a, t}, x},
        {{timeout, t}, 0, x},
        {{timeout, t}, cancel},
        {state_timeout, 7, x},
        {state_timeout, cancel},
        {transmit, all, p},
        {transmit, 3, p},
        {sense, [], t},
        {sense, [1, 2], t},
        {drive, ?WHEELS([]), m},
        {drive, ?WHEELS([{-500, 500.0, 15000}]), m},
        {actuate, pen, <<"any">>},
        {actuate, pen, up, 7},
        {trace, any},
        {done, any},
        {store, any},
        {cast, sap, {send, 2, a, b}},
        {cast, sap, {broadcast, a, b}},
        {cast, sap, {listen, a, m}},
        {cast, sap, {no, such}},
        {call, location, {pose, 1}, t},
        {call, location, {waypoint, "any"}, t},
        {call, motion, {go_to, {1, 2.0}}, t},
        {call, motion, {go_along, {{0, 0}, {1.0, 1.0}}}, t},
        {cast, motion, stop}
    ].

bad() ->
    [
        {timeout, 500000, tick},
        {{timeout, t}, 0.5, x},
        {{timeout, t}, -1, x},
        {{timeout, t}, 1 bsl 60, x},
        {{timeout, t}, infinity, x},
        {state_timeout, 0.5, x},
        {state_timeout, -5, x},
        {transmit, everybody, p},
        {transmit, 0, p},
        {transmit, 1.0, p},
        {sense, 1, t},
        {sense, [a], t},
        {sense, [1 | 2], t},
        {sense, [1]},
        {drive, ?WHEELS([{1.0, 1.0, 0.5}]), m},
        {drive, [{1.0, 1.0, 5}], m},
        {drive, ?WHEELS([{fast, 1.0, 5}]), m},
        {drive, ?WHEELS([{1.0e300, 1.0, 5}]), m},
        {drive, ?WHEELS(stop), m},
        {drive, {no_such_chassis, []}, m},
        {drive, {lists, []}, m},
        {drive, {1, []}, m},
        {drive, ?WHEELS([{1 bsl 2000, 1.0, 5}]), m},
        {drive, ?WHEELS([{1.0, 1.0, 0}]), m},
        {drive, ?WHEELS([{1.0, 1.0, 5} | x]), m},
        {actuate, "pen", down},
        {actuate, "pen", down, 7},
        {cast, "sap", x},
        {call, 1, x, t},
        {reply, app, x},
        {reply, {1, t}, x},
        trace,
        {trace},
        {no_such_action, 1},
        nonsense,
        7,
        {cast, sap, {send, north, a, b}},
        {cast, sap, {send, 2, "a", b}},
        {cast, sap, {broadcast, "a", b}},
        {cast, sap, {listen, a, 3}},
        {call, location, {pose, me}, t},
        {call, motion, {go_to, {north, 1.0}}, t},
        {call, motion, {go_to, north}, t},
        {call, motion, {go_to, {1.0e300, 0.0}}, t},
        {call, motion, {go_to, {1 bsl 2000, 0.0}}, t},
        {call, motion, {go_along, {0.0, 1.0}}, t}
    ].

good_actions_pass_test() ->
    ?assertEqual(ok, starl_action:check(good())),
    [?assertEqual({[A], m()}, {[A], step([A])}) || A <- good()].

bad_actions_crash_who_gives_them_test_() ->
    [
        {lists:flatten(io_lib:format("~tp", [Action])), fun() ->
            %% among others, at the start as well
            ?assertError({bad_action, _, [_ | _]}, step([{trace, a}, Action, {trace, b}])),
            ?assertError({bad_action, _, [_ | _]}, new([Action])),
            ?assertMatch({bad_action, _, _}, reason(fun() -> step([Action]) end))
        end}
     || Action <- bad()
    ].

%% What goes on the air or into the store: a real robot would lose it, so the one that gives it away
%% crashes.
odd_payloads_crash_who_gives_them_test_() ->
    Large = binary:copy(<<0>>, 60_000),
    Cases = [
        {{message, {app, a}}, {cast, sap, {send, 2, {app, a}, self()}}},
        {{message, a}, {call, sap, {send, 2, a, fun() -> ok end}, t}},
        {{message, a}, {call, sap, {send, 2, a, make_ref(), 5}, t}},
        {{message, a}, {cast, sap, {broadcast, a, Large}}},
        {{datagram, a}, {cast, sap, {shout, a, [Large]}}},
        {{datagram, a}, {cast, sap, {shout, a, self(), 5}}},
        {{datagram, a}, starl_sap:datagram(1, 2, a, self())},
        {store, {store, [self()]}}
    ],
    [
        {lists:flatten(io_lib:format("~tP", [Action, 12])), fun() ->
            ?assertError({bad_payload, What, [_ | _]}, step([{trace, a}, Action])),
            ?assertError({bad_payload, What, [_ | _]}, step([{until, 5, [Action], mark}])),
            ?assertError({bad_payload, What, [_ | _]}, new([Action]))
        end}
     || {What, Action} <- Cases
    ].

no_list_of_actions_test() ->
    [?assertError({bad_action, _, _}, step(No)) || No <- [x, {trace, a}, [{trace, a} | b]]].

bad_returns_test() ->
    [
        ?assertError({bad_return, {?MODULE, handle_event}, Result}, event(Result))
     || Result <- [x, {keep_state}, {next_state, a}, {noreply, a}, {keep_state, a, [], x}]
    ].

step(Actions) ->
    {_, Next} = event({keep_state_and_data, Actions}),
    Next.

event(Result) -> starl_machine:step(cast, Result, #{now => 0, robot => 1}, m()).

m() -> element(2, new([])).

new(Actions) ->
    starl_machine:new(?MODULE, #{actions => Actions}, #{
        robot => 1,
        participants => [1],
        name => test,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 0
    }).

reason(Fun) ->
    try
        Fun()
    catch
        error:Reason -> Reason
    end.
