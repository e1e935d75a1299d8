%% What a chassis' process takes from its link. This module is a driver that tells the test.
-module(starl_live_chassis_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, rest/1, condition/1, feel/2]).
%% Handles a chassis' reports.
-export([log/2]).

open(#{test := Test}) -> {ok, Test}.
drive(Script, _Until, Mark, Test) ->
    Test ! {drives, Script},
    {[{Mark, {driven, 7}}], Test}.
actuate(Device, Value, Mark, Test) -> {[{Mark, {actuated, Device, Value}}], Test}.
stop(Test) ->
    Test ! stops,
    Test.
hear({feels, Sense}, Test) -> {[{sensed, Sense}], Test};
hear(_Message, _Test) -> unknown.
rest(Test) ->
    Test ! rests,
    Test.
condition(_Test) -> #{charge => 83}.
feel(bump, _Test) -> {ok, left}.
close(Test) ->
    Test ! closed,
    ok.

-define(SCRIPT, {some_chassis, [{go, 1}]}).

%% A script that comes in time is driven and answered; one that comes late is not; to stop never is.
late_test() ->
    logger:set_primary_config(level, none),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Config = #{robot => 1, clock => Clock, profile => #{}, test => self()},
    {ok, Chassis} = starl_live_chassis:start_link(?MODULE, Config, self()),
    Never = -1,
    InTime = starl_live_clock:now_us(Clock) + 3_600_000_000,
    ok = starl_live_chassis:drive(Chassis, ?SCRIPT, Never, late),
    ok = starl_live_chassis:drive(Chassis, {some_chassis, []}, Never, rest),
    ok = starl_live_chassis:drive(Chassis, ?SCRIPT, InTime, now),
    ?assertEqual([rest, now], [heard(Chassis), heard(Chassis)]),
    ?assertEqual([{some_chassis, []}, ?SCRIPT], [driven(), driven()]),
    true = unlink(Chassis),
    ok = gen_server:stop(Chassis),
    logger:set_primary_config(level, notice),
    ?assertEqual([stops, closed], [flushed(), flushed()]).

%% Its log bears its robot, and the script that was late its moment.
a_late_script_is_logged_test() ->
    Reports = starl_live_log_ct:reports(fun() ->
        Chassis = started(?MODULE, #{}),
        ok = starl_live_chassis:drive(Chassis, ?SCRIPT, -1, late),
        stop_of(Chassis)
    end),
    ?assertMatch(
        [
            {warning, #{what := late_command, until_us := -1}, #{
                domain := [starl, robot], robot := 1
            }}
        ],
        Reports
    ).

%% What the body feels goes to the link; how it is, to who asks; that there is nothing more to do, to it.
sense_test() ->
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Config = #{robot => 1, clock => Clock, profile => #{}, test => self()},
    {ok, Chassis} = starl_live_chassis:start_link(?MODULE, Config, self()),
    Chassis ! {feels, {bump, left}},
    ok = starl_live_chassis:rest(Chassis),
    ?assertEqual(#{charge => 83}, starl_live_chassis:condition(Chassis)),
    ?assertEqual(
        [{starl_chassis, Chassis, sensed, {bump, left}}, rests], [flushed(), flushed()]
    ),
    true = unlink(Chassis),
    ok = gen_server:stop(Chassis),
    ?assertEqual([stops, closed], [flushed(), flushed()]).

%% An actuator is set and answered; a sense is asked, and the link gets the answer with its mark.
asked_test() ->
    Chassis = started(?MODULE, #{}),
    ok = starl_live_chassis:actuate(Chassis, pen, down, 3),
    ok = starl_live_chassis:feel(Chassis, bump, 4),
    ?assertEqual(
        [{starl_chassis, Chassis, 3, {actuated, pen, down}}, {starl_felt, Chassis, 4, {ok, left}}],
        [next(Chassis), next(Chassis)]
    ),
    stop_of(Chassis).

%% A driver need not feel, rest, nor tell how it is.
bare_driver_test() ->
    Chassis = started(starl_live_bare_chassis, #{}),
    ok = starl_live_chassis:feel(Chassis, bump, 4),
    ok = starl_live_chassis:rest(Chassis),
    ?assertEqual(#{}, starl_live_chassis:condition(Chassis)),
    ?assertEqual({starl_felt, Chassis, 4, unknown}, next(Chassis)),
    ?assertEqual(ok, gen_server:call(Chassis, of_another_version)),
    true = unlink(Chassis),
    ok = gen_server:stop(Chassis).

%% It ends with its link, at rest and closed; another process that ends is the driver's business.
it_ends_with_its_link_test() ->
    process_flag(trap_exit, true),
    Link = spawn(fun() ->
        receive
            ends -> ok
        end
    end),
    Config = config(#{}),
    {ok, Chassis} = starl_live_chassis:start_link(?MODULE, Config, Link),
    Chassis ! {'EXIT', self_of_nobody(), gone},
    ?assertEqual(#{charge => 83}, starl_live_chassis:condition(Chassis)),
    Chassis ! {'EXIT', Link, shutdown},
    receive
        {'EXIT', Chassis, Why} -> ?assertEqual(shutdown, Why)
    end,
    process_flag(trap_exit, false),
    ?assertEqual([stops, closed], [flushed(), flushed()]).

self_of_nobody() -> spawn(fun() -> ok end).

%% What is wrong is a text: when it opens, and later in one line of the log.
%% In a process of its own: the exit of who could not start is no matter of other tests.
a_driver_that_fails_says_why_test_() -> {spawn, fun a_driver_that_fails_says_why/0}.

a_driver_that_fails_says_why() ->
    process_flag(trap_exit, true),
    ?assertEqual(
        {error, {shutdown, {chassis, <<"no such line">>}}},
        starl_live_chassis:start_link(
            starl_live_bare_chassis, config(#{fails => ["no such ", "line"]}), self()
        )
    ),
    %% modules of tests share a process: what one leaves another one hears
    receive
        {'EXIT', _, {shutdown, {chassis, <<"no such line">>}}} -> ok
    end,
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, error),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => #{test => self()}}),
    Chassis = started(starl_live_bare_chassis, #{}),
    Chassis ! breaks,
    receive
        {'EXIT', Chassis, Why} -> ?assertEqual({shutdown, {chassis, <<"broken">>}}, Why)
    end,
    ok = logger:remove_handler(?MODULE),
    ok = logger:set_primary_config(level, Level),
    process_flag(trap_exit, false),
    receive
        {logged, Line} -> ?assertEqual(<<"broken; the robot starts anew">>, Line)
    end.

log(#{msg := {report, #{what := chassis_failed} = Report}, meta := #{report_cb := Words}}, Handler) ->
    #{config := #{test := Test}} = Handler,
    {Format, Terms} = Words(Report),
    Test ! {logged, unicode:characters_to_binary(io_lib:format(Format, Terms))};
log(_Event, _Handler) ->
    ok.

%% To begin at the last moment is in time.
is_late_test() ->
    ?assertNot(starl_live_chassis:is_late(?SCRIPT, 5, 5)),
    ?assert(starl_live_chassis:is_late(?SCRIPT, 5, 6)),
    ?assertNot(starl_live_chassis:is_late({some_chassis, []}, 5, 6)).

started(Module, Given) ->
    {ok, Chassis} = starl_live_chassis:start_link(Module, config(Given), self()),
    Chassis.

config(Given) ->
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Given#{robot => 1, clock => Clock, profile => #{}, test => self()}.

stop_of(Chassis) ->
    true = unlink(Chassis),
    ok = gen_server:stop(Chassis),
    ?assertEqual([stops, closed], [flushed(), flushed()]).

next(Chassis) ->
    receive
        Message when element(2, Message) =:= Chassis -> Message
    end.

heard(Chassis) ->
    receive
        {starl_chassis, Chassis, Mark, {driven, 7}} -> Mark
    end.

driven() ->
    receive
        {drives, Script} -> Script
    end.

%% Of what others have sent to this process nothing.
flushed() ->
    receive
        What when What =:= stops; What =:= rests; What =:= closed -> What;
        {starl_chassis, _, sensed, _} = What -> What
    end.
