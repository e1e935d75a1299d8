%% @doc The contract of the intersection: no two robots come nearer to each other than half a metre.
%%
%% Violations are excused during a fault and for half a minute after it. A lease that ran out while
%% a robot was cut off, or down, leaves the robot in a section that another robot may get.
%%
%% Progress: the crossing is passed every two minutes, until the first robot is done, as long as no
%% robot has died. The two minutes count from the last pass, or from the end of all faults if that
%% is later.
%%
%% Events of machine `chassis': `motion'; of machine `app': {@link starl_crossing:event()}, `done';
%% of machine `robot': `died'; of machine `supervisor': `given_up'.
-module(starl_crossing_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    separation = starl_separation:new(500.0) :: starl_separation:t(),
    faults :: [starl_assumption:window()],
    healed :: integer() | never,
    %% when the crossing was passed last; `over': no other pass is owed
    since = 0 :: integer() | over,
    passes = 0 :: non_neg_integer()
}).

-define(AFTER_US, 30000000).

-define(WITHIN_US, 120000000).

-spec init(#{faults => [starl_assumption:window()], healed_us => integer() | never}) -> #state{}.
init(Config) ->
    #state{faults = maps:get(faults, Config, []), healed = maps:get(healed_us, Config, 0)}.

%% @doc All faults, and when they are over.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, faults := Faults, bodies := Bodies} = Known, Config) ->
    #{healed_us := Healed} = Known,
    Config#{faults => Broken ++ Faults ++ Bodies, healed_us => Healed}.

%% @doc In real time a fault is known when it happens.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _} = Window, #state{faults = Faults, healed = Healed} = State) ->
    State#state{faults = [Window | Faults], healed = max(Healed, To)}.

-spec interests() -> [atom()].
interests() -> [chassis, app, robot, supervisor].

%% @doc {@link starl_crossing:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{passes, 0}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    case late(T, State) of
        [] -> judge(Event, State);
        Late -> starl_violation:step(Late, State#state{since = over})
    end.

%% The crossing stands empty, or blocked.
late(T, #state{since = Since, healed = Healed}) when is_integer(Since), is_integer(Healed) ->
    Due = max(Since, Healed) + ?WITHIN_US,
    [starl_violation:new(crossing, nobody_passes, Due, [], #{}) || T > Due];
late(_T, _State) ->
    [].

judge({T, Robot, chassis, {motion, Piece}}, #state{separation = Before} = State) ->
    {Met, Advanced} = starl_separation:advance(T, Before),
    Next = State#state{separation = starl_separation:motion(Robot, Piece, Advanced)},
    starl_violation:step(judged(Met, State), Next);
judge({_, _, app, passes}, #state{passes = Passes, since = over} = State) ->
    {ok, State#state{passes = Passes + 1}};
judge({T, _, app, passes}, #state{passes = Passes} = State) ->
    {ok, State#state{passes = Passes + 1, since = T}};
judge({_, _, Machine, {End, _}}, State) when
    Machine =:= robot, End =:= died;
    Machine =:= supervisor, End =:= given_up;
    Machine =:= app, End =:= done
->
    {ok, State#state{since = over}};
judge(_Event, State) ->
    {ok, State}.

judged(Met, #state{faults = Faults}) ->
    [
        starl_violation:new(crossing, too_near, At, [A, B], #{mm => Mm})
     || {Mm, At, {A, B}} <- Met,
        not lists:any(
            fun({_, From, To, _}) -> From =< At andalso At =< To + ?AFTER_US end, Faults
        )
    ].

%% @doc Results: the passes of the crossing, and the least distance of two robots (mm).
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{atom() => term()}}.
finish(EndUs, #state{separation = Separation, passes = Passes} = State) ->
    {Met, Least} = starl_separation:finish(EndUs, Separation),
    Results = starl_unjudged:with(
        starl_unjudged:unhealed(
            "the crossing is passed again and again", State#state.healed, EndUs
        ),
        #{passes => Passes, least_mm => least(Least)}
    ),
    starl_violation:finish(judged(Met, State) ++ late(EndUs, State), Results).

least({Mm, _, _}) -> Mm;
least(none) -> null.
