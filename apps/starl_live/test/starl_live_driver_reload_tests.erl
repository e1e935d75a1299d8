%% New code for a live robot: what its machines are told of it, what they run then, and who learns what has
%% become of it.
-module(starl_live_driver_reload_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_driver_ct, [with_driver/2, sent/0, does/2]).

%% The module of its application and of one block.
-define(CODE, starl_live_driver_ct).
-define(ORDER, #{number => 1, versions => #{?CODE => new}, trial_us => 1000}).

%% Machines of this module get words; what they tell is a fact, and goes to who asked.
a_reload_is_told_to_who_asked_test() ->
    with_driver(#{}, fun(Driver, _) ->
        Switch = #{number => 1, module => new, trial_us => 1000},
        Words = [{app, {take, Switch}}, {mutex, {take, Switch}}],
        {Words, Asked} = starl_live_driver:reload(?ORDER, self(), Driver),
        Told = #{number => 1, outcome => taken, module => new, tell => nobody},
        {[], One} = starl_live_driver:perform({reloaded, Told}, app, Asked),
        {Restarts, _} = starl_live_driver:perform({reloaded, Told#{tell := others}}, app, Asked),
        ?assertEqual([{To, info, {restarted, app}} || To <- [mutex, sap]], Restarts),
        {[], _} = starl_live_driver:flush(One),
        ?assertEqual(
            [
                {starl_traced, 1, self(), {1, 0, [{0, 1, app, {reloaded, 1, taken}}]}},
                {starl_reloaded, 1, app, Told}
            ],
            sent()
        ),
        %% a machine that is gone takes none, and has none to give back
        {Take, Back} = {{take, Switch}, {back, 1, 2}},
        {[], _} = starl_live_driver:flush(starl_live_driver:gone(mutex, Take, Asked)),
        Done = #{number => 1, outcome => done, module => new, tell => nobody},
        ?assertMatch([{starl_traced, _, _, _}, {starl_reloaded, 1, mutex, Done}], sent()),
        ?assertEqual(Asked, starl_live_driver:gone(mutex, Back, Asked)),
        {BackWords, _} = starl_live_driver:take_back(1, 2, Asked),
        ?assertEqual([{app, Back}, {mutex, Back}], BackWords),
        ok
    end).

%% What a machine runs now is what it starts with, and that is logged. A word that it has heeded is not given to its
%% successor again.
what_a_machine_tells_of_a_reload_is_known_test() ->
    with_driver(#{}, fun(Driver, _) ->
        Switch = #{number => 1, module => lists, trial_us => 1000},
        {_, Asked} = starl_live_driver:reload(
            ?ORDER#{versions => #{?CODE => lists}}, self(), Driver
        ),
        Lineage = starl_lineage:take(Switch#{kept => none}, 0, starl_lineage:new(?CODE)),
        Told = starl_reload:told(1, taken, nobody, Lineage),
        Code = fun(B) ->
            #{code := Runs} = starl_live_driver:base(app, 1, B),
            starl_lineage:code(Runs)
        end,
        Self = self(),
        Reports = starl_live_log_ct:reports(fun() ->
            {[], Next} = starl_live_driver:perform({reloaded, Told}, app, Asked),
            Self ! {heeds, Next}
        end),
        Heeds =
            receive
                {heeds, Next} -> Next
            end,
        ?assertMatch(
            [
                {notice,
                    #{what := reload, outcome := <<"robot 1, app (lists): runs the new code">>}, _}
            ],
            Reports
        ),
        ?assertEqual([?CODE, lists], [Code(Asked), Code(Heeds)]),
        {[], _} = starl_live_driver:flush(starl_live_driver:handles(app, boot, x, Heeds)),
        ?assertEqual([taken], [How || {starl_reloaded, 1, app, #{outcome := How}} <- sent()]),
        ok
    end).

%% Nobody is told of what nobody asked for.
a_reload_that_nobody_asked_for_test() ->
    with_driver(#{sink => none}, fun(Driver, _) ->
        Told = #{number => 1, outcome => taken, module => new, tell => nobody},
        {[], [], _} = does([{reloaded, Told}], Driver),
        ok
    end).

%% A machine starts with the code that it has not taken yet, which is on trial then; if it crashes on trial, that is
%% told, and otherwise it is not.
a_crash_on_trial_is_told_test() ->
    with_driver(#{}, fun(Driver, _) ->
        {_, Asked} = starl_live_driver:reload(?ORDER, self(), Driver),
        ?assertNot(is_map_key(code, starl_live_driver:base(sap, 1, Asked))),
        ?assert(is_map_key(code, starl_live_driver:base(app, 1, Asked))),
        {[], Booted} = starl_live_driver:flush(starl_live_driver:handles(app, boot, x, Asked)),
        ?assertMatch(
            [{starl_traced, _, _, _}, {starl_reloaded, 1, app, #{outcome := taken}}], sent()
        ),
        Cause = starl_crash:cause({badarg, []}),
        Crashed = fun(Name, Why) ->
            {[], _} = starl_live_driver:flush(starl_live_driver:crashed(Name, Why, Booted)),
            [Outcome || {starl_reloaded, 1, app, #{outcome := Outcome}} <- sent()]
        end,
        ?assertEqual([{crashed, Cause}], Crashed(app, Cause)),
        %% it is taken once
        {[], _} = starl_live_driver:flush(starl_live_driver:handles(app, boot, x, Booted)),
        ?assertEqual([], [How || {starl_reloaded, _, _, #{outcome := How}} <- sent()]),
        %% unless it has failed elsewhere before
        {_, Back} = starl_live_driver:take_back(1, 2, Asked),
        {[], _} = starl_live_driver:flush(starl_live_driver:handles(app, boot, x, Back)),
        ?assertEqual([{back, 2}], [How || {starl_reloaded, _, _, #{outcome := How}} <- sent()]),
        ?assertEqual([], Crashed(sap, Cause)),
        ?assertEqual([], Crashed(app, none)),
        ok
    end).
