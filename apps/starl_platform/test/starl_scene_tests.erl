%% What is told of a scene that an application has made.
-module(starl_scene_tests).
-include_lib("eunit/include/eunit.hrl").

%% A sequential application, a machine and a monitor.
-export([init/2, step/2, init/1, handle_event/5, finish/2]).

init(_, _) -> s.
init(_) -> s.
step(_, _) -> s.
handle_event(_, _, _, _, _) -> s.
finish(_, _) -> s.

told(Scene) ->
    case starl_scene:check(Scene) of
        ok -> ok;
        {error, Line} -> unicode:characters_to_list(Line)
    end.

-define(APP, {sequential, ?MODULE, []}).

with(Key, Value) -> told(#{app => ?APP, Key => Value}).

sound_test_() ->
    [
        {lists:concat([Key]), ?_assertEqual(ok, with(Key, Value))}
     || {Key, Value} <- [
            {app, ?APP},
            {app, {machine, ?MODULE, #{}}},
            {waypoints, #{}},
            {waypoints, #{a => {0, 1.5}}},
            {poses, #{1 => {0, 1.5, 0}}},
            {monitors, []},
            {monitors, [{?MODULE, #{}}]},
            {profile, #{chassis => holonomic, latency_ms => 1}},
            {sap, #{limit => 3}},
            {never_crashes, false},
            {memo, anything},
            {blocks, anything}
        ]
    ].

%% Another SAP has its own configuration.
another_sap_test() ->
    ?assertEqual(ok, told(#{app => ?APP, sap => #{own => 1}, sap_machine => my_sap})).

-define(POINTS, "waypoints: #{Name => {X, Y}} expected, not ").
-define(POSES, "poses: #{Robot => {X, Y, Heading}} expected, not ").
-define(MONITORS, "monitors: a list of {Module, #{...}} expected, not ").

wrong_test_() ->
    [
        {Text, ?_assertEqual(Text, with(Key, Value))}
     || {Text, Key, Value} <- [
            {"app: {sequential, Module, Args} or {machine, Module, Config} expected, not my_app",
                app, my_app},
            {"app: there is no module no_such_app", app, {sequential, no_such_app, []}},
            {"app: lists does not export init/2", app, {sequential, lists, []}},
            {"app: lists does not export init/1", app, {machine, lists, #{}}},
            {?POINTS "[]", waypoints, []},
            {?POINTS "#{1 => {0,0}}", waypoints, #{1 => {0, 0}}},
            {?POINTS "#{a => {0,y}}", waypoints, #{a => {0, y}}},
            {?POSES "#{0 => {0,0,0}}", poses, #{0 => {0, 0, 0}}},
            {?POSES "#{1 => {0,0}}", poses, #{1 => {0, 0}}},
            {?POSES "#{1 => {0,0,east}}", poses, #{1 => {0, 0, east}}},
            {?MONITORS "none", monitors, none},
            {?MONITORS "[lists]", monitors, [lists]},
            {"the profile has no key chasis (did you mean chassis?)", profile, #{chasis => x}},
            {"sap has no key limits (did you mean limit?)", sap, #{limits => 1}},
            {"never_crashes: true or false expected, not 1", never_crashes, 1},
            {"sap_machine: a module expected, not 1", sap_machine, 1},
            {"motion_machine: a module expected, not 1", motion_machine, 1},
            {"the scene has no key poss (did you mean poses?)", poss, #{}}
        ]
    ].

no_scene_test() ->
    ?assertEqual(
        "the scene lacks the key app, as in app => {sequential, my_app, Args}",
        told(#{poses => #{}})
    ),
    ?assertEqual("{ok, #{app => ...}} or {error, \"Why\"} expected, not {ok,scene}", told(scene)).

%% Without a near key all are listed.
far_key_test() ->
    "the scene has no key zzz (keys: app, blocks, " ++ _ = with(zzz, 1).
