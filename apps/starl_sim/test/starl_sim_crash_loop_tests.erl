%% When it is hopeless to restart an application: only if nothing differs from crash to crash.
-module(starl_sim_crash_loop_tests).
-include_lib("eunit/include/eunit.hrl").

-define(CAUSE, {"oops", [{my_app, step, 2, "my_app.erl", 7}]}).

%% The same crash after the same number of steps, whatever the time between: the twentieth is one
%% too many.
same_crash_test() ->
    ?assertEqual([{20, hopeless}], hopeless([crash(I, #{}) || I <- lists:seq(1, 20)])),
    ?assertEqual([], hopeless([crash(I, #{}) || I <- lists:seq(1, 19)])).

%% The number of steps is not known of a machine: it is hopeless if no time passes.
no_time_passes_test() ->
    Unknown = #{steps => unknown},
    ?assertEqual([], hopeless([crash(I, Unknown) || I <- lists:seq(1, 100)])),
    ?assertMatch([{20, _} | _], hopeless([crash(5, Unknown) || _ <- lists:seq(1, 20)])).

%% A step that never lets time pass is tried three times only.
endless_step_is_tried_three_times_test() ->
    ?assertEqual(
        [{3, hopeless}], hopeless([crash(I, #{endless => true}) || I <- lists:seq(1, 3)])
    ).

%% Whatever differs begins a new row.
whatever_differs_begins_a_new_row_test_() ->
    [
        {atom_to_list(Key), ?_assertEqual([], hopeless(row(fun(I) -> #{Key => value(Key, I)} end)))}
     || Key <- [cause, steps, pose, stored]
    ].

%% One other crash among them is enough.
broken_row_test() ->
    Same = [crash(I, #{}) || I <- lists:seq(1, 19)],
    Other = crash(20, #{cause => {"other", []}}),
    ?assertEqual([], hopeless(Same ++ [Other | Same])).

%% A robot that is pushed by millimetres has not moved; one that creeps has, in the end.
pushed_by_millimetres_has_not_moved_test() ->
    Pushed = fun(I) -> #{pose => {1000.0 + I rem 2, 0.0, 0.0}} end,
    ?assertMatch([{20, hopeless} | _], hopeless(row(Pushed))),
    ?assertEqual([], hopeless(row(fun(I) -> #{pose => {10.0 * I, 0.0, 0.0}} end))).

row(With) -> [crash(I, With(I)) || I <- lists:seq(1, 100)].

value(cause, I) -> {integer_to_list(I rem 3), []};
value(steps, I) -> I rem 3;
value(pose, I) -> {500.0 * (I rem 3), 0.0, 0.0};
value(stored, I) -> {stored, I rem 3}.

crash(I, Given) ->
    maps:merge(
        #{
            cause => ?CAUSE,
            endless => false,
            steps => 3,
            at_us => 1000 * I,
            pose => {1000.0, 2000.0, 0.0},
            stored => none
        },
        Given
    ).

%% The numbers of the crashes that are hopeless.
hopeless(Crashes) ->
    {Told, _} = lists:mapfoldl(
        fun starl_sim_crash_loop:crashed/2, starl_sim_crash_loop:new(), Crashes
    ),
    [{I, T} || {I, T} <- lists:zip(lists:seq(1, length(Told)), Told), T =:= hopeless].
