%% @doc The contract of a formation: when a robot first considers a round's formation complete,
%% every robot stands in its place, within the tolerance. A robot is excused if a fault gave it a
%% wrong position when it came to its place. So is a robot whose store was damaged or set back,
%% until it comes to its place of that round, because it may have forgotten the round.
%%
%% Progress: each formation is complete within three minutes after the previous one, or after the
%% end of all faults if that is later. This holds until the first robot is done, as long as no robot
%% has died and no store was damaged or set back.
%%
%% Events of machine `app': {@link starl_formation:event()}; of machine `chassis': `motion'; of
%% machine `barrier': `store_damaged'; of machine `robot': `store_set_back', `died'; of machine
%% `supervisor': `given_up'.
-module(starl_formation_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    robots :: [starl:robot_id()],
    tolerance :: number(),
    assumption :: starl_assumption:t(),
    pieces = #{} :: #{starl:robot_id() => starl_trajectory:piece()},
    %% where each robot came to its place last, when, and in which round
    places = #{} :: #{starl:robot_id() => {pos_integer(), integer(), starl_geometry:point()}},
    %% the robots that may have forgotten their round
    unsound = #{} :: #{starl:robot_id() => true},
    healed :: integer() | never,
    %% when a formation was formed last; `over': no other one is owed
    since = 0 :: integer() | over,
    formed = 0 :: non_neg_integer(),
    worst = 0.0 :: float()
}).

%% Positions are exact to this (mm).
-define(MARGIN_MM, 20.0).
-define(WITHIN_US, 180000000).

-spec init(#{
    robots := [starl:robot_id()],
    tolerance_mm := number(),
    bodies => [starl_assumption:window()],
    healed_us => integer() | never
}) -> #state{}.
init(#{robots := Robots, tolerance_mm := Mm} = Config) ->
    #state{
        robots = Robots,
        tolerance = Mm,
        healed = maps:get(healed_us, Config, 0),
        assumption = starl_assumption:new(maps:get(bodies, Config, []), 0)
    }.

%% @doc The faults of bodies, and when all faults are over.
-spec context(starl_monitor:known(), map()) -> map().
context(#{bodies := Bodies, healed_us := Healed}, Config) ->
    Config#{bodies => Bodies, healed_us => Healed}.

%% @doc In real time a fault is known when it happens.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _} = Window, #state{assumption = Assumption, healed = Healed} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption), healed = max(Healed, To)
    }.

-spec interests() -> [atom()].
interests() -> [chassis, app, barrier, robot, supervisor].

%% @doc {@link starl_formation:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{in_place, 2}, {formed, 1}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    case late(T, State) of
        [] -> judge(Event, State);
        Late -> starl_violation:step(Late, State#state{since = over})
    end.

%% The next formation is overdue.
late(T, #state{since = Since, healed = Healed} = State) when
    is_integer(Since), is_integer(Healed)
->
    #state{robots = Robots, formed = Formed} = State,
    Due = max(Since, Healed) + ?WITHIN_US,
    Details = #{round => Formed + 1},
    [starl_violation:new(formation, not_formed, Due, Robots, Details) || T > Due];
late(_T, _State) ->
    [].

judge({_, Robot, chassis, {motion, Piece}}, #state{pieces = Pieces} = State) ->
    {ok, State#state{pieces = Pieces#{Robot => Piece}}};
judge({T, Robot, app, {in_place, Round, Place}}, #state{places = Places} = State) ->
    {ok, State#state{places = Places#{Robot => {Round, T, Place}}}};
judge({_, _, Machine, {End, _}}, State) when
    Machine =:= robot, End =:= died;
    Machine =:= supervisor, End =:= given_up;
    Machine =:= app, End =:= done
->
    {ok, State#state{since = over}};
%% A leader that has forgotten the order may give another one, and places are mixed up.
judge({_, Robot, Machine, Damage}, #state{places = Places, unsound = Unsound} = State) when
    Machine =:= barrier, Damage =:= store_damaged; Machine =:= robot, Damage =:= store_set_back
->
    {ok, State#state{
        places = maps:remove(Robot, Places), unsound = Unsound#{Robot => true}, since = over
    }};
judge({T, Robot, app, {formed, Round}}, #state{formed = Formed} = State) when Round > Formed ->
    formed(T, Robot, Round, State);
judge(_Event, State) ->
    {ok, State}.

formed(T, Robot, Round, State) ->
    Errors = [{Id, error(Id, Round, T, State)} || Id <- State#state.robots],
    Known = [Mm || {_, Mm} <- Errors, is_float(Mm)],
    Sound = maps:without([Id || {Id, Mm} <- Errors, is_float(Mm)], State#state.unsound),
    Next = State#state{
        formed = Round,
        since = again(T, State),
        worst = lists:max([State#state.worst | Known]),
        unsound = Sound
    },
    Away = [
        starl_violation:new(formation, not_in_place, T, lists:usort([Robot, Id]), #{
            round => Round, mm => Mm
        })
     || {Id, Mm} <- Errors, is_away(Id, Mm, T, State)
    ],
    starl_violation:step(Away, Next).

again(_T, #state{since = over}) -> over;
again(T, _State) -> T.

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

%% @doc Results: the rounds that were formed, and the greatest distance of a robot from its place then.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{atom() => term()}}.
finish(EndUs, #state{formed = Formed, worst = Worst} = State) ->
    Results = starl_unjudged:with(
        starl_unjudged:unhealed("the next formation is formed", State#state.healed, EndUs),
        #{formed => Formed, worst_mm => Worst}
    ),
    starl_violation:finish(late(EndUs, State), Results).
