%% @doc Calls to the nodes of a cluster. No call keeps the cluster waiting. A process for each node
%% makes the calls to it, one after the other, and a caller that asks several nodes waits for a
%% limited time.
%% ```
%%   ask --> the process of each node -- the call --> its answer, or
%%             silent: the limit has passed; the call is still under way
%%             down: the node has ended
%% '''
%% A node that stands still gets its calls when it goes on, in their order.
-module(starl_cluster_calls).

-export([new/0, joined/2, lost/2, stop/1, ask/4, hear/2, await/1, result/2]).

-export_type([t/1, call/0, answers/0, ended/1]).

%% A call to a node. It does not fail: what a node could not do is in its answer.
-type call() :: fun(() -> Answer :: term()).

-type answers() :: #{starl:robot_id() => {ok, Answer :: term()} | silent | down}.

%% A question that has ended, by the name that its asker gave it.
-type ended(Name) :: {Name, answers()}.

-record(question, {
    name :: term(),
    timer :: reference() | none,
    answers = #{} :: answers(),
    waiting :: [starl:robot_id()]
}).

-record(calls, {
    callers = #{} :: #{starl:robot_id() => pid()},
    questions = #{} :: #{reference() => #question{}}
}).

-opaque t(_Name) :: #calls{}.

%% @doc No node has joined.
-spec new() -> t(_).
new() -> #calls{}.

%% @doc The node of a robot can be asked from now on.
-spec joined(starl:robot_id(), t(Name)) -> t(Name).
joined(Robot, #calls{callers = Callers} = Calls) ->
    Asker = self(),
    Calls#calls{callers = Callers#{Robot => spawn_link(fun() -> caller(Robot, Asker) end)}}.

caller(Robot, Asker) ->
    receive
        {call, Ref, Call} -> Asker ! {?MODULE, Ref, Robot, Call()}
    end,
    caller(Robot, Asker).

%% @doc The node of a robot has ended: its answers to open questions do not hold any more. Returns the
%% questions that wait for nobody now.
-spec lost(starl:robot_id(), t(Name)) -> {[ended(Name)], t(Name)}.
lost(Robot, #calls{callers = Callers, questions = Questions} = Calls) ->
    ok = ended([Pid || {Id, Pid} <- maps:to_list(Callers), Id =:= Robot]),
    Left = Calls#calls{callers = maps:remove(Robot, Callers)},
    lists:foldl(
        fun(Ref, {Ended, C}) ->
            {More, Next} = answered(Ref, Robot, down, C),
            {More ++ Ended, Next}
        end,
        {[], Left},
        [Ref || {Ref, Question} <- maps:to_list(Questions), concerns(Robot, Question)]
    ).

concerns(Robot, #question{answers = Answers, waiting = Waiting}) ->
    is_map_key(Robot, Answers) orelse lists:member(Robot, Waiting).

%% @doc Ends all calls.
-spec stop(t(_)) -> ok.
stop(#calls{callers = Callers}) -> ended(maps:values(Callers)).

ended(Pids) ->
    lists:foreach(
        fun(Pid) ->
            true = unlink(Pid),
            true = exit(Pid, kill)
        end,
        Pids
    ).

%% @doc Asks nodes. Their answers come as a message to this process, for {@link hear/2}: when all have
%% answered, or the limit has passed.
-spec ask(Name, [{starl:robot_id(), call()}], LimitMs :: timeout(), t(Name)) -> t(Name).
ask(Name, Wanted, LimitMs, #calls{callers = Callers, questions = Questions} = Calls) ->
    Ref = make_ref(),
    Asked = [{Robot, Pid, Call} || {Robot, Call} <- Wanted, #{Robot := Pid} <- [Callers]],
    ok = lists:foreach(fun({_, Pid, Call}) -> Pid ! {call, Ref, Call} end, Asked),
    Waiting = [Robot || {Robot, _, _} <- Asked],
    Down = maps:from_list([{Robot, down} || {Robot, _} <- Wanted, not is_map_key(Robot, Callers)]),
    Question = #question{
        name = Name, timer = timer(Waiting, LimitMs, Ref), answers = Down, waiting = Waiting
    },
    Calls#calls{questions = Questions#{Ref => Question}}.

%% A question to nobody ends at once.
timer([], _LimitMs, Ref) ->
    self() ! {?MODULE, Ref, over},
    none;
timer(_Waiting, infinity, _Ref) ->
    none;
timer(_Waiting, LimitMs, Ref) ->
    erlang:send_after(LimitMs, self(), {?MODULE, Ref, over}).

%% @doc The questions that a message ends; `unknown': it is none of these messages.
-spec hear(Message :: term(), t(Name)) -> {[ended(Name)], t(Name)} | unknown.
hear({?MODULE, Ref, Robot, Answer}, #calls{questions = Questions} = Calls) ->
    case Questions of
        #{Ref := #question{waiting = Waiting}} ->
            heard(lists:member(Robot, Waiting), Ref, Robot, Answer, Calls);
        #{} ->
            {[], Calls}
    end;
hear({?MODULE, Ref, over}, Calls) ->
    over(Ref, Calls);
hear(_Message, _Calls) ->
    unknown.

%% A node may have ended after its answer.
heard(true, Ref, Robot, Answer, Calls) -> answered(Ref, Robot, {ok, Answer}, Calls);
heard(false, _Ref, _Robot, _Answer, Calls) -> {[], Calls}.

%% @doc Waits for the end of all questions.
-spec await(t(Name)) -> {[ended(Name)], t(Name)}.
await(#calls{questions = Questions} = Calls) when map_size(Questions) =:= 0 ->
    {[], Calls};
await(Calls) ->
    {Ended, Next} =
        receive
            {?MODULE, _, _} = Message -> hear(Message, Calls);
            {?MODULE, _, _, _} = Message -> hear(Message, Calls)
        end,
    {More, Last} = await(Next),
    {Ended ++ More, Last}.

%% @doc The answer of a robot's node. A call that fails answers in the same form.
-spec result(starl:robot_id(), answers()) -> Answer :: term() | {error, unicode:chardata()} | down.
result(Robot, Answers) ->
    case Answers of
        #{Robot := {ok, Answer}} -> Answer;
        #{Robot := silent} -> {error, "its node does not answer"};
        #{Robot := down} -> down
    end.

answered(Ref, Robot, Answer, #calls{questions = Questions} = Calls) ->
    #{Ref := #question{answers = Answers, waiting = Waiting} = Question} = Questions,
    Heard = Question#question{
        answers = Answers#{Robot => Answer}, waiting = lists:delete(Robot, Waiting)
    },
    complete(Ref, Heard, Calls#calls{questions = Questions#{Ref := Heard}}).

complete(Ref, #question{waiting = []}, Calls) -> over(Ref, Calls);
complete(_Ref, _Question, Calls) -> {[], Calls}.

over(Ref, #calls{questions = Questions} = Calls) ->
    case maps:take(Ref, Questions) of
        {#question{name = Name, timer = Timer, answers = Answers, waiting = Waiting}, Left} ->
            _ = [erlang:cancel_timer(Timer) || Timer =/= none],
            Silent = maps:from_list([{Robot, silent} || Robot <- Waiting]),
            {[{Name, maps:merge(Silent, Answers)}], Calls#calls{questions = Left}};
        error ->
            {[], Calls}
    end.
