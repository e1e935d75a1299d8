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
%%     |<-------- told [{Name, their K, my K}, ...]  |
%% '''
%% What is kept of a name is how far each robot has come; that only grows, so what is late or
%% comes twice changes nothing, and no entry is ever deleted that it could bring back. A robot
%% passes only when it also knows that all others know that it has reached the round: so after a
%% crash of its machine any of them can tell how far it was.
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
    %% false: after a crash, known only from what the others say
    sure = true :: boolean(),
    at = 0 :: non_neg_integer(),
    passed = 0 :: non_neg_integer(),
    reached = #{} :: counts(),
    heard = #{} :: counts(),
    from = none :: starl_machine:from() | none
}).

-record(barrier, {
    others :: [starl:robot_id()],
    incarnation :: pos_integer(),
    retry_us :: pos_integer(),
    gates = #{} :: #{starl_barrier:name() => #gate{}},
    %% after a crash: who has not told yet what it knows, and who asked for a round meanwhile
    untold = [] :: [starl:robot_id()],
    asking = [] :: [{starl_machine:from(), starl_barrier:name()}]
}).

-spec init(starl_machine:config()) -> {ready, #barrier{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    Others = starl_team:others(Self, Team),
    Barrier = #barrier{
        others = Others,
        incarnation = Incarnation,
        retry_us = 1000 * maps:get(retry_ms, Config, ?RETRY_MS),
        untold = [Other || Incarnation > 1, Other <- Others]
    },
    {ready, Barrier, [starl_sap:listen(barrier, barrier) | ask_untold(Barrier)]}.

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
handle_event({timeout, {again, Name}}, _, ready, Barrier, _Meta) ->
    again(Name, Barrier);
handle_event({timeout, {patience, Name}}, _, ready, Barrier, _Meta) ->
    give_up(Name, timeout, Barrier);
handle_event({timeout, untold}, _, ready, Barrier, _Meta) ->
    {keep_state, Barrier, ask_untold(Barrier)};
handle_event(info, {restarted, sap}, ready, _Barrier, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(barrier, barrier)]};
handle_event(info, {restarted, Caller}, ready, Barrier, _Meta) ->
    caller_restarted(Caller, Barrier);
handle_event(_, _, _, _, _) ->
    unknown_event.

message({reached, Name, Round, Known, Answer}, From, Barrier) ->
    Heard = hear(Name, From, Round, Known, Barrier),
    {keep_state, Passed, Actions} = check(Name, [], Heard),
    {keep_state, Passed, [report(Name, From, false, Passed) || Answer] ++ Actions};
message({who, Incarnation}, From, #barrier{gates = Gates} = Barrier) ->
    Facts = [
        {Name, At, maps:get(From, Reached, 0)}
     || {Name, #gate{at = At, reached = Reached}} <- lists:sort(maps:to_list(Gates))
    ],
    {keep_state, Barrier, [starl_sap:post(From, barrier, {told, Incarnation, Facts})]};
message({told, Incarnation, Facts}, From, #barrier{incarnation = Incarnation} = Barrier) ->
    Told = lists:foldl(
        fun({Name, Round, Known}, B) -> hear(Name, From, Round, Known, B) end, Barrier, Facts
    ),
    answer_asking(Told#barrier{untold = lists:delete(From, Told#barrier.untold)});
message({told, _Earlier, _Facts}, _From, _Barrier) ->
    keep_state_and_data;
message(_, _, _) ->
    unknown_event.

%% -- the robot's own rounds -----------------------------------------------------------------

%% The round not passed yet. After a crash only the others know.
round_of(From, Name, #barrier{untold = Untold, asking = Asking} = Barrier) ->
    case gate(Name, Barrier) of
        #gate{sure = false} when Untold =/= [] ->
            {keep_state, Barrier#barrier{asking = [{From, Name} | Asking]}};
        #gate{passed = Passed} = Gate ->
            Sure = put_gate(Name, Gate#gate{sure = true}, Barrier),
            {keep_state, Sure, [{reply, From, Passed + 1}]}
    end.

answer_asking(#barrier{untold = [], asking = [{From, Name} | Rest]} = Barrier) ->
    {keep_state, Next, Reply} = round_of(From, Name, Barrier#barrier{asking = Rest}),
    {keep_state, Last, Replies} = answer_asking(Next),
    {keep_state, Last, Reply ++ Replies};
answer_asking(Barrier) ->
    {keep_state, Barrier, []}.

reach(From, Name, Round, Us, #barrier{retry_us = Retry} = Barrier) ->
    Gate = back_to(Round, gate(Name, Barrier)),
    New = Gate#gate.at < Round,
    At = put_gate(Name, Gate#gate{at = Round, from = From}, Barrier),
    Announce = {call, sap, {broadcast, barrier, {reached, Name, Round, 0, false}},
        {announced, Name, Round}},
    Actions =
        [A || New, A <- [{trace, {reached, Name, Round}}, Announce]] ++
            [
                {{timeout, {again, Name}}, Retry, again},
                {{timeout, {patience, Name}}, Us, patience}
            ],
    check(Name, Actions, At).

%% The caller knows better than the others what it has passed.
back_to(Round, #gate{sure = false} = Gate) ->
    Gate#gate{sure = true, at = Round - 1, passed = Round - 1};
back_to(_Round, Gate) ->
    Gate.

%% Passes, if all is well.
check(Name, Actions, Barrier) ->
    #gate{at = At, from = From} = Gate = gate(Name, Barrier),
    case From =/= none andalso missing(Gate, Barrier) =:= [] of
        true ->
            Passed = put_gate(Name, Gate#gate{passed = At, from = none}, Barrier),
            Done = [{trace, {passed, Name, At}}, {reply, From, ok} | stop(Name)],
            {keep_state, Passed, Actions ++ Done};
        false ->
            {keep_state, Barrier, Actions}
    end.

%% Who has not reached the round, or may not know that this robot has.
missing(#gate{at = At, reached = Reached, heard = Heard}, #barrier{others = Others}) ->
    [R || R <- Others, maps:get(R, Reached, 0) < At orelse maps:get(R, Heard, 0) < At].

stop(Name) -> [{{timeout, {Timer, Name}}, cancel} || Timer <- [again, patience]].

again(Name, #barrier{retry_us = Retry} = Barrier) ->
    case gate(Name, Barrier) of
        #gate{from = none} ->
            keep_state_and_data;
        Gate ->
            Asks = [report(Name, Robot, true, Barrier) || Robot <- missing(Gate, Barrier)],
            {keep_state, Barrier, [{{timeout, {again, Name}}, Retry, again} | Asks]}
    end.

%% The robot has reached the round all the same, and answers those that ask.
give_up(Name, Why, Barrier) ->
    case gate(Name, Barrier) of
        #gate{from = none} ->
            keep_state_and_data;
        #gate{from = From, at = At} = Gate ->
            Failed = put_gate(Name, Gate#gate{from = none}, Barrier),
            Told = [{trace, {failed, Name, At, Why}}, {reply, From, {error, Why}}],
            {keep_state, Failed, Told ++ stop(Name)}
    end.

caller_restarted(Caller, #barrier{gates = Gates, asking = Asking} = Barrier) ->
    Names = [Name || {Name, #gate{from = {C, _}}} <- lists:sort(maps:to_list(Gates)), C =:= Caller],
    Left = Barrier#barrier{asking = [A || {{C, _}, _} = A <- Asking, C =/= Caller]},
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

%% What this robot reached before its machine crashed, and was not waiting for, it has passed.
remember(Known, #gate{sure = false, at = At} = Gate) when Known > At ->
    Gate#gate{at = Known, passed = Known};
remember(_Known, Gate) ->
    Gate.

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

ask_untold(#barrier{untold = []}) ->
    [];
ask_untold(#barrier{untold = Untold, incarnation = Incarnation, retry_us = Retry}) ->
    [
        {{timeout, untold}, Retry, again}
        | [starl_sap:post(Other, barrier, {who, Incarnation}) || Other <- Untold]
    ].

gate(Name, #barrier{gates = Gates, incarnation = Incarnation}) ->
    maps:get(Name, Gates, #gate{sure = Incarnation =:= 1}).

put_gate(Name, Gate, #barrier{gates = Gates} = Barrier) ->
    Barrier#barrier{gates = Gates#{Name => Gate}}.
