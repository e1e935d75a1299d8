%% The rules of the loop of every robot, with a driver that is played here: its world is a map, its
%% machines are functions, its processes are played, too.
-module(starl_robot_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_driver).
-behaviour(starl_platform).
-behaviour(starl_machine).

-export([
    handles/4, clock/1, present/1, base/3, trace/3, plan/5, store/3, ended/2, perform/3, stop/1
]).
-export([init/1, handle_event/5]).

%% -- the loop -------------------------------------------------------------------------------

%% Machines boot in their order, before anything else; then local events come one after the other,
%% each with the actions of its machine in their order.
order_test() ->
    {quiet, R} = starl_robot:run(
        robot(#{
            app => fun
                (boot, _) -> [{cast, sap, one}, {trace, a}, {cast, sap, two}, {trace, b}];
                (_, _) -> []
            end,
            sap => fun
                (cast, Word) -> [{trace, Word}, {cast, location, Word}];
                (_, _) -> []
            end,
            location => fun
                (cast, Word) -> [{trace, Word}];
                (_, _) -> []
            end
        })
    ),
    ?assertEqual(
        [
            {sap, boot},
            {location, boot},
            {app, boot},
            {sap, cast},
            {sap, cast},
            {location, cast},
            {location, cast}
        ],
        handled(R)
    ),
    ?assertEqual(
        [{app, a}, {app, b}, {sap, one}, {sap, two}, {location, one}, {location, two}], traced(R)
    ).

%% One event at a time, for those who look between them.
pace_test() ->
    Robot = starl_robot:pace(single, robot(#{app => silent(), sap => silent()})),
    {paused, One} = starl_robot:run(Robot),
    ?assertEqual([{sap, boot}], handled(One)),
    {paused, Two} = starl_robot:run(One),
    ?assertEqual([{sap, boot}, {app, boot}], handled(Two)),
    ?assertMatch({quiet, _}, starl_robot:run(Two)).

%% A call of a machine that the robot does not have is refused, and traced.
refusal_test() ->
    {quiet, R} = starl_robot:run(
        robot(#{
            app => fun
                (boot, _) -> [{call, nobody, q, t}];
                ({reply, t}, Answer) -> [{trace, Answer}];
                (_, _) -> []
            end
        })
    ),
    ?assertEqual(
        [{nobody, {unknown_machine, nobody}}, {app, {no_such_machine, nobody}}], traced(R)
    ).

%% A timer that was cancelled, or started anew, is dropped when its event comes; the machine hears of
%% the last start alone.
cancelled_timer_is_dropped_at_delivery_test() ->
    {quiet, R} = starl_robot:run(
        robot(#{
            app => fun
                (boot, _) ->
                    [
                        {{timeout, a}, 10, x},
                        {{timeout, b}, 10, x},
                        {{timeout, b}, 20, y},
                        {state_timeout, 5, z},
                        {{timeout, a}, cancel}
                    ];
                (_, _) ->
                    []
            end
        })
    ),
    ?assertEqual([{app, a, x}, {app, b, x}, {app, b, y}, {app, state_timeout, z}], planned(R)),
    ?assertEqual(stale, starl_robot:expire(app, a, 1, R)),
    ?assertEqual(stale, starl_robot:expire(app, b, 2, R)),
    {ok, state_timeout, _} = starl_robot:expire(app, state_timeout, 4, R),
    {ok, {timeout, b}, Left} = starl_robot:expire(app, b, 3, R),
    {quiet, Fired} = starl_robot:fire(app, {timeout, b}, y, starl_robot:world(R), Left, R),
    ?assertEqual(stale, starl_robot:expire(app, b, 3, Fired)).

