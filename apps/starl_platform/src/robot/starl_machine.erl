%% @doc The behaviour of StarL's protocol machines, and the pure runner of such a machine.
%% ```
%%   -module(counting_machine).
%%   -behaviour(starl_machine).
%%   -export([init/1, handle_event/5]).
%%
%%   init(_Config) -> {ready, 0, []}.
%%
%%   handle_event(cast, increment, ready, N, _Meta) ->
%%       {keep_state, N + 1, [{trace, {counted, N + 1}}]};
%%   handle_event({call, From}, value, ready, N, _Meta) ->
%%       {keep_state, N, [{reply, From, N}]};
%%   handle_event(_Type, _Content, _State, _N, _Meta) ->
%%       unknown_event.
%% '''
%%
%% A machine is a callback module with gen_statem's vocabulary and no side effects. Time, identity
%% and randomness come in through its configuration and {@link meta()}, and everything that leaves
%% is an {@link action()}. The same code ({@link starl_machine_runner}) runs in three places: in
%% {@link starl_machine_proc} (a process in a robot's supervision tree), inline in a simulator, and
%% in the exhaustive checker.
%%
%% A machine answers an unknown event with `unknown_event': the event is traced, never fatal, never
%% silent. A message from another robot may hold any term. A machine that exports `accepts/2' gets
%% only messages whose body it accepts; each other message leaves the trace event `{malformed, From,
%% Type, Body}'.
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

%% The kind of an event: `cast' and `{call, From}' from another machine of the same robot, `{reply,
%% Tag}' for the answer to its own call, timeouts as in gen_statem, `packet' from the radio, and
%% `info' from the platform. The contents of `info' are: `{located, Tag, [{robot_id(), pose(),
%% AgeUs}]}' after `sense'; `{driven, Mark, Us}' or `{stalled, Mark, Told}' after `drive';
%% `{actuated, Mark, Device, Value}' after `actuate' with a mark; `{felt, Tag, {ok, Reading} | none
%% | unknown}' after `feel'; `{restarted, Name}' when another machine of this robot has crashed and
%% come back; `{given_up, Name}' when it does not come back (a machine may leave it unhandled); and
%% `{late, Mark}' when actions were not carried out because their deadline had passed. The runner
%% itself handles `code', a reload command ({@link starl_reload}).
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
    | {sense, [starl:robot_id()] | {near, Mm :: number()}, Tag :: term()}
    %% ask a sense; answered by `info', `{felt, Tag, {ok, Reading} | none | unknown}'
    | {feel, starl_sense:kind(), Tag :: term()}
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

