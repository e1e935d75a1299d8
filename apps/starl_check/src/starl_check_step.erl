%% @doc Carries out a choice (see {@link starl_check_choice}) and gives the next state.
-module(starl_check_step).

-export([initial/2, step/4]).

-export_type([result/0]).

-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type state() :: starl_check_state:t().

%% The state after a step, with the traced events (see {@link starl_check_part:traces/2}); or the
%% violation; `beyond': a state that the model does not follow.
-type result() ::
    {ok, starl_check_part:ref() | none, state()}
    | {violation, starl_check_part:ref() | none, starl_monitor:violation()}
    | beyond.

%% @doc The team after the start of all machines.
-spec initial(model(), store()) ->
    {ok, none, state()} | {violation, starl_check_part:ref() | none, starl_monitor:violation()}.
initial(Model, Store) ->
    Empty = starl_check_state:new(Model, Store),
    boot(starl_check_state:places(Empty), Empty, Model, Store).

boot([], State, _Model, _Store) ->
    {ok, none, State};
boot([Place | Places], State, Model, Store) ->
    Booted = starl_check_part:boot(Place, Model, Store),
    case happened(Place, Booted, State, Model, Store) of
        {ok, _, Next} -> boot(Places, Next, Model, Store);
        {violation, _, _} = Broken -> Broken
    end.

%% @doc The result of a choice.
-spec step(starl_check_choice:t(), state(), model(), store()) -> result().
step({refuse, I}, #{items := Items, stale := Stale} = State, Model, Store) ->
    Pair = {starl_check_part:source(I), starl_check_part:receiver(I)},
    Left = State#{items := lists:delete(I, Items), stale := lists:delete(Pair, Stale)},
    {ok, none, note(refused, I, Left, Model, Store)};
step(tick, State, Model, Store) ->
    Ticks = starl_check_choice:next_due(State, Model, Store),
    {ok, none, pass(Ticks, slow(tick, State, Model, Store), Model, Store)};
step(Choice, State, Model, Store) ->
    {Place, Then} = before(Choice, State, Model, Store),
    happen(Place, starl_check_choice:event(Choice), Then, Model, Store).

%% Where the event of a choice happens, and the state that it finds.
before({still, Choice, _Cut}, #{still := Still} = State, Model, Store) ->
    before(Choice, State#{still := Still - 1}, Model, Store);
before({deliver, I}, #{items := Items, stale := Stale} = State, Model, Store) ->
    Left = State#{items := lists:delete(I, Items), stale := starl_check_choice:heard(I, Stale)},
    {starl_check_part:receiver(I), note(acknowledged, I, Left, Model, Store)};
before({again, I}, #{dup := Dup} = State, _Model, _Store) ->
    {starl_check_part:receiver(I), State#{dup := Dup - 1}};
before({outcome, Place, Ref, Lost}, State, _Model, Store) ->
    {Place, give_up(Place, Ref, Lost, State, Store)};
before({fire, Place, Key}, #{timeout := Left} = State, Model, Store) ->
    case starl_check_model:timer(Key, Model) of
        patience -> {Place, slow(fire, State#{timeout := Left - 1}, Model, Store)};
        free -> {Place, slow(fire, State, Model, Store)};
        _ -> {Place, State}
    end;
before({crash, Place, sap}, #{sap := Sap} = State, #{sap := contract} = Model, Store) ->
    {Place, forsake(Place, State#{sap := Sap - 1}, Model, Store)};
before({crash, Place, _Name}, #{crash := Crash} = State, _Model, _Store) ->
    {Place, State#{crash := Crash - 1}};
before({down, Place}, #{reboot := Reboot} = State, Model, Store) ->
    {Place, gone(Place, State#{reboot := Reboot - 1}, Model, Store)};
before({die, Place}, #{death := Death} = State, Model, Store) ->
    {Place, gone(Place, State#{death := Death - 1}, Model, Store)};
before({_UpOrGoOn, Place}, State, _Model, _Store) ->
    {Place, State}.

%% An event happens to a robot.
happen(Place, Event, #{robots := Robots} = State, Model, Store) ->
    Happening = starl_check_part:event(Place, element(Place, Robots), Event, Model, Store),
    happened(Place, Happening, State, Model, Store).

happened(_Place, beyond, _State, _Model, _Store) ->
    beyond;
happened(_Place, {broken, Violation}, _State, _Model, _Store) ->
    {violation, none, Violation};
happened(Place, {Number, Sent, Traces, Judged}, State, Model, Store) ->
    #{robots := Robots, items := Items, monitor := Monitor} = State,
    case starl_check_part:judge(Judged, Monitor, Model, Store) of
        {violation, Violation} ->
            {violation, Traces, Violation};
        Next ->
            After = State#{robots := setelement(Place, Robots, Number), monitor := Next},
            {To, Nobody} = lists:partition(fun(I) -> is_taken(I, After, Store) end, Sent),
            Put = After#{items := lists:merge(To, Items)},
            {ok, Traces, lists:foldl(fun(I, S) -> vain(I, S, Model, Store) end, Put, Nobody)}
    end.

%% Whether the receiver of a message exists: during the start of the team not all robots do.
is_taken(I, #{robots := Robots}, Store) ->
    case element(starl_check_part:receiver(I), Robots) of
        none -> true;
        Number -> lists:member(starl_check_part:condition(Number, Store), [up, stands])
    end.

%% A message to a robot that is down or dead does not arrive; its source hears of this later.
vain(I, State, Model, Store) ->
    Refused = note(refused, I, State, Model, Store),
    case starl_check_part:item(I, Store) of
        {message, From, _, _, _, Ref, _} when Ref =/= none ->
            inform(From, {delayed, Ref}, Refused, Model, Store);
        _ ->
            Refused
    end.

%% A robot's SAP learns something, but its machines do not yet.
inform(Place, Event, #{robots := Robots} = State, Model, Store) ->
    Robot = element(Place, Robots),
    {Number, [], none, none} = starl_check_part:event(Place, Robot, Event, Model, Store),
    State#{robots := setelement(Place, Robots, Number)}.

%% The source's SAP learns the outcome of the message of a call.
note(What, I, State, Model, Store) ->
    case starl_check_part:item(I, Store) of
        {message, From, To, _, _, Ref, _} when Ref =/= none ->
            inform(From, {What, Ref, starl_check_model:id(To, Model)}, State, Model, Store);
        _ ->
            State
    end.

%% A message reported lost may still be under way; its outcome matters no more.
give_up(Place, Ref, Lost, State, Store) ->
    #{items := Items, robots := Robots, loss := Loss, stale := Stale} = State,
    Calls = starl_check_part:calls(element(Place, Robots), Store),
    {Ref, Open, _, _, _} = lists:keyfind(Ref, 1, Calls),
    Denied = [
        Dest
     || Dest <- Lost -- Open, not lists:member({Place, starl_check_term:number(Dest)}, Stale)
    ],
    State#{
        items := lists:sort([given_up(I, Place, Ref, Store) || I <- Items]),
        loss := Loss - starl_check_choice:price(Place, Ref, Open, State, Store) - length(Denied)
    }.

given_up(I, Place, Ref, Store) ->
    case starl_check_part:item(I, Store) of
        {message, Place, To, Type, Body, Ref, _} ->
            starl_check_part:item_number({message, Place, To, Type, Body, none, ghost}, Store);
        _ ->
            I
    end.

%% Messages under way when a time-out fires count as slow, and beyond that budget as lost.
slow(What, #{late := Late, loss := Loss} = State, Model, Store) ->
    Fresh = starl_check_choice:fresh(What, State, Store),
    {Slow, Lost} = lists:split(min(Late, length(Fresh)), Fresh),
    Counted = State#{late := Late - length(Slow), loss := Loss - length(Lost)},
    All = [{late, One} || One <- Slow] ++ [{ghost, One} || One <- Lost],
    lists:foldl(fun({Age, One}, S) -> grow_old(One, Age, S, Model, Store) end, Counted, All).

grow_old({Place, Ref}, _Age, State, Model, Store) ->
    inform(Place, {delayed, Ref}, State, Model, Store);
grow_old(I, Age, #{items := Items} = State, _Model, Store) ->
    Old = starl_check_part:grown_old(I, Age, Store),
    State#{items := lists:merge([Old], lists:delete(I, Items))}.

%% A robot is gone together with its SAP: messages under way to it do not arrive. Its own messages
%% do, but no caller waits for their outcome. When it starts again, all other robots hear of it.
gone(Place, #{items := Items, stale := Stale} = State, Model, Store) ->
    {Its, Left} = lists:partition(fun(I) -> starl_check_part:receiver(I) =:= Place end, Items),
    Told = lists:foldl(fun(I, S) -> note(refused, I, S, Model, Store) end, State, Its),
    Told#{
        items := lists:sort([unheeded(Place, I, Store) || I <- Left]),
        stale := [Pair || {A, B} = Pair <- Stale, A =/= Place, B =/= Place]
    }.

unheeded(Place, I, Store) ->
    case starl_check_part:item(I, Store) of
        {message, Place, To, Type, Body, _, Age} ->
            starl_check_part:item_number({message, Place, To, Type, Body, none, Age}, Store);
        _ ->
            I
    end.

%% A robot's SAP is gone: messages under way to it are refused. Its own messages may arrive or not,
%% and no caller waits for their outcome.
forsake(Place, #{items := Items, stale := Stale} = State, Model, Store) ->
    {Its, Left} = lists:partition(fun(I) -> starl_check_part:receiver(I) =:= Place end, Items),
    Told = lists:foldl(fun(I, S) -> note(refused, I, S, Model, Store) end, State, Its),
    Others = lists:delete(Place, starl_check_state:places(State)),
    Told#{
        items := lists:sort([forsaken(Place, I, Store) || I <- Left]),
        stale := lists:usort(
            [{Other, Place} || Other <- Others] ++ [Pair || {Who, _} = Pair <- Stale, Who =/= Place]
        )
    }.

forsaken(Place, I, Store) ->
    case starl_check_part:item(I, Store) of
        {message, Place, To, Type, Body, _, _} ->
            starl_check_part:item_number({message, Place, To, Type, Body, none, ghost}, Store);
        _ ->
            I
    end.

pass(Ticks, #{robots := Robots, items := Before} = State, Model, Store) ->
    Items = lists:foldl(
        fun(Place, Some) -> queued(Place, Some, Store) end, Before, standing(State, Store)
    ),
    State#{
        robots := list_to_tuple([
            starl_check_part:later_robot(R, Ticks, Model, Store)
         || R <- tuple_to_list(Robots)
        ]),
        items := lists:sort([
            starl_check_part:later_item(I, Ticks, Model, Store)
         || I <- Items
        ])
    }.

standing(#{robots := Robots} = State, Store) ->
    [
        Place
     || Place <- starl_check_state:places(State),
        starl_check_part:condition(element(Place, Robots), Store) =:= stands
    ].

%% Messages to a robot that stands still have reached its queue when time passes: later ones come behind.
queued(Place, Items, Store) ->
    {Its, Others} = lists:partition(fun(I) -> starl_check_part:receiver(I) =:= Place end, Items),
    case lists:any(fun(I) -> starl_check_part:queue(I, Store) =:= 0 end, Its) of
        true -> [starl_check_part:moved_up(I, Store) || I <- Its] ++ Others;
        false -> Items
    end.