%% What follows a store takes place only when the term is durable; a full store is the machine's crash.
full_store_test() ->
    Store = #{
        app => fun
            (boot, _) -> [{trace, before}, {store, kept}, {trace, later}];
            (_, _) -> []
        end
    },
    {quiet, R} = starl_robot:run(robot(Store)),
    ?assertEqual({[{app, before}, {app, later}], #{app => kept}}, {traced(R), stored(R)}),
    {crashed, app, store_full, Full} = starl_robot:run(robot((world(Store))#{full => true}, Store)),
    ?assertEqual([{app, before}], traced(Full)).

%% A machine that finds its store damaged is told so, and so are the monitors.
damaged_store_is_traced_test() ->
    {quiet, R} = starl_robot:run(
        robot((world(#{app => silent()}))#{stored => damaged}, #{app => silent()})
    ),
    ?assertEqual([{app, store_damaged}], traced(R)).

%% Only the world's actions are the world's; what answers them at once comes in its turn.
world_test() ->
    {quiet, R} = starl_robot:run(
        robot(#{
            app => fun
                (boot, _) ->
                    [{sense, [1], t}, {cast, app, after_it}, {actuate, pen, down}, {done, x}];
                (info, {located, t, _}) ->
                    [{trace, seen}];
                (cast, Word) ->
                    [{trace, Word}]
            end
        })
    ),
    ?assertEqual([{sense, [1], t}, {actuate, pen, down}], maps:get(asked, starl_robot:world(R))),
    ?assertEqual([{app, {done, x}}, {app, seen}, {app, after_it}], traced(R)),
    ?assertEqual([{done, x}], maps:get(ended, starl_robot:world(R))).

%% -- latest moments -------------------------------------------------------------------------

%% Actions with a latest moment take place at that moment, and not later: then none of them does, and
%% their machine learns of it before anything else.
%% Holds: What is late does not leave: a packet, a reply, a fact with a latest moment is dropped,
%% and its machine is told
%% Red: f9ea041; told by 15b73fc: there were no latest moments
what_is_late_is_not_done_test() ->
    App = fun
        (boot, _) ->
            [
                {cast, app, word},
                {until, 100, [{trace, a}, {cast, app, a}], a},
                {until, 99, [{trace, b}, {cast, app, b}], b},
                {until, 98, [{trace, c}], c},
                {trace, d}
            ];
        (_, Content) ->
            [{trace, Content}]
    end,
    Machines = #{app => App},
    {quiet, R} = starl_robot:run(robot((world(Machines))#{now => 100}, Machines)),
    ?assertEqual(
        [{app, E} || E <- [a, late, late, d, {late, b}, {late, c}, word, a]], traced(R)
    ).

%% What leaves the robot keeps its latest moment, for the driver to look again.
what_leaves_keeps_its_latest_moment_test() ->
    Group = [{transmit, 2, packet}, {actuate, pen, down}, {trace, sent}],
    Machines = #{
        app => fun
            (boot, _) -> [{until, 5, Group, m}];
            (_, _) -> []
        end
    },
    {quiet, R} = starl_robot:run(robot(Machines)),
    ?assertEqual(
        [{until, 5, {transmit, 2, packet}, m}, {until, 5, {actuate, pen, down}, m}],
        maps:get(asked, starl_robot:world(R))
    ).

%% The robot stands still after so many actions of the machine's next step; the rest takes place when
%% it goes on, at that time: what has become late meanwhile is not done.
stands_still_in_mid_step_test_() ->
    App = fun
        (boot, _) -> [];
        (cast, go) -> [{trace, a}, {cast, sap, go}, {until, 50, [{trace, b}, {trace, c}], m}];
        (_, Content) -> [{trace, Content}]
    end,
    Sap = fun
        (boot, _) -> [];
        (_, Content) -> [{trace, Content}]
    end,
    {quiet, R} = starl_robot:run(robot(#{app => App, sap => Sap})),
    Late = [{70, app, late}, {70, app, {late, m}}, {70, sap, go}],
    [
        {integer_to_list(After), fun() ->
            Armed = starl_robot:stand_still(app, After, R),
            World = starl_robot:world(Armed),
            {stands, Stands} = starl_robot:event(app, cast, go, World, Armed),
            ?assertMatch({stands, _}, starl_robot:run(Stands)),
            Later = starl_robot:world(at(70, Stands), Stands),
            {quiet, Done} = starl_robot:run(starl_robot:go_on(Later)),
            ?assertEqual({Before, Then}, {timed(Stands), timed(Done) -- timed(Stands)}),
            %% the next step stands still no more
            {quiet, _} = starl_robot:event(app, cast, go, at(70, Done), Done)
        end}
     || {After, Before, Then} <- [
            {0, [], [{70, app, a} | Late]},
            {1, [{0, app, a}], Late},
            {2, [{0, app, a}], Late},
            %% facts leave with the look at the clock
            {3, [{0, app, E} || E <- [a, b, c]], [{70, sap, go}]}
        ]
    ].

%% What is kept of calls is no action: the robot stands still at the same place.
stands_still_at_the_same_action_with_histories_test() ->
    Kept = {trace, {history, {invoked, {1, 1}, sap, go}}},
    App = fun
        (boot, _) -> [];
        (cast, plain) -> [{trace, a}, {trace, b}, {trace, c}];
        (cast, kept) -> [Kept, {trace, a}, Kept, {trace, b}, Kept, {trace, c}, Kept];
        (cast, few) -> [Kept, {trace, a}, {trace, b}, Kept]
    end,
    {quiet, R} = starl_robot:run(robot(#{app => App})),
    Armed = starl_robot:stand_still(app, 2, R),
    Until = fun(How) ->
        {Stands, Then} = starl_robot:event(app, cast, How, starl_robot:world(Armed), Armed),
        {Stands, [E || {app, E} <- traced(Then), is_atom(E)]}
    end,
    ?assertEqual({stands, [a, b]}, Until(plain)),
    ?assertEqual({stands, [a, b]}, Until(kept)),
    ?assertEqual({quiet, [a, b]}, Until(few)).

%% A step of fewer actions goes by.
stands_still_in_a_step_of_more_actions_test() ->
    App = fun
        (boot, _) -> [];
        (cast, short) -> [{trace, a}, {trace, b}];
        (cast, long) -> [{trace, c}, {trace, d}, {trace, e}]
    end,
    {quiet, R} = starl_robot:run(robot(#{app => App})),
    Armed = starl_robot:stand_still(app, 2, R),
    {quiet, Short} = starl_robot:event(app, cast, short, starl_robot:world(Armed), Armed),
    {stands, Stands} = starl_robot:event(app, cast, long, starl_robot:world(Short), Short),
    ?assertEqual([{app, E} || E <- [a, b, c, d]], traced(Stands)).

%% Timers count from the beginning of the step, however long the robot stood still in it.
timers_count_from_the_beginning_of_their_step_test() ->
    Group = [{trace, a}, {{timeout, c}, 40, c}],
    App = fun
        (cast, go) -> [{{timeout, a}, 50, a}, {{timeout, b}, 10, b}, {until, 99, Group, m}];
        (_, _) -> []
    end,
    {quiet, R} = starl_robot:run(robot(#{app => App})),
    Armed = starl_robot:stand_still(app, 1, R),
    {stands, Stands} = starl_robot:event(app, cast, go, starl_robot:world(Armed), Armed),
    Later = starl_robot:world(at(30, Stands), Stands),
    {quiet, Done} = starl_robot:run(starl_robot:go_on(Later)),
    ?assertEqual([{a, 50}, {b, 0}, {c, 10}], maps:get(times, starl_robot:world(Done))).

%% A machine that restarts while it is called gets no call: the caller takes the news for its end. So it
%% is whether the call is under way already, or comes later in a step that stands still.
%% Holds: A call under way to a machine that restarts has an end; a machine that was lost before it
%% booted boots once
%% Red: 15b73fc, run
a_call_ends_with_the_restart_of_its_machine_test() ->
    App = fun
        (cast, go) ->
            [{call, sap, ask, t}, {trace, go}, {call, sap, ask, t}, {call, location, ask, t}];
        (info, News) ->
            [{trace, News}];
        (_, _) ->
            []
    end,
    Service = fun
        ({call, _}, ask) -> [{trace, asked}];
        (_, _) -> []
    end,
    {quiet, R} = starl_robot:run(robot(#{app => App, sap => Service, location => Service})),
    Armed = starl_robot:stand_still(app, 2, R),
    {stands, Stands} = starl_robot:event(app, cast, go, starl_robot:world(Armed), Armed),
    Restarted = restarted(sap, starl_robot:lost(sap, killed, Stands)),
    {quiet, Done} = starl_robot:run(starl_robot:go_on(Restarted)),
    ?assertEqual(
        [{app, go}, {sap, crashed}, {app, {restarted, sap}}, {location, asked}], traced(Done)
    ).

%% A machine that is lost before it has booted boots once, when it is back.
lost_before_it_has_booted_test() ->
    Boots = fun
        (boot, _) -> [{trace, booted}];
        (_, _) -> []
    end,
    Armed = starl_robot:stand_still(sap, 0, robot(#{sap => Boots, app => Boots})),
    {stands, Stands} = starl_robot:run(Armed),
    Lost = starl_robot:go_on(restarted(app, starl_robot:lost(app, killed, Stands))),
    {quiet, Done} = starl_robot:run(Lost),
    ?assertEqual([{app, crashed}, {sap, booted}, {app, booted}], traced(Done)).

%% A machine that is lost meanwhile leaves the rest of its step undone.
lost_while_it_stands_still_test() ->
    App = fun
        (cast, go) -> [{trace, a}, {trace, b}];
        (_, _) -> []
    end,
    {quiet, R} = starl_robot:run(robot(#{app => App})),
    Armed = starl_robot:stand_still(app, 1, R),
    {stands, Stands} = starl_robot:event(app, cast, go, starl_robot:world(Armed), Armed),
    Lost = starl_robot:go_on(restarted(app, starl_robot:lost(app, killed, Stands))),
    {quiet, Done} = starl_robot:run(Lost),
    ?assertEqual([{app, a}, {app, crashed}], traced(Done)),
    ?assertMatch({quiet, _}, starl_robot:run(starl_robot:go_on(starl_robot:go_down(Stands)))).

%% -- processes ------------------------------------------------------------------------------

%% A process is given one order at a time; while it is at work nothing else goes on, and what it does
%% bears the time at which its event began.
step_bears_the_time_of_its_beginning_test() ->
    [A, Sap] = pids(2),
    {ask, Sap, {starl_boot, #{name := sap, incarnation := 1}}, R0} =
        starl_robot:run(attached(#{sap => Sap, app => A})),
    ?assertEqual(sap, starl_robot:busy(R0)),
    {ask, A, {starl_boot, _}, R1} = starl_robot:answered(Sap, [], R0),
    {quiet, R2} = starl_robot:answered(A, [], R1),
    {ask, A, {starl_step, cast, x, #{now := 100}}, R3} =
        starl_robot:event(app, cast, x, at(100, R2), R2),
    {quiet, R4} = starl_robot:answered(A, [{trace, late}], R3),
    ?assertEqual([{100, app, late}], [T || {_, _, late} = T <- timed(R4)]).

%% The last word of a process that is dead, or is not at work, counts for nothing.
answer_of_another_process_test() ->
    [Old, New] = pids(2),
    {ask, Old, _, R0} = starl_robot:run(attached(#{app => Old})),
    Bare = starl_robot:lost(app, killed, R0),
    Gone = starl_robot:machines(starl_robot_machines:lose(app, starl_robot:machines(Bare)), Bare),
    {ok, Attached} = starl_robot:attach(app, New, Gone),
    Back = starl_robot:back([app], [], Attached),
    {ask, New, {starl_boot, #{incarnation := 2}}, R1} = starl_robot:run(Back),
    ?assertEqual(ignored, starl_robot:answered(Old, [{trace, ghost}], R1)),
    {quiet, R2} = starl_robot:answered(New, [{trace, alive}], R1),
    ?assertEqual(ignored, starl_robot:answered(New, [{trace, again}], R2)),
    ?assertEqual([{app, crashed}, {app, alive}], traced(R2)).

%% A successor that attaches before its predecessor's end is heard of has to wait.
early_successor_test() ->
    [Old, New] = pids(2),
    Robot = attached(#{app => Old}),
    ?assertEqual(early, starl_robot:attach(app, New, Robot)),
    Lost = starl_robot_machines:lose(app, starl_robot:machines(Robot)),
    ?assertMatch({ok, _}, starl_robot:attach(app, New, starl_robot:machines(Lost, Robot))).

%% -- crashes --------------------------------------------------------------------------------

%% A machine that crashes is told with its place in the code, its timers are forgotten, what was to be
%% done is not; when it comes back the others are told, before anything else.
crash_test() ->
    Machines = #{
        app => silent(),
        sap => fun
            (boot, _) -> [{{timeout, t}, 1, x}];
            (cast, boom) -> error(boom);
            (info, _) -> []
        end
    },
    {quiet, R} = starl_robot:run(robot(Machines)),
    {crashed, sap, Reason, Crashed} = starl_robot:event(sap, cast, boom, starl_robot:world(R), R),
    Lost = starl_robot:lost(sap, Reason, starl_robot:then([{app, cast, later}], Crashed)),
    ?assertEqual(stale, starl_robot:expire(sap, t, 1, Lost)),
    ?assertMatch([{sap, crashed}, {supervisor, {crashed, sap, {"boom", [_ | _]}}}], traced(Lost)),
    Back = restarted(sap, Lost),
    {quiet, Told} = starl_robot:run(Back),
    ?assertEqual(
        [{sap, boot}, {app, info}, {app, cast}], lists:nthtail(2, handled(Told))
    ),
    ?assertEqual(2, starl_robot_machines:incarnation(sap, starl_robot:machines(Told))).

%% An application that is given up: motion stops the robot, the others are told.
farewell_test() ->
    {quiet, R} = starl_robot:run(robot(#{app => silent(), motion => silent(), block => silent()})),
    Lost = starl_robot:lost(app, killed, R),
    Left = starl_robot:machines(starl_robot_machines:lose(app, starl_robot:machines(Lost)), Lost),
    {quiet, Told} = starl_robot:run(starl_robot:back([], [app], Left)),
    ?assertEqual(
        [{motion, cast}, {motion, info}, {block, info}], lists:nthtail(3, handled(Told))
    ),
    ?assertEqual([given_up], maps:get(ended, starl_robot:world(Told))).

%% Whatever the reason, a robot without its machines stands: its chassis is told.
stands_test() ->
    {quiet, R} = starl_robot:run(robot(#{app => silent()})),
    [
        ?assertEqual({true, Condition}, {
            maps:get(stopped, starl_robot:world(Gone)), starl_robot:condition(Gone)
        })
     || {Condition, Gone} <- [
            {dead, starl_robot:die(gave_up, R)},
            {dead, starl_robot:die(killed, R)},
            {down, starl_robot:go_down(R)}
        ]
    ].

restarted(Name, Robot) ->
    {ok, Machines} = starl_robot_machines:restart(Name, 1, starl_robot:machines(Robot)),
    starl_robot:back([Name], [], starl_robot:machines(Machines, Robot)).

%% -- the driver -----------------------------------------------------------------------------

world(_Machines) ->
    #{
        now => 0,
        handled => [],
        traced => [],
        planned => [],
        times => [],
        asked => [],
        ended => [],
        stored => #{},
        stopped => false
    }.

handles(Name, Type, _Content, #{handled := Handled} = W) -> W#{handled := [{Name, Type} | Handled]}.

clock(#{now := Now}) -> Now.

present(World) -> clock(World).

base(Name, Incarnation, #{now := Now, stored := Stored}) ->
    #{
        robot => 1,
        participants => [1],
        name => Name,
        incarnation => Incarnation,
        now => Now,
        random => rand:seed_s(exsss, 1),
        stored =>
            case Stored of
                damaged -> damaged;
                _ -> none
            end
    }.

trace(Name, Event, #{now := Now, traced := Traced} = W) ->
    W#{traced := [{Now, Name, Event} | Traced]}.

plan(Name, Timer, Us, Content, #{planned := Planned, times := Times} = W) ->
    Next = W#{planned := Planned ++ [{Name, Timer, Content}], times := Times ++ [{Timer, Us}]},
    {length(Planned) + 1, Next}.

store(_Name, _Term, #{full := true}) -> full;
store(Name, Term, #{stored := Stored} = W) -> {ok, W#{stored := Stored#{Name => Term}}}.

ended(How, #{ended := Ended} = W) -> W#{ended := [How | Ended]}.

perform({until, _, {trace, Event}, _}, Name, W) ->
    {[], trace(Name, Event, W)};
perform({sense, _, Tag} = Action, Name, #{asked := Asked} = W) ->
    {[{Name, info, {located, Tag, []}}], W#{asked := Asked ++ [Action]}};
perform(Action, _Name, #{asked := Asked} = W) ->
    {[], W#{asked := Asked ++ [Action]}}.

stop(W) -> W#{stopped := true}.

%% -- machines -------------------------------------------------------------------------------

init(#{act := Act}) -> {ready, Act, Act(boot, none)}.

handle_event(Type, Content, ready, Act, _Meta) -> {keep_state_and_data, Act(Type, Content)}.

silent() -> fun(_, _) -> [] end.

%% -- helpers --------------------------------------------------------------------------------

robot(Machines) -> robot(world(Machines), Machines).

robot(World, Machines) ->
    Inline = maps:map(fun(_, Act) -> {?MODULE, #{act => Act}} end, Machines),
    starl_robot:new(1, ?MODULE, World, starl_robot_machines:new(Inline)).

attached(Processes) ->
    Attach = fun(Name, Pid, Machines) ->
        {ok, Next} = starl_robot_machines:attach(Name, Pid, Machines),
        Next
    end,
    Machines = maps:fold(Attach, starl_robot_machines:new(#{}), Processes),
    starl_robot:new(1, ?MODULE, world(#{}), Machines).

%% Some processes that do nothing.
pids(N) -> [spawn(fun() -> ok end) || _ <- lists:seq(1, N)].

at(Now, Robot) -> (starl_robot:world(Robot))#{now := Now}.

handled(Robot) ->
    #{handled := Handled} = starl_robot:world(Robot),
    lists:reverse(Handled).

timed(Robot) ->
    #{traced := Traced} = starl_robot:world(Robot),
    lists:reverse(Traced).

traced(Robot) -> [{Name, Event} || {_, Name, Event} <- timed(Robot)].

planned(Robot) -> maps:get(planned, starl_robot:world(Robot)).

stored(Robot) -> maps:get(stored, starl_robot:world(Robot)).
