%% @doc The states of a checked team, what may happen in each, and what that leads to.
%%
%% A state is made of numbers (see {@link starl_check_store}): the monitor's state, one for each
%% robot, those of the messages under way in ascending order, and how many faults may still
%% happen. What may happen:
%% <dl>
%% <dt>`{deliver, Item}'</dt><dd>a message, an outcome or a packet arrives</dd>
%% <dt>`{again, Item}'</dt><dd>a packet arrives, and will once more</dd>
%% <dt>`{lose, Item}'</dt><dd>SAP reports to a caller that its message is lost, whether it has
%%   arrived, will arrive later or never</dd>
%% <dt>`{refuse, Item}'</dt><dd>the receiver's SAP has restarted, the source's does not know it
%%   yet: the message does not arrive and is reported `restarted'</dd>
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
    | {report, From :: place(), To :: place(), starl_check_sap:ref(), starl_check_sap:outcome(),
        age()}
    | {packet, From :: place(), To :: place(), starl_packet:t()}.

-type choice() ::
    {deliver | again | lose | refuse, ref()}
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
    Fresh = fresh(State, Store),
    lists:append([item_choices(I, Item, State) || {I, Item} <- Under]) ++
        lists:append([
            fires(Place, Fresh, State, Model, Store)
         || Place <- places_of(State)
        ]) ++
        [tick || may_pass(Fresh, State, Model, Store)] ++
        [
            {crash, Place, Name}
         || State#state.crash > 0, Place <- places_of(State), Name <- maps:get(crash, Model)
        ].

places_of(#state{robots = Robots}) -> lists:seq(1, tuple_size(Robots)).

item_choices(I, {packet, _, _, _}, #state{dup = Dup}) ->
    [{deliver, I} | [{again, I} || Dup > 0]];
item_choices(I, {message, From, To, _, _, Ref, Age}, #state{loss = Loss, stale = Stale}) ->
    [{deliver, I}] ++
        [{lose, I} || Loss > 0, Ref =/= none] ++
        [{refuse, I} || Age =/= ghost, lists:member({From, To}, Stale)];
item_choices(I, {report, From, To, _, Outcome, _}, #state{loss = Loss, stale = Stale}) ->
    [{deliver, I}] ++
        [{lose, I} || Loss > 0, Outcome =:= acknowledged] ++
        [{refuse, I} || Outcome =:= acknowledged, lists:member({To, From}, Stale)].

%% The messages that a time-out would make slow.
fresh(#state{items = Items}, Store) ->
    [I || I <- Items, age(item(I, Store)) =:= fresh].

age({packet, _, _, _}) -> late;
age({message, _, _, _, _, _, Age}) -> Age;
age({report, _, _, _, _, Age}) -> Age.

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

may_wait(Fresh, #state{late = Late, loss = Loss}) -> length(Fresh) =< Late + Loss.

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
        length([I || I <- Items, must_arrive(item(I, Store))]) =< Loss.

must_arrive({packet, _, _, _}) -> true;
must_arrive(Item) -> age(Item) =/= ghost.

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
    Acked = [item_number(R, Store) || R <- acknowledgement(Item)],
    happen(receiver(Item), {item, I}, Left#state{items = add(Acked, Left#state.items)}, Model, Store);
step({again, I}, #state{dup = Dup} = State, Model, Store) ->
    {packet, _, To, _} = item(I, Store),
    happen(To, {item, I}, State#state{dup = Dup - 1}, Model, Store);
step({lose, I}, #state{loss = Loss} = State, Model, Store) ->
    report(lost, I, item(I, Store), State#state{loss = Loss - 1}, Model, Store);
step({refuse, I}, State, Model, Store) ->
    report(restarted, I, item(I, Store), State, Model, Store);
step({fire, Place, Key}, State, Model, Store) ->
    Fired =
        case starl_check_model:timer(Key, Model) of
            patience -> slow(State#state{timeout = State#state.timeout - 1}, Store);
            free -> slow(State, Store);
            _ -> State
        end,
    happen(Place, {fire, Key}, Fired, Model, Store);
step({crash, Place, Name}, #state{crash = Crash} = State, Model, Store) ->
    Struck = State#state{crash = Crash - 1},
    case {Name, Model} of
        {sap, #{sap := contract}} ->
            happen(Place, {crash, Name}, forsake(Place, Struck, Store), Model, Store);
        _ ->
            happen(Place, {crash, Name}, Struck, Model, Store)
    end;
step(tick, State, Model, Store) ->
    Ticks = next_due(State, Model, Store),
    {ok, [], pass(Ticks, slow(State, Store), Model, Store)}.

receiver({packet, _, To, _}) -> To;
receiver({message, _, To, _, _, _, _}) -> To;
receiver({report, _, To, _, _, _}) -> To.

acknowledgement({message, From, To, _, _, Ref, _}) when Ref =/= none ->
    [{report, To, From, Ref, acknowledged, fresh}];
acknowledgement(_) ->
    [].

%% The source hears, if it waits for it, that its message is lost or refused.
report(lost, I, {message, From, To, Type, Body, Ref, _}, State, Model, Store) ->
    Ghost = [item_number({message, From, To, Type, Body, none, ghost}, Store)],
    hear({report, To, From, Ref, lost, fresh}, replace(I, Ghost, State), Model, Store);
report(restarted, I, {message, From, To, _, _, none, _}, State, _Model, _Store) ->
    {ok, [], replace(I, [], known(From, To, State))};
report(restarted, I, {message, From, To, _, _, Ref, _}, State, Model, Store) ->
    Known = known(From, To, replace(I, [], State)),
    hear({report, To, From, Ref, restarted, fresh}, Known, Model, Store);
report(Outcome, I, {report, From, To, Ref, acknowledged, _}, State, Model, Store) ->
    hear({report, From, To, Ref, Outcome, fresh}, replace(I, [], State), Model, Store).

hear({report, _, To, _, _, _} = Report, State, Model, Store) ->
    happen(To, {item, item_number(Report, Store)}, State, Model, Store).

known(From, To, #state{stale = Stale} = State) ->
    State#state{stale = lists:delete({From, To}, Stale)}.

%% A message that the receiver's present SAP took, or one that it sent, tells its incarnation.
heard({message, From, To, _, _, _, Age}, #state{stale = [_ | _] = Stale} = State) ->
    Own = [{To, From} || Age =/= ghost],
    State#state{stale = Stale -- [{From, To} | Own]};
heard(_, State) ->
    State.

replace(I, New, #state{items = Items} = State) ->
    State#state{items = add(New, lists:delete(I, Items))}.

add(New, Items) -> lists:merge(lists:sort(New), Items).

%% What is under way while a time-out fires is slow, or, beyond the number of those, lost.
slow(#state{items = Items, late = Late, loss = Loss} = State, Store) ->
    Fresh = fresh(State, Store),
    {Slow, Lost} = lists:split(min(Late, length(Fresh)), Fresh),
    Aged = [aged(I, late, Store) || I <- Slow] ++ [aged(I, ghost, Store) || I <- Lost],
    State#state{
        items = add(Aged, Items -- Fresh), late = Late - length(Slow), loss = Loss - length(Lost)
    }.

aged(I, Age, Store) ->
    starl_check_store:memo(
        {Age, I}, fun() -> item_number(with_age(Age, item(I, Store)), Store) end, Store
    ).

with_age(Age, {message, From, To, Type, Body, Ref, _}) ->
    {message, From, To, Type, Body, Ref, Age};
with_age(_, {report, From, To, Ref, Outcome, _}) ->
    {report, From, To, Ref, Outcome, late}.

%% A robot's SAP is gone: whoever had a message under way to it will hear that it restarted;
%% its own messages may arrive or not, and nobody waits for their outcome.
forsake(Place, #state{items = Items} = State, Store) ->
    Left = lists:append([forsaken(Place, item(I, Store)) || I <- Items]),
    State#state{
        items = lists:sort([item_number(Item, Store) || Item <- Left]),
        stale = lists:usort(
            [{Other, Place} || Other <- places_of(State), Other =/= Place] ++
                [Pair || {Who, _} = Pair <- State#state.stale, Who =/= Place]
        )
    }.

forsaken(Place, {message, From, Place, _, _, Ref, _}) ->
    [{report, Place, From, Ref, restarted, fresh} || Ref =/= none];
forsaken(Place, {message, Place, To, Type, Body, _, _}) ->
    [{message, Place, To, Type, Body, none, ghost}];
forsaken(Place, {report, _, Place, _, _, _}) ->
    [];
forsaken(_Place, Item) ->
    [Item].

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

robot_event({fire, Key}, _Store) ->
    {fire, Key};
robot_event({crash, Name}, _Store) ->
    {crash, Name};
robot_event({item, I}, Store) ->
    case item(I, Store) of
        {packet, _, _, Packet} -> {packet, Packet};
        {message, From, _, Type, Body, _, _} -> {message, starl_check_term:id(From), Type, Body};
        {report, From, _, Ref, Outcome, _} -> {report, starl_check_term:id(From), Ref, Outcome}
    end.

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
key(State, Permutations, Model, Store) ->
    lists:min([pack(State) | [pack(image(P, State, Model, Store)) || P <- Permutations]]).

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

image(Permutation, State, #{monitor := {Module, _}}, Store) ->
    #state{robots = Robots, items = Items, stale = Stale, monitor = Monitor} = State,
    Moved = [
        {element(Place, Permutation), renamed(Permutation, element(Place, Robots), robot, Store)}
     || Place <- places_of(State)
    ],
    State#state{
        robots = list_to_tuple([Number || {_, Number} <- lists:sort(Moved)]),
        items = lists:sort([renamed(Permutation, I, item, Store) || I <- Items]),
        stale = lists:sort([{element(A, Permutation), element(B, Permutation)} || {A, B} <- Stale]),
        monitor = renamed(Permutation, Monitor, {monitor, Module}, Store)
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
    item_number({message, New, NewTo, Type, Renamed, Ref, Age}, Store);
rename(item, Permutation, {report, From, To, Ref, Outcome, Age}, Store) ->
    {New, NewTo} = {element(From, Permutation), element(To, Permutation)},
    item_number({report, New, NewTo, Ref, Outcome, Age}, Store).
