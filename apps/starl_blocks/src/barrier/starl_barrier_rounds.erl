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
%% '''
%% For each name a robot keeps the rounds that each robot has reached ({@link starl_barrier_gate}).
%% These counts only grow, so a message that is late or comes twice changes nothing. No entry is
%% ever deleted, so such a message brings none back.
%%
%% The robot stores its own counts: a reached round before it announces it, a passed round before it
%% answers. So they outlive a crash of the machine and a reboot of the robot. It asks for the
%% others' counts when it next waits for them.
%%
%% In the later lives of the robot its store may be an earlier one than that of its last life: all
%% others confirm its counts before it takes part in a new round. As a rule no other one knows a later
%% round of this robot than its store.
%%
%% If one does, or the store is damaged, the others tell this robot's count. Any of them can: a robot
%% passes only when it also knows that all others know that it has reached the round. They know the
%% round that it reached, not whether it passed. If one of them has not reached that round itself,
%% no robot has passed it; else it counts as passed, so the next `sync' is for the round after it
%% and waits for all.
%%
%% Calls: `{round, Name}' (the turn of the next `sync', {@link starl_barrier_gate:turn()}), `{sync,
%% Name, Turn, Us}' (answer `ok' or `{error, timeout}'), `{resume, Name, Turn}' (after a crash: the
%% application has not passed this round). Trace: {@link event()}.
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

-define(RETRY_MS, 3000).

-record(barrier, {
    others :: [starl:robot_id()],
    incarnation :: pos_integer(),
    retry_us :: pos_integer(),
    gates = #{} :: #{starl_barrier:name() => starl_barrier_gate:t()},
    %% are this robot's earlier rounds known, from its store or from the others?
    settled :: boolean(),
    %% are the stored counts complete, or those of some names only?
    extent :: complete | partial,
    %% if they are not known: the robots that have not answered yet, and those that have answered
    %% and knew their own counts
    untold = [] :: [starl:robot_id()],
    witnesses = [] :: [starl:robot_id()],
    %% the callers that asked for a round before that was known
    asking = #{} :: #{{starl_machine:name(), starl_barrier:name()} => starl_machine:from()}
}).

-spec init(starl_machine:config()) -> {ready, #barrier{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    #{stored := Stored} = Config,
    Others = starl_team:others(Self, Team),
    IsSure = Others =:= [] orelse maps:get(life, Config, {0, 1}) =:= {0, 1},
    {Extent, Gates} = recall(Stored, IsSure),
    Settled = Others =:= [] orelse (IsSure andalso Extent =:= complete),
    Barrier = #barrier{
        others = Others,
        incarnation = Incarnation,
        retry_us = 1000 * maps:get(retry_ms, Config, ?RETRY_MS),
        gates = Gates,
        settled = Settled,
        extent = Extent,
        untold = [Other || Other <- Others, not Settled]
    },
    Listen = starl_sap:listen(barrier, barrier),
    {ready, Barrier, recalled(Barrier) ++ [Listen | ask_untold(Barrier)]}.

recalled(#barrier{gates = Gates}) ->
    [
        {trace, {recalled, Name, Reached, Passed}}
     || {Name, Gate} <- lists:sort(maps:to_list(Gates)),
        {Reached, Passed, _} <- [starl_barrier_gate:counts(Gate)]
    ].

recall(none, _IsSure) ->
    {complete, #{}};
recall({stored, {Extent, Counts}}, IsSure) ->
    {Extent, maps:map(fun(_Name, Count) -> starl_barrier_gate:recall(Count, IsSure) end, Counts)};
recall(damaged, _IsSure) ->
    {partial, #{}}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #barrier{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {round, Name}, ready, Barrier, _Meta) ->
    round_of(From, Name, Barrier);
handle_event({call, From}, {sync, Name, Turn, Us}, ready, Barrier, _Meta) ->
    sync(From, Name, Turn, Us, Barrier);
handle_event({call, From}, {resume, Name, Turn}, ready, Barrier, _Meta) ->
    Gate = starl_barrier_gate:resume(Turn, gate(Name, Barrier)),
    {keep_state, put_gate(Name, Gate, Barrier), [{reply, From, ok}]};
handle_event(cast, {message, From, barrier, Message}, ready, Barrier, _Meta) ->
    message(Message, From, Barrier);
handle_event({reply, {announced, Name, Round}}, Outcome, ready, Barrier, _Meta) ->
    announced(Name, Round, Outcome, Barrier);
handle_event({timeout, {again, Name}}, _, ready, Barrier, _Meta) ->
    again(Name, Barrier);
handle_event({timeout, {patience, Name}}, _, ready, Barrier, _Meta) ->
    give_up(Name, timeout, Barrier);
handle_event({timeout, untold}, _, ready, Barrier, _Meta) ->
    {keep_state, Barrier, ask_untold(Barrier)};
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
    starl_shape:is([any, any, natural, natural, boolean], Body);
accepts(barrier, {who, Incarnation}) ->
    starl_shape:is(count, Incarnation);
accepts(barrier, {told, _, _, _} = Body) ->
    Facts = {list, [any, natural, natural, natural]},
    starl_shape:is([any, count, boolean, Facts], Body);
accepts(_Type, _Body) ->
    false.

message({reached, Name, Round, Known, Answer}, From, Barrier) ->
    Heard = hear(Name, From, Round, Known, Barrier),
    {keep_state, Passed, Actions} = check(Name, [], Heard),
    {keep_state, Passed, [report(Name, From, false, Passed) || Answer] ++ Actions};
message({who, Incarnation}, From, #barrier{gates = Gates, settled = Settled} = Barrier) ->
    Facts = [fact(From, Named) || Named <- lists:sort(maps:to_list(Gates))],
    {keep_state, Barrier, [starl_sap:post(From, barrier, {told, Incarnation, Settled, Facts})]};
message({told, Incarnation, Certain, Facts}, From, #barrier{incarnation = Incarnation} = Barrier) ->
    told(Certain, Facts, From, Barrier);
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
        true -> {keep_state, Barrier, [{reply, From, starl_barrier_gate:turn(Gate)}]}
    end.

sync(From, Name, {Round, _} = Turn, Us, Barrier) ->
    Gate = gate(Name, Barrier),
    case starl_barrier_gate:is_passed(Round, Gate) of
        true ->
            Told = put_gate(Name, starl_barrier_gate:tell(Round, Gate), Barrier),
            {keep_state, Told, [{reply, From, ok}]};
        false ->
            reach(From, Name, Turn, Us, Barrier)
    end.

reach(From, Name, {Round, _} = Turn, Us, #barrier{others = Others} = Barrier) ->
    {Which, Gate} = starl_barrier_gate:reach(Turn, From, Others, gate(Name, Barrier)),
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

%% The counts that must not be forgotten: the robot's own; `partial': of these names only.
store(#barrier{gates = Gates, extent = Extent}) ->
    Counts = maps:map(fun(_Name, Gate) -> starl_barrier_gate:counts(Gate) end, Gates),
    {store, {Extent, maps:filter(fun(_Name, Count) -> Count =/= none end, Counts)}}.

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
            Told = [{trace, {failed, Name, At, Why}}, {reply, From, {error, Why}}],
            {keep_state, put_gate(Name, starl_barrier_gate:fail(Gate), Barrier), Told ++ stop(Name)}
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

ask_untold(#barrier{untold = []}) ->
    [];
ask_untold(#barrier{untold = Untold, incarnation = Incarnation, retry_us = Retry}) ->
    [
        {{timeout, untold}, Retry, again}
        | [starl_sap:post(Other, barrier, {who, Incarnation}) || Other <- Untold]
    ].

%% A robot's knowledge of a name: its own count, the asker's, and the last round that all have
%% surely reached.
fact(Asker, {Name, Gate}) ->
    {At, Reached, All} = starl_barrier_gate:fact(Asker, Gate),
    {Name, At, Reached, All}.

told(Certain, Facts, From, #barrier{untold = Untold, witnesses = Witnesses} = Barrier) ->
    Learned = lists:foldl(
        fun({Name, Round, Known, All}, B) ->
            Gate = starl_barrier_gate:learn(From, Round, Known, All, gate(Name, B)),
            put_gate(Name, Gate, B)
        end,
        Barrier#barrier{
            untold = lists:delete(From, Untold),
            witnesses = [From || Certain] ++ lists:delete(From, Witnesses)
        },
        Facts
    ),
    case Learned of
        #barrier{settled = false, untold = []} -> settle(Learned);
        #barrier{} -> {keep_state, Learned, []}
    end.

%% The others have told all that they know.
settle(#barrier{gates = Gates, witnesses = Witnesses, asking = Asking} = Barrier) ->
    #barrier{others = Others} = Barrier,
    %% monitors learn that the store was no good
    Outdated = lists:any(fun starl_barrier_gate:is_outdated/1, maps:values(Gates)),
    Assured = maps:map(
        fun(_, Gate) -> starl_barrier_gate:assure(Witnesses, Others, Gate) end, Gates
    ),
    Settled = Barrier#barrier{settled = true, extent = complete, gates = Assured},
    Replies = [
        {reply, From, starl_barrier_gate:turn(gate(Name, Settled))}
     || {{_Caller, Name}, From} <- lists:sort(maps:to_list(Asking))
    ],
    {keep_state, Settled#barrier{asking = #{}}, [{trace, store_damaged} || Outdated] ++ Replies}.

gate(Name, #barrier{gates = Gates, settled = Settled}) ->
    maps:get(Name, Gates, starl_barrier_gate:new(Settled)).

put_gate(Name, Gate, #barrier{gates = Gates} = Barrier) ->
    Barrier#barrier{gates = Gates#{Name => Gate}}.
