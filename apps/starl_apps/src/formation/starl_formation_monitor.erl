%% @doc The contract of a formation: when a robot first takes a round's formation for formed, every robot
%% stands in its place, to within the tolerance. A robot that a fault gave a wrong position when it
%% came to its place is excused; so is one whose store was damaged or set back, which may have forgotten
%% the round, until it comes to its place of that round.
%%
%% Events of machine `app': {@link starl_formation:event()}; of machine `chassis': `motion'; of machine
%% `barrier': `store_damaged'; of machine `robot': `store_set_back'.
-module(starl_formation_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    robots :: [starl:robot_id()],
    tolerance :: number(),
    assumption :: starl_assumption:t(),
    pieces = #{} :: #{starl:robot_id() => starl_trajectory:piece()},
    %% where each robot came to its place last, when, and in which round
    places = #{} :: #{starl:robot_id() => {pos_integer(), integer(), starl_geometry:point()}},
    %% the robots that may have forgotten their round
    unsound = #{} :: #{starl:robot_id() => true},
    formed = 0 :: non_neg_integer(),
    worst = 0.0 :: float()
}).

%% Positions are exact to this (mm).
-define(MARGIN_MM, 20.0).

-spec init(#{
    robots := [starl:robot_id()],
    tolerance_mm := number(),
    bodies => [starl_assumption:window()]
}) -> #state{}.
init(#{robots := Robots, tolerance_mm := Mm} = Config) ->
    #state{
        robots = Robots,
        tolerance = Mm,
        assumption = starl_assumption:new(maps:get(bodies, Config, []), 0)
    }.

%% @doc The faults of bodies.
-spec context(starl_monitor:known(), map()) -> map().
context(#{bodies := Bodies}, Config) -> Config#{bodies => Bodies}.

-spec interests() -> [atom()].
interests() -> [chassis, app, barrier, robot].

%% @doc {@link starl_formation:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{in_place, 2}, {formed, 1}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({_, Robot, chassis, {motion, Piece}}, #state{pieces = Pieces} = State) ->
    {ok, State#state{pieces = Pieces#{Robot => Piece}}};
step({T, Robot, app, {in_place, Round, Place}}, #state{places = Places} = State) ->
    {ok, State#state{places = Places#{Robot => {Round, T, Place}}}};
step({_, Robot, Machine, Damage}, #state{places = Places, unsound = Unsound} = State) when
    Machine =:= barrier, Damage =:= store_damaged; Machine =:= robot, Damage =:= store_set_back
->
    {ok, State#state{places = maps:remove(Robot, Places), unsound = Unsound#{Robot => true}}};
step({T, Robot, app, {formed, Round}}, #state{formed = Formed} = State) when Round > Formed ->
    Errors = [{Id, error(Id, Round, T, State)} || Id <- State#state.robots],
    Known = [Mm || {_, Mm} <- Errors, is_float(Mm)],
    Sound = maps:without([Id || {Id, Mm} <- Errors, is_float(Mm)], State#state.unsound),
    Next = State#state{
        formed = Round, worst = lists:max([State#state.worst | Known]), unsound = Sound
    },
    case [{Id, Mm} || {Id, Mm} <- Errors, is_away(Id, Mm, T, State)] of
        [] -> {ok, Next};
        [{Id, Mm} | _] -> {violation, violation(T, [Robot, Id], Round, Mm), Next}
    end;
step(_Event, State) ->
    {ok, State}.

%% The distance of a robot from its place of a round.
error(Id, Round, T, #state{places = Places, pieces = Pieces}) ->
    case {Places, Pieces} of
        {#{Id := {Round, _, Place}}, #{Id := Piece}} ->
            starl_geometry:distance(Place, starl_trajectory:position(T, Piece));
        _ ->
            never
    end.

is_away(Id, never, _T, #state{unsound = Unsound}) ->
    not is_map_key(Id, Unsound);
is_away(Id, Mm, T, #state{tolerance = Tolerance, places = Places, assumption = Assumption}) ->
    #{Id := {_, Since, _}} = Places,
    Mm > Tolerance + ?MARGIN_MM andalso
        not starl_assumption:is_misplaced(Id, Since - 1000000, T, Assumption).

violation(T, Robots, Round, Mm) ->
    #{
        contract => formation,
        what => not_in_place,
        at_us => T,
        robots => lists:usort(Robots),
        details => #{round => Round, mm => Mm}
    }.

%% @doc Results: the rounds that were formed, and the greatest distance of a robot from its place then.
-spec finish(integer(), #state{}) -> {ok, map()}.
finish(_EndUs, #state{formed = Formed, worst = Worst}) ->
    {ok, #{formed => Formed, worst_mm => Worst}}.
