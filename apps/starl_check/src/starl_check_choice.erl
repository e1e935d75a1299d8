%% @doc Lists the choices in a state of a checked team: the steps that may happen next.
%%
%% <dl>
%% <dt>`{deliver, Item}'</dt><dd>a message or a packet arrives</dd>
%% <dt>`{again, Item}'</dt><dd>a packet arrives, and will arrive once more</dd>
%% <dt>`{outcome, Place, Call, Lost}'</dt><dd>a caller hears the outcome of its message: at the
%%   receivers `Lost' it is reported lost, although it may have arrived, or may arrive later</dd>
%% <dt>`{refuse, Item}'</dt><dd>the receiver's SAP has restarted, and the source's SAP does not know
%%   this yet: the message does not arrive and will be reported as refused</dd>
%% <dt>`{fire, Place, Timer}'</dt><dd>a time-out, or the client's next call</dd>
%% <dt>`{crash, Place, Machine}'</dt><dd>a machine crashes and starts anew</dd>
%% <dt>`{still, Choice, Cut}'</dt><dd>a message arrives, an outcome is heard or a timer fires, and the robot
%%   stands still before it has done all that follows from it: nothing else happens to it</dd>
%% <dt>`{go_on, Place}'</dt><dd>it does the rest, some time later</dd>
%% <dt>`{down | up | die, Place}'</dt><dd>a robot goes down, or dies for good; one that is down
%%   starts anew</dd>
%% <dt>`tick'</dt><dd>time passes to the next timed timer, or by the model's grain</dd>
%% </dl>
%% A loss that no robot hears of is not a separate step. A message that never arrives stays under
%% way for ever, and each such execution also covers the loss of the message, because safety up to a
%% moment does not depend on later events. So packets may be lost at will. A message over SAP's
%% contract that is still under way when a time-out fires, or when time passes, is either slow or
%% lost. It is counted as such, within the budgets `late' and `loss'. This also bounds the number of
%% messages under way, because every time-out may send more. A call runs out of patience at most
%% `timeout' times.
-module(starl_check_choice).

-export([event/1, local/4, refusals/1, waiting/3, outcomes/4, global/3, renamed/3, hears/3]).
-export([items/2, arriving/3, is_silent/4, is_stuck/3, price/5, fresh/3, next_due/3, heard/2]).

-export_type([t/0]).

-type place() :: starl_check_term:place().
-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type state() :: starl_check_state:t().
-type ref() :: starl_check_part:ref().

-type t() ::
    {deliver | again | refuse, ref()}
    | {outcome, place(), starl_check_sap:ref(), Lost :: [starl:robot_id()]}
    | {fire, place(), starl_check_robot:timer()}
    | {crash, place(), starl_machine:name()}
    | {down | up | die | go_on, place()}
    | {still, t(), starl_check_robot:cut()}
    | tick.

%% @doc The same choice when robots change places.
-spec renamed(starl_check_term:permutation(), t(), store()) -> t().
renamed(Permutation, {Kind, I}, Store) when Kind =:= deliver; Kind =:= again; Kind =:= refuse ->
    {Kind, starl_check_part:renamed_item(Permutation, I, Store)};
renamed(Permutation, {still, Choice, Cut}, Store) ->
    {still, renamed(Permutation, Choice, Store), Cut};
renamed(Permutation, {Kind, Place}, _Store) ->
    {Kind, element(Place, Permutation)};
renamed(Permutation, {outcome, Place, Ref, Lost}, _Store) ->
    {outcome, element(Place, Permutation), Ref, starl_check_term:rename(Lost, Permutation)};
renamed(Permutation, {Kind, Place, What}, _Store) ->
    {Kind, element(Place, Permutation), starl_check_term:rename(What, Permutation)};
renamed(_Permutation, tick, _Store) ->
    tick.

%% @doc The messages under way to these robots, each once.
-spec items([place()], state()) -> [ref()].
items(Places, #{items := Items}) ->
    [I || I <- lists:usort(Items), lists:member(starl_check_part:receiver(I), Places)].

%% @doc The messages under way to a robot that may be its next. What was sent while it stood still waits
%% in its queue, in the order in which time passed; only slow or lost messages let others overtake.
-spec arriving(place(), state(), store()) -> [ref()].
arriving(Place, #{late := Late, loss := Loss} = State, _Store) when Late + Loss > 0 ->
    items([Place], State);
arriving(Place, State, Store) ->
    Queued = [{starl_check_part:queue(I, Store), I} || I <- items([Place], State)],
    Head = lists:max([0 | [N || {N, _} <- Queued, is_integer(N)]]),
    [I || {N, I} <- Queued, N =:= none orelse N =:= Head].

%% @doc The choices at one robot that depend on no other robot: messages arrive, a machine crashes,
%% a timer fires that does not wait for messages.
-spec local(place(), state(), model(), store()) -> [t()].
local(Place, #{robots := Robots} = State, Model, Store) ->
    Robot = element(Place, Robots),
    case starl_check_part:condition(Robot, Store) of
        up -> at_running(Place, State, Model, Store);
        stands -> [{go_on, Place} || may_go_on(Robot, Model, Store)] ++ downfall(Place, State);
        down -> [{up, Place}] ++ death(Place, State);
        dead -> []
    end.

%% Without time between it is as if it had not stood still.
may_go_on(_Robot, #{grain := none}, _Store) -> true;
may_go_on(Robot, _Model, Store) -> starl_check_part:has_aged(Robot, Store).

downfall(Place, #{reboot := Reboot} = State) ->
    [{down, Place} || Reboot > 0] ++ death(Place, State).

death(Place, #{death := Death}) -> [{die, Place} || Death > 0].

at_running(Place, #{dup := Dup, robots := Robots} = State, Model, Store) ->
    Mine = arriving(Place, State, Store),
    Robot = element(Place, Robots),
    Whole =
        [{deliver, I} || I <- Mine] ++
            [
                {fire, Place, Key}
             || {Key, Due, Kind} <- starl_check_part:timers(Robot, Model, Store),
                Kind =:= step orelse {Kind, Due} =:= {timed, 0}
            ],
    Whole ++
        lists:append([stills(Choice, Robot, State, Model, Store) || Choice <- Whole]) ++
        [{again, I} || Dup > 0, I <- Mine, starl_check_part:age(I) =:= packet] ++
        [{crash, Place, Name} || maps:get(crash, State) > 0, Name <- maps:get(crash, Model)] ++
        [{crash, Place, sap} || maps:get(sap, State) > 0] ++
        downfall(Place, State).

%% The moments at which the robot can stand still after this choice.
stills(_Choice, _Robot, #{still := 0}, _Model, _Store) ->
    [];
stills(Choice, Robot, _State, Model, Store) ->
    [
        {still, Choice, Cut}
     || Cut <- starl_check_part:cuts(Robot, event(Choice), Model, Store)
    ].

%% @doc What happens to the robot by this choice; none by `refuse' and `tick'.
-spec event(t()) -> starl_check_part:event().
event({Kind, I}) when Kind =:= deliver; Kind =:= again -> I;
event({outcome, _Place, Ref, Lost}) -> {outcome, Ref, Lost};
event({fire, _Place, Key}) -> {fire, Key};
event({crash, _Place, Name}) -> {crash, Name};
event({still, Choice, Cut}) -> {still, Cut, event(Choice)};
event({What, _Place}) when What =:= down; What =:= up; What =:= die; What =:= go_on -> What.

