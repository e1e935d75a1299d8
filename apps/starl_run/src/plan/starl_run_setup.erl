%% @doc Sets up the run of a checked scenario: reads its floor, lets the application make its scene, places the
%% robots, checks and draws faults, and loads new code. {@link starl_run_plan} makes the plan of all that.
-module(starl_run_setup).

-export([make/3]).

%% @doc The scenario with its floor and its drawn faults, the scene, and the plan, or the first problem.
-spec make(module(), starl_run_scenario:t(), starl_run_plan:options()) ->
    {ok, starl_run:planned()} | {error, starl_run:reason()}.
make(App, Scenario, Options) ->
    #{robots := N, faults := Faults} = Scenario,
    Targets = [{element(1, Fault), R} || Fault <- Faults, R <- starl_run_fault:targets(Fault)],
    case [{Id, R} || {Id, R} <- Targets, R > N] of
        [{Id, Robot} | _] -> {error, {fault_target, Id, Robot}};
        [] -> set_scene(App, Scenario, Options)
    end.

set_scene(App, Scenario, Options) ->
    case starl_run_floor:read(Scenario) of
        {ok, Floor} -> set_scene(App, Floor, starl_run_floor:given(Floor, Scenario), Options);
        {error, Why} -> {error, {scene, Why}}
    end.

set_scene(App, Floor, Scenario, Options) ->
    Context = starl_run_plan:context(App, Floor, Scenario),
    case starl_scene:make(App, Context) of
        {ok, Scene} -> on_floor(Floor, Scenario, Scene, Context, Options);
        {error, Why} -> {error, {scene, Why}}
    end.

%% The scenario's floor plan, or else that of the application.
on_floor(none, Scenario, #{floor := #{size := Size} = Floor} = Scene, Context, Options) ->
    Placed = Context#{floor := Floor, world := Size},
    stand(starl_run_floor:given(Floor, Scenario), Scene, Placed, Options);
on_floor(none, Scenario, Scene, Context, Options) ->
    stand(Scenario, Scene, Context, Options);
on_floor(Floor, Scenario, Scene, Context, Options) ->
    stand(Scenario, Scene#{floor => Floor}, Context, Options).

stand(Scenario, Scene, Context, Options) ->
    case starl_run_floor:stand(Scenario, Scene, Context) of
        {ok, Standing} -> check_faults(Scenario, Standing, Context, Options);
        {error, Why} -> {error, {scene, Why}}
    end.

check_faults(#{faults := Faults} = Scenario, Scene, Context, Options) ->
    Known = [sap, location, motion, app | [N || {N, _, _} <- maps:get(blocks, Scene, [])]],
    Unknown = [
        {fault_machine, Id, N, Known}
     || {Id, _, _, kill_machine, {_, N}, _} <- Faults, not lists:member(N, Known)
    ],
    case Unknown ++ starl_run_floor:faults(Faults, Scene) of
        [] -> planned(with_random_faults(Known, Scene, Scenario), Scene, Context, Options);
        [Problem | _] -> {error, Problem}
    end.

%% Drawn faults stand in the scenario from now on as if the user had given them.
with_random_faults(_Known, _Scene, #{random_faults := []} = Scenario) ->
    Scenario;
with_random_faults(Known, Scene, Scenario) ->
    #{faults := Given, random_faults := What, heal := Heal} = Scenario,
    Drawn = starl_run_fault_draw:draw((longest(Scenario))#{
        seed => maps:get(seed, Scenario),
        robots => maps:get(robots, Scenario),
        machines => Known,
        floor => drawn_on(Scene),
        until_ms => max(1, round(1000 * Heal)),
        kinds => What
    }),
    Scenario#{faults := Given ++ Drawn, random_faults := []}.

drawn_on(#{floor := #{doors := Doors, size := Size}}) -> {length(Doors), Size};
drawn_on(_Scene) -> none.

longest(#{longest_fault := none}) -> #{};
longest(#{longest_fault := Seconds}) -> #{longest_ms => max(1, round(1000 * Seconds))}.

%% The new code of the scenario is loaded, here and on the nodes.
planned(Scenario, Scene, Context, Options) ->
    case starl_run_reloads:make(Scenario, starl_run_plan:parts(Scene)) of
        {ok, Reloads, Code} ->
            Own = {Reloads, Code ++ maps:get(code, Options, [])},
            {ok, {Scenario, Scene, starl_run_plan:make(Scenario, Scene, Context, Own, Options)}};
        {error, Why} ->
            {error, {new_code, Why}}
    end.
