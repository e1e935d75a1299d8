%% @doc The machine of the barrier: it counts the rounds of each name.
%% ```
%%   robot                                       all others
%%     | reached {Name, K} ------------------------->|   once, when the robot reaches round K
%%     |<------------------------ reached {Name, K}  |   from each
%%     |   all have reached K, and know that I have: pass
%%     | reached {Name, K, ask} -------------------->|   now and then, to those it misses
%%     |<--- reached {Name, their K, what they know} |
%%
%%     | who --------------------------------------->|   if its store is damaged, or may be old
%%     |<-------- told [{Name, their K, my K, ...}]  |
%%     | who, after the last of these names -------->|   if these are not all
%% '''
%% For each name a robot keeps the rounds that each robot has reached ({@link starl_barrier_gate}).
%% These counts only grow, so a message that is late or comes twice changes nothing. No entry is
%% ever deleted, so such a message brings none back.
%%
%% Names are bounded. The application may use `names' of them; a further name is answered with
%% `{error, full}'. A name that only others have used is kept for the robot that was first heard to
%% use it, at most twice `names' for each robot. If a name was not kept, its counts are asked for
%% when the application uses it. So a robot that invents names takes no room from others.
%%
%% The robot stores its own counts: a reached round before it announces it, a passed round before it
%% answers. So they survive a crash of the machine and a reboot of the robot. The robot asks for the
%% others' counts when it next waits for them.
%%
%% In a later life of the robot, its store may be older than its last life. So all others confirm
%% its counts before it takes part in a new round. Usually no other robot knows of a later round
%% than the store.
%%
%% If another robot does, or if the store is damaged, the others report this robot's count. Any of
%% them can: a robot passes only when it also knows that all others know that it has reached the
%% round. They know the round that it reached, not whether it passed. If one of them has not reached
%% that round itself, no robot has passed it. Else it counts as passed, so the next `sync' is for
%% the round after it and waits for all.
%%
%% Calls. `{round, Name}': the answer is the application's progress
%% ({@link starl_barrier_gate:progress()}), or `{error, full}'. `{sync, Name, Progress, Us}': the
%% answer is `ok' or `{error, timeout}'. `{resume, Name, Progress}', after a crash: the application
%% has not passed this round. Trace: {@link event()}.
-module(starl_barrier_rounds).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

%% The trace of each round of a name.
-type event() ::
    {reached, starl_barrier:name(), starl_barrier:round()}
    | {passed, starl_barrier:name(), starl_barrier:round()}
    %% with these counts the machine starts again: a life that ended in the middle of a step may
    %% have stored a round, and not have told of it
    | {recalled, starl_barrier:name(), Reached :: starl_barrier:round(),
        Passed :: starl_barrier:round()}
    %% the caller waits no longer: its patience is at an end, or SAP has restarted
    | {failed, starl_barrier:name(), starl_barrier:round(), timeout | restarted}.

-record(barrier, {
    others :: [starl:robot_id()],
    incarnation :: pos_integer(),
    retry_us :: pos_integer(),
    gates = #{} :: #{starl_barrier:name() => starl_barrier_gate:t()},
    %% the most names that the application may use
    names :: pos_integer(),
    %% the names that only others have used, by the robot that was first heard to
    foreign = #{} :: #{starl:robot_id() => #{starl_barrier:name() => true}},
    %% are this robot's earlier rounds known, from its store or from the others?
    settled :: boolean(),
    %% are the stored counts complete, or those of some names only?
    extent :: complete | partial,
    %% if they are not known: the robots that have not answered yet, and those that have answered
    %% and knew their own counts
    unanswered = [] :: [starl:robot_id()],
    witnesses = [] :: [starl:robot_id()],
    %% the callers that asked for a round before that was known
    asking = #{} :: #{{starl_machine:name(), starl_barrier:name()} => starl_machine:from()}
}).

