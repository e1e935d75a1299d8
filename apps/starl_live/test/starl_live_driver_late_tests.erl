%% What a live robot's step was to do by a moment that is past: it does not leave, and the machine that wanted
%% it learns of it, as do the log and the counters, which know leases by their ends.
-module(starl_live_driver_late_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_driver_ct, [with_driver/2, sent/0, does/2, packet/0]).

-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

%% What has a latest moment leaves by then or not at all; then its machine learns of it, once, in the order of the
%% step. The radio and the chassis are told the moment, and look once more.
what_is_late_does_not_leave_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        Until = fun(Us) ->
            [
                {until, Us, {trace, {said, Us}}, a},
                {until, Us, {transmit, 2, packet()}, b},
                {until, Us, {drive, ?SCRIPT, 5}, c},
                {until, Us, {actuate, pen, down}, d}
            ]
        end,
        ok = Set(100),
        Self = self(),
        ?assertMatch(
            {
                [
                    {starl_traced, 1, Self, {1, 100, [{0, 1, app, {said, 100}}]}},
                    {transmit, 2, _, {100, {app, b}}},
                    {drive, ?SCRIPT, 100, {app, 5}},
                    {actuate, pen, down, none}
                ],
                [],
                _
            },
            does(Until(100), Driver)
        ),
        {[], Late, After} = does(Until(99), Driver),
        ?assertEqual([{app, info, {late, Mark}} || Mark <- [a, b, c, d]], Late),
        ?assertMatch({[stop], [], _}, does_stop(After)),
        %% a script is begun within half a second of its step, whatever its latest moment
        ?assertMatch({[{drive, ?SCRIPT, 500000, _}], [], _}, does([lasts(600000)], Driver)),
        ?assertMatch({[{drive, ?SCRIPT, 400000, _}], [], _}, does([lasts(400000)], Driver)),
        ok
    end).

lasts(Us) -> {until, Us, {drive, ?SCRIPT, 5}, c}.

does_stop(Driver) ->
    {Late, Next} = starl_live_driver:flush(starl_live_driver:stop(Driver)),
    {sent(), Late, Next}.

%% Two things of one order that are late are told once.
an_owner_learns_of_it_once_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        ok = Set(100),
        Said = [{until, 1, {trace, {said, N}}, a} || N <- [1, 2]],
        ?assertMatch({[], [{app, info, {late, a}}], _}, does(Said, Driver)),
        ok
    end).

%% Facts of two orders are late in their order, and before what was to be sent.
owners_learn_of_it_in_the_order_of_the_step_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        ok = Set(100),
        Late = [
            {until, 1, {actuate, pen, down}, c},
            {until, 1, {trace, {said, 1}}, a},
            {until, 100, {trace, {said, 2}}, in_time},
            {until, 1, {trace, {said, 3}}, b}
        ],
        ?assertMatch(
            {
                [{starl_traced, 1, _, {1, 100, [{0, 1, app, {said, 2}}]}}],
                [{app, info, {late, a}}, {app, info, {late, b}}, {app, info, {late, c}}],
                _
            },
            does(Late, Driver)
        ),
        ok
    end).

%% The log has a warning of each thing that was late, whether it was known at its step or when it was to leave.
what_is_late_is_logged_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        ok = Set(100),
        Logged = fun(Do) ->
            [{Level, Report} || {Level, Report, _} <- starl_live_log_ct:reports(Do)]
        end,
        Late = {warning, #{what => late, machine => app}},
        ?assertEqual(
            [Late, Late],
            Logged(fun() ->
                does([{until, 1, {trace, x}, a}, {until, 1, {actuate, pen, down}, b}], Driver)
            end)
        ),
        ?assertEqual([Late], Logged(fun() -> starl_live_driver:trace(app, late, Driver) end)),
        ?assertEqual([], Logged(fun() -> starl_live_driver:trace(app, {said, 1}, Driver) end)),
        ?assertEqual([], Logged(fun() -> does([{until, 100, {trace, x}, a}], Driver) end)),
        ok
    end).

%% Facts are counted when they are traced, whenever they leave.
facts_are_counted_test() ->
    with_driver(#{}, fun(Driver, _) ->
        Traced = lists:foldl(
            fun({Name, Fact}, B) -> starl_live_driver:trace(Name, Fact, B) end,
            Driver,
            [{app, crashed}, {app, crashed}, {mutex, late}]
        ),
        {[], Sent} = starl_live_driver:perform(
            {until, 9, {trace, {leased, token, 1, 8000}}, a}, app, Traced
        ),
        Counts = starl_live_driver:counts(Sent),
        Text = iolist_to_binary(starl_live_counts:text([], Counts)),
        [
            ?assertMatch({match, _}, re:run(Text, Line))
         || Line <- [
                "\nstarl_restarts_total{machine=\"app\"} 2\n",
                "\nstarl_late_total{machine=\"mutex\"} 1\n"
            ]
        ],
        ?assertMatch([{lease_seconds, [{token, token}], _}], starl_live_counts:leases(0, Counts)),
        ok
    end).

%% The end of a lease is known from the last moment of a shout.
a_lease_ends_at_its_latest_moment_test() ->
    with_driver(#{}, fun(Driver, _) ->
        {_, [], Next} = does([{until, 9000, {transmit, all, packet()}, a}], Driver),
        ?assertMatch(
            [{_, _, Seconds}] when Seconds == 0.008,
            starl_live_counts:leases(1000, starl_live_driver:counts(Next))
        ),
        {_, [], Bare} = does([{until, 9000, {actuate, pen, down}, a}], Driver),
        ?assertEqual([], starl_live_counts:leases(1000, starl_live_driver:counts(Bare))),
        ok
    end).
