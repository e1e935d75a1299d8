%% @doc The turn of a sequential application. It holds the clock, the random numbers and the actions
%% that the application has not yet handed back to its driver. A blocking call
%% ({@link starl_app_call}) hands them back and waits for its event. Parts of the turn hold the
%% rest: the messages that arrive meanwhile ({@link starl_app_inbox}) and the code
%% ({@link starl_app_code}).
%%
%% The turn is kept in the process dictionary, under one key. The application's own functions lie
%% between the calls on the stack, so no state can be passed through them. {@link starl_app_proc}
%% takes the steps.
-module(starl_app_turn).

-export([perform/1, store/1, stored/0, now/0, present/0, random/0, listen/1, application/0]).
-export([wait/1, new_tag/1, take/1, read/1, history/2, given_up/0]).
-export([start/4, waits/1]).
-export([step/0, count/1, stepped/0, steps/0, take_back/3, code/0, code/2, over/0]).

-define(TURN, starl_turn).
%% The largest number of actions and steps in one moment of the robot's clock.
-define(MOMENT_LIMIT, 100000).

-record(turn, {
    robot :: pos_integer(),
    driver :: pid(),
    now :: integer(),
    clock = none :: fun(() -> integer()) | none,
    actions = [] :: [starl_machine:action()],
    %% the number of actions and steps since the clock last changed
    count = 0 :: non_neg_integer(),
    inbox = starl_app_inbox:new() :: starl_app_inbox:t(),
    random :: rand:state(),
    stored :: starl_machine:stored(),
    %% of a call; an answer to a call of an earlier incarnation is not accepted
    tag :: {Incarnation :: pos_integer(), non_neg_integer()},
    %% machines that are not started again
    given_up = [] :: [starl_machine:name()],
    %% the last thing waited for
    waits = nothing :: starl_app_call:waits(),
    %% completed steps
    steps = 0 :: non_neg_integer(),
    code :: starl_app_code:t(),
    %% the application is done
    over = false :: boolean(),
    %% the machines of whose calls a history is kept
    histories = [] :: [starl_machine:name()]
}).

%% @doc The first turn of an application, by the boot of its driver.
-spec start(starl:robot_id(), module(), pid(), Boot :: map()) -> ok.
start(Id, Module, Driver, Boot) ->
    #{now := Now, random := Random, incarnation := Incarnation, stored := Stored} = Boot,
    _ = put(?TURN, #turn{
        robot = Id,
        driver = Driver,
        now = Now,
        clock = maps:get(clock, Boot, none),
        random = Random,
        stored = Stored,
        tag = {Incarnation, 0},
        code = starl_app_code:new(maps:get(code, Boot, starl_lineage:new(Module))),
        histories = maps:get(histories, Boot, [])
    }),
    ok.

%% @doc The application that runs in this process; `none': it is no process of an application.
-spec application() -> module() | none.
application() ->
    case get(?TURN) of
        #turn{code = Code} -> starl_app_code:module(Code);
        undefined -> none
    end.

%% @doc What the application of a process with this dictionary waits for.
-spec waits([{term(), term()}]) -> starl_app_call:waits().
waits(Dictionary) ->
    case lists:keyfind(?TURN, 1, Dictionary) of
        {?TURN, #turn{waits = Waits}} -> Waits;
        _ -> nothing
    end.

%% -- the steps ------------------------------------------------------------------------------

%% @doc The code of the application.
-spec code() -> starl_app_code:t().
code() -> (turn())#turn.code.

%% @doc The application goes on with its code in this state, and reports how it has applied reload
%% commands.
-spec code(starl_app_code:t(), [starl_reload:told()]) -> ok.
code(Code, Told) ->
    _ = put(?TURN, (turn())#turn{code = Code}),
    perform([{reloaded, One} || One <- Told]).

%% @doc A step begins. May it crash? Then it may be taken back.
-spec step() -> MayCrash :: boolean().
step() ->
    #turn{inbox = Inbox} = Turn = turn(),
    MayCrash = may_crash(Turn),
    _ = MayCrash andalso put(?TURN, Turn#turn{inbox = starl_app_inbox:step(Inbox)}),
    MayCrash.

may_crash(#turn{now = Now, code = Code}) -> starl_app_code:may_crash(Now, Code).

%% @doc A step has ended well.
-spec stepped() -> ok.
stepped() ->
    #turn{steps = Steps, code = Code} = Turn = turn(),
    _ = put(?TURN, Turn#turn{steps = Steps + 1, code = starl_app_code:stepped(Code)}),
    ok.

%% @doc The number of completed steps.
-spec steps() -> non_neg_integer().
steps() -> (turn())#turn.steps.

%% @doc A step has crashed: it is taken back as far as it can be ({@link starl_app_code:taken_back/4}), if it
%% may crash (else `false'). What it has read will be read again.
-spec take_back(starl_crash:cause(), module(), State :: term()) ->
    starl_app_code:running() | none | false.
