%% @doc The process of a sequential application; it makes the application's calls block.
%%
%% It speaks the driver protocol of {@link starl_driver}. Between two events the
%% application runs on its own stack; a blocking call hands control back to the driver, with the
%% actions gathered so far, and waits for its event. Other events that arrive meanwhile
%% are kept: messages in a bounded inbox, in their order. SAP never hands over more messages than
%% there is room for: it is told the room with the first type that the application listens to, and
%% later the number of messages read. Other senders, such as geocast, are not held back: a message
%% without room is dropped, with a trace event.
%%
%% The turn (the clock and the actions not yet handed back) lives in the process dictionary,
%% under one key: the application's own functions lie between the calls on the stack, so no
%% state can be threaded through them.
-module(starl_app_proc).

-export([start_link/1, init/1]).
-export([perform/1, store/1, stored/0, now/0, random/0, listen/1, call/3, await/2, sleep/1]).
-export([application/0, waiting/1, snapshot/1, restore/2]).

-export_type([waits/0, snapshot/0]).

-define(TURN, starl_turn).
%% Where its step began, if snapshots are taken.
-define(BEGUN, starl_begun).
%% The events of a step that are kept for a snapshot.
-define(MOST_EVENTS, 5000).
%% The time that an application may take to come back to where it was, in real time.
-define(PATIENCE_MS, 30000).
-define(INBOX_LIMIT, 1000).
%% SAP is told of read messages in batches of this size, or one by one when room is scarce.
-define(READ_AT_ONCE, 100).
%% The largest number of actions and steps in one moment of the robot's clock.
-define(MOMENT_LIMIT, 100000).
%% The time that a caller waits after a crash of the machine that it called.
-define(RESTARTED_US, 250000).
%% The time between two attempts to carry a state over into other code.
-define(OTHER_CODE_US, 1000000).

-record(turn, {
    robot :: pos_integer(),
    module :: module(),
    driver :: pid(),
    now :: integer(),
    clock = none :: fun(() -> integer()) | none,
    actions = [] :: [starl_machine:action()],
    %% the number of actions and steps since the clock last changed
    count = 0 :: non_neg_integer(),
    inbox = [] :: [message()],
    %% whether SAP knows the room; the number of messages read that SAP has not been told of
    room_told = false :: boolean(),
    unsaid = 0 :: non_neg_integer(),
    random :: rand:state(),
    stored :: starl_machine:stored(),
    %% of a call; an answer to a call of an earlier incarnation is not accepted
    tag :: {Incarnation :: pos_integer(), non_neg_integer()},
    %% subscriptions, repeated to a machine that has restarted
    listening = [] :: [{starl_machine:name(), Word :: term()}],
    %% machines that are not started again
    given_up = [] :: [starl_machine:name()],
    %% the last thing waited for
    waits = nothing :: waits(),
    %% completed steps
    steps = 0 :: non_neg_integer(),
    %% words on new code, to be heeded before the next step, in their order
    switches = [] :: [starl_reload:word()],
    %% the versions of its code, with {@link starl_app_code:kept()}
    lineage :: starl_lineage:t(),
    %% the states with which it goes on, if the former code crashes with what new code has left
    resorts = [] :: [starl_app_code:resort()],
    %% the application is done
    over = false :: boolean(),
    %% while a step may be taken back: the messages that it has read, newest first; those of a step
    %% that was taken back
    read = [] :: [message()],
    again = [] :: [message()],
    %% the machines of whose calls a history is kept
    histories = [] :: [starl_machine:name()],
    %% what has come since the step began, newest first, and its number, if snapshots are taken
    log = none :: {non_neg_integer(), [entry()]} | none,
    %% what is still to come again, until the application is where the snapshot was taken
    replay = none :: {From :: pid(), reference(), [entry()]} | none
}).

%% What came to a step from outside: an event, at this time of the robot's clock; what the clock showed.
-type entry() ::
    {event, starl_machine:event_type() | code, Content :: term(), NowUs :: integer()}
    | {clock, Us :: integer()}.

%% An application as data: as its step began, and all that has come since. A stack is no data: the step
%% is taken anew, with the same events, and what it does until then is not done again.
-type snapshot() :: #{turn := tuple(), at := place(), log := [entry()]}.

