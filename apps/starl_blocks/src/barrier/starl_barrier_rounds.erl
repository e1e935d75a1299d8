%% @doc Barriers by counting rounds.
%% ```
%%   robot                                       all others
%%     | reached {Name, K} ------------------------->|   once, when the robot reaches round K
%%     |<------------------------ reached {Name, K}  |   from each
%%     |   all have reached K, and know that I have: pass
%%     | reached {Name, K, ask} -------------------->|   now and then, to those it misses
%%     |<--- reached {Name, their K, what they know} |
%%
%%     | who --------------------------------------->|   after a crash of this machine
%%     |<-------- told [{Name, their K, my K, ...}]  |
%% '''
%% What is kept of a name is how far each robot has come; that only grows, so what is late or
%% comes twice changes nothing, and no entry is ever deleted that it could bring back.
%%
%% A machine that has crashed has its own counts from the robot's {@link starl_barrier_log}. Only
%% where that is lost, too (the robot has rebooted), do the others tell how far it was: a robot
%% passes only when it also knows that all others know that it has reached the round, so any of
%% them can. They know what it reached, not what it passed. If one of them has not come so far
%% itself, nobody has passed that round; else it counts as passed, so the next `sync' is for the
%% round after it and waits for all, whatever the robot did before.
%%
%% Calls: `{round, Name}' (the round that the next `sync' is for), `{sync, Name, Round, Us}'
%% (answer `ok' or `{error, timeout}'), `{resume, Name, Round}' (after a crash: this round has
%% not been passed). Trace: `{reached, Name, K}', `{passed, Name, K}',
%% `{failed, Name, K, timeout | restarted}'.
-module(starl_barrier_rounds).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-define(RETRY_MS, 3000).

-type counts() :: #{starl:robot_id() => non_neg_integer()}.

%% A name: how far this robot has come, how far the others, and what they know of it.
-record(gate, {
    %% false: known only from what the others say
    sure = true :: boolean(),
    at = 0 :: non_neg_integer(),
    passed = 0 :: non_neg_integer(),
    %% the last round that somebody has surely passed: so all have reached it
    done = 0 :: non_neg_integer(),
    reached = #{} :: counts(),
    heard = #{} :: counts(),
    from = none :: starl_machine:from() | none,
    %% while it waits: those that it may miss; whoever was seen to be there is not looked at again
    awaited = [] :: [starl:robot_id()]
}).

-record(barrier, {
    others :: [starl:robot_id()],
    incarnation :: pos_integer(),
    retry_us :: pos_integer(),
    log :: starl_machine:name() | none,
    gates = #{} :: #{starl_barrier:name() => #gate{}},
    %% is what this robot did before known, from the log or the others?
    settled :: boolean(),
    %% after a crash: who has not told yet what it knows, and who of the others has told and
    %% knew its own counts
    untold = [] :: [starl:robot_id()],
    witnesses = [] :: [starl:robot_id()],
    %% who asked for a round before that was known
    asking = #{} :: #{{starl_machine:name(), starl_barrier:name()} => starl_machine:from()}
}).

-spec init(starl_machine:config()) -> {ready, #barrier{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    Others = starl_team:others(Self, Team),
    Log = maps:get(log, Config, none),
    Barrier = #barrier{
        others = Others,
        incarnation = Incarnation,
        retry_us = 1000 * maps:get(retry_ms, Config, ?RETRY_MS),
        log = Log,
        settled = Incarnation =:= 1 orelse Others =:= [],
        untold = [Other || Incarnation > 1, Other <- Others]
    },
    Recall = [Action || Incarnation > 1, Action <- starl_barrier_log:recall(Log, recalled)],
    {ready, Barrier, [starl_sap:listen(barrier, barrier) | Recall ++ ask_untold(Barrier)]}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #barrier{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {round, Name}, ready, Barrier, _Meta) ->
    round_of(From, Name, Barrier);
handle_event({call, From}, {sync, Name, Round, Us}, ready, Barrier, _Meta) ->
    reach(From, Name, Round, Us, Barrier);
handle_event({call, From}, {resume, Name, Round}, ready, Barrier, _Meta) ->
    Gate = back_to(Round, gate(Name, Barrier)),
    {keep_state, put_gate(Name, Gate, Barrier), [{reply, From, ok}]};
handle_event(cast, {message, From, barrier, Message}, ready, Barrier, _Meta) ->
    message(Message, From, Barrier);
handle_event({reply, {announced, Name, Round}}, Outcome, ready, Barrier, _Meta) ->
    announced(Name, Round, Outcome, Barrier);
handle_event({reply, recalled}, Answer, ready, Barrier, _Meta) ->
    recalled(Answer, Barrier);
handle_event({timeout, {again, Name}}, _, ready, Barrier, _Meta) ->
    again(Name, Barrier);
handle_event({timeout, {patience, Name}}, _, ready, Barrier, _Meta) ->
    give_up(Name, timeout, Barrier);
handle_event({timeout, untold}, _, ready, Barrier, _Meta) ->
    {keep_state, Barrier, ask_untold(Barrier)};
handle_event(info, {restarted, sap}, ready, _Barrier, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(barrier, barrier)]};
handle_event(info, {restarted, Log}, ready, #barrier{log = Log} = Barrier, _Meta) ->
    {keep_state, Barrier, note_all(Barrier)};
handle_event(info, {restarted, Caller}, ready, Barrier, _Meta) ->
    caller_restarted(Caller, Barrier);
handle_event(_, _, _, _, _) ->
    unknown_event.

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

%% The round not passed yet. After a reboot only the others know.
round_of({Caller, _} = From, Name, #barrier{asking = Asking} = Barrier) ->
    case gate(Name, Barrier) of
        #gate{sure = false} ->
            {keep_state, Barrier#barrier{asking = Asking#{{Caller, Name} => From}}, []};
        #gate{passed = Passed} ->
            {keep_state, Barrier, [{reply, From, Passed + 1}]}
    end.

reach(From, Name, Round, Us, #barrier{retry_us = Retry, log = Log} = Barrier) ->
    Gate = back_to(Round, gate(Name, Barrier)),
    New = Gate#gate.at < Round,
    Waiting = Gate#gate{at = Round, from = From, awaited = Barrier#barrier.others},
    At = put_gate(Name, Waiting, Barrier),
    Announce = {call, sap, {broadcast, barrier, {reached, Name, Round, 0, false}},
        {announced, Name, Round}},
    First =
        case New of
            true ->
                Note = starl_barrier_log:note(Log, Name, {Round, Gate#gate.passed}),
                Note ++ [{trace, {reached, Name, Round}}, Announce];
            false ->
                ask_missing(Name, At)
        end,
    Timers = [
        {{timeout, {again, Name}}, Retry, again}, {{timeout, {patience, Name}}, Us, patience}
    ],
    check(Name, First ++ Timers, At).

%% The caller knows better than the others what it has passed.
back_to(Round, #gate{sure = false} = Gate) ->
    Gate#gate{sure = true, at = Round - 1, passed = Round - 1};
back_to(_Round, Gate) ->
    Gate.

%% Passes, if all is well.
check(Name, Actions, #barrier{log = Log} = Barrier) ->
    #gate{at = At, from = From, awaited = Awaited} = Gate = gate(Name, Barrier),
    case lists:dropwhile(fun(Robot) -> not is_missed(Robot, Gate) end, Awaited) of
        [] when From =/= none ->
            Passed = Gate#gate{passed = At, done = At, from = none, awaited = []},
            Note = starl_barrier_log:note(Log, Name, {At, At}),
            Done = [{trace, {passed, Name, At}}, {reply, From, ok} | stop(Name)],
            {keep_state, put_gate(Name, Passed, Barrier), Actions ++ Note ++ Done};
        Left ->
            {keep_state, put_gate(Name, Gate#gate{awaited = Left}, Barrier), Actions}
    end.

%% Has it not reached the round, or may it not know that this robot has?
is_missed(Robot, #gate{at = At, reached = Reached, heard = Heard}) ->
    maps:get(Robot, Reached, 0) < At orelse maps:get(Robot, Heard, 0) < At.

stop(Name) -> [{{timeout, {Timer, Name}}, cancel} || Timer <- [again, patience]].

again(Name, #barrier{retry_us = Retry} = Barrier) ->
    case gate(Name, Barrier) of
        #gate{from = none} ->
            keep_state_and_data;
        #gate{} ->
            Again = {{timeout, {again, Name}}, Retry, again},
            {keep_state, Barrier, [Again | ask_missing(Name, Barrier)]}
    end.

ask_missing(Name, Barrier) ->
    #gate{awaited = Awaited} = Gate = gate(Name, Barrier),
    [report(Name, Robot, true, Barrier) || Robot <- Awaited, is_missed(Robot, Gate)].

%% The robot has reached the round all the same, and answers those that ask.
give_up(Name, Why, Barrier) ->
    case gate(Name, Barrier) of
        #gate{from = none} ->
            keep_state_and_data;
        #gate{from = From, at = At} = Gate ->
            Failed = put_gate(Name, Gate#gate{from = none, awaited = []}, Barrier),
            Told = [{trace, {failed, Name, At, Why}}, {reply, From, {error, Why}}],
            {keep_state, Failed, Told ++ stop(Name)}
    end.

caller_restarted(Caller, #barrier{gates = Gates, asking = Asking} = Barrier) ->
    Names = [Name || {Name, #gate{from = {C, _}}} <- lists:sort(maps:to_list(Gates)), C =:= Caller],
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

%% A robot has reached a round, and knows that this robot has reached one. Both only grow.
hear(Name, Robot, Round, Known, Barrier) ->
    #gate{reached = Reached, heard = Heard} = Gate = gate(Name, Barrier),
    More = Gate#gate{reached = raise(Robot, Round, Reached), heard = raise(Robot, Known, Heard)},
    put_gate(Name, remember(Known, More), Barrier).

raise(Robot, Count, Counts) -> Counts#{Robot => max(Count, maps:get(Robot, Counts, 0))}.

remember(Known, #gate{sure = false, at = At} = Gate) when Known > At -> Gate#gate{at = Known};
remember(_Known, Gate) -> Gate.

%% The outcome of the announcement says who knows.
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
    #gate{at = At, reached = Reached} = gate(Name, Barrier),
    starl_sap:post(To, barrier, {reached, Name, At, maps:get(To, Reached, 0), Answer}).

%% -- after a crash --------------------------------------------------------------------------

ask_untold(#barrier{untold = []}) ->
    [];
ask_untold(#barrier{untold = Untold, incarnation = Incarnation, retry_us = Retry}) ->
    [
        {{timeout, untold}, Retry, again}
        | [starl_sap:post(Other, barrier, {who, Incarnation}) || Other <- Untold]
    ].

%% What one knows of a name: its own count, the asker's, and the last round surely passed.
fact(Asker, {Name, #gate{at = At, done = Done, reached = Reached}}) ->
    {Name, At, maps:get(Asker, Reached, 0), Done}.

told(Certain, Facts, From, #barrier{untold = Untold, witnesses = Witnesses} = Barrier) ->
    Learned = lists:foldl(
        fun({Name, Round, Known, Done}, B) ->
            Gate = gate(Name, B),
            More = Gate#gate{done = max(Done, Gate#gate.done)},
            hear(Name, From, Round, Known, put_gate(Name, remember(Done, More), B))
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

%% All that can be known is known.
settle(#barrier{gates = Gates} = Barrier) ->
    Settled = Barrier#barrier{
        settled = true, gates = maps:map(fun(_, Gate) -> assure(Gate, Barrier) end, Gates)
    },
    answer_asking(note_all(Settled), Settled).

assure(#gate{sure = false, at = At, reached = Reached} = Gate, #barrier{witnesses = Witnesses}) ->
    Behind = [W || W <- Witnesses, maps:get(W, Reached, 0) < At],
    Gate#gate{sure = true, passed = At - length(lists:sublist(Behind, 1))};
assure(Gate, _Barrier) ->
    Gate.

answer_asking(Actions, #barrier{asking = Asking} = Barrier) ->
    Replies = [
        {reply, From, (gate(Name, Barrier))#gate.passed + 1}
     || {{_Caller, Name}, From} <- lists:sort(maps:to_list(Asking))
    ],
    {keep_state, Barrier#barrier{asking = #{}}, Actions ++ Replies}.

%% What the log says is exact.
recalled({complete, Notes}, #barrier{settled = false} = Barrier) ->
    Recalled = maps:fold(fun recall/3, Barrier#barrier{settled = true}, Notes),
    All = maps:map(fun(_, Gate) -> Gate#gate{sure = true} end, Recalled#barrier.gates),
    answer_asking([], Recalled#barrier{gates = All});
recalled(_Partial, Barrier) ->
    {keep_state, Barrier, []}.

recall(Name, {At, Passed}, Barrier) ->
    Gate = gate(Name, Barrier),
    put_gate(Name, Gate#gate{sure = true, at = At, passed = Passed}, Barrier).

%% The log is told everything, unless that would make it believe in what is not known yet.
note_all(#barrier{settled = false}) ->
    [];
note_all(#barrier{log = Log, gates = Gates}) ->
    Notes = maps:map(fun(_, #gate{at = At, passed = Passed}) -> {At, Passed} end, Gates),
    starl_barrier_log:notes(Log, Notes).

gate(Name, #barrier{gates = Gates, settled = Settled}) ->
    maps:get(Name, Gates, #gate{sure = Settled}).

put_gate(Name, Gate, #barrier{gates = Gates} = Barrier) ->
    Barrier#barrier{gates = Gates#{Name => Gate}}.