take_back(Cause, Module, State) ->
    #turn{code = Code, inbox = Inbox} = Turn = turn(),
    case may_crash(Turn) andalso starl_app_code:taken_back(Cause, Module, State, Code) of
        {Told, Former, Next} ->
            Unread = starl_app_inbox:taken_back(Inbox),
            _ = put(?TURN, Turn#turn{count = 0, inbox = Unread}),
            ok = code(Next, Told),
            Former;
        Not ->
            Not
    end.

%% @doc The application takes no step any more.
-spec over() -> no_return().
over() ->
    _ = put(?TURN, (turn())#turn{over = true}),
    hear_all(turn()),
    wait(fun(_, _) -> skip end).

hear_all(#turn{code = Code} = Turn) ->
    case starl_app_code:word(Code) of
        none ->
            ok;
        {Word, Left} ->
            ok = hear(Word, Turn#turn{code = Left}),
            hear_all(turn())
    end.

hear(Word, #turn{over = IsOver, code = Code} = Turn) ->
    {Told, Next} = starl_app_code:hear(Word, IsOver, Code),
    _ = put(?TURN, Turn),
    code(Next, Told).

%% -- calls that do not block ----------------------------------------------------------------

%% @doc Adds actions to the turn; they take place when the application next blocks. A malformed
%% action crashes the application ({@link starl_action}), and so do too many actions without time
%% passing: in one turn, or in turn after turn of a loop that polls.
-spec perform([starl_machine:action()]) -> ok.
perform(New) ->
    ok = starl_action:check(New),
    #turn{actions = Actions, inbox = Inbox} = Turn = counted(length(New), turn()),
    _ = put(?TURN, Turn#turn{
        actions = lists:reverse(New, Actions), inbox = starl_app_inbox:subscribed(New, Inbox)
    }),
    ok.

%% @doc Keeps a term over crashes and reboots, in place of the term kept before.
-spec store(term()) -> ok.
store(Term) ->
    ok = perform([{store, Term}]),
    _ = put(?TURN, (turn())#turn{stored = {stored, Term}}),
    ok.

%% @doc The term that was kept last, in this incarnation or an earlier one.
-spec stored() -> starl_machine:stored().
stored() -> (turn())#turn.stored.

turn() ->
    case get(?TURN) of
        #turn{} = Turn -> Turn;
        undefined -> error({not_in_an_application, self()})
    end.

%% @doc Counts actions and steps. The actions of a turn stay in memory until the application blocks; in
%% virtual time, a loop that lets no time pass holds up the whole team.
-spec count(non_neg_integer()) -> ok.
count(N) ->
    _ = put(?TURN, counted(N, turn())),
    ok.

counted(N, #turn{count = Count} = Turn) when Count + N =< ?MOMENT_LIMIT ->
    Turn#turn{count = Count + N};
counted(_N, #turn{code = Code}) ->
    Application = starl_app_code:module(Code),
    error({step_never_blocks, #{application => Application, actions_and_steps => ?MOMENT_LIMIT}}).

%% @doc Listens to a type of message of SAP.
-spec listen(starl_packet:type()) -> ok.
listen(Type) ->
    #turn{inbox = Inbox} = Turn = turn(),
    {Word, Next} = starl_app_inbox:listen(Type, Inbox),
    _ = put(?TURN, Turn#turn{inbox = Next}),
    %% tells messages that wait for their listener from those that wait in vain
    perform([{trace, {listens, Type}}, {cast, sap, Word}]).

%% @doc The robot's own clock, in microseconds, at the beginning of this turn.
-spec now() -> integer().
now() -> (turn())#turn.now.

%% @doc The time that the robot's own clock shows now. In virtual time a turn takes none.
-spec present() -> integer().
present() ->
    case turn() of
        #turn{clock = none, now = Now} -> Now;
        #turn{clock = Clock, now = Now} -> max(Now, Clock())
    end.

%% @doc A number in `0.0 =< X < 1.0' from the application's own random stream.
-spec random() -> float().
random() ->
    #turn{random = Random} = Turn = turn(),
    {X, Next} = rand:uniform_s(Random),
    _ = put(?TURN, Turn#turn{random = Next}),
    X.

%% @doc Keeps what the caller of a machine sees, beside what the application does: it is none of its
%% actions, which are counted.
-spec history(starl_machine:name(), Event :: term()) -> ok.
history(Name, Event) ->
    #turn{histories = Names, actions = Actions} = Turn = turn(),
    case lists:member(Name, Names) of
        true ->
            _ = put(?TURN, Turn#turn{actions = [{trace, {history, Event}} | Actions]}),
            ok;
        false ->
            ok
    end.

%% @doc The machines that are not started again.
-spec given_up() -> [starl_machine:name()].
given_up() -> (turn())#turn.given_up.

%% @doc Reads the first message of these types that has come already.
-spec take([starl_packet:type()]) -> {ok, starl_app_inbox:message()} | none.
take(Types) ->
    #turn{inbox = Inbox} = Turn = turn(),
    case starl_app_inbox:take(Types, may_crash(Turn), Inbox) of
        {Message, Actions, Left} ->
            ok = has_read(Actions, Left, Turn),
            {ok, Message};
        none ->
            none
    end.

%% @doc Reads a message that has just come.
-spec read(starl_app_inbox:message()) -> ok.
read(Message) ->
    #turn{inbox = Inbox} = Turn = turn(),
    {Actions, Next} = starl_app_inbox:read(Message, may_crash(Turn), Inbox),
    has_read(Actions, Next, Turn).

has_read(Actions, Inbox, Turn) ->
    _ = put(?TURN, Turn#turn{inbox = Inbox}),
    perform(Actions).

%% @doc The tag of the next call, which waits for this.
-spec new_tag(starl_app_call:waits()) -> {Incarnation :: pos_integer(), pos_integer()}.
new_tag(Waits) ->
    #turn{tag = {Life, N}} = Turn = turn(),
    _ = put(?TURN, Turn#turn{tag = {Life, N + 1}, waits = Waits}),
    {Life, N + 1}.

%% -- waiting --------------------------------------------------------------------------------

%% @doc Hands the gathered actions back and takes events until Match accepts one.
-spec wait(fun((starl_machine:event_type(), term()) -> skip | term())) -> term().
wait(Match) ->
    #turn{robot = Id, driver = Driver, actions = Actions} = Turn = get(?TURN),
    _ = starl_driver:done(Driver, Id, lists:reverse(Actions)),
    receive
        {starl_step, Type, Content, #{now := Now}} -> came(Type, Content, Now, Match, Turn)
    end.

came(code, Word, Now, Match, Turn) ->
    ok = hear(Word, handed_back(Now, Turn)),
    wait(Match);
came(Type0, Content0, Now, Match, Turn) ->
    _ = put(?TURN, handed_back(Now, Turn)),
    #turn{robot = Id, inbox = Inbox} = Turn,
    {Type, Content} = starl_app_inbox:sensed(Type0, Content0, Id, Inbox),
    heed(Type, Content),
    case Match(Type, Content) of
        skip ->
            keep(Type, Content),
            wait(Match);
        Answer ->
            Answer
    end.

%% The next turn begins.
handed_back(Now, #turn{now = Now} = Turn) -> Turn#turn{actions = []};
handed_back(Now, Turn) -> Turn#turn{actions = [], count = 0, now = Now}.

%% A restarted machine has lost its listeners: the application listens again.
heed(info, {restarted, Machine}) ->
    #turn{inbox = Inbox} = Turn = get(?TURN),
    {Words, Next} = starl_app_inbox:restarted(Machine, Inbox),
    _ = put(?TURN, Turn#turn{inbox = Next}),
    lists:foreach(fun(Word) -> listens_again(Machine, Word) end, Words);
heed(info, {given_up, Machine}) ->
    #turn{given_up = GivenUp} = Turn = get(?TURN),
    _ = put(?TURN, Turn#turn{given_up = [Machine | GivenUp]}),
    ok;
heed(_, _) ->
    ok.

listens_again(sap, {listen, Type, app}) -> listen(Type);
listens_again(Machine, Word) -> perform([{cast, Machine, Word}]).

%% Keeps or traces an event for which the application does not wait.
keep(cast, {message, From, Type, Body}) ->
    #turn{inbox = Inbox} = Turn = get(?TURN),
    case starl_app_inbox:put({From, Type, Body}, Inbox) of
        {ok, Next} -> put(?TURN, Turn#turn{inbox = Next});
        full -> perform([{trace, {inbox_full, From, Type}}])
    end;
keep({timeout, _}, call) ->
    ok;
keep({reply, _}, _) ->
    ok;
keep(info, {Word, _}) when Word =:= restarted; Word =:= given_up; Word =:= sensed ->
    ok;
keep(Type, Content) ->
    perform([{trace, {unknown_event, Type, Content}}]).
