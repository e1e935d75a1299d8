%% @doc The contract of a convoy. No robot passes a door before a robot that was ahead of it, and
%% two robots never come nearer than 400 mm.
%%
%% Violations are excused during a fault and for half a minute after it. A lease that ran out while
%% a robot was cut off, or down, leaves the robot in a section that another robot may get. Two
%% robots that come too near are excused only by their own faults, by faults of all robots, and by
%% faults of the homes of the tokens there. At the end of an excused time the order of the column is
%% determined anew, from the robots' places on the lane.
%%
%% Progress: as long as no robot has died, some robot reaches a new section every two minutes, until
%% all have arrived. The two minutes count from the last such step, or from the end of all faults if
%% that is later. After an excused time all sections count as new.
%%
%% Events of machine `chassis': `motion'; of machine `app': {@link starl_convoy:event()}, `done'; of
%% machine `robot': `died'; of machine `supervisor': `given_up'.
-module(starl_convoy_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    separation = starl_separation:new(400.0) :: starl_separation:t(),
    lane :: starl_convoy_route:t(),
    robots :: [starl:robot_id(), ...],
    %% the excused times, whose fault each is, and which of their ends are still to come
    excused :: [excused()],
    ends :: [integer()],
    healed :: integer() | never,
    %% the robots that are not there; how each moves
    under_way :: [starl:robot_id()],
    pieces = #{} :: #{starl:robot_id() => starl_trajectory:piece()},
    %% how far each was on the lane when that was seen last, in sections; of those that have come through each door the
    %% one that was farthest behind; the last section to which each has come
    places :: #{starl:robot_id() => number()},
    through = #{} :: #{pos_integer() => Place :: number()},
    farthest = #{} :: #{starl:robot_id() => pos_integer()},
    %% when somebody moved on last; `over': no progress is owed
    since = 0 :: integer() | over,
    last = 0 :: integer(),
    passes = 0 :: non_neg_integer()
}).

-type excused() :: {starl:robot_id() | all, FromUs :: integer(), ToUs :: integer()}.

-define(AFTER_US, 30000000).
-define(WITHIN_US, 120000000).
%% Two robots that are nearer to each other on the lane, in sections, stand beside each other.
-define(BESIDE, 0.7).

%% @doc `robots': the column, the first one ahead, on this lane.
-spec init(#{
    robots := [starl:robot_id()],
    lane := starl_convoy_route:t(),
    faults => [starl_assumption:window()],
    healed_us => integer() | never
}) -> #state{}.
init(#{robots := Robots, lane := Lane} = Config) ->
    Excused = [excused(Fault) || Fault <- maps:get(faults, Config, [])],
    #state{
        lane = Lane,
        robots = Robots,
        excused = Excused,
        ends = ends([To || {_, _, To} <- Excused], Excused),
        healed = maps:get(healed_us, Config, 0),
        under_way = Robots,
        places = maps:from_list([{Robot, -K} || {K, Robot} <- lists:enumerate(Robots)])
    }.

excused({Robot, From, To, _}) -> {Robot, From, To + ?AFTER_US}.

ends(Times, Excused) -> [T || T <- lists:usort(Times), not is_within(T + 1, Excused)].

%% @doc All faults, and when they are over.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, faults := Faults, bodies := Bodies} = Known, Config) ->
    #{healed_us := Healed} = Known,
    Config#{faults => Broken ++ Faults ++ Bodies, healed_us => Healed}.

