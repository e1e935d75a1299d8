%% @doc Which faults of a run break what contracts assume of clocks, promptness and positions, when
%% and of whom: for the monitors that ask for it ({@link starl_assumption}). All other faults are
%% such that contracts hold under them.
-module(starl_sim_assumption).

-export([broken/2]).

%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).

%% @doc The windows in which these faults break an assumption, where the positioning system is exact
%% or not: one that is not is found out when it gets stuck (`starl_location').
-spec broken([starl_sim_fault:t()], IsExact :: boolean()) -> [starl_assumption:window()].
broken(Faults, IsExact) ->
    lists:append([
        windows(starl_sim_fault:compile(Fault))
     || {_, _, _, Kind, _, _} = Fault <- Faults, IsExact orelse Kind =/= location_frozen
    ]).

windows({_, Time, Time, Kind, _, _}) when Kind =/= clock_step ->
    [];
windows({_, From, To, clock_offset, Robot, #{ms := Ms}}) ->
    shift(Robot, From, 1000 * Ms) ++ shift(Robot, To, -1000 * Ms);
windows({_, From, _, clock_step, Robot, #{ms := Ms}}) ->
    shift(Robot, From, 1000 * Ms);
windows({_, From, To, clock_freeze, Robot, _}) ->
    [{Robot, From, To, {clock, From - To}}];
windows({_, From, To, clock_drift, Robot, #{ppm := Ppm}}) when abs(Ppm) > ?DRIFT_PPM ->
    [{Robot, From, To, {clock, round((To - From) * Ppm / 1000000)}}];
windows({_, From, To, pause, Robot, _}) ->
    [{Robot, From, To, pause}];
windows({_, From, To, slow, Robot, #{lag_ms := Ms}}) ->
    [{Robot, From, To, {slow, 1000 * Ms}}];
windows({_, From, To, location_frozen, Robots, _}) ->
    [{Robots, From, To, position}];
windows({_, From, To, location_swap, {A, B}, _}) ->
    [{A, From, To, position}, {B, From, To, position}];
windows(_) ->
    [].

shift(_Robot, _Time, 0) -> [];
shift(Robot, Time, Us) -> [{Robot, Time, Time, {clock, Us}}].
