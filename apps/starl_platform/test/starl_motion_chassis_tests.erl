%% Motion up against something, on a chassis that is none of those that ship: it waits a moment before each leg, and only
%% waits where it stands behind its line; its tries are three times as long. Otherwise it is one with two wheels.
%%
%% Holds: A robot up against something backs off only where a try of its own chassis keeps it on
%% its line, and a step may begin with a wait
%% Red: d7c73771, run: it backs off by 6 mm where 5.5 mm are left; the machine crashes
-module(starl_motion_chassis_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_chassis).
-export([simulation/0, profile/1, check/1, duration_us/2, next/4, resume/3, last/1, undo/1]).
-export([try_mm/1, tracking_radius/1, ends_mm/1, cruise/4, rests_s/1, pace/1]).

-define(OTHER, starl_chassis_differential).
-define(ROUTE, {{0.0, 0.0}, {1000.0, 0.0}}).
-define(WAITS, {0.0, 0.0, 10000}).

simulation() -> ?OTHER:simulation().
profile(Overrides) -> ?OTHER:profile(Overrides).
check(Commands) -> ?OTHER:check(Commands).
duration_us(Commands, Profile) -> ?OTHER:duration_us(Commands, Profile).
next(_Way, {X, _, _}, _Line, _Profile) when X < 0 -> {drive, [?WAITS]};
next(Way, Pose, Line, Profile) -> waits(?OTHER:next(Way, Pose, Line, Profile)).
resume(Pose, Memo, Profile) -> waits(?OTHER:resume(Pose, Memo, Profile)).
last(Commands) -> ?OTHER:last(Commands).
undo(Told) -> longer(?OTHER:undo(Told)).
try_mm(Profile) -> 3 * ?OTHER:try_mm(Profile).
tracking_radius(Profile) -> ?OTHER:tracking_radius(Profile).
ends_mm(Profile) -> ?OTHER:ends_mm(Profile).
cruise(Velocity, Pose, Us, Profile) -> ?OTHER:cruise(Velocity, Pose, Us, Profile).
rests_s(Profile) -> ?OTHER:rests_s(Profile).
pace(Profile) -> ?OTHER:pace(Profile).

waits({How, Commands}) -> {How, [?WAITS | Commands]};
waits(arrived) -> arrived.

longer({ok, Commands}) -> {ok, [{Left, Right, 3 * Us} || {Left, Right, Us} <- Commands]};
longer(Other) -> Other.

%% It backs off where that keeps it on its line; nearer to the edge it looks, and tries on.
a_try_is_as_long_as_that_of_the_chassis_test() ->
    Radius = tracking_radius(own()),
    ?assertMatch([{drive, {?MODULE, [{_, _, 60000}]}, _} | _], tried(Radius - 7.5)),
    ?assertMatch([{call, location, {pose, 1}, _} | _], tried(Radius - 6.5)).

%% The first command that moves it is tried, not the moment in which it waits.
a_step_may_begin_with_a_wait_test() ->
    Y = tracking_radius(own()) - 1.0,
    {[{call, location, {pose, 1}, Tag} | _], Machine} = stalled(Y),
    {Tries, _} = step({reply, Tag}, {ok, {0.0, Y, 0.0}}, Machine),
    ?assertMatch(
        [{drive, {?MODULE, [{Left, Right, 60000}]}, _} | _] when Left =/= 0.0; Right =/= 0.0, Tries
    ).

%% What does not move it is no try: it does that, and its next step will tell.
a_step_that_stands_is_no_try_test() ->
    Y = tracking_radius(own()) - 1.0,
    {[{call, location, _, Tag} | _], Machine} = stalled(Y),
    {[{drive, Waits, _}], Driving} = step({reply, Tag}, {ok, {-1.0, Y, 0.0}}, Machine),
    ?assertEqual({{?MODULE, [?WAITS]}, driving}, {Waits, starl_machine:state(Driving)}).

own() -> starl_chassis:profile(?MODULE, #{position_error_mm => 1.0}).

%% What a robot does that came up against something so far beside its line.
tried(Y) -> element(1, stalled(Y)).

stalled(Y) ->
    {[{drive, {?MODULE, []}, First} | _], A} = starl_machine:new(
        starl_motion,
        #{profiles => [own()], solid => true},
        #{
            robot => 1,
            participants => [1],
            name => motion,
            incarnation => 1,
            random => rand:seed_s(exsss, 1),
            now => 0
        }
    ),
    {_, B} = step(info, {driven, First, 0}, A),
    {Stops, C} = step({call, {app, 1}}, {go_along, ?ROUTE}, B),
    [Second] = [Mark || {drive, {_, []}, Mark} <- Stops],
    {Looks, D} = step(info, {driven, Second, 0}, C),
    [Tag] = [N || {call, location, {pose, 1}, N} <- Looks],
    {Drives, E} = step({reply, Tag}, {ok, {0.0, Y, 0.0}}, D),
    [{Third, [?WAITS, {Left, Right, _} | _]}] = [
        {Mark, Script}
     || {drive, {_, Script}, Mark} <- Drives
    ],
    {_, F} = step(info, {stalled, Third, {Left, Right}}, E),
    step(state_timeout, try_again, F).

%% Its actions, but for timers.
step(Type, Content, Machine) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine),
    {[Action || Action <- Actions, element(1, Action) =/= state_timeout], Next}.
