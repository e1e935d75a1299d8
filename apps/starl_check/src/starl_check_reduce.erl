%% @doc Partial-order reduction: gives the runs of choices that lead from one kept state to the
%% next.
%%
%% Most arriving messages change only the state of their receiver (see
%% {@link starl_check_choice:is_silent/4}). Such a silent arrival commutes with the events of other
%% robots, because a message under way stays under way. So in any history a silent arrival can be
%% deferred, past the events of other robots and past those events of its own robot with which it
%% commutes, until right before the first event that would have another result ("receives are right
%% movers", Lipton 1975; here this is tried out, case by case, on the states themselves). The result
%% is a history of the same length with the same judged events in the same order, made of runs:
%% ```
%%   silent arrivals, none of which can be deferred . one event that is not silent
%% '''
%% Only such runs are followed, and only their final states are kept. No judged event is missed: the
%% silent arrivals at the end of a history are the only events left out, and they are not judged. A
%% run's arrivals belong to
%% <ul>
%% <li>the robot at which its last event happens;</li>
%% <li>if the last event is SAP's answer to a call: also the receivers of the call's message, which
%%   must have received it;</li>
%% <li>if the last event waits for all messages (a time-out, the passing of time): all robots.</li>
%% </ul>
%% A message that counts as slow or lost, and that would change nothing if it arrived now, need not
%% arrive: while it stays under way, everything that is possible without it remains possible.
-module(starl_check_reduce).

-export([runs/3, choices/3, may_end/3]).
-export_type([run/0]).

-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type state() :: starl_check_state:t().
-type ref() :: starl_check_part:ref().

%% The steps in order, and the result of the last one; `stuck' if nothing can happen any more.
-type run() ::
    {[starl_check_choice:t(), ...], starl_check_step:result()}
    | {[starl_check_choice:t()], stuck}.

%% A set of silent arrivals at one robot: the arrivals in one possible order, the state if no other
%% robot receives anything, and the states before, each with its last arrival.
-record(taken, {
    order = [] :: [ref()],
    state :: state(),
    before = [] :: [{Last :: ref(), #taken{}}]
}).

%% Gives the choices after such arrivals.
-type choose() :: fun((state()) -> [starl_check_choice:t()]).

%% @doc The runs to follow from a state.
-spec runs(state(), model(), store()) -> [run()].
runs(State, Model, Store) ->
    All = all_runs(State, Model, Store),
    [{Choices, left_out(Result, Model, Store)} || {Choices, Result} <- All, Result =/= beyond].

left_out({ok, Traces, State}, Model, Store) ->
    {ok, Traces, starl_check_inert:without(State, Model, Store)};
left_out(Other, _Model, _Store) ->
    Other.

all_runs(State, #{reduce := false} = Model, Store) ->
    [
        {[Choice], starl_check_step:step(Choice, State, Model, Store)}
     || Choice <- choices(State, Model, Store)
    ] ++ [{[], stuck} || starl_check_choice:is_stuck(State, Model, Store)];
all_runs(State, Model, Store) ->
    Places = starl_check_state:places(State),
    Each = [{Place, taken(Place, State, Model, Store)} || Place <- Places],
    lists:append([at(Place, Taken, Model, Store) || {Place, Taken} <- Each]) ++
        [
            {[Choice], starl_check_step:step(Choice, State, Model, Store)}
         || Choice <- starl_check_choice:refusals(State)
        ] ++
        lists:append([answers(Place, State, Each, Model, Store) || Place <- Places]) ++
        everywhere(State, Each, Model, Store).

%% @doc All choices, without reduction.
-spec choices(state(), model(), store()) -> [starl_check_choice:t()].
choices(State, Model, Store) ->
    Places = starl_check_state:places(State),
    lists:append([starl_check_choice:local(Place, State, Model, Store) || Place <- Places]) ++
        starl_check_choice:refusals(State) ++
        [
            Choice
         || Place <- Places, {_, Choice} <- starl_check_choice:outcomes(Place, State, Model, Store)
        ] ++
        starl_check_choice:global(State, Model, Store).

%% @doc Whether all clients are done, or will be after silent arrivals only, without arrivals of
%% messages reported lost.
-spec may_end(state(), model(), store()) -> boolean().
may_end(#{robots := Robots, items := Items} = State, Model, Store) ->
    Kept = State#{items := [I || I <- Items, starl_check_part:age(I) =/= ghost]},
    Places = starl_check_state:places(State),
    Waiting = [P || P <- Places, not starl_check_part:is_done(element(P, Robots), Store)],
    lists:all(fun(Place) -> ends_at(Place, Kept, Model, Store) end, Waiting).

%% This depends only on the robot and on the messages under way to it.
ends_at(Place, #{robots := Robots, stale := Stale} = State, Model, Store) ->
    Mine = starl_check_choice:items([Place], State),
    IsDone = fun(#taken{state = #{robots := Then}}) ->
        starl_check_part:is_done(element(Place, Then), Store)
    end,
    Mine =/= [] andalso
        starl_check_store:memo(
            {may_end, element(Place, Robots), Mine, Stale},
            fun() -> lists:any(IsDone, taken(Place, State, Model, Store)) end,
            Store
        ).

%% -- the kinds of runs ----------------------------------------------------------------------

%% Runs whose last event happens at one robot.
at(Place, Taken, Model, Store) ->
    Choose = fun(State) ->
        [
            Choice
         || Choice <- starl_check_choice:local(Place, State, Model, Store),
            not is_silent(Choice, State, Model, Store)
        ]
    end,
    {Runs, _} = lists:mapfoldl(
        fun(#taken{state = State, before = Before} = One, Known) ->
            Tried = tried(State, Choose, Model, Store),
            Earlier = [{Last, maps:get(Less#taken.state, Known)} || {Last, Less} <- Before],
            {kept([One], Tried, Earlier, Model, Store), Known#{State => Tried}}
        end,
        #{},
        Taken
    ),
    lists:append(Runs).

is_silent({deliver, I}, State, Model, Store) ->
    starl_check_choice:is_silent(I, State, Model, Store);
is_silent(_Choice, _State, _Model, _Store) ->
    false.

%% Runs whose last event tells a robot the outcome of a message.
answers(Place, State, Each, Model, Store) ->
    lists:append([
        answer(Place, Ref, Open, Each, Model, Store)
     || {Ref, Open} <- starl_check_choice:waiting(Place, State, Store)
    ]).

answer(Place, Ref, Open, Each, Model, Store) ->
    Choose = fun(State) ->
        [
            Choice
         || {R, Choice} <- starl_check_choice:outcomes(Place, State, Model, Store), R =:= Ref
        ]
    end,
    Own = lists:keyfind(Place, 1, Each),
    Receivers = [
        {To, [One || One <- Taken, ends_with(Place, Ref, One, Store)]}
     || {To, Taken} <- Each, To =/= Place, lists:member(To, Open)
    ],
    lists:append([follow(Some, Choose, Model, Store) || Some <- product([Own | Receivers])]).

%% Whether the robot has received nothing, or must have received the message of the call last. The
%% answer depends on no other arrival there.
ends_with(Place, Ref, #taken{before = Before}, Store) ->
    lists:all(
        fun({Last, _}) ->
            case starl_check_part:item(Last, Store) of
                {message, Place, _, _, _, Ref, _} -> true;
                _ -> false
            end
        end,
        Before
    ).

%% Runs whose last event waits until nothing is under way, and the test whether the team is stuck. A
%% time-out at one robot does not depend on arrivals at others of messages that already count as
%% slow or lost; the passing of time may.
everywhere(#{late := Late, loss := Loss}, Each, #{grain := Grain} = Model, Store) ->
    Enough = [
        {Place, [One || One <- Taken, left_fresh(Place, One, Store) =< Late + Loss]}
     || {Place, Taken} <- Each
    ],
    Fresh = [{Place, [One || One <- Taken, is_fresh_last(One)]} || {Place, Taken} <- Enough],
    lists:append([stuck(Some, Model, Store) || Some <- product(Fresh)]) ++
        lists:append([
            follow(Some, fires(Place, Model, Store), Model, Store)
         || {Place, Own} <- Enough,
            Some <- product(lists:keyreplace(Place, 1, Fresh, {Place, Own}))
        ]) ++
        lists:append([
            follow(Some, fun(State) -> ticks(State, Model, Store) end, Model, Store)
         || Grain =/= none, Some <- product(Enough)
        ]).

is_fresh_last(#taken{before = Before}) ->
    lists:all(fun({Last, _}) -> starl_check_part:age(Last) =:= fresh end, Before).

fires(Place, Model, Store) ->
    fun(State) ->
        [
            Choice
         || Choice <- starl_check_choice:global(State, Model, Store), fires_at(Place, Choice)
        ]
    end.

fires_at(Place, {still, {fire, At, _}, _}) -> At =:= Place;
fires_at(Place, {fire, At, _}) -> At =:= Place;
fires_at(_Place, _Choice) -> false.

ticks(State, Model, Store) ->
    [tick || tick <- starl_check_choice:global(State, Model, Store)].

left_fresh(Place, #taken{state = #{items := Items} = State}, Store) ->
    length([
        I
     || I <- Items,
        starl_check_part:age(I) =:= fresh,
        starl_check_part:receiver(I) =:= Place,
        starl_check_choice:hears(I, State, Store)
    ]).

stuck(Some, Model, Store) ->
    [
        {deliveries(Some), stuck}
     || starl_check_choice:is_stuck(combined(Some, Model, Store), Model, Store)
    ].

product([]) -> [[]];
product([{_, First} | Rest]) -> [[One | Others] || One <- First, Others <- product(Rest)].

%% -- runs -----------------------------------------------------------------------------------

%% The runs that begin with these arrivals, unless the last arrival can be deferred.
-spec follow([#taken{}], choose(), model(), store()) -> [run()].
follow(Some, Choose, Model, Store) ->
    case tried(combined(Some, Model, Store), Choose, Model, Store) of
        [] ->
            [];
        Tried ->
            Earlier = [
                {Last, tried(combined(Fewer, Model, Store), Choose, Model, Store)}
             || {Last, Fewer} <- one_less(Some)
            ],
            kept(Some, Tried, Earlier, Model, Store)
    end.

%% All choices in a state, with their results.
tried(State, Choose, Model, Store) ->
    [
        {Choice, Result}
     || Choice <- Choose(State),
        Result <- [starl_check_step:step(Choice, State, Model, Store)],
        Result =/= beyond
    ].

%% `Earlier': every arrival that may be the last one, with the choices before it.
kept(Some, Tried, Earlier, Model, Store) ->
    [
        {deliveries(Some) ++ [Choice], Result}
     || {Choice, Result} <- Tried, not may_wait(Choice, Result, Earlier, Model, Store)
    ].

deliveries(Some) -> [{deliver, I} || #taken{order = Order} <- Some, I <- Order].

combined([#taken{state = State} | Others], Model, Store) ->
    lists:foldl(
        fun({deliver, _} = Choice, Reached) ->
            {ok, _, Next} = starl_check_step:step(Choice, Reached, Model, Store),
            Next
        end,
        State,
        deliveries(Others)
    ).

one_less([]) ->
    [];
one_less([#taken{before = Before} = One | Others]) ->
    [{Last, [Less | Others]} || {Last, Less} <- Before] ++
        [{Last, [One | Fewer]} || {Last, Fewer} <- one_less(Others)].

%% Whether the last arrival can be deferred until after the event with the same result.
may_wait(Choice, {ok, _, Reached}, Earlier, Model, Store) ->
    lists:any(
        fun({Last, Tried}) ->
            case lists:keyfind(Choice, 1, Tried) of
                {Choice, {ok, _, Next}} -> may_follow(Last, Next, Reached, Model, Store);
                _ -> false
            end
        end,
        Earlier
    );
may_wait(_Choice, {violation, _, _}, _Earlier, _Model, _Store) ->
    false.

may_follow(Last, #{items := Items} = State, Reached, Model, Store) ->
    lists:member(Last, Items) andalso
        starl_check_choice:is_silent(Last, State, Model, Store) andalso
        is_same(starl_check_step:step({deliver, Last}, State, Model, Store), Reached).
is_same({ok, _, Next}, Reached) -> Next =:= Reached;
is_same(_Violation, _Reached) -> false.

%% -- silent arrivals ------------------------------------------------------------------------

%% All sets of silent arrivals at a robot, smaller sets first.
taken(Place, State, Model, Store) -> grow([#taken{state = State}], Place, Model, Store).

grow([], _Place, _Model, _Store) ->
    [];
grow(Level, Place, Model, Store) ->
    Arrivals = [
        {Next, {I, One}}
     || #taken{state = State} = One <- Level,
        I <- starl_check_choice:arriving(Place, State, Store),
        starl_check_choice:is_silent(I, State, Model, Store),
        {ok, _, Next} <- [starl_check_step:step({deliver, I}, State, Model, Store)],
        matters(I, State, Next)
    ],
    Reached = gathered(Arrivals),
    Larger = [
        #taken{order = One#taken.order ++ [I], state = Next, before = Before}
     || {Next, [{I, One} | _] = Before} <- lists:sort(maps:to_list(Reached))
    ],
    Level ++ grow(Larger, Place, Model, Store).

gathered(Arrivals) ->
    lists:foldr(
        fun({Next, By}, Known) -> Known#{Next => [By | maps:get(Next, Known, [])]} end,
        #{},
        Arrivals
    ).

matters(I, #{robots := Robots}, #{robots := Changed}) ->
    Robots =/= Changed orelse starl_check_part:age(I) =:= fresh.
