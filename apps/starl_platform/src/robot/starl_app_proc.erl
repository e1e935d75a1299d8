%% @doc The process of a sequential application, and the calls that the application makes in it. It
%% takes the application's steps, replaces its code, and reports its crashes.
%%
%% The application runs on a stack of its own. A blocking call ({@link call/3}, {@link await/2},
%% {@link sleep/1}) hands the actions gathered so far to the driver ({@link starl_driver}), and
%% returns with the event that it waits for:
%% ```
%%   driver                                 application
%%     | {starl_boot, ..} ------------------> | init/2, then step/2 again and again;
%%     |                                      |   its actions are gathered
%%     | <--------- {starl_done, .., Actions} | it blocks
%%     | {starl_step, Type, Content, ..} ---> | the awaited event: the call returns
%%     |                                      | another one: a message is kept until it is read,
%%     | <--------- {starl_done, .., Actions} |   the rest is traced or ignored
%% '''
%% A turn is what the application does between two events. All of it happens at the time of the
%% event by the robot's clock. The record of the turn is kept in the process dictionary, under one
%% key: the application's own functions lie between the calls on the stack, so no state can be
%% passed through them. Messages that arrive meanwhile are in {@link starl_app_inbox}, the versions
%% of the code in {@link starl_app_code}.
-module(starl_app_proc).

-export([start_link/1, init/1, waiting/1]).
-export([call/3, await/2, sleep/1]).
-export([perform/1, listen/1, store/1, stored/0, now/0, random/0, application/0]).

-export_type([waits/0]).

-define(TURN, starl_turn).
%% The largest number of actions and steps in one moment of the robot's clock.
-define(MOMENT_LIMIT, 100000).
%% The time between two attempts to carry a state over into other code.
-define(OTHER_CODE_US, 1000000).
%% The time that a caller waits after a crash of the machine that it called.
-define(RESTARTED_US, 250000).

%% The start arguments. `handle' is the application's `Robot'.
-type spec() :: #{
    robot := pos_integer(),
    handle := term(),
    module := module(),
    args := term(),
    driver := pid()
}.

%% What an application waits for: messages of these types, the answer of a machine, a time, or
%% nothing, after its end.
-type waits() ::
    {message, [starl_packet:type()]} | {answer, starl_machine:name()} | time | nothing.

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
    waits = nothing :: waits(),
    %% completed steps
    steps = 0 :: non_neg_integer(),
    code :: starl_app_code:t(),
    %% the application is done
    over = false :: boolean(),
    %% the machines of whose calls a history is kept
    histories = [] :: [starl_machine:name()]
}).

%% -- start ----------------------------------------------------------------------------------

%% @doc Starts the process of an application on a robot.
-spec start_link(spec()) -> {ok, pid()} | {error, term()}.
start_link(Spec) -> proc_lib:start_link(?MODULE, init, [Spec]).

%% @private
-spec init(spec()) -> no_return().
init(#{robot := Id, handle := Robot, module := Module, args := Args, driver := Driver}) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Id, machine => app}),
    _ = starl_driver:attach(Driver, Id, app),
    proc_lib:init_ack({ok, self()}),
    receive
        {starl_boot, Boot} ->
            _ = put(?TURN, first_turn(Id, Module, Driver, Boot)),
            run(Robot, Args)
    end.

first_turn(Id, Module, Driver, Boot) ->
    #{now := Now, random := Random, incarnation := Incarnation, stored := Stored} = Boot,
    #turn{
        robot = Id,
        driver = Driver,
        now = Now,
        clock = maps:get(clock, Boot, none),
        random = Random,
        stored = Stored,
        tag = {Incarnation, 0},
        code = starl_app_code:new(maps:get(code, Boot, starl_lineage:new(Module))),
        histories = maps:get(histories, Boot, [])
    }.

%% Every kind of crash carries its stack.
run(Robot, Args) ->
    #turn{code = Code} = turn(),
    Module = starl_app_code:module(Code),
    try
        loop(Robot, {Module, Module:init(Robot, Args), starl_app_code:version(Module)})
    catch
        Class:Reason:Stack ->
            #turn{steps = Steps} = turn(),
            exit(starl_crash:with_steps(Steps, starl_crash:reason(Class, Reason, Stack)))
    end.

%% @doc What the application in this process waits for, and its calls, the innermost first; while
%% the process is at rest.
-spec waiting(pid()) -> {waits(), [starl_crash:frame()]}.
waiting(Pid) ->
    case erlang:process_info(Pid, [dictionary, current_stacktrace]) of
        [{dictionary, Dictionary}, {current_stacktrace, Stack}] ->
            {waits(lists:keyfind(?TURN, 1, Dictionary)), starl_crash:frames(Stack)};
        undefined ->
            {nothing, []}
    end.

waits({?TURN, #turn{waits = Waits}}) -> Waits;
waits(false) -> nothing.

%% -- steps ----------------------------------------------------------------------------------

loop(Robot, Before) ->
    {Module, State, Version} = upgrade(with_new_code(Before)),
    case attempted(Robot, Module, State) of
        {continue, Next} ->
            ok = step_ended(),
            loop(Robot, {Module, Next, Version});
        {done, Result} ->
            ok = perform([{done, Result}]),
            over();
        {taken_back, Former} ->
            loop(Robot, Former)
    end.

%% A step of new code on trial may crash, and so may the first step after the return to the former
%% code. Then it may be taken back.
attempted(Robot, Module, State) ->
    #turn{inbox = Inbox} = Turn = turn(),
    case may_crash(Turn) of
        true ->
            _ = put(?TURN, Turn#turn{inbox = starl_app_inbox:step(Inbox)}),
            try
                stepped(Robot, Module, State)
            catch
                Class:Reason:Stack -> crashed({Class, Reason, Stack}, Module, State)
            end;
        false ->
            stepped(Robot, Module, State)
    end.

may_crash(#turn{now = Now, code = Code}) -> starl_app_code:may_crash(Now, Code).

stepped(Robot, Module, State) ->
    ok = count_step(Module),
    case Module:step(Robot, State) of
        {continue, _} = Continue -> Continue;
        {done, _} = Done -> Done;
        Other -> erlang:raise(error, {bad_return, {Module, step}, Other}, [step_of(Module)])
    end.

count_step(Module) ->
    try
        _ = put(?TURN, counted(1, turn())),
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

step_ended() ->
    #turn{steps = Steps, code = Code} = Turn = turn(),
    _ = put(?TURN, Turn#turn{steps = Steps + 1, code = starl_app_code:stepped(Code)}),
    ok.

%% A step that may crash has crashed: it is taken back as far as it can be
%% ({@link starl_app_code:taken_back/4}). The messages that it has read will be read again.
crashed({Class, Reason, Stack} = Crash, Module, State) ->
    #turn{code = Code, inbox = Inbox} = Turn = turn(),
    Cause = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
    case may_crash(Turn) andalso starl_app_code:taken_back(Cause, Module, State, Code) of
        {Reports, Former, Next} ->
            _ = put(?TURN, Turn#turn{count = 0, inbox = starl_app_inbox:taken_back(Inbox)}),
            ok = code(Next, Reports),
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

%% The application takes no step any more.
-spec over() -> no_return().
over() ->
    _ = put(?TURN, (turn())#turn{over = true}),
    ok = refuse_new_code(turn()),
    wait(fun(_, _) -> skip end).

%% -- new code -------------------------------------------------------------------------------

%% A reload command has come: it is applied before the next step, or refused after the last.
reload_command(Command, #turn{over = IsOver, code = Code} = Turn) ->
    {Reports, Next} = starl_app_code:received(Command, IsOver, Code),
    _ = put(?TURN, Turn),
    code(Next, Reports).

refuse_new_code(#turn{code = Code} = Turn) ->
    case starl_app_code:next_command(Code) of
        none ->
            ok;
        {Command, Left} ->
            ok = reload_command(Command, Turn#turn{code = Left}),
            refuse_new_code(turn())
    end.

%% Applies the reload commands that have come since the last step.
with_new_code(Running) ->
    #turn{code = Code} = Turn = turn(),
    case starl_app_code:next_command(Code) of
        none ->
            Running;
        {Command, Left} ->
            _ = put(?TURN, Turn#turn{code = Left}),
            with_new_code(reloaded(Command, Running))
    end.

reloaded(Command, {Module, _State, _Md5} = Running) ->
    #turn{code = Code, now = Now} = turn(),
    case starl_app_code:apply_command(Command, Running, Now, Code) of
        {ok, Reports, Next, Applied} ->
            #turn{code = Present} = turn(),
            ok = code(starl_app_code:with_later_commands(Applied, Present), Reports),
            Next;
        {no_way_back, Reports} ->
            ok = code(Code, Reports),
            %% the driver carries it out when the application blocks
            ok = sleep(0),
            error({no_way_back, Module})
    end.

%% The application goes on with its code in this state, and reports how it has applied reload
%% commands.
code(Code, Reports) ->
    _ = put(?TURN, (turn())#turn{code = Code}),
    perform([{reloaded, Report} || Report <- Reports]).

%% A state never meets code that cannot take it over: the application waits with it before the
%% next step until suitable code is loaded. The code that the state came from is suitable.
upgrade({Module, State, Old} = Running) ->
    case starl_app_code:version(Module) of
        Old -> Running;
        New -> upgrade(starl_app_code:carried(Module, State, Old), New, Running)
    end.

upgrade({ok, Next}, New, {Module, _State, _Old}) ->
    {Module, Next, New};
upgrade({failed, Cause}, New, {Module, _State, _Old} = Running) ->
    ok = perform([{trace, {code_change_failed, Cause}}, starl_motion:stop()]),
    Why = unicode:characters_to_binary(starl_crash:format(Cause)),
    logger:error(#{what => code_change_failed, application => Module, reason => Why}),
    ok = await_other_code(Module, New),
    upgrade(Running).

await_other_code(Module, Failed) ->
    ok = sleep(?OTHER_CODE_US),
    case starl_app_code:version(Module) of
        Failed -> await_other_code(Module, Failed);
        _ -> ok
    end.

%% -- calls that block -----------------------------------------------------------------------

%% @doc Calls another machine of the robot and waits for its answer. `{error, restarted}': the
%% machine crashed, a quarter of a second ago; the request may or may not have taken effect. `{ok,
%% late}': the answer granted something for a time, which ran out before the answer came.
-spec call(starl_machine:name(), Request :: term(), Us :: pos_integer() | infinity) ->
    {ok, Answer :: term()} | {error, timeout | restarted}.
call(Name, Request, Us) ->
    Tag = new_tag({answer, Name}),
    ok = history(Name, {invoked, Tag, Name, Request}),
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
    ok = history(Name, {returned, Tag, Answer}),
    Answer.

%% Keeps what the caller of a machine sees, beside what the application does: it is none of its
%% actions, which are counted.
history(Name, Event) ->
    #turn{histories = Names, actions = Actions} = Turn = turn(),
    case lists:member(Name, Names) of
        true ->
            _ = put(?TURN, Turn#turn{actions = [{trace, {history, Event}} | Actions]}),
            ok;
        false ->
            ok
    end.

%% The computer may have stalled before the answer came.
in_time(Latest, Reply) ->
    case present() =< Latest of
        true -> Reply;
        false -> late
    end.

%% The time that the robot's own clock shows now. In virtual time a turn takes none.
present() ->
    case turn() of
        #turn{clock = none, now = Now} ->
            Now;
        #turn{clock = Clock, now = Now} ->
            max(Now, Clock())
    end.

%% The cause of the crash, such as a full store, may last: a caller that tried again at once would
%% crash the machine until it is given up.
restarted(Answer) ->
    ok = sleep(?RESTARTED_US),
    Answer.

%% A machine that was given up is missing, too.
missing(Name) ->
    #turn{given_up = GivenUp} = turn(),
    case lists:member(Name, GivenUp) of
        true -> {given_up, Name, it_crashed_too_often};
        false -> {no_such_machine, Name, add_it_to_blocks}
    end.

%% @doc Waits for a message of one of the given types; messages that came earlier count.
-spec await([starl_packet:type()], Us :: non_neg_integer() | infinity) ->
    {ok, starl_app_inbox:message()} | timeout.
await(Types, Us) ->
    #turn{inbox = Inbox} = Turn = turn(),
    case starl_app_inbox:take(Types, may_crash(Turn), Inbox) of
        {Message, Actions, Left} -> has_read(Message, Actions, Left, Turn);
        none -> await_new(Types, Us)
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
        {message, Message} ->
            #turn{inbox = Inbox} = Turn = turn(),
            {Actions, Next} = starl_app_inbox:read(Message, may_crash(Turn), Inbox),
            has_read(Message, Actions, Next, Turn);
        timeout ->
            timeout
    end.

has_read(Message, Actions, Inbox, Turn) ->
    _ = put(?TURN, Turn#turn{inbox = Inbox}),
    perform(Actions),
    {ok, Message}.

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

%% The tag of the next call, which waits for this.
-spec new_tag(waits()) -> {Incarnation :: pos_integer(), pos_integer()}.
new_tag(Waits) ->
    #turn{tag = {Life, N}} = Turn = turn(),
    _ = put(?TURN, Turn#turn{tag = {Life, N + 1}, waits = Waits}),
    {Life, N + 1}.

timer(_Tag, infinity) -> [];
timer(Tag, Us) -> [{{timeout, Tag}, Us, call}].

stop_timer(_Tag, infinity) -> ok;
stop_timer(Tag, _Us) -> perform([{{timeout, Tag}, cancel}]).

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

%% Counts actions and steps. The actions of a turn stay in memory until the application blocks; in
%% virtual time, a loop that lets no time pass holds up the whole team.
counted(N, #turn{count = Count} = Turn) when Count + N =< ?MOMENT_LIMIT ->
    Turn#turn{count = Count + N};
counted(_N, #turn{code = Code}) ->
    Application = starl_app_code:module(Code),
    error({step_never_blocks, #{application => Application, actions_and_steps => ?MOMENT_LIMIT}}).

%% @doc Listens to a type of message of SAP.
-spec listen(starl_packet:type()) -> ok.
listen(Type) ->
    #turn{inbox = Inbox} = Turn = turn(),
    {Request, Next} = starl_app_inbox:listen(Type, Inbox),
    _ = put(?TURN, Turn#turn{inbox = Next}),
    %% tells messages that wait for their listener from those that wait in vain
    perform([{trace, {listens, Type}}, {cast, sap, Request}]).

%% @doc Keeps a term over crashes and reboots, in place of the term kept before.
-spec store(term()) -> ok.
store(Term) ->
    ok = perform([{store, Term}]),
    _ = put(?TURN, (turn())#turn{stored = {stored, Term}}),
    ok.

%% @doc The term that was kept last, in this incarnation or an earlier one.
-spec stored() -> starl_machine:stored().
stored() -> (turn())#turn.stored.

%% @doc The robot's own clock, in microseconds, at the beginning of this turn.
-spec now() -> integer().
now() -> (turn())#turn.now.

%% @doc A number in `0.0 =< X < 1.0' from the application's own random stream.
-spec random() -> float().
random() ->
    #turn{random = Random} = Turn = turn(),
    {X, Next} = rand:uniform_s(Random),
    _ = put(?TURN, Turn#turn{random = Next}),
    X.

%% @doc The application that runs in this process; `none': it is no process of an application.
-spec application() -> module() | none.
application() ->
    case get(?TURN) of
        #turn{code = Code} -> starl_app_code:module(Code);
        undefined -> none
    end.

turn() ->
    case get(?TURN) of
        #turn{} = Turn -> Turn;
        undefined -> error({not_in_an_application, self()})
    end.

%% -- waiting --------------------------------------------------------------------------------

%% Hands the gathered actions back and takes events until Match accepts one.
wait(Match) ->
    #turn{robot = Id, driver = Driver, actions = Actions} = Turn = get(?TURN),
    _ = starl_driver:done(Driver, Id, lists:reverse(Actions)),
    receive
        {starl_step, Type, Content, #{now := Now}} -> event(Type, Content, Now, Match, Turn)
    end.

event(code, Command, Now, Match, Turn) ->
    ok = reload_command(Command, next_turn(Now, Turn)),
    wait(Match);
event(Type0, Content0, Now, Match, Turn) ->
    _ = put(?TURN, next_turn(Now, Turn)),
    #turn{robot = Id, inbox = Inbox} = Turn,
    {Type, Content} = starl_app_inbox:sensed(Type0, Content0, Id, Inbox),
    note(Type, Content),
    case Match(Type, Content) of
        skip ->
            keep(Type, Content),
            wait(Match);
        Answer ->
            Answer
    end.

next_turn(Now, #turn{now = Now} = Turn) -> Turn#turn{actions = []};
next_turn(Now, Turn) -> Turn#turn{actions = [], count = 0, now = Now}.

%% A restarted machine has lost its listeners: the application listens again.
note(info, {restarted, Machine}) ->
    #turn{inbox = Inbox} = Turn = get(?TURN),
    {Requests, Next} = starl_app_inbox:restarted(Machine, Inbox),
    _ = put(?TURN, Turn#turn{inbox = Next}),
    lists:foreach(fun(Request) -> subscribe_again(Machine, Request) end, Requests);
note(info, {given_up, Machine}) ->
    #turn{given_up = GivenUp} = Turn = get(?TURN),
    _ = put(?TURN, Turn#turn{given_up = [Machine | GivenUp]}),
    ok;
note(_, _) ->
    ok.

subscribe_again(sap, {listen, Type, app}) -> listen(Type);
subscribe_again(Machine, Request) -> perform([{cast, Machine, Request}]).

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
keep(info, {Kind, _}) when Kind =:= restarted; Kind =:= given_up; Kind =:= sensed ->
    ok;
keep(Type, Content) ->
    perform([{trace, {unknown_event, Type, Content}}]).