%% The term that a machine kept with the action `store', returned after a crash of the machine and
%% after a reboot of the robot alike. `none': it has never kept a term. `damaged': it kept a term
%% that cannot be read, or the robot has lost its store and nobody knows whether it did. So the
%% machine must assume that it has made every promise it could have made. A full store crashes the
%% machine that writes, before any later action. A machine that wrote in `init/1' would crash at
%% every restart, so a machine writes only when it makes a promise.
-type stored() :: none | {stored, Term :: term()} | damaged.

%% The configuration given to `init/1'. `incarnation' grows with each start of this machine on this
%% robot, by one in a life of the robot. A robot that comes up again begins with a number that no
%% earlier life has reached ({@link starl_robot_machines}), whatever has become of its store. 1:
%% this machine has never run before. `life' gives the beginning of the robot's present life: `{0,
%% 1}' is its first life; in a later life its store may be older than its last life. `latest_life',
%% for SAP only: no earlier life can have had a larger number. `random' is the machine's own random
%% stream, different in each life. `team_seed' is the same number for all robots of the team, in all
%% their lives. So a machine repeats what it has sent by this number, after a restart and even after
%% the loss of its store. `clock' reads the robot's own clock where steps take time; only an
%% application gets it. `code': the versions of a machine that does not start with its first code.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    name := name(),
    incarnation := pos_integer(),
    life => starl_robot_machines:life(),
    latest_life => pos_integer(),
    stored := stored(),
    random := rand:state(),
    team_seed := integer(),
    now := integer(),
    clock => fun(() -> integer()),
    code => starl_lineage:t(),
    histories => [name()],
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
%% Does the machine accept messages of this type with this body ({@link starl_shape:is/2})?
-callback accepts(starl_packet:type(), Body :: term()) -> boolean().
%% Carries the state of the module with this MD5 over to this one; as in gen_statem, `{down, Vsn}'
%% carries it back. Code that converts states must be able to do both: else it is not taken. Without
%% this callback the state stays as it is.
-callback code_change(Md5 | {down, Md5}, State, Data) ->
    {ok, State :: term(), Data :: term()}
when
    Md5 :: binary(), State :: term(), Data :: term().
%% Do real robots keep the calls to it? Then a model of what its block promises explains them
%% ({@link starl_history_model}). Without this callback they are not kept, since they cost room in
%% recordings.
-callback has_history() -> boolean().
-optional_callbacks([accepts/2, code_change/3, has_history/0]).

%% A machine that runs reloaded code, or did. `before', for some time after the way back from code
%% that has no `code_change/3': the machine with the state that it had before, unless it has started
%% with that code.
-record(reloaded, {
    machine :: starl_machine_runner:t(),
    lineage :: starl_lineage:t(),
    before = none :: {starl_machine_runner:t() | unknown, UntilUs :: integer()} | none
}).

%% A machine with its present state.
-opaque t() :: starl_machine_runner:t() | #reloaded{}.

%% @doc Returns a machine in its first state, with the actions of its start. `Base' is the
%% platform's part of the configuration, `Config' the machine's own.
-spec new(module(), Config :: map(), Base :: config()) -> {[action()], t()}.
new(_First, Config, #{code := Lineage} = Base) ->
    {Actions, Machine} = new(starl_lineage:code(Lineage), Config, maps:remove(code, Base)),
    {Actions, reloaded(Machine, Lineage, none)};
new(Module, Config, Base) ->
    starl_machine_runner:new(Module, Config, Base).

%% @doc Handles one event, and returns the actions in the order in which they are to take place.
-spec step(event_type(), Content :: term(), meta(), t()) -> {[action()], t()}.
step(code, Word, Meta, Running) ->
    switch(Word, Meta, Running);
step(Type, Content, Meta, #reloaded{machine = Machine} = Reloaded) ->
    try starl_machine_runner:step(Type, Content, Meta, Machine) of
        {[{trace, {unknown_event, Type, Content}}] = Actions, Machine} ->
            unknown(Type, Content, Meta, Actions, Reloaded);
        {Actions, Next} ->
            {Actions, went_on(Meta, Reloaded#reloaded{machine = Next})}
    catch
        Class:Reason:Stack -> failed(Class, Reason, Stack, {Type, Content, Meta}, Reloaded)
    end;
step(Type, Content, Meta, Machine) ->
    starl_machine_runner:step(Type, Content, Meta, Machine).

%% -- new code -------------------------------------------------------------------------------

%% A machine may have started with the code before it hears of it.
switch({take, #{number := N} = Switch}, #{now := Now}, Running) ->
    {Machine, Lineage} = with_lineage(Running),
    case starl_lineage:has(N, Lineage) of
        true -> {[], Running};
        false -> taken(Switch, Now, Machine, Lineage, Running)
    end;
switch({back, N, Robot}, #{now := Now}, Running) ->
    {Machine, Lineage} = with_lineage(Running),
    case starl_lineage:leave(N, Lineage) of
        {left, Left, Earlier} ->
            {left({back, Robot}, Left, Earlier), moved_back(Now, Left, Earlier, Machine)};
        {skipped, Skipped} ->
            {told(N, {back, Robot}, Skipped), reloaded(Machine, Skipped, none)};
        unknown ->
            {[], Running}
    end.

with_lineage(#reloaded{machine = Machine, lineage = Lineage}) -> {Machine, Lineage};
with_lineage(Machine) -> {Machine, starl_lineage:new(module(Machine))}.

reloaded(Machine, Lineage, Before) ->
    case starl_lineage:is_first(Lineage) andalso Before =:= none of
        true -> Machine;
        false -> #reloaded{machine = Machine, lineage = Lineage, before = Before}
    end.

told(N, Outcome, Lineage) -> [{reloaded, starl_reload:told(N, Outcome, nobody, Lineage)}].

left(Outcome, Left, Earlier) ->
    [{reloaded, Told} || Told <- starl_reload:left(Outcome, nobody, {Left, Earlier})].

%% No code without a way back.
taken(#{number := N, module := New} = Switch, Now, Machine, Lineage, Running) ->
    try
        Next = starl_machine_runner:moved_over(New, Machine),
        Taken = starl_lineage:take(Switch#{kept => kept(New, Machine)}, Now, Lineage),
        {Left, Earlier} = starl_lineage:back(Taken),
        _ = moved_back(Now, Left, Earlier, Next),
        {told(N, taken, Taken), reloaded(Next, Taken, none)}
    catch
        Class:Reason:Stack ->
            Cause = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
            {told(N, {migration_failed, Cause}, Lineage), Running}
    end.

%% What code without `code_change/3' leaves may be of no use to the former code.
kept(Module, Machine) ->
    case starl_machine_runner:converts(Module) of
        true -> none;
        false -> Machine
    end.

%% Each version converts the state for the one before.
moved_back(Now, Left, Earlier, Machine) ->
    Formers = [Module || #{module := Module} <- tl(Left)] ++ [starl_lineage:code(Earlier)],
    case lists:foldl(fun without/2, {Machine, none}, lists:zip(Left, Formers)) of
        {Back, none} ->
            reloaded(Back, Earlier, none);
        {Back, Before} ->
            Until = Now + lists:max([Us || #{trial_us := Us} <- Left]),
            reloaded(Back, Earlier, {Before, Until})
    end.

without({#{module := Module, kept := none}, Former}, {Machine, Before0}) ->
    Before =
        case {starl_machine_runner:converts(Module), Before0} of
            {false, _} -> unknown;
            {true, none} -> none;
            {true, unknown} -> unknown;
            {true, _} -> starl_machine_runner:moved_down(Former, Before0)
        end,
    {starl_machine_runner:moved_down(Former, Machine), Before};
without({#{kept := Kept}, Former}, {Machine, _Before}) ->
    {starl_machine_runner:moved_down(Former, Machine), Kept}.

%% An event that crashed has done nothing: the former code handles it. If even the way back crashes,
%% the machine does.
failed(Class, Reason, Stack, {Type, Content, #{now := Now} = Meta}, Reloaded) ->
    #reloaded{machine = Machine, lineage = Lineage} = Reloaded,
    case starl_lineage:is_on_trial(Now, Lineage) of
        true ->
            Cause = starl_crash:cause(starl_crash:reason(error, Reason, Stack)),
            {Left, Earlier} = starl_lineage:back(Lineage),
            {Actions, Next} = step(Type, Content, Meta, moved_back(Now, Left, Earlier, Machine)),
            {left({crashed, Cause}, Left, Earlier) ++ Actions, Next};
        false ->
            erlang:raise(Class, Reason, Stack)
    end.

%% The code does not know an event. If it is on trial and the former code knows it, somebody may
%% wait for ever for what that does: the trial has failed as if the code had crashed. After the way
%% back it may be the state that the code does not know: then the machine crashes, and starts anew.
unknown(Type, Content, #{now := Now} = Meta, Actions, #reloaded{lineage = Lineage} = Reloaded) ->
    case {starl_lineage:is_on_trial(Now, Lineage), Reloaded#reloaded.before} of
        {true, _} ->
            asked(Type, Content, Meta, Actions, Reloaded);
        {false, {Before, Until}} when Now < Until ->
            _ = is_missed(Type, Content, Meta, Before) andalso no_use(Reloaded),
            {Actions, Reloaded};
        {false, _} ->
            {Actions, Reloaded}
    end.

asked(Type, Content, #{now := Now} = Meta, Actions, Reloaded) ->
    #reloaded{machine = Machine, lineage = Lineage} = Reloaded,
    {Left, Earlier} = starl_lineage:back(Lineage),
    Former = moved_back(Now, Left, Earlier, Machine),
    case answer(Type, Content, Meta, Former) of
        {Handled, Next} ->
            Cause = starl_crash:cause(not_known(Type, Content, module(Machine))),
            {left({crashed, Cause}, Left, Earlier) ++ Handled, Next};
        unknown ->
            _ = is_missed(Type, Content, Meta, before(Former)) andalso no_use(Reloaded),
            {Actions, Reloaded}
    end.

before(#reloaded{before = {Before, _}}) when Before =/= unknown -> Before;
before(_) -> none.

%% News of other machines may be unknown to any state.
is_missed(_Type, _Content, _Meta, none) -> false;
is_missed(Type, _Content, _Meta, unknown) -> Type =/= info;
is_missed(Type, Content, Meta, Before) -> answer(Type, Content, Meta, Before) =/= unknown.

%% What a machine would do; it is only asked, and may crash.
answer(Type, Content, Meta, Machine) ->
    try step(Type, Content, Meta, Machine) of
        {[{trace, {unknown_event, _, _}}], _} -> unknown;
        Answer -> Answer
    catch
        _:_ -> unknown
    end.

-spec no_use(#reloaded{}) -> no_return().
no_use(#reloaded{machine = Machine}) -> error({unknown_state, {state(Machine), data(Machine)}}).

not_known(Type, Content, Module) ->
    Place =
        case starl_code:line(Module, handle_event, 5) of
            {ok, File, Line} -> [{file, File}, {line, Line}];
            none -> []
        end,
    {{unknown_event, Type, Content}, [{Module, handle_event, 5, Place}]}.

%% The state before the switch is of no use for long.
went_on(#{now := Now}, #reloaded{before = {_, Until}} = Reloaded) when Now >= Until ->
    reloaded(Reloaded#reloaded.machine, Reloaded#reloaded.lineage, none);
went_on(_Meta, Reloaded) ->
    Reloaded.

%% @doc The callback module.
-spec module(t()) -> module().
module(#reloaded{machine = Machine}) -> module(Machine);
module(Machine) -> starl_machine_runner:module(Machine).

%% @doc The present state, for inspection.
-spec state(t()) -> term().
state(#reloaded{machine = Machine}) -> state(Machine);
state(Machine) -> starl_machine_runner:state(Machine).

%% @doc The present data, for inspection.
-spec data(t()) -> term().
data(#reloaded{machine = Machine}) -> data(Machine);
data(Machine) -> starl_machine_runner:data(Machine).
