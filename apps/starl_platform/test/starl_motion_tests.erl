%% The machine of motion, event by event: what it commands, asks and answers in each state.
-module(starl_motion_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1_000_000).
-define(FROM, {app, 1}).
-define(OTHER, {app, 2}).
-define(ROUTE, {{0.0, 0.0}, {3000.0, 0.0}}).
-define(ASKS(N), {call, location, {pose, 1}, N}).

%% A machine with its time, the number and the time of its last command, and the number of its last look.
-record(m, {
    machine :: term(),
    now = 0 :: integer(),
    command = 0 :: integer(),
    told = 0 :: integer(),
    asked = 0 :: integer()
}).

new() -> new(#{}, 1).

new(Config, Incarnation) ->
    Profile = starl_chassis:profile(starl_chassis_differential, #{}),
    {Actions, Machine} = starl_machine:new(
        starl_motion, maps:merge(#{profiles => [Profile]}, Config), #{
            robot => 1,
            participants => [1],
            name => motion,
            incarnation => Incarnation,
            random => rand:seed_s(exsss, 1),
            now => 0
        }
    ),
    {Actions, noted(Actions, #m{machine = Machine})}.

noted(Actions, M) -> lists:foldl(fun note/2, M, Actions).

note({drive, _, N}, #m{now = Now} = M) -> M#m{command = N, told = Now};
note({call, location, _, N}, M) -> M#m{asked = N};
note(_Action, M) -> M.

step(Type, Content, #m{machine = Machine, now = Now} = M) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => Now, robot => 1}, Machine),
    {Actions, noted(Actions, M#m{machine = Next})}.

later(Us, #m{now = Now} = M) -> M#m{now = Now + Us}.

%% The chassis answers; by its clock, which agrees with the robot's, it heard the command when it was given.
driven(#m{command = N, told = Told} = M) -> step(info, {driven, N, Told}, M).

seen(Pose, #m{asked = N} = M) -> step({reply, N}, {ok, Pose}, M).

calls(Call, M) -> step({call, ?FROM}, Call, M).

m({_Actions, M}) -> M.

%% Its actions without timers; its timers.
acts({Actions, _}) -> [A || A <- Actions, element(1, A) =/= state_timeout].

timers({Actions, _}) -> [{Us, What} || {state_timeout, Us, What} <- Actions].

traced({Actions, _}) -> [What || {trace, What} <- Actions].

replies({Actions, _}) -> [{From, Answer} || {reply, From, Answer} <- Actions].

drives({Actions, _}) -> [Script || {drive, {starl_chassis_differential, Script}, _} <- Actions].

%% At rest.
idle() -> m(driven(m(new()))).

%% On its first leg along the route, or to its end.
leg(Call) -> leg(Call, idle()).

leg({go_to, _} = Call, M) ->
    m(seen({0.0, 0.0, 0.0}, m(calls(Call, M))));
leg(Call, M) ->
    m(seen({0.0, 0.0, 0.0}, m(driven(m(calls(Call, M)))))).

%% -- rest --------------------------------------------------------------------------------------------

%% A robot that starts is told to stand, again until it has answered; its numbers are those of no life before.
it_stands_first_test() ->
    First = new(),
    Mark = (1 bsl 32) + 1,
    ?assertEqual([{drive, {starl_chassis_differential, []}, Mark}], acts(First)),
    ?assertEqual([{500_000, heard_nothing}], timers(First)),
    Again = step(state_timeout, heard_nothing, m(First)),
    ?assertMatch([{drive, {_, []}, N}] when N =:= Mark + 1, acts(Again)),
    ?assertEqual([], acts(driven(m(Again)))),
    %% an answer to a command before the last is none
    ?assertEqual([], acts(step(info, {driven, Mark, 0}, m(Again)))),
    ?assertMatch([?ASKS(1)], [A || {call, _, _, _} = A <- acts(calls({go_to, {9.0, 9.0}}, idle()))]),
    {Reborn, _} = new(#{}, 3),
    ?assertMatch([{trace, {velocity_over, restarted}}, {drive, _, _} | _], Reborn),
    ?assertMatch([{drive, _, N}] when N =:= (3 bsl 32) + 1, [D || {drive, _, _} = D <- Reborn]).

%% Callers of `stop' are answered when it stands, in their order; those of a drive, at once.
stop_is_answered_when_it_stands_test() ->
    Stops = step({call, ?OTHER}, stop, leg({go_to, {3000.0, 0.0}})),
    ?assertEqual([{?FROM, {error, stopped}}], replies(Stops)),
    ?assertEqual([{goal_over, command}], traced(Stops)),
    ?assertEqual([[]], drives(Stops)),
    Both = step({call, {app, 3}}, stop, m(Stops)),
    ?assertEqual([], replies(Both)),
    ?assertEqual([{?OTHER, ok}, {{app, 3}, ok}], replies(driven(m(Both)))),
    %% another drive answers them, too, when it stands
    Goes = calls({go_to, {9.0, 9.0}}, m(Both)),
    ?assertEqual([{?OTHER, ok}, {{app, 3}, ok}], replies(driven(m(Goes)))),
    %% ... once
    Drives = m(seen({3000.0, 0.0, math:pi()}, m(driven(m(Goes))))),
    ?assertEqual([], replies(driven(later(?S, Drives)))),
    %% a cast has no caller
    Cast = step(cast, stop, leg({go_to, {3000.0, 0.0}})),
    ?assertEqual([{?FROM, {error, stopped}}], replies(Cast)),
    ?assertEqual([], replies(driven(m(Cast)))).

%% -- a drive -----------------------------------------------------------------------------------------

%% Looks, drives, looks, and has arrived: each with its fact.
a_drive_test() ->
    Goes = calls({go_to, {200.0, 0.0}}, idle()),
    ?assertEqual([{goal, to, {200.0, 0.0}}], traced(Goes)),
    ?assertEqual([{500_000, ask}], timers(Goes)),
    Drives = seen({0.0, 0.0, 0.0}, m(Goes)),
    ?assertEqual([{line, {{0.0, 0.0}, {200.0, 0.0}}}], traced(Drives)),
    [[{500.0, 500.0, Us}]] = drives(Drives),
    ?assertEqual([{Us + 500_000, heard_nothing}], timers(Drives)),
    Stands = driven(later(Us, m(Drives))),
    ?assertMatch([?ASKS(_)], acts(Stands)),
    Arrived = seen({199.0, 0.0, 0.0}, m(Stands)),
    ?assertEqual([{?FROM, ok}], replies(Arrived)),
    ?assertEqual([{goal_over, arrived}], traced(Arrived)),
    %% one that comes after is not of this drive
    ?assertEqual([], replies(step(cast, stop, m(Arrived)))).

%% A turn, a look, and then the leg that was planned before.
a_turn_is_looked_at_test() ->
    Turns = seen({0.0, 0.0, 1.0}, m(calls({go_to, {3000.0, 0.0}}, idle()))),
    ?assertMatch([[{L, R, _}]] when L =:= -R, drives(Turns)),
    Looks = driven(later(?S, m(Turns))),
    [[{500.0, 500.0, Us}]] = drives(seen({0.0, 0.0, 0.0}, m(Looks))),
    ?assertEqual([[{500.0, 500.0, Us}]], drives(seen({2900.0, 0.0, 0.0}, m(Looks)))),
    %% another goal forgets it
    Other = calls({go_to, {-3000.0, 0.0}}, m(Looks)),
    ?assertMatch([[{L, R, _}]] when L =:= -R, drives(seen({0.0, 0.0, 0.0}, m(Other)))).

%% A pose without an answer is asked for again; along a line the robot is told to stand before it.
no_pose_test() ->
    To = step(state_timeout, ask, m(calls({go_to, {200.0, 0.0}}, idle()))),
    ?assertMatch([?ASKS(2)], acts(To)),
    Along = m(driven(m(calls({go_along, ?ROUTE}, idle())))),
    ?assertMatch([{drive, {_, []}, _}], acts(step(state_timeout, ask, Along))),
    %% an answer of an earlier look, and one that knows nothing, change nothing
    ?assertEqual([], acts(step({reply, 1}, {ok, {0.0, 0.0, 0.0}}, m(To)))),
    ?assertEqual([], acts(step({reply, 2}, {error, unknown}, m(To)))),
    ?assertMatch([?ASKS(3)], acts(step(info, {restarted, location}, m(To)))),
    ?assertEqual([], acts(step(info, {restarted, sap}, m(To)))),
    ?assertEqual([], acts(step(info, {restarted, location}, idle()))).

%% A robot that stands and was seen less than a tenth of a second ago is not looked for again.
a_recent_look_counts_test() ->
    Arrived = m(seen({0.0, 0.0, 0.0}, m(calls({go_to, {0.0, 0.0}}, later(?S, idle()))))),
    Goes = fun(Us) -> acts(calls({go_to, {200.0, 0.0}}, later(Us, Arrived))) end,
    ?assertMatch([_, _, {drive, {_, [_ | _]}, _}], Goes(99_999)),
    ?assertMatch([_, ?ASKS(_)], Goes(100_000)),
    ?assertMatch([_, ?ASKS(_)], Goes(-1)).

%% Along a given line, and to its beginning, the robot is told to stand before it looks.
along_a_line_test() ->
    Along = calls({go_along, ?ROUTE}, idle()),
    ?assertEqual([{goal, along, {3000.0, 0.0}}], traced(Along)),
    ?assertEqual([[]], drives(Along)),
    Drives = seen({10.0, 5.0, 0.0}, m(driven(m(Along)))),
    ?assertEqual([{line, ?ROUTE}], traced(Drives)),
    Faces = calls({face, ?ROUTE}, idle()),
    ?assertEqual([{goal, face, {0.0, 0.0}}], traced(Faces)),
    ?assertEqual([{?FROM, ok}], replies(seen({0.0, 0.0, 0.0}, m(driven(m(Faces)))))).

%% Its own clock was set back: a drive along a line ends, any other goes on, and who waits for it to stand learns of it.
a_wrong_clock_ends_what_rests_on_it_test() ->
    Wrong = fun(M) -> driven((later(?S, M))#m{now = -3_000_000}) end,
    Along = Wrong(leg({go_along, ?ROUTE})),
    ?assertEqual([{?FROM, {error, out_of_time}}], replies(Along)),
    ?assertEqual([{goal_over, out_of_time}], traced(Along)),
    ?assertMatch([?ASKS(_)], acts(Wrong(leg({go_to, {3000.0, 0.0}})))),
    Stops = m(step({call, ?OTHER}, stop, leg({go_along, ?ROUTE}))),
    ?assertEqual([{?OTHER, {error, out_of_time}}], replies(Wrong(Stops))).

%% -- a drive that does not obey ----------------------------------------------------------------------

%% Half a second later it tries the reverse, slowly; when that has obeyed it looks and goes on.
a_stalled_drive_is_tried_test() ->
    #m{command = N} = Drives = leg({go_to, {3000.0, 0.0}}),
    Stalled = step(info, {stalled, N, {500.0, 500.0}}, Drives),
    ?assertEqual({[], [{500_000, try_again}]}, {acts(Stalled), timers(Stalled)}),
    Tries = step(state_timeout, try_again, m(Stalled)),
    ?assertEqual([[{-100.0, -100.0, 20_000}]], drives(Tries)),
    Looks = driven(later(20_000, m(Tries))),
    ?assertMatch([?ASKS(_)], acts(Looks)),
    ?assertMatch([[{500.0, 500.0, _}]], drives(seen({0.0, 0.0, 0.0}, m(Looks)))),
    %% a try that does not obey either is tried in reverse
    #m{command = M} = m(Tries),
    Again = m(step(info, {stalled, M, {-100.0, -100.0}}, m(Tries))),
    ?assertEqual([[{100.0, 100.0, 20_000}]], drives(step(state_timeout, try_again, Again))),
    %% of a command before the last it is late, and nonsense is unknown
    ?assertEqual([], acts(step(info, {stalled, N, {500.0, 500.0}}, m(Tries)))),
    ?assertMatch([{unknown_event, _, _}], traced(step(info, {stalled, N, nonsense}, m(Tries)))),
    %% a drive that was to stand, and does not, is told again
    #m{command = K} = Halts = leg({go_to, {3000.0, 0.0}}),
    ?assertEqual([[]], drives(step(info, {stalled, K, {0.0, 0.0}}, Halts))).

%% Meanwhile it keeps to its try: another goal waits, a velocity is refused.
meanwhile_others_wait_test() ->
    #m{command = N} = Drives = leg({go_to, {3000.0, 0.0}}),
    Stalled = m(step(info, {stalled, N, {500.0, 500.0}}, Drives)),
    Goes = step({call, ?OTHER}, {go_to, {9.0, 9.0}}, Stalled),
    ?assertEqual([{?FROM, {error, stopped}}], replies(Goes)),
    ?assertEqual([], drives(Goes)),
    Velocity = fun(M) -> replies(step({call, ?OTHER}, {velocity, {1.0, 0.0}, ?S}, M)) end,
    ?assertEqual([{?OTHER, {error, stalled}}], Velocity(Stalled)),
    ?assertEqual(
        [{?OTHER, {error, stalled}}], Velocity(m(step(state_timeout, try_again, Stalled)))
    ).

%% An answer that is lost may have been that the drive does not obey: the robot stands, looks, and tries.
no_answer_test() ->
    Stands = step(state_timeout, heard_nothing, later(?S, leg({go_to, {3000.0, 0.0}}))),
    ?assertEqual([[]], drives(Stands)),
    Looks = driven(m(Stands)),
    ?assertMatch([?ASKS(_)], acts(Looks)),
    ?assertEqual([[{-100.0, -100.0, 20_000}]], drives(seen({0.0, 0.0, 0.0}, m(Looks)))).

%% Where there may be walls, three times in a row are enough: along a line the way is blocked. A leg that was driven
%% begins the count anew.
blocked_test() ->
    Solid = m(driven(m(new(#{solid => true}, 1)))),
    Stall = fun(M) ->
        #m{command = N} = M,
        Tries = m(step(state_timeout, try_again, m(step(info, {stalled, N, {500.0, 500.0}}, M)))),
        driven(later(20_000, Tries))
    end,
    On = fun(Looks) -> m(seen({0.0, 0.0, 0.0}, m(Looks))) end,
    Twice = Stall(On(Stall(leg({go_along, ?ROUTE}, Solid)))),
    ?assertMatch([?ASKS(_)], acts(Twice)),
    Thrice = Stall(On(Twice)),
    ?assertEqual([{?FROM, {error, blocked}}], replies(Thrice)),
    ?assertEqual([{goal_over, blocked}], traced(Thrice)),
    %% nobody waits for one that was told to stop
    #m{command = Last} = Third = On(Twice),
    Stops = step(cast, stop, m(step(info, {stalled, Last, {500.0, 500.0}}, Third))),
    ?assertEqual({[], []}, {replies(driven(m(Stops))), traced(driven(m(Stops)))}),
    Between = driven(later(?S, On(Twice))),
    ?assertMatch([?ASKS(_)], acts(Stall(On(Between)))),
    To = Stall(On(Stall(On(Stall(leg({go_to, {3000.0, 0.0}}, Solid)))))),
    ?assertMatch([?ASKS(_)], acts(To)),
    Open = Stall(On(Stall(On(Stall(leg({go_along, ?ROUTE})))))),
    ?assertMatch([?ASKS(_)], acts(Open)).

%% A try may lead anywhere: it needs room up to the tracking radius, where a try of 2 mm and the error of
%% the position are allowed for. Without that the robot looks first.
a_try_stays_on_the_line_test() ->
    Solid = m(driven(m(new(#{solid => true}, 1)))),
    Profile = starl_chassis:profile(starl_chassis_differential, #{}),
    #{position_error_mm := Error} = Profile,
    Room = starl_chassis:tracking_radius(Profile) - 2.0 - Error,
    Tries = fun(Aside) ->
        M = m(seen({100.0, Aside, 0.0}, m(driven(m(calls({go_along, ?ROUTE}, Solid)))))),
        #m{command = N} = M,
        acts(step(state_timeout, try_again, m(step(info, {stalled, N, {500.0, 500.0}}, M))))
    end,
    ?assertMatch([{drive, {_, [{-100.0, -100.0, 20_000}]}, _}], Tries(Room - 0.01)),
    ?assertMatch([?ASKS(_)], Tries(Room + 0.01)).

%% -- a velocity --------------------------------------------------------------------------------------

%% It looks, and drives for what is left of the time; at the end it says so.
a_velocity_test() ->
    Looks = calls({velocity, {300.0, 0.0}, ?S}, idle()),
    ?assertEqual({[?ASKS(1)], [{500_000, ask}]}, {acts(Looks), timers(Looks)}),
    Drives = seen({0.0, 0.0, 0.0}, later(200_000, m(Looks))),
    ?assertEqual([{velocity, {300.0, 0.0}, 800_000}], traced(Drives)),
    ?assertEqual([{?FROM, ok}], replies(Drives)),
    ?assertEqual([[{300.0, 300.0, 800_000}]], drives(Drives)),
    ?assertEqual([{1_300_000, heard_nothing}], timers(Drives)),
    ?assertEqual([{velocity_over, time}], traced(driven(later(800_000, m(Drives))))),
    Late = seen({0.0, 0.0, 0.0}, later(2 * ?S, m(Looks))),
    ?assertEqual([[{300.0, 300.0, 1}]], drives(Late)).

%% Another one keeps it driving; who waited for it to stand is told.
another_velocity_test() ->
    Drives = m(seen({0.0, 0.0, 0.0}, m(calls({velocity, {300.0, 0.0}, ?S}, idle())))),
    Again = step({call, ?OTHER}, {velocity, {100.0, 0.0}, ?S}, Drives),
    ?assertEqual({[], [?ASKS(2)]}, {drives(Again), acts(Again)}),
    Slower = seen({0.0, 0.0, 0.0}, m(Again)),
    ?assertEqual([{?OTHER, ok}], replies(Slower)),
    ?assertEqual([], [Why || {velocity_over, Why} <- traced(Slower)]),
    Stops = m(step({call, {app, 3}}, stop, m(Slower))),
    Stopped = step({call, ?FROM}, {velocity, {1.0, 0.0}, ?S}, Stops),
    ?assertEqual([{{app, 3}, {error, stopped}}], replies(Stopped)),
    %% the time of the first ends while it looks for the second: it stands, and goes on from there
    Over = driven(later(?S, m(Again))),
    ?assertEqual([{velocity_over, time}], traced(Over)),
    ?assertEqual([], traced(step(info, {driven, (m(Over))#m.command, 0}, m(Over)))),
    ?assertEqual([{?OTHER, ok}], replies(seen({0.0, 0.0, 0.0}, m(Over)))).

%% A velocity ends a drive to a goal, once: what ends the velocity ends no goal.
a_velocity_has_no_goal_test() ->
    Steers = calls({velocity, {300.0, 0.0}, ?S}, leg({go_to, {3000.0, 0.0}})),
    ?assertEqual([{goal_over, command}], traced(Steers)),
    Again = step({call, ?OTHER}, {velocity, {100.0, 0.0}, ?S}, m(Steers)),
    ?assertEqual({[{?FROM, {error, stopped}}], []}, {replies(Again), traced(Again)}),
    ?assertEqual([], traced(step(cast, stop, m(Steers)))).

%% Without a pose it stops.
blind_test() ->
    First = m(calls({velocity, {300.0, 0.0}, ?S}, idle())),
    Unknown = step({reply, 1}, {error, unknown}, First),
    ?assertEqual([{?FROM, {error, unknown}}], replies(Unknown)),
    ?assertEqual({[[]], []}, {drives(Unknown), traced(Unknown)}),
    %% and rests as soon as it stands: the velocity has its answer
    ?assertEqual([], acts(step(info, {driven, (m(Unknown))#m.command, 0}, m(Unknown)))),
    Stalled = step(info, {stalled, First#m.command, {0.0, 0.0}}, First),
    ?assertEqual({[[]], []}, {drives(Stalled), traced(Stalled)}),
    ?assertEqual([{?FROM, {error, unknown}}], replies(step(state_timeout, ask, First))),
    Drives = m(seen({0.0, 0.0, 0.0}, First)),
    Again = m(step({call, ?OTHER}, {velocity, {100.0, 0.0}, ?S}, Drives)),
    ?assertEqual([{velocity_over, unknown}], traced(step({reply, 2}, {error, unknown}, Again))),
    ?assertMatch([?ASKS(3)], acts(step(info, {restarted, location}, Again))).

%% What ends it otherwise: another command, a drive that does not obey, no answer.
a_velocity_ends_test() ->
    #m{command = N} =
        Drives = m(seen({0.0, 0.0, 0.0}, m(calls({velocity, {300.0, 0.0}, ?S}, idle())))),
    Over = fun(Step) -> [Why || {velocity_over, Why} <- traced(Step)] end,
    Stopped = step(cast, stop, Drives),
    ?assertEqual([command], Over(Stopped)),
    ?assertEqual([], Over(step(cast, stop, m(Stopped)))),
    Goes = calls({go_to, {9.0, 9.0}}, Drives),
    ?assertEqual({[command], [[]]}, {Over(Goes), drives(Goes)}),
    Stalled = step(info, {stalled, N, {300.0, 300.0}}, Drives),
    ?assertEqual({[stalled], [{500_000, try_again}]}, {Over(Stalled), timers(Stalled)}),
    Silent = step(state_timeout, heard_nothing, Drives),
    ?assertEqual({[no_answer], [[]]}, {Over(Silent), drives(Silent)}),
    %% then it stands and has to try: a velocity begins the try, and is refused
    Idle = m(driven(m(Silent))),
    Refused = calls({velocity, {1.0, 0.0}, ?S}, Idle),
    ?assertEqual([{?FROM, {error, stalled}}], replies(Refused)),
    ?assertEqual([[{-100.0, -100.0, 20_000}]], drives(Refused)),
    %% one that waits for its look is told
    Asks = m(step({call, ?OTHER}, {velocity, {100.0, 0.0}, ?S}, Drives)),
    ?assertEqual(
        [{?OTHER, {error, stalled}}], replies(step(info, {stalled, N, {300.0, 300.0}}, Asks))
    ).

%% What it has no word for changes nothing.
unknown_test() ->
    M = idle(),
    [
        ?assertMatch([{unknown_event, _, _}], traced(step(Type, Content, M)))
     || {Type, Content} <- [
            {cast, hello},
            {info, hello},
            {{call, ?FROM}, hello},
            {state_timeout, hello},
            {info, {driven, 1, never}}
        ]
    ],
    ?assertEqual({cast, motion, stop}, starl_motion:stop()).
