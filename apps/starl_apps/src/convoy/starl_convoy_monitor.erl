%% @doc The contract of a convoy: no robot comes through a door before one that was ahead of it, and no two robots come
%% nearer to each other than 400 mm. Excused is what happens in a fault, or up to half a minute after it: a lease that ran out while a
%% robot was cut off, or down, leaves it in a section that another may get. Who was overtaken in that time may stay
%% behind.
%%
%% Progress: as long as none has died, somebody comes to a next section within two minutes after the last time and after
%% all faults, until all are there.
%%
%% Events of machine `chassis': `motion'; of machine `app': {@link starl_convoy:event()}, `done'; of
%% machine `robot': `died'; of machine `supervisor': `given_up'.
-module(starl_convoy_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    separation = starl_separation:new(400.0) :: starl_separation:t(),
    faults :: [starl_assumption:window()],
    healed :: integer() | never,
    %% the robots that are not there; the place of each in the column
    under_way :: [starl:robot_id()],
    places :: #{starl:robot_id() => pos_integer()},
    %% the last in the column of those that have come through each door
    through = #{} :: #{pos_integer() => {Place :: pos_integer(), AtUs :: integer()}},
    %% those whom a fault has had overtaken
    mixed = #{} :: #{starl:robot_id() => true},
    %% when somebody moved on last; `over': no progress is owed
    since = 0 :: integer() | over,
    last = 0 :: integer(),
    passes = 0 :: non_neg_integer()
}).

-define(AFTER_US, 30000000).
-define(WITHIN_US, 120000000).

%% @doc `robots': the column, the first one ahead.
-spec init(#{
    robots := [starl:robot_id()],
    faults => [starl_assumption:window()],
    healed_us => integer() | never
}) -> #state{}.
init(#{robots := Robots} = Config) ->
    #state{
        faults = maps:get(faults, Config, []),
        healed = maps:get(healed_us, Config, 0),
        under_way = Robots,
        places = maps:from_list([{Robot, K} || {K, Robot} <- lists:enumerate(Robots)])
    }.

%% @doc All faults, and when they are over.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, faults := Faults, bodies := Bodies} = Known, Config) ->
    #{healed_us := Healed} = Known,
    Config#{faults => Broken ++ Faults ++ Bodies, healed_us => Healed}.

-spec interests() -> [atom()].
interests() -> [chassis, app, robot, supervisor].

%% @doc {@link starl_convoy:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{at, 2}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    case late(T, State) of
        [] -> judge(Event, State);
        [Violation] -> {violation, Violation, State#state{since = over}}
    end.

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
    Next = State#state{separation = starl_separation:motion(Robot, Piece, Advanced)},
    told(near(Met, State), Next);
judge({T, Robot, app, {at, _Section, Door}}, #state{} = State) ->
    passes(T, Robot, Door, moved(T, State));
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

moved(T, #state{since = over} = State) -> State#state{last = T};
moved(T, State) -> State#state{since = T, last = T}.

passes(_T, _Robot, none, State) ->
    {ok, State};
passes(T, Robot, Door, #state{through = Through, places = Places, passes = N} = State) ->
    #{Robot := Place} = Places,
    {Last, Before} = maps:get(Door, Through, {0, T}),
    Next = State#state{
        through = Through#{Door => max({Place, T}, {Last, Before})}, passes = N + 1
    },
    case Place < Last andalso not is_map_key(Robot, State#state.mixed) of
        false -> {ok, Next};
        true -> overtaken(T, Before, Robot, Door, Next)
    end.

%% The other one has overtaken when it came through. If that is excused, it is ahead from now on.
overtaken(T, Before, Robot, Door, #state{mixed = Mixed} = State) ->
    case is_excused(T, State) orelse is_excused(Before, State) of
        true -> {ok, State#state{mixed = Mixed#{Robot => true}}};
        false -> {violation, violation(overtaken, T, [Robot], #{door => Door}), State}
    end.

near(Met, State) ->
    [
        violation(too_near, At, [A, B], #{mm => Mm})
     || {Mm, At, {A, B}} <- Met, not is_excused(At, State)
    ].

is_excused(At, #state{faults = Faults}) ->
    lists:any(fun({_, From, To, _}) -> From =< At andalso At =< To + ?AFTER_US end, Faults).

told([], State) -> {ok, State};
told([Violation | _], State) -> {violation, Violation, State}.

violation(What, At, Robots, Details) ->
    #{contract => convoy, what => What, at_us => At, robots => Robots, details => Details}.

%% @doc Results: the passes of doors, when the last robot moved on, and the least distance of two robots (mm).
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{atom() => term()}}.
finish(EndUs, #state{separation = Separation, passes = Passes, last = Last} = State) ->
    {Met, Least} = starl_separation:finish(EndUs, Separation),
    Results = #{passes => Passes, last_us => Last, least_mm => least(Least)},
    case near(Met, State) ++ late(EndUs, State) of
        [] -> {ok, Results};
        Violations -> {{violation, Violations}, Results}
    end.

least({Mm, _, _}) -> Mm;
least(none) -> null.