%% @doc In real time a fault is known when it happens: what is judged is older.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _} = Window, #state{excused = Before, healed = Healed} = State) ->
    {_, _, End} = New = excused(Window),
    State#state{
        excused = [New | Before],
        ends = ends([End | State#state.ends], [New | Before]),
        healed = max(Healed, To)
    }.

-spec interests() -> [atom()].
interests() -> [chassis, app, robot, supervisor].

%% @doc {@link starl_convoy:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{at, 2}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, #state{ends = [End | Ends]} = State) when T > End ->
    step(Event, seen(T, State#state{ends = Ends}));
step({T, _, _, _} = Event, State) ->
    case late(T, State) of
        [] -> judge(Event, State);
        Late -> starl_violation:step(Late, State#state{since = over})
    end.

%% What was excused may have mixed up the column: its order is what it is now.
seen(T, #state{pieces = Pieces, lane = Lane, places = Places} = State) ->
    Place = fun(_Robot, Piece) ->
        {X, Y, _} = starl_trajectory:pose(T, Piece),
        starl_convoy_place:progress({X, Y}, Lane)
    end,
    State#state{
        places = maps:merge(Places, maps:map(Place, Pieces)), through = #{}, farthest = #{}
    }.

%% The column stands.
late(T, #state{since = Since, healed = Healed} = State) when
    is_integer(Since), is_integer(Healed)
->
    Due = max(Since, Healed) + ?WITHIN_US,
    [violation(nobody_moves, Due, State#state.under_way, #{}) || T > Due];
late(_T, _State) ->
    [].

judge({T, Robot, chassis, {motion, Piece}}, #state{separation = Before} = State) ->
    {Met, Advanced} = starl_separation:advance(T, Before),
    Next = State#state{
        separation = starl_separation:motion(Robot, Piece, Advanced),
        pieces = (State#state.pieces)#{Robot => Piece}
    },
    starl_violation:step(near(Met, State), Next);
judge({T, Robot, app, {at, Section, Door}}, #state{} = State) ->
    passes(T, Robot, Door, moved(T, Robot, Section, State));
judge({_, Robot, app, {done, _}}, #state{under_way = Robots} = State) ->
    case lists:delete(Robot, Robots) of
        [] -> {ok, State#state{under_way = [], since = over}};
        Left -> {ok, State#state{under_way = Left}}
    end;
judge({_, _, Machine, {End, _}}, State) when
    Machine =:= robot, End =:= died;
    Machine =:= supervisor, End =:= given_up
->
    {ok, State#state{since = over}};
judge(_Event, State) ->
    {ok, State}.

%% Who drives to and fro does not move on.
moved(T, Robot, Section, #state{farthest = Farthest} = State) ->
    case Farthest of
        #{Robot := Last} when Last >= Section -> State;
        #{} -> since(T, State#state{farthest = Farthest#{Robot => Section}, last = T})
    end.

since(_T, #state{since = over} = State) -> State;
since(T, State) -> State#state{since = T}.

passes(_T, _Robot, none, State) ->
    {ok, State};
passes(T, Robot, Door, #state{places = Places, through = Through, passes = N} = State) ->
    #{Robot := Place} = Places,
    Behind = maps:get(Door, Through, Place),
    Next = State#state{passes = N + 1},
    case is_within(T, State#state.excused) of
        true ->
            {ok, Next};
        false when Behind < Place - ?BESIDE ->
            {violation, violation(overtaken, T, [Robot], #{door => Door}), Next};
        false ->
            {ok, Next#state{through = Through#{Door => min(Behind, Place)}}}
    end.

near(Met, State) ->
    [
        violation(too_near, At, [A, B], #{mm => Mm})
     || {Mm, At, {A, B}} <- Met, not is_excused(At, [A, B], State)
    ].

is_excused(At, Two, #state{excused = Excused} = State) ->
    Concerned = [all | Two] ++ lists:append([homes(At, Robot, State) || Robot <- Two]),
    is_within(At, [Time || {Robot, _, _} = Time <- Excused, lists:member(Robot, Concerned)]).

%% A lease also runs out where the token's home does not answer: those of the sections between which the robot is.
homes(At, Robot, #state{pieces = Pieces, lane = Lane, robots = Robots}) ->
    #{Robot := Piece} = Pieces,
    Seen = max(At, starl_trajectory:start_us(Piece)),
    Place = starl_convoy_place:progress(starl_trajectory:position(Seen, Piece), Lane),
    [starl_mutex:home({section, I}, Robots) || I <- lists:usort([floor(Place), ceil(Place)])].

is_within(At, Times) -> lists:any(fun({_, From, To}) -> From =< At andalso At =< To end, Times).

violation(What, At, Robots, Details) ->
    starl_violation:new(convoy, What, At, Robots, Details).

%% @doc Results: the passes of doors, when the last robot moved on, and the least distance of two robots (mm).
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{atom() => term()}}.
finish(EndUs, #state{separation = Separation, passes = Passes, last = Last} = State) ->
    {Met, Least} = starl_separation:finish(EndUs, Separation),
    Results = starl_unjudged:with(
        starl_unjudged:unhealed("somebody moves on", State#state.healed, EndUs),
        #{passes => Passes, last_us => Last, least_mm => least(Least)}
    ),
    starl_violation:finish(near(Met, State) ++ late(EndUs, State), Results).

least({Mm, _, _}) -> Mm;
least(none) -> null.