%% @doc The messages that a restarted SAP may refuse.
-spec refusals(state()) -> [t()].
refusals(#{stale := []}) ->
    [];
refusals(#{stale := Stale, items := Items}) ->
    [
        {refuse, I}
     || I <- lists:usort(Items),
        starl_check_part:age(I) =/= ghost,
        lists:member({starl_check_part:source(I), starl_check_part:receiver(I)}, Stale)
    ].

%% @doc The unanswered calls of a robot's SAP, each with the receivers that lack the message.
-spec waiting(place(), state(), store()) -> [{starl_check_sap:ref(), Open :: [place()]}].
waiting(Place, #{robots := Robots}, Store) ->
    [
        {Ref, [starl_check_term:number(Robot) || Robot <- Open]}
     || {Ref, Open, _, _, _} <- starl_check_part:calls(element(Place, Robots), Store)
    ].

%% @doc The answers to a robot's calls of SAP. A call may be answered when its message has reached
%% all receivers or is reported lost. A message that has arrived is also reported lost if its
%% acknowledgements were lost.
-spec outcomes(place(), state(), model(), store()) -> [{starl_check_sap:ref(), t()}].
outcomes(Place, #{robots := Robots} = State, Model, Store) ->
    Robot = element(Place, Robots),
    Whole = lists:append([
        answers(Place, Call, State, Store)
     || starl_check_part:condition(Robot, Store) =/= stands,
        Call <- starl_check_part:calls(Robot, Store)
    ]),
    Whole ++
        [
            {Ref, Still}
         || {Ref, Choice} <- Whole, Still <- stills(Choice, Robot, State, Model, Store)
        ].

answers(Place, {Ref, Open, Reached, _, _}, #{loss := Loss} = State, Store) ->
    case Loss - price(Place, Ref, Open, State, Store) of
        Left when Left >= 0 ->
            [
                {Ref, {outcome, Place, Ref, lists:sort(Open ++ Denied)}}
             || Denied <- subsets(Left, Reached, Place, State)
            ];
        _ ->
            []
    end.

%% @doc The number of losses needed to answer a call; messages already counted as lost are free.
-spec price(place(), starl_check_sap:ref(), Open :: [starl:robot_id()], state(), store()) ->
    integer().
price(_Place, _Ref, [], _State, _Store) ->
    0;
price(Place, Ref, Open, #{items := Items}, Store) ->
    length(Open) -
        length([
            I
         || I <- Items,
            starl_check_part:age(I) =:= ghost,
            starl_check_part:source(I) =:= Place,
            element(6, starl_check_part:item(I, Store)) =:= Ref
        ]).

%% The subsets of the receivers with at most this number of losses. Receivers that may seem to have
%% restarted before the message came are free: the lost acknowledgement of a robot whose SAP has
%% crashed since is a refusal.
subsets(_Left, [], _Place, _State) ->
    [[]];
subsets(Left, [Dest | Rest], Place, #{stale := Stale} = State) ->
    Without = subsets(Left, Rest, Place, State),
    case lists:member({Place, starl_check_term:number(Dest)}, Stale) of
        true ->
            Without ++ [[Dest | Others] || Others <- Without];
        false when Left > 0 ->
            Without ++ [[Dest | Others] || Others <- subsets(Left - 1, Rest, Place, State)];
        false ->
            Without
    end.

%% @doc The choices that need all messages under way to be slow or lost: the other timers fire, and
%% time passes.
-spec global(state(), model(), store()) -> [t()].
global(State, Model, Store) ->
    [Fire || is_quiet(fire, State, Store), Fire <- fires(State, Model, Store)] ++
        [tick || is_quiet(tick, State, Store), may_pass(State, Model, Store)].

may_pass(#{robots := Robots} = State, Model, Store) ->
    next_due(State, Model, Store) > 0 andalso
        not lists:any(
            fun(Number) -> starl_check_part:must_go_on(Number, Model, Store) end,
            tuple_to_list(Robots)
        ).

is_quiet(What, #{late := Late, loss := Loss} = State, Store) ->
    length(fresh(What, State, Store)) =< Late + Loss.

fires(#{robots := Robots} = State, Model, Store) ->
    lists:append([
        [Whole | stills(Whole, element(Place, Robots), State, Model, Store)]
     || Place <- starl_check_state:places(State),
        Whole <- fires_at(Place, State, Model, Store)
    ]).

fires_at(Place, #{robots := Robots, timeout := Left}, Model, Store) ->
    Robot = element(Place, Robots),
    [
        {fire, Place, Key}
     || starl_check_part:condition(Robot, Store) =/= stands,
        {Key, _, Kind} <- starl_check_part:timers(Robot, Model, Store),
        Kind =:= free orelse (Kind =:= patience andalso Left > 0)
    ].

%% @doc The messages that a time-out or the passing of time would make slow, and the answers that might
%% have come before. While time passes, what is under way to a robot that stands still is not slow: the
%% robot is.
-spec fresh(fire | tick, state(), store()) -> [ref() | {place(), starl_check_sap:ref()}].
fresh(What, #{items := Items, robots := Robots} = State, Store) ->
    [
        I
     || I <- Items,
        starl_check_part:age(I) =:= fresh,
        What =:= fire orelse hears(I, State, Store)
    ] ++
        [
            {Place, Ref}
         || Place <- starl_check_state:places(State),
            What =:= fire orelse
                starl_check_part:condition(element(Place, Robots), Store) =/= stands,
            {Ref, [], _, _, false} <- starl_check_part:calls(element(Place, Robots), Store)
        ].

%% @doc Whether the receiver of a message does not stand still.
-spec hears(ref(), state(), store()) -> boolean().
hears(I, #{robots := Robots}, Store) ->
    starl_check_part:condition(element(starl_check_part:receiver(I), Robots), Store) =/= stands.

%% @doc The ticks to the next timed timer, at most the grain; 0 in a model without time.
-spec next_due(state(), model(), store()) -> non_neg_integer().
next_due(_State, #{grain := none}, _Store) ->
    0;
next_due(#{robots := Robots}, #{grain := Grain} = Model, Store) ->
    Dues = [
        Due
     || Number <- tuple_to_list(Robots),
        starl_check_part:condition(Number, Store) =/= stands,
        {_, Due, timed} <- starl_check_part:timers(Number, Model, Store)
    ],
    lists:min([Grain | Dues]).

%% @doc Whether the arrival of a message changes only the state of its receiver: nothing is sent,
%% nothing is judged, and no SAP learns of the restart of another.
-spec is_silent(ref(), state(), model(), store()) -> boolean().
is_silent(I, #{robots := Robots, stale := Stale} = State, Model, Store) ->
    To = starl_check_part:receiver(I),
    hears(I, State, Store) andalso
        case starl_check_part:event(To, element(To, Robots), I, Model, Store) of
            {_, [], _, none} -> Stale =:= [] orelse heard(I, Stale) =:= Stale;
            _ -> false
        end.

%% @doc Whether a client waits although no message must arrive and no time-out will come.
-spec is_stuck(state(), model(), store()) -> boolean().
is_stuck(#{robots := Robots, items := Items, loss := Loss}, Model, Store) ->
    Numbers = tuple_to_list(Robots),
    lists:all(fun(N) -> is_settled(starl_check_part:condition(N, Store)) end, Numbers) andalso
        lists:all(fun(N) -> starl_check_part:timers(N, Model, Store) =:= [] end, Numbers) andalso
        lists:all(fun(N) -> starl_check_part:calls(N, Store) =:= [] end, Numbers) andalso
        not lists:all(fun(N) -> starl_check_part:is_done(N, Store) end, Numbers) andalso
        length([I || I <- Items, starl_check_part:age(I) =/= ghost]) =< Loss.

is_settled(Condition) -> Condition =:= up orelse Condition =:= dead.

%% @doc The pairs of robots whose SAPs may still not know of a restart, after a message has been
%% delivered: the messages that a SAP has received and sent since its restart tell its
%% incarnation.
-spec heard(ref(), [{place(), place()}]) -> [{place(), place()}].
heard(_I, []) ->
    [];
heard(I, Stale) ->
    {From, To} = Pair = {starl_check_part:source(I), starl_check_part:receiver(I)},
    case starl_check_part:age(I) of
        ghost -> Stale -- [Pair];
        _ -> Stale -- [Pair, {To, From}]
    end.
