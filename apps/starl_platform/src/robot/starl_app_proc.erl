%% @doc The process of a sequential application. It starts the application, takes its steps, applies
%% new code, and reports its crashes. {@link starl_app_turn} keeps what the application does in a
%% turn; {@link starl_app_call} has its blocking calls. The process uses the driver protocol of
%% {@link starl_driver}.
-module(starl_app_proc).

-export([start_link/1, init/1, waiting/1]).

%% The time between two attempts to carry a state over into other code.
-define(OTHER_CODE_US, 1000000).

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
    receive
        {starl_boot, Boot} ->
            ok = starl_app_turn:start(Id, Module, Driver, Boot),
            run(Robot, Args)
    end.

%% Every kind of crash carries its stack.
run(Robot, Args) ->
    Module = starl_app_code:module(starl_app_turn:code()),
    try
        loop(Robot, Module, Module:init(Robot, Args), starl_app_code:version(Module))
    catch
        Class:Reason:Stack ->
            Steps = starl_app_turn:steps(),
            exit(starl_crash:with_steps(Steps, starl_crash:reason(Class, Reason, Stack)))
    end.

%% @doc What the application in this process waits for, and its calls, the innermost first; while
%% the process is at rest.
-spec waiting(pid()) -> {starl_app_call:waits(), [starl_crash:frame()]}.
waiting(Pid) ->
    case erlang:process_info(Pid, [dictionary, current_stacktrace]) of
        [{dictionary, Words}, {current_stacktrace, Stack}] ->
            {starl_app_turn:waits(Words), starl_crash:frames(Stack)};
        undefined ->
            {nothing, []}
    end.

%% -- steps ----------------------------------------------------------------------------------

loop(Robot, Module0, State0, Version0) ->
    {Module, State1, Version1} = switched({Module0, State0, Version0}),
    {State, Version} = upgrade(Module, State1, Version1),
    case attempted(Robot, Module, State) of
        {continue, Next} ->
            ok = starl_app_turn:stepped(),
            loop(Robot, Module, Next, Version);
        {done, Result} ->
            ok = starl_app_turn:perform([{done, Result}]),
            starl_app_turn:over();
        {taken_back, {Former, Kept, Md5}} ->
            loop(Robot, Former, Kept, Md5)
    end.

%% A step of new code on trial may crash, and so may the first step after the way back.
attempted(Robot, Module, State) ->
    case starl_app_turn:step() of
        true ->
            try
                stepped(Robot, Module, State)
            catch
                Class:Reason:Stack -> crashed({Class, Reason, Stack}, Module, State)
            end;
        false ->
            stepped(Robot, Module, State)
    end.

crashed({Class, Reason, Stack} = Crash, Module, State) ->
    Cause = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
    case starl_app_turn:take_back(Cause, Module, State) of
        {_Module, _State, _Md5} = Former ->
            {taken_back, Former};
        none ->
            %% the driver hears of code that was taken in this turn before it hears of the crash
            ok = starl_app_call:sleep(0),
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

count_step(Module) ->
    try
        starl_app_turn:count(1)
    catch
        error:Reason -> erlang:raise(error, Reason, [step_of(Module)])
    end.

%% The frame of a step that has returned.
step_of(Module) ->
    case starl_code:line(Module, step, 2) of
        {ok, File, Line} -> {Module, step, 2, [{file, File}, {line, Line}]};
        none -> {Module, step, 2, []}
    end.

%% -- new code -------------------------------------------------------------------------------

%% Heeds the words on new code that have come since the last step.
switched(Running) ->
    case starl_app_code:word(starl_app_turn:code()) of
        none ->
            Running;
        {Word, Code} ->
            ok = starl_app_turn:code(Code, []),
            switched(heeded(Word, Running))
    end.

heeded(Word, {Module, _State, _Md5} = Running) ->
    Code = starl_app_turn:code(),
    case starl_app_code:heed(Word, Running, starl_app_turn:now(), Code) of
        {ok, Told, Next, Heeded} ->
            ok = starl_app_turn:code(starl_app_code:heeded(Heeded, starl_app_turn:code()), Told),
            Next;
        {no_way_back, Told} ->
            ok = starl_app_turn:code(Code, Told),
            %% the driver carries it out when the application blocks
            ok = starl_app_call:sleep(0),
            error({no_way_back, Module})
    end.

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
    ok = starl_app_turn:perform([{trace, {code_change_failed, Cause}}, starl_motion:stop()]),
    Why = unicode:characters_to_binary(starl_crash:format(Cause)),
    logger:error(#{what => code_change_failed, application => Module, reason => Why}),
    ok = await_other_code(Module, New),
    upgrade(Module, State, Old).

await_other_code(Module, Failed) ->
    ok = starl_app_call:sleep(?OTHER_CODE_US),
    case starl_app_code:version(Module) of
        Failed -> await_other_code(Module, Failed);
        _ -> ok
    end.
