%% @doc The behaviour of every protocol of StarL, and the pure runner of such a machine.
%%
%% A machine is a callback module with gen_statem's vocabulary and no side effects: time,
%% identity and randomness come in through its configuration and {@link meta()}, and everything
%% that leaves is an {@link action()}. The same code is interpreted by
%% {@link starl_machine_proc} (a process in a robot's supervision tree), inline in a simulator,
%% and by the exhaustive checker.
%%
%% A machine answers an unknown event with `unknown_event': the event is traced, never
%% fatal, never silent. A message from another robot may hold any term: a machine that exports
%% `accepts/2' gets only messages whose body it accepts; each other message leaves the trace event
%% `{malformed, From, Type, Body}'.
-module(starl_machine).

-export([new/3, step/4, module/1, state/1, data/1]).

-export_type([t/0, name/0, tag/0, from/0, event_type/0, action/0, stored/0, meta/0, config/0]).
-export_type([result/0]).

%% The name of a machine within its robot: `sap', `motion', `election', `app', …
-type name() :: atom().

%% A caller's own mark on a call; it comes back with the reply.
-type tag() :: term().

%% The receiver of a reply. A reply that grants something for a time may be `{until, Us, Answer}':
%% the caller, if it is an application, gets `Answer', or `late' if its robot's clock shows a later
%% time when the call returns ({@link starl:call/4}).
-type from() :: {name(), tag()}.

%% The kind of an event:
%% `cast' and `{call, From}' from another machine of the same robot, `{reply, Tag}' for the
%% answer to its own call, timeouts as in gen_statem, `packet' from the radio, and `info' from
%% the platform: `{located, Tag, [{robot_id(), pose(), AgeUs}]}' after `sense', `{driven, Mark, Us}'
%% or `{stalled, Mark, Told}' after `drive', `{actuated, Mark, Device, Value}' after `actuate'
%% with a mark, `{restarted, Name}' when another machine of this robot has crashed and come back,
%% `{given_up, Name}' when it does not come back (a machine may leave it unhandled), and `{late,
%% Mark}' when actions were not carried out because their latest moment had passed. The runner
%% itself handles `code', a word on new code ({@link starl_reload}).
-type event_type() ::
    cast
    | code
    | {call, from()}
    | {reply, tag()}
    | {timeout, term()}
    | state_timeout
    | packet
    | info.

%% Everything that leaves a machine. A malformed action crashes it ({@link starl_action}).
-type action() ::
    %% to another machine of the same robot
    {cast, name(), Content :: term()}
    | {call, name(), Request :: term(), tag()}
    | {reply, from(), Answer :: term()}
    %% timers on the robot's own clock, in microseconds
    | {{timeout, Name :: term()}, Us :: non_neg_integer(), Content :: term()}
    | {{timeout, Name :: term()}, cancel}
    | {state_timeout, Us :: non_neg_integer(), Content :: term()}
    | {state_timeout, cancel}
    %% the radio: one packet on the air, for one robot or for all in range
    | {transmit, starl:robot_id() | all, starl_packet:t()}
    %% ask the positioning system; answered by the event `info', `{located, Tag, …}'
    | {sense, [starl:robot_id()], Tag :: term()}
    %% the chassis drives the script and then stands; replaces a script that is running; answered by
    %% `info', `{driven, Mark, …}', or `{stalled, Mark, …}' if the drive does not obey
    | {drive, starl_chassis:script(), Mark :: term()}
    %% any other actuator: `{actuate, pen, down}'; with a mark, answered by `info', `{actuated,
    %% Mark, Device, Value}' with the state of its sensor
    | {actuate, Device :: atom(), Value :: term()}
    | {actuate, Device :: atom(), Value :: term(), Mark :: term()}
    %% keeps a term for this machine over crashes and reboots, in place of the term kept before;
    %% later actions take place only when the term is durable; if it cannot be written, the machine
    %% crashes instead (see {@link stored()})
    | {store, Term :: term()}
    %% the robot has lived before with this incarnation, and its store does not know it: all machines
    %% begin anew, and find their terms damaged
    | {outlived, starl_packet:incarnation()}
    %% a fact for the recording and the monitors
    | {trace, Event :: term()}
    %% what rests on a lease has a latest moment, by the robot's own clock: these actions take place
    %% only if it has not passed when they leave; else none of them does, and the machine learns
    %% of it by the event `info', `{late, Mark}', before any other. Facts come first among them. A
    %% computer may stand still in the middle of a step, so the time of its beginning tells nothing
    | {until, Us :: integer(), [action()], Mark :: term()}
    %% the application has finished with this result
    | {done, Result :: term()}
    %% the runner of a machine or an application tells how it has heeded a word on new code
    | {reloaded, starl_reload:told()}.

%% What a machine may know of the world when it handles an event: the robot's own clock (µs).
-type meta() :: #{now := integer(), robot := starl:robot_id()}.

