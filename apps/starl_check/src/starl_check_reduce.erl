%% @doc Partial-order reduction: which runs of choices lead from one state that is kept to the
%% next.
%%
%% Most messages that arrive change nothing but what their receiver knows (see
%% {@link starl_check_choice:is_silent/4}). Such an arrival and whatever happens at another robot
%% come to the same in either order: a message that is under way stays so. So in any history an
%% arrival of this kind can be put off, past the events of other robots, and past those of its
%% own that it commutes with, until right before the first event that would come out differently
%% ("receives are right movers", Lipton 1975; here it is tried out, case by case, on the states
%% themselves). What comes about is a history with the same events that are judged, in the same
%% order, and of the same length, made of runs:
%% ```
%%   silent arrivals, none of which could be put off . one event that is not silent
%% '''
%% Only runs like these are followed, and only what they lead to is kept. What a monitor can see
%% is all seen: the silent arrivals at the end of a history are the only events left out, and they
%% are not judged. A run's arrivals belong to
%% <ul>
%% <li>the robot at which its last event happens;</li>
%% <li>where the last event is SAP's answer to a call: also the receivers of the call's message,
%%   which are to have got it;</li>
%% <li>where it is one that waits for all messages (a time-out, the passing of time): all
%%   robots.</li>
%% </ul>
%% A message that counts as slow or lost, and that would change nothing if it arrived now, need not
%% do so: as long as it stays under way all remains possible that is possible without it.
-module(starl_check_reduce).

-export([runs/3, choices/3, may_end/3]).
-export_type([run/0]).

-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type state() :: starl_check_state:t().
-type ref() :: starl_check_part:ref().

%% What happens one after the other, and what the last of it leads to; `stuck' if nothing can
%% happen any more.
-type run() ::
    {[starl_check_choice:t(), ...], starl_check_step:result()}
    | {[starl_check_choice:t()], stuck}.

%% What one robot may have taken of what is silent: in one of the orders that lead here, the
%% state if no other robot takes anything, and from where it has come by which last arrival.
-record(taken, {
    order = [] :: [ref()],
    state :: state(),
    before = [] :: [{Last :: ref(), #taken{}}]
}).

%% What may happen after such arrivals.
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

%% @doc All that may happen, without reduction.
-spec choices(state(), model(), store()) -> [starl_check_choice:t()].
choices(State, Model, Store) ->
    Places = starl_check_state:places(State),
    lists:append([starl_check_choice:local(Place, State, Model, Store) || Place <- Places]) ++
        starl_check_choice:refusals(State) ++
        [
            Choice
         || Place <- Places, {_, Choice} <- starl_check_choice:outcomes(Place, State, Store)
        ] ++
        starl_check_choice:global(State, Model, Store).

%% @doc Are all clients done, or is nothing missing for it but silent arrivals? Not of what was
%% reported lost.
-spec may_end(state(), model(), store()) -> boolean().
may_end(#{robots := Robots, items := Items} = State, Model, Store) ->
    Kept = State#{items := [I || I <- Items, starl_check_part:age(I) =/= ghost]},
    Places = starl_check_state:places(State),
    Waiting = [P || P <- Places, not starl_check_part:is_done(element(P, Robots), Store)],
    lists:all(fun(Place) -> ends_at(Place, Kept, Model, Store) end, Waiting).

%% It depends on the robot and on what is under way to it.
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

%% What happens at one robot.
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

%% A robot hears what has become of its messages.
answers(Place, State, Each, Model, Store) ->
    lists:append([
        answer(Place, Ref, Open, Each, Model, Store)
     || {Ref, Open} <- starl_check_choice:waiting(Place, State, Store)
    ]).

answer(Place, Ref, Open, Each, Model, Store) ->
    Choose = fun(State) ->
        [
            Choice
         || {R, Choice} <- starl_check_choice:outcomes(Place, State, Store), R =:= Ref
        ]
    end,
    Own = lists:keyfind(Place, 1, Each),
    Receivers = [
        {To, [One || One <- Taken, ends_with(Place, Ref, One, Store)]}
     || {To, Taken} <- Each, To =/= Place, lists:member(To, Open)
    ],
    lists:append([follow(Some, Choose, Model, Store) || Some <- product([Own | Receivers])]).

%% Has the robot taken nothing, or must the message of the call be what it has taken last? The
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

%% What waits until nothing is under way; and is that the end? A time-out at one robot does not
%% depend on what others take that counts as slow or lost already, the passing of time may.
everywhere(#{late := Late, loss := Loss}, Each, #{grain := Grain} = Model, Store) ->
    Enough = [
        {Place, [One || One <- Taken, left_fresh(Place, One) =< Late + Loss]}
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
         || {fire, At, _} = Choice <- starl_check_choice:global(State, Model, Store), At =:= Place
        ]
    end.

ticks(State, Model, Store) ->
    [tick || tick <- starl_check_choice:global(State, Model, Store)].

left_fresh(Place, #taken{state = #{items := Items}}) ->
    length([
        I
     || I <- Items,
        starl_check_part:age(I) =:= fresh,
        starl_check_part:receiver(I) =:= Place
    ]).

stuck(Some, Model, Store) ->
    [
        {deliveries(Some), stuck}
     || starl_check_choice:is_stuck(combined(Some, Model, Store), Model, Store)
    ].

product([]) -> [[]];
product([{_, First} | Rest]) -> [[One | Others] || One <- First, Others <- product(Rest)].

%% -- runs -----------------------------------------------------------------------------------

%% The runs that begin with these arrivals, unless the last of them could be put off.
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

%% All that may happen in a state, and what it leads to.
tried(State, Choose, Model, Store) ->
    [
        {Choice, Result}
     || Choice <- Choose(State),
        Result <- [starl_check_step:step(Choice, State, Model, Store)],
        Result =/= beyond
    ].

%% `Earlier': every arrival that may be the last one, and what may happen before it.
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

%% Could the last arrival come after the event, and all would be the same?
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

%% Everything that a robot may have taken of what is silent, fewer arrivals first.
taken(Place, State, Model, Store) -> grow([#taken{state = State}], Place, Model, Store).

grow([], _Place, _Model, _Store) ->
    [];
grow(Level, Place, Model, Store) ->
    Arrivals = [
        {Next, {I, One}}
     || #taken{state = State} = One <- Level,
        I <- starl_check_choice:items([Place], State),
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
