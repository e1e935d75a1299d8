%% @doc The states of a checked team, what may happen in each, and what that leads to.
%%
%% A state is made of numbers (see {@link starl_check_store}): the monitor's state, one for each
%% robot, those of the messages under way in ascending order, and how many faults may still
%% happen. What may happen:
%% <dl>
%% <dt>`{deliver, Item}'</dt><dd>a message or a packet arrives</dd>
%% <dt>`{again, Item}'</dt><dd>a packet arrives, and will once more</dd>
%% <dt>`{outcome, Place, Call, Lost}'</dt><dd>a caller hears what has become of its message: at
%%   these receivers it is reported lost, whether it has arrived, will arrive later or never</dd>
%% <dt>`{refuse, Item}'</dt><dd>the receiver's SAP has restarted, the source's does not know it
%%   yet: the message does not arrive and will be reported so</dd>
%% <dt>`{fire, Place, Timer}'</dt><dd>a time-out, or the client's next call</dd>
%% <dt>`{crash, Place, Machine}'</dt><dd>a machine crashes and starts anew</dd>
%% <dt>`tick'</dt><dd>time passes to the next timed timer, or by the model's grain</dd>
%% </dl>
%% A loss of which nobody hears is not a step of its own. What never arrives stays under way for
%% ever, and every way there is also a way on which it was lost: what safety allows up to any
%% moment does not depend on what comes later. So packets may be lost at will. A message over
%% SAP's contract that is still under way when a time-out fires, or when time passes, is either
%% slow or lost, and is counted as such: at most as many as `late' and `loss' say. This also bounds
%% how many messages can ever be under way, as every time-out may send more. A call fails for
%% want of patience as often as `timeout' says.
-module(starl_check_state).

-export([initial/2, choices/3, step/4, key/4, pack/1, unpack/1, is_stuck/3, item/2]).

-export_type([t/0, choice/0, item/0, result/0]).

-type place() :: starl_check_term:place().
-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().

%% The number of a message under way.
-type ref() :: non_neg_integer().

%% `late': it is counted as slow; `ghost': as lost, it may arrive or not.
-type age() :: fresh | late | ghost.

-type item() ::
    {message, From :: place(), To :: place(), Type :: atom(), Body :: term(),
        starl_check_sap:ref() | none, age()}
    | {packet, From :: place(), To :: place(), starl_packet:t()}.

-type choice() ::
    {deliver | again | refuse, ref()}
    | {outcome, place(), starl_check_sap:ref(), Lost :: [starl:robot_id()]}
    | {fire, place(), starl_check_robot:timer()}
    | {crash, place(), starl_machine:name()}
    | tick.

-record(state, {
    monitor :: ref(),
    robots :: tuple(),
    items = [] :: [ref()],
    loss :: non_neg_integer(),
    crash :: non_neg_integer(),
    dup :: non_neg_integer(),
    late :: non_neg_integer(),
    timeout :: non_neg_integer(),
    %% the first one's SAP may not know yet that the second one's has restarted
    stale = [] :: [{place(), place()}]
}).

-opaque t() :: #state{}.

%% What a step leads to, with what the robots traced; or how it broke a contract.
-type result() ::
    {ok, [starl_monitor:trace_event()], t()}
    | {violation, [starl_monitor:trace_event()], starl_monitor:violation()}.

%% @doc The team when all machines have started.
-spec initial(model(), store()) -> result().
initial(#{ids := Ids, faults := Faults, monitor := {Module, Config}} = Model, Store) ->
    Judge = Module:init(Config),
    Boots = [{Place, starl_check_robot:boot(Place, Model)} || Place <- places(Ids)],
    Robots = [starl_check_store:number(Robot, Robot, Store) || {_, {_, _, Robot}} <- Boots],
    Items = [new_item(Place, Sent) || {Place, {All, _, _}} <- Boots, Sent <- All],
    Traces = lists:append([Traces || {_, {_, Traces, _}} <- Boots]),
    State = #state{
        monitor = monitor_number(Module, Judge, Store),
        robots = list_to_tuple(Robots),
        items = lists:sort([item_number(Item, Store) || Item <- Items]),
        loss = maps:get(loss, Faults),
        crash = maps:get(crash, Faults),
        dup = maps:get(dup, Faults),
        late = maps:get(late, Faults),
        timeout = maps:get(timeout, Faults)
    },
    judge(Traces, State, Model, Store).