%% The term that a machine kept with the action `store', given back after a crash of the machine and
%% after a reboot of the robot alike. `none': it has never kept a term. `damaged': it kept a term
%% that cannot be read, or the robot has lost its store and nobody knows whether it did, so the machine
%% must assume that it has made every promise it could have made. A full store crashes the machine that writes, before any later action. A machine that wrote
%% in `init/1' would crash at every restart, so a machine writes only when it makes a promise.
-type stored() :: none | {stored, Term :: term()} | damaged.

%% The configuration given to `init/1'. `incarnation' grows with each start of this machine on this
%% robot, by one in a life of the robot; a robot that comes up again begins with a number that no
%% earlier life has reached ({@link starl_robot_machines}), whatever has become of its store. 1: this
%% machine has never run before. `life' tells where the present life of the robot begins: `{0, 1}' is
%% its first life; in a later one its store may be that of an earlier life than its last. `random' is the machine's
%% own random stream, another one in each life. `team_seed' is the same number for all robots of the
%% team, in all their lives: what a machine has told by it, it tells again after a restart, and after
%% the loss of its store, too. `clock' reads the robot's own clock where steps take time; only an
%% application gets it.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    name := name(),
    incarnation := pos_integer(),
    life => starl_robot_machines:life(),
    stored := stored(),
    random := rand:state(),
    team_seed := integer(),
    now := integer(),
    clock => fun(() -> integer()),
    atom() => term()
}.

-type result() ::
    {next_state, State :: term(), Data :: term()}
    | {next_state, State :: term(), Data :: term(), [action()]}
    | {keep_state, Data :: term()}
    | {keep_state, Data :: term(), [action()]}
    | keep_state_and_data
    | {keep_state_and_data, [action()]}
    | unknown_event.

-callback init(config()) -> {State :: term(), Data :: term(), [action()]}.
-callback handle_event(event_type(), Content :: term(), State :: term(), Data :: term(), meta()) ->
    result().
%% Does the machine take messages of this type with this body ({@link starl_shape:is/2})?
-callback accepts(starl_packet:type(), Body :: term()) -> boolean().
%% Carries the state of the module with this MD5 over to this one; as in gen_statem, `{down, Vsn}'
%% carries it back. Code that converts states must be able to do both: else it is not taken. Without
%% this callback the state stays as it is.
-callback code_change(Md5 | {down, Md5}, State, Data) ->
    {ok, State :: term(), Data :: term()}
when
    Md5 :: binary(), State :: term(), Data :: term().
-optional_callbacks([accepts/2, code_change/3]).

-record(machine, {
    %% the callback, looked up once; a fun of this kind calls the latest version of its module;
    %% a faulty callback may return any term
    handle :: fun((event_type(), term(), State :: term(), Data :: term(), meta()) -> term()),
    %% likewise, for a machine that checks messages before it takes them
    accepts = all :: all | fun((starl_packet:type(), Body :: term()) -> boolean()),
    state :: term(),
    data :: term()
}).

%% A machine that runs reloaded code: the module before, and until when the new one is on trial.
-record(reloaded, {
    machine :: #machine{},
    switch :: starl_reload:switch(),
    former :: module(),
    until :: integer()
}).

%% A machine with its present state.
-opaque t() :: #machine{} | #reloaded{}.

%% @doc A machine in its first state, with the actions of its start. `Base' is the platform's part
%% of the configuration, `Config' the machine's own.
-spec new(module(), Config :: map(), Base :: config()) -> {[action()], t()}.
new(Module, Config, Base) ->
    case Module:init(maps:merge(Config, Base)) of
        {State, Data, Actions} ->
            Machine = #machine{
                handle = fun Module:handle_event/5,
                accepts = accepts(Module),
                state = State,
                data = Data
            },
            {checked(Actions), Machine};
        Other ->
            bad_return(Module, init, Other)
    end.

accepts(Module) ->
    case erlang:function_exported(Module, accepts, 2) of
        true -> fun Module:accepts/2;
        false -> all
    end.