-spec init(starl_machine:config()) -> {ready, #barrier{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    #{stored := Stored, retry_ms := RetryMs, names := Names} =
        maps:merge(starl_options:defaults(starl_barrier:options()), Config),
    Others = starl_team:others(Self, Team),
    IsSure = Others =:= [] orelse maps:get(life, Config, {0, 1}) =:= {0, 1},
    {Extent, Gates, Foreign} = recall(Stored, IsSure),
    Settled = Others =:= [] orelse (IsSure andalso Extent =:= complete),
    Barrier = #barrier{
        others = Others,
        incarnation = Incarnation,
        retry_us = 1000 * RetryMs,
        gates = Gates,
        names = Names,
        foreign = Foreign,
        settled = Settled,
        extent = Extent,
        unanswered = [Other || Other <- Others, not Settled]
    },
    Listen = starl_sap:listen(barrier, barrier),
    {ready, Barrier, recalled(Barrier) ++ [Listen | ask_others(Barrier)]}.

recalled(#barrier{gates = Gates}) ->
    [
        {trace, {recalled, Name, Reached, Passed}}
     || {Name, Gate} <- lists:sort(maps:to_list(Gates)),
        {Reached, Passed, _} <- [starl_barrier_gate:counts(Gate)]
    ].

recall(none, _IsSure) ->
    {complete, #{}, #{}};
recall({stored, {Extent, Counts}}, IsSure) ->
    recall({stored, {Extent, Counts, #{}}}, IsSure);
recall({stored, {Extent, Counts, Foreign}}, IsSure) ->
    Gates = maps:map(fun(_Name, Count) -> starl_barrier_gate:recall(Count, IsSure) end, Counts),
    {Extent, Gates, Foreign};
recall(damaged, _IsSure) ->
    {partial, #{}, #{}}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #barrier{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {round, Name}, ready, Barrier, _Meta) ->
    round_of(From, Name, Barrier);
handle_event({call, From}, {sync, Name, Progress, Us}, ready, Barrier, _Meta) ->
    sync(From, Name, Progress, Us, Barrier);
handle_event({call, From}, {resume, Name, Progress}, ready, Barrier, _Meta) ->
    Own = own(Name, Barrier),
    Gate = starl_barrier_gate:resume(Progress, gate(Name, Own)),
    {keep_state, put_gate(Name, Gate, Own), [{reply, From, ok}]};
handle_event(cast, {message, From, barrier, Message}, ready, Barrier, _Meta) ->
    message(Message, From, Barrier);
handle_event({reply, {announced, Name, Round}}, Outcome, ready, Barrier, _Meta) ->
    announced(Name, Round, Outcome, Barrier);
handle_event({timeout, {again, Name}}, _, ready, Barrier, _Meta) ->
    again(Name, Barrier);
handle_event({timeout, {patience, Name}}, _, ready, Barrier, _Meta) ->
    give_up(Name, timeout, Barrier);
handle_event({timeout, untold}, _, ready, Barrier, _Meta) ->
    {keep_state, Barrier, ask_others(Barrier)};
handle_event(info, {restarted, sap}, ready, _Barrier, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(barrier, barrier)]};
handle_event(info, {Gone, Caller}, ready, Barrier, _Meta) when
    Gone =:= restarted; Gone =:= given_up
->
    caller_restarted(Caller, Barrier);
handle_event(_, _, _, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(barrier, {reached, _, _, _, _} = Body) ->
    starl_shape:is([any, label, natural, natural, boolean], Body);
accepts(barrier, {who, Incarnation}) ->
    starl_shape:is(count, Incarnation);
accepts(barrier, {who, _, _} = Body) ->
    starl_shape:is([any, count, label], Body);
accepts(barrier, {told, _, _, _} = Body) ->
    starl_shape:is([any, count, boolean, facts()], Body);
accepts(barrier, {part, _, _} = Body) ->
    starl_shape:is([any, count, facts()], Body);
accepts(_Type, _Body) ->
    false.

facts() -> {list, [label, natural, natural, natural]}.

message({reached, Name, Round, Known, Answer}, From, Barrier) ->
    Heard = hear(Name, From, Round, Known, admit(Name, From, Barrier)),
    {keep_state, Passed, Actions} = check(Name, [], Heard),
    {keep_state, Passed, [report(Name, From, false, Passed) || Answer] ++ Actions};
message({who, Incarnation}, From, Barrier) ->
    {keep_state, Barrier, [answer(From, Incarnation, facts(From, Barrier), Barrier)]};
message({who, Incarnation, After}, From, Barrier) ->
    Facts = [Fact || Fact <- facts(From, Barrier), element(1, Fact) > After],
    {keep_state, Barrier, [answer(From, Incarnation, Facts, Barrier)]};
message({told, Incarnation, Certain, Facts}, From, #barrier{incarnation = Incarnation} = Barrier) ->
    has_answered(Certain, From, learn(Facts, From, Barrier));
message({part, Incarnation, Facts}, From, #barrier{incarnation = Incarnation} = Barrier) ->
    More = [
        starl_sap:post(From, barrier, {who, Incarnation, element(1, lists:last(Facts))})
     || Facts =/= []
    ],
    {keep_state, learn(Facts, From, Barrier), More};
message({part, _Earlier, _Facts}, _From, _Barrier) ->
    keep_state_and_data;
message({told, _Earlier, _Certain, _Facts}, _From, _Barrier) ->
    keep_state_and_data;
message(_, _, _) ->
    unknown_event.

%% -- the robot's own rounds -----------------------------------------------------------------

%% The round not passed yet. In a later life, or if the store is damaged, the others are asked first.
round_of({Caller, _} = From, Name, #barrier{asking = Asking} = Barrier) ->
    Gate = gate(Name, Barrier),
    case starl_barrier_gate:is_sure(Gate) of
        false -> {keep_state, Barrier#barrier{asking = Asking#{{Caller, Name} => From}}, []};
        true -> {keep_state, Barrier, [{reply, From, progress(Name, Barrier)}]}
    end.

progress(Name, Barrier) ->
    case may_use(Name, Barrier) of
        true -> starl_barrier_gate:progress(gate(Name, Barrier));
        false -> {error, full}
    end.

sync(From, Name, {Round, _} = Progress, Us, Barrier0) ->
    Barrier = own(Name, Barrier0),
    Gate = gate(Name, Barrier),
    case starl_barrier_gate:is_passed(Round, Gate) of
        true ->
            Notified = put_gate(Name, starl_barrier_gate:notified(Round, Gate), Barrier),
            {keep_state, Notified, [{reply, From, ok}]};
        false ->
            reach(From, Name, Progress, Us, Barrier)
    end.

reach(From, Name, {Round, _} = Progress, Us, #barrier{others = Others} = Barrier) ->
    {Which, Gate} = starl_barrier_gate:reach(Progress, From, Others, gate(Name, Barrier)),
    At = put_gate(Name, Gate, Barrier),
    First =
        case Which of
            new -> announce(Name, Round, At) ++ ask_forgotten(Name, At);
            again -> ask_missing(Name, At)
        end,
    Timers = [
        {{timeout, {again, Name}}, Barrier#barrier.retry_us, again},
        {{timeout, {patience, Name}}, Us, patience}
    ],
    check(Name, First ++ Timers, At).

%% The counts that the others told before a crash are asked for again.
ask_forgotten(_Name, #barrier{incarnation = 1}) ->
    [];
ask_forgotten(Name, Barrier) ->
    [
        report(Name, Robot, true, Barrier)
     || Robot <- starl_barrier_gate:unheard(gate(Name, Barrier))
    ].

announce(Name, Round, Barrier) ->
    Announce =
        {call, sap, {broadcast, barrier, {reached, Name, Round, 0, false}},
            {announced, Name, Round}},
    [store(Barrier), {trace, {reached, Name, Round}}, Announce].

%% The counts that must not be forgotten: the robot's own; `partial': of these names only. With them the names
%% that others have told this robot to have reached, and that its application has not used since.
store(#barrier{gates = Gates, extent = Extent, foreign = Foreign}) ->
    Counts = maps:filter(
        fun(_Name, Count) -> Count =/= none andalso Count =/= {0, 0, 0} end,
        maps:map(fun(_Name, Gate) -> starl_barrier_gate:counts(Gate) end, Gates)
    ),
    Kept = maps:map(fun(_Robot, Names) -> maps:with(maps:keys(Counts), Names) end, Foreign),
    case maps:filter(fun(_Robot, Names) -> map_size(Names) > 0 end, Kept) of
        None when map_size(None) =:= 0 -> {store, {Extent, Counts}};
        Some -> {store, {Extent, Counts, Some}}
    end.

%% Passes, if all robots have reached the round and know it of this one.
check(Name, Actions, Barrier) ->
    case starl_barrier_gate:pass(gate(Name, Barrier)) of
        {passed, From, Round, Gate} ->
            Passed = put_gate(Name, Gate, Barrier),
            Done = [{trace, {passed, Name, Round}}, {reply, From, ok} | stop(Name)],
            {keep_state, Passed, Actions ++ [store(Passed) | Done]};
        waits ->
            {keep_state, Barrier, Actions}
    end.

stop(Name) -> [{{timeout, {Timer, Name}}, cancel} || Timer <- [again, patience]].

again(Name, #barrier{retry_us = Retry} = Barrier) ->
    case starl_barrier_gate:caller(gate(Name, Barrier)) of
        none ->
            keep_state_and_data;
        {_, _} ->
            Again = {{timeout, {again, Name}}, Retry, again},
            {keep_state, Barrier, [Again | ask_missing(Name, Barrier)]}
    end.

ask_missing(Name, Barrier) ->
    [
        report(Name, Robot, true, Barrier)
     || Robot <- starl_barrier_gate:missed(gate(Name, Barrier))
    ].

%% The robot has reached the round all the same, and answers those that ask.
give_up(Name, Why, Barrier) ->
    Gate = gate(Name, Barrier),
    case starl_barrier_gate:caller(Gate) of
        none ->
            keep_state_and_data;
        {_, _} = From ->
            {At, _, _} = starl_barrier_gate:counts(Gate),
            Failed = [{trace, {failed, Name, At, Why}}, {reply, From, {error, Why}}],
            {keep_state, put_gate(Name, starl_barrier_gate:fail(Gate), Barrier),
                Failed ++ stop(Name)}
    end.

caller_restarted(Caller, #barrier{gates = Gates, asking = Asking} = Barrier) ->
    Names = [
        Name
     || {Name, Gate} <- lists:sort(maps:to_list(Gates)),
        {C, _} <- [starl_barrier_gate:caller(Gate)],
        C =:= Caller
    ],
    Left = Barrier#barrier{asking = maps:filter(fun({C, _}, _) -> C =/= Caller end, Asking)},
    lists:foldl(
        fun(Name, {keep_state, B, Actions}) ->
            {keep_state, Next, More} = give_up(Name, restarted, B),
            {keep_state, Next, Actions ++ More}
        end,
        {keep_state, Left, []},
        Names
    ).

%% -- the others -----------------------------------------------------------------------------

hear(Name, Robot, Round, Known, Barrier) ->
    put_gate(Name, starl_barrier_gate:hear(Robot, Round, Known, gate(Name, Barrier)), Barrier).

%% The outcome of the announcement tells which robots know it.
announced(Name, Round, Outcome, #barrier{others = Others} = Barrier) ->
    Deaf =
        case Outcome of
            ok -> [];
            {error, {lost, Lost}} -> Lost;
            {error, overload} -> Others
        end,
    Know = lists:foldl(
        fun(Robot, B) -> hear(Name, Robot, 0, Round, B) end, Barrier, Others -- Deaf
    ),
    check(Name, [], Know).

report(Name, To, Answer, Barrier) ->
    {At, Reached, _} = starl_barrier_gate:fact(To, gate(Name, Barrier)),
    starl_sap:post(To, barrier, {reached, Name, At, Reached, Answer}).

%% -- after a reboot, or a damaged store -----------------------------------------------------

ask_others(#barrier{unanswered = []}) ->
    [];
ask_others(#barrier{unanswered = Unanswered, incarnation = Incarnation, retry_us = Retry}) ->
    [
        {{timeout, untold}, Retry, again}
        | [starl_sap:post(Other, barrier, {who, Incarnation}) || Other <- Unanswered]
    ].

%% A robot's knowledge of each name: its own count, the asker's, and the last round that all have
%% surely reached. Names that neither of the two has reached are not told.
facts(Asker, #barrier{gates = Gates}) ->
    [
        {Name, At, Reached, All}
     || {Name, Gate} <- lists:sort(maps:to_list(Gates)),
        {At, Reached, All} <- [starl_barrier_gate:fact(Asker, Gate)],
        At > 0 orelse Reached > 0 orelse All > 0
    ].

%% What does not fit into one message is asked for in parts.
answer(To, Incarnation, Facts, #barrier{settled = Settled}) ->
    case starl_payload:parts(Facts) of
        [All] -> starl_sap:post(To, barrier, {told, Incarnation, Settled, All});
        [First | _] -> starl_sap:post(To, barrier, {part, Incarnation, First})
    end.

learn(Facts, From, Barrier) ->
    lists:foldl(
        fun({Name, Round, Known, All}, B0) ->
            B = admit(Name, From, B0),
            put_gate(Name, starl_barrier_gate:learn(From, Round, Known, All, gate(Name, B)), B)
        end,
        Barrier,
        Facts
    ).

has_answered(Certain, From, #barrier{unanswered = Unanswered, witnesses = Witnesses} = Barrier) ->
    Learned = Barrier#barrier{
        unanswered = lists:delete(From, Unanswered),
        witnesses = [From || Certain] ++ lists:delete(From, Witnesses)
    },
    case Learned of
        #barrier{settled = false, unanswered = []} -> settle(Learned);
        #barrier{} -> {keep_state, Learned, []}
    end.

%% All others have answered.
settle(#barrier{gates = Gates, witnesses = Witnesses, asking = Asking} = Barrier) ->
    #barrier{others = Others} = Barrier,
    %% monitors learn that the store was no good
    Outdated = lists:any(fun starl_barrier_gate:is_outdated/1, maps:values(Gates)),
    Assured = maps:map(
        fun(_, Gate) -> starl_barrier_gate:assure(Witnesses, Others, Gate) end, Gates
    ),
    Settled = Barrier#barrier{settled = true, extent = complete, gates = Assured},
    Replies = [
        {reply, From, progress(Name, Settled)}
     || {{_Caller, Name}, From} <- lists:sort(maps:to_list(Asking))
    ],
    {keep_state, Settled#barrier{asking = #{}}, [{trace, store_damaged} || Outdated] ++ Replies}.

gate(Name, #barrier{gates = Gates, settled = Settled}) ->
    maps:get(Name, Gates, starl_barrier_gate:new(Settled)).

%% A name for which there is no room is not kept.
put_gate(Name, Gate, #barrier{gates = Gates} = Barrier) when is_map_key(Name, Gates) ->
    Barrier#barrier{gates = Gates#{Name := Gate}};
put_gate(_Name, _Gate, Barrier) ->
    Barrier.

%% -- the room for names ---------------------------------------------------------------------

%% May the application use this name?
may_use(Name, #barrier{gates = Gates, names = Most, foreign = Foreign} = Barrier) ->
    Own = map_size(Gates) - lists:sum([map_size(Names) || Names <- maps:values(Foreign)]),
    Own < Most orelse is_own(Name, Barrier).

is_own(Name, #barrier{gates = Gates, foreign = Foreign}) ->
    is_map_key(Name, Gates) andalso
        not lists:any(fun(Names) -> is_map_key(Name, Names) end, maps:values(Foreign)).

%% The application uses the name.
own(Name, #barrier{foreign = Foreign} = Barrier) ->
    Others = maps:map(fun(_Robot, Names) -> maps:remove(Name, Names) end, Foreign),
    known(Name, Barrier#barrier{foreign = Others}).

%% Another robot uses the name: it is kept, if there is room among those of that robot.
admit(Name, _From, #barrier{gates = Gates} = Barrier) when is_map_key(Name, Gates) ->
    Barrier;
admit(Name, From, #barrier{names = Most, foreign = Foreign} = Barrier) ->
    case maps:get(From, Foreign, #{}) of
        Names when map_size(Names) < 2 * Most ->
            known(Name, Barrier#barrier{foreign = Foreign#{From => Names#{Name => true}}});
        _Full ->
            Barrier
    end.

known(Name, #barrier{gates = Gates} = Barrier) ->
    Barrier#barrier{gates = Gates#{Name => gate(Name, Barrier)}}.