places(Ids) -> lists:seq(1, length(Ids)).

%% -- what may happen ------------------------------------------------------------------------

%% @doc All that may happen, in an order that depends on nothing but the state and the store.
-spec choices(t(), model(), store()) -> [choice()].
choices(#state{items = Items} = State, Model, Store) ->
    Under = [{I, item(I, Store)} || I <- lists:usort(Items)],
    Fresh = length(fresh(State, Store)),
    lists:append([item_choices(I, Item, State) || {I, Item} <- Under]) ++
        lists:append([outcomes(Place, Under, State, Store) || Place <- places_of(State)]) ++
        lists:append([fires(Place, Fresh, State, Model, Store) || Place <- places_of(State)]) ++
        [tick || may_pass(Fresh, State, Model, Store)] ++
        [
            {crash, Place, Name}
         || State#state.crash > 0, Place <- places_of(State), Name <- maps:get(crash, Model)
        ].

places_of(#state{robots = Robots}) -> lists:seq(1, tuple_size(Robots)).

item_choices(I, {packet, _, _, _}, #state{dup = Dup}) ->
    [{deliver, I} | [{again, I} || Dup > 0]];
item_choices(I, {message, From, To, _, _, _, Age}, #state{stale = Stale}) ->
    [{deliver, I} | [{refuse, I} || Age =/= ghost, lists:member({From, To}, Stale)]].

%% A call may be answered once its message has reached all receivers, or else is reported lost;
%% one that has arrived is reported lost, too, if its acknowledgements were lost.
outcomes(Place, Under, #state{robots = Robots, loss = Loss} = State, Store) ->
    [
        {outcome, Place, Ref, lists:sort(Open ++ Denied)}
     || {Ref, Open, Reached, _, _} <- calls(element(Place, Robots), Store),
        Left <- [Loss - price(Place, Ref, Open, Under)],
        Left >= 0,
        Denied <- subsets(Left, Reached, Place, State)
    ].

%% What is counted as lost already costs nothing.
price(Place, Ref, Open, Under) ->
    length(Open) -
        length([I || {I, {message, From, _, _, _, R, ghost}} <- Under, From =:= Place, R =:= Ref]).

%% So many of the receivers, and any of those that may seem to have restarted before the message
%% came: the lost acknowledgement of a robot whose SAP has crashed since is a refusal.
subsets(_Left, [], _Place, _State) ->
    [[]];
subsets(Left, [Dest | Rest], Place, #state{stale = Stale} = State) ->
    Without = subsets(Left, Rest, Place, State),
    case lists:member({Place, starl_check_term:number(Dest)}, Stale) of
        true -> Without ++ [[Dest | Others] || Others <- Without];
        false when Left > 0 ->
            Without ++ [[Dest | Others] || Others <- subsets(Left - 1, Rest, Place, State)];
        false -> Without
    end.

calls(Number, Store) ->
    starl_check_store:memo(
        {calls, Number},
        fun() -> starl_check_robot:calls(starl_check_store:term(Number, Store)) end,
        Store
    ).

%% The messages that a time-out would make slow, and the answers that might have come.
fresh(#state{items = Items, robots = Robots} = State, Store) ->
    [I || I <- Items, age(I, Store) =:= fresh] ++
        [
            {Place, Ref}
         || Place <- places_of(State),
            {Ref, [], _, _, false} <- calls(element(Place, Robots), Store)
        ].

age(I, Store) ->
    case item(I, Store) of
        {packet, _, _, _} -> late;
        {message, _, _, _, _, _, Age} -> Age
    end.

fires(Place, Fresh, #state{robots = Robots} = State, Model, Store) ->
    Timers = timers(element(Place, Robots), Model, Store),
    [{fire, Place, Key} || {Key, Due, Kind} <- Timers, may_fire(Kind, Due, Fresh, State)].

timers(Number, Model, Store) ->
    starl_check_store:memo(
        {timers, Number},
        fun() ->
            Robot = starl_check_store:term(Number, Store),
            [{Key, Due, starl_check_model:timer(Key, Model)}
             || {Key, Due} <- starl_check_robot:timers(Robot)]
        end,
        Store
    ).

may_fire(step, _Due, _Fresh, _State) -> true;
may_fire(timed, Due, _Fresh, _State) -> Due =:= 0;
may_fire(patience, _Due, Fresh, #state{timeout = Left} = State) ->
    Left > 0 andalso may_wait(Fresh, State);
may_fire(free, _Due, Fresh, State) -> may_wait(Fresh, State).

may_wait(Fresh, #state{late = Late, loss = Loss}) -> Fresh =< Late + Loss.

may_pass(_Fresh, _State, #{grain := none}, _Store) ->
    false;
may_pass(Fresh, State, Model, Store) ->
    may_wait(Fresh, State) andalso next_due(State, Model, Store) > 0.

%% The ticks to the next timed timer, at most the grain.
next_due(#state{robots = Robots}, #{grain := Grain} = Model, Store) ->
    Dues = [
        Due
     || Number <- tuple_to_list(Robots), {_, Due, timed} <- timers(Number, Model, Store)
    ],
    lists:min([Grain | Dues]).

%% @doc Is a client waiting, with nothing under way that must arrive, and no time-out to come?
-spec is_stuck(t(), model(), store()) -> boolean().
is_stuck(#state{robots = Robots, items = Items, loss = Loss}, Model, Store) ->
    Numbers = tuple_to_list(Robots),
    not lists:all(fun(Number) -> is_done(Number, Store) end, Numbers) andalso
        lists:all(fun(Number) -> timers(Number, Model, Store) =:= [] end, Numbers) andalso
        lists:all(fun(Number) -> calls(Number, Store) =:= [] end, Numbers) andalso
        length([I || I <- Items, age(I, Store) =/= ghost]) =< Loss.

is_done(Number, Store) ->
    starl_check_store:memo(
        {done, Number},
        fun() -> starl_check_robot:is_done(starl_check_store:term(Number, Store)) end,
        Store
    ).

%% -- steps ----------------------------------------------------------------------------------

%% @doc What a choice leads to.
-spec step(choice(), t(), model(), store()) -> result().
step({deliver, I}, #state{items = Items} = State, Model, Store) ->
    Item = item(I, Store),
    Left = heard(Item, State#state{items = lists:delete(I, Items)}),
    Known = note(acknowledged, Item, Left, Model, Store),
    happen(element(3, Item), {item, I}, Known, Model, Store);
step({again, I}, #state{dup = Dup} = State, Model, Store) ->
    {packet, _, To, _} = item(I, Store),
    happen(To, {item, I}, State#state{dup = Dup - 1}, Model, Store);
step({outcome, Place, Ref, Lost}, State, Model, Store) ->
    happen(Place, {outcome, Ref, Lost}, give_up(Place, Ref, Lost, State, Store), Model, Store);
step({refuse, I}, #state{items = Items, stale = Stale} = State, Model, Store) ->
    {message, From, To, _, _, _, _} = Item = item(I, Store),
    Left = State#state{items = lists:delete(I, Items), stale = lists:delete({From, To}, Stale)},
    {ok, [], note(refused, Item, Left, Model, Store)};
step({fire, Place, Key}, State, Model, Store) ->
    Fired =
        case starl_check_model:timer(Key, Model) of
            patience -> slow(State#state{timeout = State#state.timeout - 1}, Model, Store);
            free -> slow(State, Model, Store);
            _ -> State
        end,
    happen(Place, {fire, Key}, Fired, Model, Store);
step({crash, Place, Name}, #state{crash = Crash} = State, Model, Store) ->
    Struck = State#state{crash = Crash - 1},
    case {Name, Model} of
        {sap, #{sap := contract}} ->
            happen(Place, {crash, Name}, forsake(Place, Struck, Model, Store), Model, Store);
        _ ->
            happen(Place, {crash, Name}, Struck, Model, Store)
    end;
step(tick, State, Model, Store) ->
    Ticks = next_due(State, Model, Store),
    {ok, [], pass(Ticks, slow(State, Model, Store), Model, Store)}.

%% The source's SAP learns what has become of the message of a call; its caller does not yet.
note(What, {message, From, To, _, _, Ref, _}, #state{robots = Robots} = State, Model, Store) when
    Ref =/= none
->
    Event = {What, Ref, starl_check_term:id(To)},
    {Number, [], []} = robot_memo(From, element(From, Robots), Event, Model, Store),
    State#state{robots = setelement(From, Robots, Number)};
note(_What, _Item, State, _Model, _Store) ->
    State.

%% What is reported lost may still be under way, and is nobody's concern any more.
give_up(Place, Ref, Lost, #state{items = Items, robots = Robots, loss = Loss} = State, Store) ->
    Under = [{I, item(I, Store)} || I <- Items],
    {Ref, Open, _, _, _} = lists:keyfind(Ref, 1, calls(element(Place, Robots), Store)),
    Denied = [
        Dest
     || Dest <- Lost -- Open,
        not lists:member({Place, starl_check_term:number(Dest)}, State#state.stale)
    ],
    Left = [
        case Item of
            {message, Place, To, Type, Body, Ref, _} ->
                item_number({message, Place, To, Type, Body, none, ghost}, Store);
            _ ->
                I
        end
     || {I, Item} <- Under
    ],
    State#state{
        items = lists:sort(Left), loss = Loss - price(Place, Ref, Open, Under) - length(Denied)
    }.

%% A message that the receiver's present SAP took, or one that it sent, tells its incarnation.
heard({message, From, To, _, _, _, Age}, #state{stale = [_ | _] = Stale} = State) ->
    Own = [{To, From} || Age =/= ghost],
    State#state{stale = Stale -- [{From, To} | Own]};
heard(_, State) ->
    State.

add(New, Items) -> lists:merge(lists:sort(New), Items).

%% What is under way while a time-out fires is slow, or, beyond the number of those, lost.
slow(#state{late = Late, loss = Loss} = State, Model, Store) ->
    Fresh = fresh(State, Store),
    {Slow, Lost} = lists:split(min(Late, length(Fresh)), Fresh),
    Counted = State#state{late = Late - length(Slow), loss = Loss - length(Lost)},
    All = [{late, Item} || Item <- Slow] ++ [{ghost, Item} || Item <- Lost],
    lists:foldl(fun({Age, Item}, S) -> grow_old(Item, Age, S, Model, Store) end, Counted, All).

grow_old({Place, Ref}, _Age, #state{robots = Robots} = State, Model, Store) ->
    {Number, [], []} = robot_memo(Place, element(Place, Robots), {delayed, Ref}, Model, Store),
    State#state{robots = setelement(Place, Robots, Number)};
grow_old(I, Age, #state{items = Items} = State, _Model, Store) ->
    {message, From, To, Type, Body, Ref, fresh} = item(I, Store),
    Old = item_number({message, From, To, Type, Body, Ref, Age}, Store),
    State#state{items = add([Old], lists:delete(I, Items))}.

%% A robot's SAP is gone: messages under way to it are refused; its own may arrive or not, and
%% nobody waits for what becomes of them.
forsake(Place, #state{items = Items} = State, Model, Store) ->
    Under = [item(I, Store) || I <- Items],
    Told = lists:foldl(
        fun(Item, S) -> note(refused, Item, S, Model, Store) end,
        State,
        [Item || {message, _, To, _, _, _, _} = Item <- Under, To =:= Place]
    ),
    Left = [forsaken(Place, Item) || Item <- Under, element(3, Item) =/= Place],
    Told#state{
        items = lists:sort([item_number(Item, Store) || Item <- Left]),
        stale = lists:usort(
            [{Other, Place} || Other <- places_of(State), Other =/= Place] ++
                [Pair || {Who, _} = Pair <- State#state.stale, Who =/= Place]
        )
    }.

forsaken(Place, {message, Place, To, Type, Body, _, _}) ->
    {message, Place, To, Type, Body, none, ghost};
forsaken(_Place, Item) ->
    Item.

pass(Ticks, #state{robots = Robots, items = Items} = State, Model, Store) ->
    State#state{
        robots = list_to_tuple([older_robot(R, Ticks, Model, Store) || R <- tuple_to_list(Robots)]),
        items = lists:sort([older_item(I, Ticks, Model, Store) || I <- Items])
    }.

older_robot(Number, Ticks, Model, Store) ->
    starl_check_store:memo(
        {pass, Number, Ticks},
        fun() ->
            Robot = starl_check_robot:shift(Ticks, starl_check_store:term(Number, Store), Model),
            starl_check_store:number(Robot, Robot, Store)
        end,
        Store
    ).

older_item(I, Ticks, #{rates := Rates, horizon_us := Horizon}, Store) ->
    starl_check_store:memo(
        {pass, I, Ticks},
        fun() ->
            item_number(starl_check_term:shift(item(I, Store), Ticks, Rates, Horizon), Store)
        end,
        Store
    ).

%% Something happens to a robot.
happen(Place, Event, #state{robots = Robots, items = Items} = State, Model, Store) ->
    case robot_memo(Place, element(Place, Robots), Event, Model, Store) of
        {Number, Sent, Traces} ->
            Next = State#state{
                robots = setelement(Place, Robots, Number), items = add(Sent, Items)
            },
            judge(Traces, without_inert(Next, Model, Store), Model, Store);
        {broken, Violation} ->
            {violation, [], Violation}
    end.

%% A message that changes nothing, now and for ever, may as well have arrived. Which ones these are
%% the model says; after a crash of its receiver such a message would count again.
without_inert(#state{crash = 0, items = Items} = State, Model, Store) ->
    State#state{items = [I || I <- Items, not is_inert(I, State, Model, Store)]};
without_inert(State, _Model, _Store) ->
    State.

is_inert(I, #state{robots = Robots}, Model, Store) ->
    case may_be_inert(I, Model, Store) of
        false ->
            false;
        To ->
            Number = element(To, Robots),
            {Number, [], []} =:= robot_memo(To, Number, {item, I}, Model, Store)
    end.

may_be_inert(I, Model, Store) ->
    starl_check_store:memo(
        {inert, I},
        fun() ->
            case item(I, Store) of
                {message, _, To, Type, Body, none, _} ->
                    starl_check_model:may_be_inert(Type, Body, Model) andalso To;
                _ ->
                    false
            end
        end,
        Store
    ).

robot_memo(Place, Number, Event, Model, Store) ->
    starl_check_store:memo(
        {Place, Number, Event},
        fun() -> robot_step(Place, Number, Event, Model, Store) end,
        Store
    ).

robot_step(Place, Number, Event, Model, Store) ->
    Robot = starl_check_store:term(Number, Store),
    try starl_check_robot:event(robot_event(Event, Store), Robot, Model) of
        {Sent, Traces, Next} ->
            Items = [item_number(new_item(Place, S), Store) || S <- Sent],
            {starl_check_store:number(Next, Next, Store), lists:sort(Items), Traces}
    catch
        error:Reason:Stack -> {broken, crashed(Place, Reason, Stack)}
    end.

%% A machine that cannot handle what happened to it.
crashed(Place, Reason, Stack) ->
    #{
        contract => machine, what => crashed, at_us => 0, robots => [starl_check_term:id(Place)],
        details => #{reason => Reason, at => lists:sublist([{M, F} || {M, F, _, _} <- Stack], 1)}
    }.

robot_event({item, I}, Store) ->
    case item(I, Store) of
        {packet, _, _, Packet} -> {packet, Packet};
        {message, From, _, Type, Body, _, _} -> {message, starl_check_term:id(From), Type, Body}
    end;
robot_event(Event, _Store) ->
    Event.

new_item(From, {packet, To, Packet}) ->
    {packet, From, starl_check_term:number(To), Packet};
new_item(From, {message, To, Type, Body, Ref}) ->
    {message, From, starl_check_term:number(To), Type, Body, Ref, fresh}.

judge([], State, _Model, _Store) ->
    {ok, [], State};
judge(Traces, #state{monitor = Number} = State, #{monitor := {Module, _}}, Store) ->
    Verdict = starl_check_store:memo(
        {judge, Number, Traces},
        fun() -> verdict(Traces, Module, starl_check_store:term(Number, Store), Store) end,
        Store
    ),
    case Verdict of
        {violation, Violation} -> {violation, Traces, Violation};
        Next -> {ok, Traces, State#state{monitor = Next}}
    end.

verdict(Traces, Module, Judge, Store) ->
    Wanted = Module:interests(),
    Heard = [T || {_, _, Name, _} = T <- Traces, lists:member(Name, Wanted)],
    case judged(Heard, Module, Judge) of
        {violation, Violation} -> {violation, Violation};
        {ok, Next} -> monitor_number(Module, Next, Store)
    end.

judged([], _Module, Judge) ->
    {ok, Judge};
judged([Trace | Traces], Module, Judge) ->
    case Module:step(Trace, Judge) of
        {ok, Next} -> judged(Traces, Module, Next);
        {violation, Violation, _} -> {violation, Violation}
    end.

%% Monitors that judge alike from now on are one state.
monitor_number(Module, Judge, Store) ->
    starl_check_store:number({Module, Module:timeless(Judge)}, Judge, Store).

%% -- parts ----------------------------------------------------------------------------------

item_number(Item, Store) -> starl_check_store:number(Item, Item, Store).

%% @doc The message of a number.
-spec item(ref(), store()) -> item().
item(I, Store) -> starl_check_store:term(I, Store).

%% @doc A binary that tells the state from all others, but for those that differ from it only in
%% which of the robots that are like each other is which.
-spec key(t(), [starl_check_term:permutation()], model(), store()) -> binary().
key(State, [], _Model, _Store) ->
    pack(State);
key(State, Permutations, Model, Store) ->
    %% the robots and the monitor come first; only where they decide nothing do the rest
    Cores = [{core(P, State, Model, Store), P} || P <- Permutations],
    Own = {State#state.robots, State#state.monitor},
    Least = lists:min([Own | [Core || {Core, _} <- Cores]]),
    Images = [image(P, Core, State, Store) || {Core, P} <- Cores, Core =:= Least],
    lists:min([pack(Image) || Image <- [State || Own =:= Least] ++ Images]).

%% The robots and the monitor of the state that differs by this permutation.
core(Permutation, #state{robots = Robots, monitor = Monitor}, #{monitor := {Module, _}}, Store) ->
    Moved = move(1, Permutation, Robots, Robots, Store),
    {Moved, renamed(Permutation, Monitor, {monitor, Module}, Store)}.

move(Place, Permutation, _Robots, Moved, _Store) when Place > tuple_size(Permutation) ->
    Moved;
move(Place, Permutation, Robots, Moved, Store) ->
    Renamed = renamed(Permutation, element(Place, Robots), robot, Store),
    Next = setelement(element(Place, Permutation), Moved, Renamed),
    move(Place + 1, Permutation, Robots, Next, Store).

%% @doc The state in few bytes.
-spec pack(t()) -> binary().
pack(#state{monitor = Monitor, robots = Robots, items = Items, stale = Stale} = State) ->
    #state{loss = Loss, crash = Crash, dup = Dup, late = Late, timeout = Timeout} = State,
    Pairs = << <<A, B>> || {A, B} <- Stale >>,
    Parts = << <<N:32>> || N <- tuple_to_list(Robots) ++ Items >>,
    <<(tuple_size(Robots)), Monitor:32, Loss, Crash, Dup, Late, Timeout, (length(Stale)),
        Pairs/binary, Parts/binary>>.

%% @doc The state that was packed.
-spec unpack(binary()) -> t().
unpack(<<Size, Monitor:32, Loss, Crash, Dup, Late, Timeout, Stale, Rest/binary>>) ->
    <<Pairs:Stale/binary-unit:16, Robots:Size/binary-unit:32, Items/binary>> = Rest,
    #state{
        monitor = Monitor,
        robots = list_to_tuple([N || <<N:32>> <= Robots]),
        items = [N || <<N:32>> <= Items],
        loss = Loss, crash = Crash, dup = Dup, late = Late, timeout = Timeout,
        stale = [{A, B} || <<A, B>> <= Pairs]
    }.

image(Permutation, {Robots, Monitor}, #state{items = Items, stale = Stale} = State, Store) ->
    State#state{
        robots = Robots,
        items = lists:sort([renamed(Permutation, I, item, Store) || I <- Items]),
        stale = lists:sort([{element(A, Permutation), element(B, Permutation)} || {A, B} <- Stale]),
        monitor = Monitor
    }.

renamed(Permutation, Number, Kind, Store) ->
    starl_check_store:memo(
        {renamed, Permutation, Number},
        fun() -> rename(Kind, Permutation, starl_check_store:term(Number, Store), Store) end,
        Store
    ).

rename(robot, Permutation, Robot, Store) ->
    Renamed = starl_check_robot:rename(Robot, Permutation),
    starl_check_store:number(Renamed, Renamed, Store);
rename({monitor, Module}, Permutation, Judge, Store) ->
    monitor_number(Module, starl_check_term:rename(Judge, Permutation), Store);
rename(item, Permutation, {packet, From, To, Packet}, Store) ->
    {New, NewTo} = {element(From, Permutation), element(To, Permutation)},
    item_number({packet, New, NewTo, starl_check_term:rename(Packet, Permutation)}, Store);
rename(item, Permutation, {message, From, To, Type, Body, Ref, Age}, Store) ->
    {New, NewTo} = {element(From, Permutation), element(To, Permutation)},
    Renamed = starl_check_term:rename(Body, Permutation),
    item_number({message, New, NewTo, Type, Renamed, Ref, Age}, Store).