%% @doc Handles one event; returns the actions in the order in which they are to take place.
-spec step(event_type(), Content :: term(), meta(), t()) -> {[action()], t()}.
step(cast, {message, From, Type, Body} = Message, Meta, #machine{accepts = Accepts} = Machine) when
    Accepts =/= all
->
    case Accepts(Type, Body) of
        true -> handle(cast, Message, Meta, Machine);
        false -> {[{trace, {malformed, From, Type, Body}}], Machine}
    end;
step(code, Word, Meta, Machine) ->
    switch(Word, Meta, Machine);
step(Type, Content, Meta, #machine{} = Machine) ->
    handle(Type, Content, Meta, Machine);
step(Type, Content, Meta, #reloaded{machine = Machine} = Reloaded) ->
    try step(Type, Content, Meta, Machine) of
        {Actions, Next} -> {Actions, Reloaded#reloaded{machine = Next}}
    catch
        Class:Reason:Stack -> failed(Class, Reason, Stack, {Type, Content, Meta}, Reloaded)
    end.

handle(Type, Content, Meta, #machine{handle = Handle, state = State, data = Data} = Machine) ->
    case Handle(Type, Content, State, Data, Meta) of
        {keep_state, NewData, Actions} ->
            {checked(Actions), Machine#machine{data = NewData}};
        {keep_state_and_data, Actions} ->
            {checked(Actions), Machine};
        {keep_state, NewData} ->
            {[], Machine#machine{data = NewData}};
        keep_state_and_data ->
            {[], Machine};
        {next_state, NewState, NewData, Actions} ->
            moved(NewState, NewData, checked(Actions), Machine);
        {next_state, NewState, NewData} ->
            moved(NewState, NewData, [], Machine);
        unknown_event when Type =:= info, element(1, Content) =:= given_up -> {[], Machine};
        unknown_event ->
            {[{trace, {unknown_event, Type, Content}}], Machine};
        Other ->
            bad_return(module(Machine), handle_event, Other)
    end.

%% The platform trusts the actions that it carries out: a mistake must be found here.
checked(Actions) ->
    ok = starl_action:check(Actions),
    Actions.

-spec bad_return(module(), init | handle_event, term()) -> no_return().
bad_return(Module, Function, Other) -> error({bad_return, {Module, Function}, Other}).

%% -- new code -------------------------------------------------------------------------------

switch({take, Switch}, Meta, #reloaded{machine = Machine}) ->
    switch({take, Switch}, Meta, Machine);
switch({take, #{module := New} = Switch}, #{now := Now}, #machine{} = Machine) ->
    Former = module(Machine),
    #{trial_us := Us} = Switch,
    try both_ways(New, Former, Machine) of
        Next ->
            Reloaded = #reloaded{
                machine = Next, switch = Switch, former = Former, until = Now + Us
            },
            {[told(Switch, taken, New, [])], Reloaded}
    catch
        Class:Reason:Stack ->
            Cause = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
            {[told(Switch, {migration_failed, Cause}, Former, [])], Machine}
    end;
switch({back, N, Robot}, _Meta, #reloaded{switch = #{number := N} = Switch} = Reloaded) ->
    #reloaded{machine = Machine, former = Former} = Reloaded,
    {[told(Switch, {back, Robot}, Former, [])], moved_back(Former, Machine)};
switch({back, _, _}, _Meta, Machine) ->
    {[], Machine}.

told(#{number := N}, Outcome, Module, Others) ->
    {reloaded, #{number => N, outcome => Outcome, module => Module, tell => Others}}.

%% An event that crashed has done nothing: the former code handles it. If even the way back crashes,
%% the machine does.
failed(_Class, Reason, Stack, {Type, Content, #{now := Now} = Meta}, Reloaded) when
    Now < Reloaded#reloaded.until
->
    #reloaded{machine = Machine, switch = Switch, former = Former} = Reloaded,
    Cause = starl_crash:cause(starl_crash:reason(error, Reason, Stack)),
    {Actions, Next} = step(Type, Content, Meta, moved_back(Former, Machine)),
    {[told(Switch, {crashed, Cause}, Former, []) | Actions], Next};
failed(Class, Reason, Stack, _Event, _Reloaded) ->
    erlang:raise(Class, Reason, Stack).

%% No code without a way back.
both_ways(New, Former, Machine) ->
    Next = moved_over(New, version(Former), Machine),
    _ = moved_back(Former, Next),
    Next.

moved_over(New, Vsn, #machine{state = State0, data = Data0} = Machine) ->
    {module, New} = code:ensure_loaded(New),
    {ok, State, Data} =
        case erlang:function_exported(New, code_change, 3) of
            true -> New:code_change(Vsn, State0, Data0);
            false -> {ok, State0, Data0}
        end,
    of_module(New, State, Data, Machine).

moved_back(Former, #machine{state = State0, data = Data0} = Machine) ->
    New = module(Machine),
    {ok, State, Data} =
        case erlang:function_exported(New, code_change, 3) of
            true -> New:code_change({down, version(Former)}, State0, Data0);
            false -> {ok, State0, Data0}
        end,
    of_module(Former, State, Data, Machine).

of_module(Module, State, Data, Machine) ->
    Machine#machine{
        handle = fun Module:handle_event/5,
        accepts = accepts(Module),
        state = State,
        data = Data
    }.

version(Module) -> Module:module_info(md5).

%% @doc The callback module.
-spec module(t()) -> module().
module(#reloaded{machine = Machine}) ->
    module(Machine);
module(#machine{handle = Handle}) ->
    {module, Module} = erlang:fun_info(Handle, module),
    Module.

%% @doc The present state, for inspection.
-spec state(t()) -> term().
state(#reloaded{machine = Machine}) -> state(Machine);
state(#machine{state = State}) -> State.

%% @doc The present data, for inspection.
-spec data(t()) -> term().
data(#reloaded{machine = Machine}) -> data(Machine);
data(#machine{data = Data}) -> Data.

%% As in gen_statem, a state time-out does not outlive its state.
moved(State, Data, Actions, #machine{state = State} = Machine) ->
    {Actions, Machine#machine{data = Data}};
moved(State, Data, Actions, Machine) ->
    {[{state_timeout, cancel} | Actions], Machine#machine{state = State, data = Data}}.
