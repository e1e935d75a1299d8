%% @doc The contracts of a run: its monitors, their knowledge besides the events, and the time by
%% which the run must have converged.
-module(starl_run_contracts).

-export([monitors/5, models/2, limit_us/1]).

%% What contracts take for the loss of a radio among walls or in shadows.
-define(SOME_LOSS, 0.5).

%% @doc The monitors of a run. They get the windows of broken assumptions, the time at which all faults are over,
%% the longest delay of a packet then, and the time by which this computer may prolong anything. The contract
%% of progress comes last: other contracts describe a failure better.
-spec monitors(
    starl_run_scenario:t(),
    starl_scene:t(),
    starl_chassis:profiles(),
    starl_scene:context(),
    starl_run_plan:options()
) -> [{module(), map()}].
monitors(Scenario, Scene, Profiles, #{sap := Sap0, robots := Ids}, Options) ->
    Sap = maps:merge(Sap0, maps:get(sap, Scene, #{})),
    Known = (known(Scenario, Ids, is_exact(Profiles)))#{
        slack_us => maps:get(slack_us, Options, 0), sap => Sap
    },
    %% one per cent more for the drift of the sender's clock
    Bound = starl_sap_schedule:bound_us(Sap) * 101 div 100 + 1000000,
    Own = [
        {starl_sap_monitor, #{
            bound_us => Bound, steps => starl_sap_schedule:tries(Sap) + 1, robots => Ids
        }},
        {starl_crash_monitor, #{excused => excused(Scene)}},
        {starl_motion_monitor, #{profiles => Profiles}}
    ],
    Contracts =
        Own ++ contact(Scenario, Scene, Profiles) ++ maps:get(monitors, Scene, []) ++
            progress(Scenario, Ids),
    starl_monitor:informed(with_history(Contracts, models(Scene, Options), Options), Known).

%% What contracts know of a run before it begins. What a fault does to the radio that a bound can allow for is a part
%% of the radio, and no excuse.
known(#{delay := {_, MaxMs}, clock_offset := Ms, clock_drift := Ppm} = Given, Ids, IsExact) ->
    {Lost, ExtraUs, #{faults := Faults} = Scenario} = radio(Given),
    #{
        broken => starl_run_assumption:broken(Faults, IsExact),
        faults => out_of_range(Scenario) ++ starl_run_assumption:faults(Faults),
        bodies => starl_run_assumption:bodies(Faults, IsExact),
        places => starl_run_assumption:places(Faults),
        positions => starl_run_assumption:positions(Faults),
        senses => starl_run_assumption:senses(Faults),
        obstacles => starl_run_floor:given_obstacles(Faults),
        healed_us => healed_us(Scenario),
        ends => ends(Scenario),
        core => core(Scenario, Ids),
        loss => either(told_loss(Scenario), Lost),
        clocks => #{offset_us => round(1000 * Ms), drift_ppm => Ppm},
        delay_us => round(1000 * MaxMs) + ExtraUs
    }.

%% The part of the packets and the time that faults of the radio cost, and the scenario without these.
radio(#{faults := All, time := Time} = Scenario) ->
    {Lost, ExtraUs, Faults} = starl_run_assumption:radio(All, micros(Time)),
    {Lost, ExtraUs, Scenario#{faults := Faults}}.

either(Loss, Lost) when Lost == 0 -> Loss;
either(Loss, Lost) -> 1 - (1 - Loss) * (1 - Lost).

%% @doc The models by which the histories of this run are judged.
-spec models(starl_scene:t(), starl_run_plan:options()) -> [{module(), map()}].
models(Scene, #{histories := {_, Models}}) ->
    starl_history:models(Models, maps:get(monitors, Scene, []));
models(_Scene, _Options) ->
    [].

with_history(Contracts, [_ | _] = Models, #{histories := {How, _}}) when How =/= kept ->
    [Contract || Contract <- Contracts, How =/= alone] ++
        [{starl_history_monitor, #{models => Models}}];
with_history(Contracts, _Models, _Options) ->
    Contracts.

%% A robot knows the motion of another as of the beginning of the window.
contact(#{delay := {MinMs, _}, faults := Faults}, #{floor := Floor} = Scene, Profiles) ->
    [
        {starl_contact_monitor, (starl_run_floor:obstacles(Faults, Floor))#{
            walls => starl_walls:new(Floor),
            profiles => Profiles,
            unaware_us => round(MinMs * 1000),
            never_bumps => maps:get(never_bumps, Scene, false)
        }}
    ];
contact(_Scenario, _Scene, _Profiles) ->
    [].

%% Crashes of a user's application are reported, but are no violation.
excused(#{never_crashes := true}) -> [];
excused(_Scene) -> [app].

%% A radio of limited range, or among walls, may lose any packet at any time.
out_of_range(#{range := none, wall_loss := Loss}) when Loss == 0 -> [];
out_of_range(Scenario) -> [{all, 0, limit_us(Scenario), fault}].

%% Walls and shadows lose packets, too. No bound is owed that would need their exact part, since faults never end then.
told_loss(#{loss := Loss, wall_loss := Walls, shadowing := Shadows, range := Range}) when
    Walls > 0; Shadows > 0, Range =/= none
->
    max(Loss, ?SOME_LOSS);
told_loss(#{loss := Loss}) ->
    Loss.

%% With a limited range, or walls that take packets, faults never end. With random loss they do: bounds allow for it.
healed_us(#{range := none, wall_loss := Loss, faults := Faults}) when Loss == 0 ->
    starl_run_fault:healed_us(Faults);
healed_us(_Scenario) ->
    never.

%% The same for each class of faults.
ends(#{faults := Faults} = Scenario) ->
    Ends = starl_run_assumption:ends(Faults),
    case healed_us(Scenario#{faults := []}) of
        never -> Ends#{network => never};
        _Heals -> Ends
    end.

progress(#{converge := none}, _Ids) ->
    [];
progress(Scenario, Ids) ->
    {_Lost, _ExtraUs, Others} = radio(Scenario),
    #{rest := Rest} = core(Others, Ids),
    [
        {starl_run_progress_monitor, #{
            robots => Ids -- Rest, deadline_us => deadline_us(Scenario)
        }}
    ].

%% Faults that last until the end of the run leave a core that heals.
core(#{faults := Faults, time := Time} = Scenario, Ids) ->
    {Rest, Ending} = starl_run_assumption:core(Faults, Ids, micros(Time)),
    Healing = Scenario#{faults := Ending},
    #{rest => Rest, healed_us => healed_us(Healing), ends => ends(Healing)}.

%% Counted from the end of the last fault, and of what it makes late.
deadline_us(#{heal := Heal, converge := Converge, robots := N, time := Time} = Scenario) ->
    {_Lost, _ExtraUs, #{faults := All}} = radio(Scenario),
    {_Rest, Faults} = starl_run_assumption:core(All, lists:seq(1, N), micros(Time)),
    Windows = starl_run_assumption:faults(Faults) ++ starl_run_assumption:bodies(Faults, false),
    lists:max([micros(Heal) | [To || {_, _, To, _} <- Windows]]) + micros(Converge).

%% @doc The time at which the run ends: one that has to converge ends at that deadline.
-spec limit_us(starl_run_scenario:t()) -> non_neg_integer().
limit_us(#{converge := none, time := Time}) -> micros(Time);
limit_us(#{time := Time} = Scenario) -> min(micros(Time), deadline_us(Scenario)).

%% All robots share one positioning system.
is_exact([#{position_error_mm := Error} | _]) -> Error == 0.

micros(Seconds) -> round(Seconds * 1000000).