%% Before its first step, before this step, or after its end.
-type place() :: init | {step, starl_app_code:running()} | over.

%% A message that waits in the inbox.
-type message() :: {From :: starl:robot_id(), starl_packet:type(), Body :: term()}.

%% What an application waits for: messages of these types, the answer of a machine, a time, or
%% nothing, after its end.
-type waits() ::
    {message, [starl_packet:type()]} | {answer, starl_machine:name()} | time | nothing.

%% The start arguments. `handle' is the application's `Robot'.
-type spec() :: #{
    robot := pos_integer(),
    handle := term(),
    module := module(),
    args := term(),
    driver := pid()
}.

%% @doc Starts the process of an application on a robot.
-spec start_link(spec()) -> {ok, pid()} | {error, term()}.
start_link(Spec) -> proc_lib:start_link(?MODULE, init, [Spec]).

%% @private
-spec init(spec()) -> no_return().
init(#{robot := Id, handle := Robot, module := Module, args := Args, driver := Driver}) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Id, machine => app}),
    _ = starl_driver:attach(Driver, Id, app),
    proc_lib:init_ack({ok, self()}),
    started(Id, Robot, Module, Args, Driver).

started(Id, Robot, Module, Args, Driver) ->
    receive
        {starl_snapshot, From, Ref} ->
            From ! {Ref, {ok, waiting}},
            started(Id, Robot, Module, Args, Driver);
        {starl_restore, From, Ref, #{turn := #turn{} = Turn, at := At, log := Log}} ->
            _ = put(?TURN, Turn#turn{robot = Id, driver = Driver, replay = {From, Ref, Log}}),
            resumed(At, Robot, Args);
        {starl_boot, Boot} ->
            #{now := Now, random := Random, incarnation := Incarnation, stored := Stored} = Boot,
            Lineage = maps:get(code, Boot, starl_lineage:new(Module)),
            Code = starl_lineage:code(Lineage),
            _ = put(?TURN, #turn{
                robot = Id,
                module = Code,
                lineage = Lineage,
                driver = Driver,
                now = Now,
                clock = maps:get(clock, Boot, none),
                random = Random,
                stored = Stored,
                tag = {Incarnation, 0},
                histories = maps:get(histories, Boot, []),
                log = kept_from(maps:get(snapshots, Boot, false))
            }),
            run(Robot, Code, Args)
    end.

kept_from(true) -> {0, []};
kept_from(false) -> none.

run(Robot, Module, Args) ->
    guarded(fun() ->
        ok = begun(init),
        loop(Robot, Module, Module:init(Robot, Args), starl_app_code:version(Module))
    end).

resumed(init, Robot, Args) ->
    run(Robot, (turn())#turn.module, Args);
resumed({step, {Module, State, Version}}, Robot, _Args) ->
    {module, Module} = code:ensure_loaded(Module),
    guarded(fun() -> loop(Robot, Module, State, Version) end);
resumed(over, _Robot, _Args) ->
    guarded(fun() -> over(turn()) end).

%% Every kind of crash carries its stack.
guarded(Run) ->
    try
        Run()
    catch
        Class:Reason:Stack ->
            #turn{steps = Steps} = get(?TURN),
            exit(starl_crash:with_steps(Steps, starl_crash:reason(Class, Reason, Stack)))
    end.

%% @doc The application that runs in this process; `none': it is no process of an application.
-spec application() -> module() | none.
application() ->
    case get(?TURN) of
        #turn{module = Module} -> Module;
        undefined -> none
    end.

%% @doc What the application in this process waits for, and its calls, the innermost first; while
%% the process is at rest.
-spec waiting(pid()) -> {waits(), [starl_crash:frame()]}.
waiting(Pid) ->
    case erlang:process_info(Pid, [dictionary, current_stacktrace]) of
        [{dictionary, Words}, {current_stacktrace, Stack}] ->
            Waits = [Turn#turn.waits || {?TURN, #turn{} = Turn} <- Words],
            {hd(Waits ++ [nothing]), starl_crash:frames(Stack)};
        undefined ->
            {nothing, []}
    end.

%% @doc The application in this process as data, while the process is at rest. It is told with its boot
%% whether snapshots are taken.
-spec snapshot(pid()) -> {ok, snapshot() | waiting} | {error, starl_snapshot:reason()}.
snapshot(Pid) ->
    Ref = erlang:monitor(process, Pid, [{alias, reply_demonitor}]),
    Pid ! {starl_snapshot, Ref, Ref},
    receive
        {Ref, Answer} -> Answer;
        {'DOWN', Ref, process, Pid, _} -> {error, gone}
    end.

%% @doc Lets an application that has started, and waits for its boot, go on from a snapshot. Returns when
%% it waits where it waited then.
-spec restore(pid(), snapshot()) -> ok | {error, Reason :: term()}.
restore(Pid, Snapshot) ->
    Ref = erlang:monitor(process, Pid),
    Pid ! {starl_restore, self(), Ref, Snapshot},
    receive
        {Ref, restored} ->
            true = erlang:demonitor(Ref, [flush]),
            ok;
        {'DOWN', Ref, process, Pid, Reason} ->
            {error, Reason}
    after ?PATIENCE_MS ->
        true = erlang:demonitor(Ref, [flush]),
        {error, no_answer}
    end.

begun(Where) ->
    case turn() of
        #turn{log = none} ->
            ok;
        Turn ->
            Begun = Turn#turn{log = {0, []}},
            _ = put(?BEGUN, {Where, Begun#turn{clock = none, replay = none}}),
            _ = put(?TURN, Begun),
            ok
    end.

taken() ->
    case {get(?TURN), get(?BEGUN)} of
        {#turn{log = {N, _}}, _} when N > ?MOST_EVENTS -> {error, long_step};
        {#turn{log = {_, Log}}, {Where, Turn}} ->
            {ok, #{
                turn => setelement(#turn.driver, Turn, none), at => Where, log => lists:reverse(Log)
            }};
        _ ->
            {error, long_step}
    end.

%% What is too much is not kept.
logged(_Entry, #turn{log = none} = Turn) -> Turn;
logged(_Entry, #turn{log = {N, _}} = Turn) when N >= ?MOST_EVENTS -> Turn#turn{log = {N + 1, []}};
logged(Entry, #turn{log = {N, Log}} = Turn) -> Turn#turn{log = {N + 1, [Entry | Log]}}.

%% @doc Adds actions to the turn; they take place when the application next blocks. A malformed
%% action crashes the application ({@link starl_action}), and so do too many actions without time
%% passing: in one turn, or in turn after turn of a loop that polls.
-spec perform([starl_machine:action()]) -> ok.
perform(New) ->
    ok = starl_action:check(New),
    #turn{actions = Actions} = Turn = counted(length(New), turn()),
    Listening = lists:foldl(fun listening/2, Turn#turn.listening, New),
    _ = put(?TURN, Turn#turn{actions = lists:reverse(New, Actions), listening = Listening}),
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

%% The actions of a turn stay in memory until the application blocks; in virtual time, a loop that
%% lets no time pass holds up the whole team.
counted(N, #turn{count = Count} = Turn) when Count + N =< ?MOMENT_LIMIT ->
    Turn#turn{count = Count + N};
counted(_N, #turn{module = Module}) ->
    error({step_never_blocks, #{application => Module, actions_and_steps => ?MOMENT_LIMIT}}).

%% @doc Listens to a type of message of SAP.
-spec listen(starl_packet:type()) -> ok.
listen(Type) ->
    case turn() of
        #turn{room_told = true} ->
            perform([listens(Type), {cast, sap, {listen, Type, app}}]);
        #turn{inbox = Inbox} = Turn ->
            _ = put(?TURN, Turn#turn{room_told = true, unsaid = 0}),
            Room = max(0, ?INBOX_LIMIT - length(Inbox)),
            perform([listens(Type), {cast, sap, {listen, Type, app, Room}}])
    end.

%% Tells messages that wait for their listener from those that wait in vain.
listens(Type) -> {trace, {listens, Type}}.

%% @doc The robot's own clock, in microseconds, at the beginning of this turn.
-spec now() -> integer().
now() -> (turn())#turn.now.

%% The time that the robot's own clock shows now. In virtual time a turn takes none.
present() ->
    case turn() of
        #turn{replay = {From, Ref, [{clock, Us} = Entry | Log]}} = Turn ->
            _ = put(?TURN, logged(Entry, Turn#turn{replay = {From, Ref, Log}})),
            Us;
        #turn{clock = none, now = Now} ->
            Now;
        #turn{clock = Clock, now = Now} = Turn ->
            Us = max(Now, Clock()),
            _ = put(?TURN, logged({clock, Us}, Turn)),
            Us
    end.

%% @doc A number in `0.0 =< X < 1.0' from the application's own random stream.
-spec random() -> float().
random() ->
    #turn{random = Random} = Turn = turn(),
    {X, Next} = rand:uniform_s(Random),
    _ = put(?TURN, Turn#turn{random = Next}),
    X.

%% @doc Calls another machine of the robot and waits for its answer.
%% `{error, restarted}': the machine crashed, a quarter of a second ago; the request may or may not
%% have taken effect. `{ok, late}': what the answer grants has run out on its way.
-spec call(starl_machine:name(), Request :: term(), Us :: pos_integer() | infinity) ->
    {ok, Answer :: term()} | {error, timeout | restarted}.
call(Name, Request, Us) ->
    Tag = new_tag({answer, Name}),
    ok = told(Name, {invoked, Tag, Name, Request}),
    perform([{call, Name, Request, Tag} | timer(Tag, Us)]),
    Answer = wait(fun
        ({reply, T}, {no_such_machine, N}) when T =:= Tag, N =:= Name -> no_such_machine;
        ({reply, T}, Reply) when T =:= Tag -> {answer, Reply};
        ({timeout, T}, call) when T =:= Tag -> timeout;
        (info, {restarted, N}) when N =:= Name -> restarted;
        (info, {given_up, N}) when N =:= Name -> given_up;
        (_, _) -> skip
    end),
    stop_timer(Tag, Us),
    case Answer of
        {answer, {until, Latest, Reply}} -> returned(Name, Tag, {ok, in_time(Latest, Reply)});
        {answer, Reply} -> returned(Name, Tag, {ok, Reply});
        no_such_machine -> error(missing(Name));
        given_up -> error(missing(Name));
        timeout -> returned(Name, Tag, {error, timeout});
        restarted -> restarted(returned(Name, Tag, {error, restarted}))
    end.

returned(Name, Tag, Answer) ->
    ok = told(Name, {returned, Tag, Answer}),
    Answer.

%% What the caller sees is kept beside what the application does: it is none of its actions, which are counted.
told(Name, Event) ->
    #turn{histories = Names, actions = Actions} = Turn = turn(),
    case lists:member(Name, Names) of
        true ->
            _ = put(?TURN, Turn#turn{actions = [{trace, {history, Event}} | Actions]}),
            ok;
        false ->
            ok
    end.

%% The computer may have stood still on the way of the answer.
in_time(Latest, Reply) ->
    case present() =< Latest of
        true -> Reply;
        false -> late
    end.

%% The cause of the crash, such as a full store, may last: a caller that tried again at once would
%% crash the machine until it is given up.
restarted(Answer) ->
    ok = sleep(?RESTARTED_US),
    Answer.

%% A machine that was given up is missing, too.
missing(Name) ->
    #turn{given_up = GivenUp} = get(?TURN),
    case lists:member(Name, GivenUp) of
        true -> {given_up, Name, it_crashed_too_often};
        false -> {no_such_machine, Name, add_it_to_blocks}
    end.

%% @doc Waits for a message of one of the given types; messages that came earlier count.
-spec await([starl_packet:type()], Us :: non_neg_integer() | infinity) ->
    {ok, message()} | timeout.
await(Types, Us) ->
    #turn{inbox = Inbox, again = Again} = Turn = turn(),
    case {first(Types, Again), first(Types, Inbox)} of
        {{Message, Left}, _} ->
            _ = put(?TURN, noted(Message, Turn#turn{again = Left})),
            {ok, Message};
        {none, {Message, Left}} ->
            _ = put(?TURN, Turn#turn{inbox = Left}),
            {ok, read(Message)};
        {none, none} ->
            await_new(Types, Us)
    end.

first(_Types, []) ->
    none;
first(Types, Messages) ->
    case lists:splitwith(fun({_, Type, _}) -> not lists:member(Type, Types) end, Messages) of
        {Before, [Message | After]} -> {Message, Before ++ After};
        {_, []} -> none
    end.

%% @doc Waits for this time by the robot's own clock.
-spec sleep(Us :: non_neg_integer()) -> ok.
sleep(Us) ->
    Tag = new_tag(time),
    perform(timer(Tag, Us)),
    timeout = wait(fun
        ({timeout, T}, call) when T =:= Tag -> timeout;
        (_, _) -> skip
    end),
    ok.

%% -- internals ------------------------------------------------------------------------------

loop(Robot, Module0, State0, Version0) ->
    ok = begun({step, {Module0, State0, Version0}}),
    {Module, State1, Version1} = switched({Module0, State0, Version0}, turn()),
    {State, Version} = upgrade(Module, State1, Version1),
    case attempted(Robot, Module, State, turn()) of
        {continue, Next} ->
            #turn{steps = Steps} = Turn = get(?TURN),
            _ = put(?TURN, Turn#turn{steps = Steps + 1, resorts = []}),
            loop(Robot, Module, Next, Version);
        {done, Result} ->
            perform([{done, Result}]),
            over(turn());
        {taken_back, {Former, Kept, Md5}} ->
            loop(Robot, Former, Kept, Md5)
    end.

count_step(Module) ->
    try counted(1, turn()) of
        Turn ->
            _ = put(?TURN, Turn),
            ok
    catch
        error:Reason -> erlang:raise(error, Reason, [step_of(Module)])
    end.

%% The frame of a step that has returned.
step_of(Module) ->
    case starl_code:line(Module, step, 2) of
        {ok, File, Line} -> {Module, step, 2, [{file, File}, {line, Line}]};
        none -> {Module, step, 2, []}
    end.

%% A step of new code on trial may crash, and so may the first step after the way back.
attempted(Robot, Module, State, Turn) ->
    case may_crash(Turn) of
        true ->
            _ = put(?TURN, Turn#turn{read = []}),
            try
                stepped(Robot, Module, State)
            catch
                Class:Reason:Stack -> crashed({Class, Reason, Stack}, Module, State, turn())
            end;
        false ->
            stepped(Robot, Module, State)
    end.

may_crash(#turn{resorts = [_ | _]}) -> true;
may_crash(#turn{now = Now, lineage = Lineage}) -> starl_lineage:is_on_trial(Now, Lineage).

crashed({Class, Reason, Stack} = Crash, Module, State, Turn) ->
    Cause = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
    case may_crash(Turn) andalso taken_back(Cause, Module, State, Turn) of
        {_Module, _State, _Md5} = Former ->
            {taken_back, Former};
        none ->
            %% the driver hears of code that was taken in this turn before it hears of the crash
            ok = sleep(0),
            raise(Crash);
        false ->
            raise(Crash)
    end.

-spec raise({error | exit | throw, term(), erlang:stacktrace()}) -> no_return().
raise({Class, Reason, Stack}) -> erlang:raise(Class, Reason, Stack).

stepped(Robot, Module, State) ->
    ok = count_step(Module),
    case Module:step(Robot, State) of
        {continue, _} = Continue -> Continue;
        {done, _} = Done -> Done;
        Other -> erlang:raise(error, {bad_return, {Module, step}, Other}, [step_of(Module)])
    end.

%% It takes no step any more.
over(Turn0) ->
    ok = begun(over),
    #turn{switches = Words} = Turn = Turn0#turn{log = (turn())#turn.log},
    _ = put(?TURN, Turn#turn{switches = [], over = true}),
    lists:foreach(fun(Word) -> hear(Word, turn()) end, Words),
    wait(fun(_, _) -> skip end).

%% -- new code -------------------------------------------------------------------------------

%% Heeds the words on new code that have come since the last step.
switched(Running, #turn{switches = []}) ->
    Running;
switched(Running, #turn{switches = [Word | Words]} = Turn) ->
    _ = put(?TURN, Turn#turn{switches = Words}),
    switched(heeded(Word, Running), turn()).

-spec heeded(starl_reload:word(), starl_app_code:running()) -> starl_app_code:running().
heeded({take, #{number := N} = Switch}, Running) ->
    #turn{lineage = Lineage} = turn(),
    case starl_lineage:has(N, Lineage) of
        %% it has started with this code
        true -> Running;
        false -> taken(Switch, Running)
    end;
heeded({back, N, Robot}, Running) ->
    #turn{lineage = Lineage} = Turn = turn(),
    case starl_lineage:leave(N, Lineage) of
        {left, Left, Earlier} ->
            sent_back({back, Robot}, Left, Earlier, Running);
        {skipped, Skipped} ->
            _ = put(?TURN, Turn#turn{lineage = Skipped}),
            tell([starl_reload:told(N, {back, Robot}, nobody, Skipped)]),
            Running;
        unknown ->
            Running
    end.

taken(#{number := N, module := New} = Switch, {_Module, State, Md5} = Running) ->
    case starl_app_code:carried(New, State, Md5) of
        {ok, Next} ->
            Taken = on_trial(Switch, State, Md5, turn()),
            tell([starl_reload:told(N, taken, nobody, Taken)]),
            {New, Next, starl_app_code:version(New)};
        {failed, Cause} ->
            #turn{lineage = Lineage} = turn(),
            tell([starl_reload:told(N, {migration_failed, Cause}, nobody, Lineage)]),
            Running
    end.

%% A state that no step of the former code has taken yet is not kept.
on_trial(#{module := New} = Switch, State, Md5, Turn) ->
    #turn{now = Now, lineage = Lineage, resorts = Resorts} = Turn,
    {_, Proven} = lists:last([{New, State} | Resorts]),
    Taken = starl_lineage:take(
        Switch#{kept => starl_app_code:kept(New, Proven, Md5)}, Now, Lineage
    ),
    _ = put(?TURN, Turn#turn{module = New, lineage = Taken, resorts = []}),
    Taken.

sent_back(Outcome, Left, Earlier, {_, State, _}) ->
    #turn{module = Module} = Turn = turn(),
    case starl_app_code:way_back(Left, Earlier, State) of
        none ->
            tell(starl_reload:left(Outcome, nobody, {Left, Earlier})),
            %% the driver carries it out when the application blocks
            ok = sleep(0),
            error({no_way_back, Module});
        {Former, Resorts} ->
            _ = put(?TURN, back_on(Earlier, Resorts, Turn)),
            tell(starl_reload:left(Outcome, nobody, {Left, Earlier})),
            Former
    end.

%% The step is taken back as far as it can be: what it has read will be read again. What it has done
%% stands, as after any crash; the other machines learn of one. `none': it is the application that
%% crashes, and starts anew.
taken_back(Cause, Module, _State, #turn{resorts = [{N, Before} | Resorts]} = Turn) ->
    #turn{lineage = Lineage} = Turn,
    _ = put(?TURN, unread(Turn#turn{resorts = Resorts})),
    tell([starl_reload:told(N, {restored, Cause}, others, Lineage)]),
    {Module, Before, starl_app_code:version(Module)};
taken_back(Cause, _Module, State, #turn{lineage = Lineage} = Turn) ->
    {Left, Earlier} = starl_lineage:back(Lineage),
    case starl_app_code:way_back(Left, Earlier, State) of
        none ->
            none;
        {Former, Resorts} ->
            _ = put(?TURN, unread(back_on(Earlier, Resorts, Turn))),
            tell(starl_reload:left({crashed, Cause}, others, {Left, Earlier})),
            Former
    end.

unread(#turn{read = Read, again = Again} = Turn) ->
    Turn#turn{count = 0, read = [], again = lists:reverse(Read, Again)}.

back_on(Earlier, Resorts, Turn) ->
    Turn#turn{module = starl_lineage:code(Earlier), lineage = Earlier, resorts = Resorts}.

tell(Told) -> perform([{reloaded, One} || One <- Told]).

%% A word on new code has come: too late, if the application is done. Code that was not taken yet need not be taken back.
hear({take, #{number := N}}, #turn{over = true, lineage = Lineage} = Turn) ->
    _ = put(?TURN, Turn),
    tell([starl_reload:told(N, done, nobody, Lineage)]);
hear({back, _, _}, #turn{over = true} = Turn) ->
    _ = put(?TURN, Turn),
    ok;
hear({back, N, Robot} = Word, #turn{switches = Words, lineage = Lineage} = Turn) ->
    case [S || {take, #{number := M} = S} <- Words, M =:= N] of
        [Switch | _] ->
            _ = put(?TURN, Turn#turn{switches = lists:delete({take, Switch}, Words)}),
            tell([starl_reload:told(N, {back, Robot}, nobody, Lineage)]);
        [] ->
            _ = put(?TURN, Turn#turn{switches = Words ++ [Word]}),
            ok
    end;
hear(Word, #turn{switches = Words} = Turn) ->
    _ = put(?TURN, Turn#turn{switches = Words ++ [Word]}),
    ok.

%% A state never meets code that cannot take it over: the application waits with it before the
%% next step until suitable code is loaded. The code that the state came from is suitable.
upgrade(Module, State, Old) ->
    case starl_app_code:version(Module) of
        Old -> {State, Old};
        New -> upgrade(starl_app_code:carried(Module, State, Old), Module, State, Old, New)
    end.

upgrade({ok, Next}, _Module, _State, _Old, New) ->
    {Next, New};
upgrade({failed, Cause}, Module, State, Old, New) ->
    perform([{trace, {code_change_failed, Cause}}, starl_motion:stop()]),
    Why = unicode:characters_to_binary(starl_crash:format(Cause)),
    logger:error(#{what => code_change_failed, application => Module, reason => Why}),
    ok = await_other_code(Module, New),
    upgrade(Module, State, Old).

await_other_code(Module, Failed) ->
    ok = sleep(?OTHER_CODE_US),
    case starl_app_code:version(Module) of
        Failed -> await_other_code(Module, Failed);
        _ -> ok
    end.

await_new(Types, Us) ->
    Tag = new_tag({message, Types}),
    perform(timer(Tag, Us)),
    Answer = wait(fun
        (cast, {message, From, Type, Body}) ->
            case lists:member(Type, Types) of
                true -> {message, {From, Type, Body}};
                false -> skip
            end;
        ({timeout, T}, call) when T =:= Tag ->
            timeout;
        (_, _) ->
            skip
    end),
    stop_timer(Tag, Us),
    case Answer of
        {message, Message} -> {ok, read(Message)};
        timeout -> timeout
    end.

%% Traces a message of SAP that was read, for the monitor, and gives its room back.
read({From, {app, _} = Type, Body} = Message) ->
    #turn{inbox = Inbox, unsaid = Unsaid} = Turn = get(?TURN),
    Said = said(Unsaid + 1, ?INBOX_LIMIT - length(Inbox)),
    _ = put(?TURN, Turn#turn{unsaid = Unsaid + 1 - Said}),
    Credit = [{cast, sap, {read, app, Said}} || Said > 0],
    ok = perform([{trace, {read, From, Type, erlang:phash2(Body)}} | Credit]),
    _ = put(?TURN, noted(Message, turn())),
    Message;
read(Message) ->
    _ = put(?TURN, noted(Message, turn())),
    Message.

noted(Message, #turn{read = Read} = Turn) ->
    case may_crash(Turn) of
        true -> Turn#turn{read = [Message | Read]};
        false -> Turn
    end.

said(Unsaid, Free) when Unsaid >= ?READ_AT_ONCE; Free - Unsaid < ?READ_AT_ONCE -> Unsaid;
said(_Unsaid, _Free) -> 0.

%% Hands the gathered actions back and takes events until Match accepts one. What a snapshot knows to be
%% done is not done again.
-spec wait(fun((starl_machine:event_type(), term()) -> skip | term())) -> term().
wait(Match) ->
    case get(?TURN) of
        #turn{replay = none, robot = Id, driver = Driver, actions = Actions} = Turn ->
            _ = starl_driver:done(Driver, Id, lists:reverse(Actions)),
            awaited(Match, Turn);
        #turn{replay = {From, Ref, []}} = Turn ->
            From ! {Ref, restored},
            _ = put(?TURN, Turn#turn{replay = none, actions = []}),
            awaited(Match, Turn#turn{replay = none});
        #turn{replay = {From, Ref, [{event, Type, Content, Now} | Log]}} = Turn ->
            came(Type, Content, Now, Match, Turn#turn{replay = {From, Ref, Log}});
        #turn{replay = {_, _, [{clock, _} | _]}} ->
            exit(another_way)
    end.

awaited(Match, Turn) ->
    receive
        {starl_step, Type, Content, #{now := Now}} ->
            came(Type, Content, Now, Match, Turn);
        {starl_snapshot, From, Ref} ->
            From ! {Ref, taken()},
            awaited(Match, Turn)
    end.

came(code, Word, Now, Match, Turn) ->
    ok = hear(Word, handed_back(Now, logged({event, code, Word, Now}, Turn))),
    wait(Match);
came(Type0, Content0, Now, Match, Turn) ->
    _ = put(?TURN, handed_back(Now, logged({event, Type0, Content0, Now}, Turn))),
    {Type, Content} = sensed(Type0, Content0, Turn),
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

%% What the body feels is a message of the robot itself, if the application listens to it.
sensed(info, {sensed, Sense} = Sensed, #turn{robot = Id, listening = Listening}) ->
    case lists:member({sap, {listen, {app, sense}, app}}, Listening) of
        true -> {cast, {message, Id, sense, Sense}};
        false -> {info, Sensed}
    end;
sensed(Type, Content, _Turn) ->
    {Type, Content}.

listening({cast, sap, {listen, Type, app, _Room}}, Known) ->
    lists:umerge([{sap, {listen, Type, app}}], Known);
listening({cast, Machine, {listen, _, _} = Word}, Known) ->
    lists:umerge([{Machine, Word}], Known);
listening({cast, Machine, {subscribe, _, _} = Word}, Known) ->
    lists:umerge([{Machine, Word}], Known);
listening(_, Known) ->
    Known.

%% A restarted machine has lost its listeners: the application listens again.
heed(info, {restarted, sap}) ->
    #turn{listening = Listening} = Turn = get(?TURN),
    _ = put(?TURN, Turn#turn{room_told = false}),
    lists:foreach(fun listen/1, [Type || {sap, {listen, Type, app}} <- Listening]);
heed(info, {restarted, Machine}) ->
    #turn{listening = Listening} = get(?TURN),
    perform([{cast, Machine, Word} || {M, Word} <- Listening, M =:= Machine]);
heed(info, {given_up, Machine}) ->
    #turn{given_up = GivenUp} = Turn = get(?TURN),
    _ = put(?TURN, Turn#turn{given_up = [Machine | GivenUp]}),
    ok;
heed(_, _) ->
    ok.

%% Keeps or traces an event for which the application does not wait.
keep(cast, {message, From, {app, _} = Type, Body}) ->
    #turn{inbox = Inbox} = Turn = get(?TURN),
    put(?TURN, Turn#turn{inbox = Inbox ++ [{From, Type, Body}]});
keep(cast, {message, From, Type, Body}) ->
    #turn{inbox = Inbox} = Turn = get(?TURN),
    case length(Inbox) < ?INBOX_LIMIT of
        true -> put(?TURN, Turn#turn{inbox = Inbox ++ [{From, Type, Body}]});
        false -> perform([{trace, {inbox_full, From, Type}}])
    end;
keep({timeout, _}, call) ->
    ok;
keep({reply, _}, _) ->
    ok;
keep(info, {Word, _}) when Word =:= restarted; Word =:= given_up; Word =:= sensed ->
    ok;
keep(Type, Content) ->
    perform([{trace, {unknown_event, Type, Content}}]).

new_tag(Waits) ->
    #turn{tag = {Life, N}} = Turn = turn(),
    _ = put(?TURN, Turn#turn{tag = {Life, N + 1}, waits = Waits}),
    {Life, N + 1}.

timer(_Tag, infinity) -> [];
timer(Tag, Us) -> [{{timeout, Tag}, Us, call}].

stop_timer(_Tag, infinity) -> ok;
stop_timer(Tag, _Us) -> perform([{{timeout, Tag}, cancel}]).
