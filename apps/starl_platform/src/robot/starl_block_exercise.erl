%% @doc The behaviour of a block's exercise: every robot uses the block all the time, under faults.
%% The application `exercise' runs it, and `./starl soak' draws its values at random.
%%
%% A module with this behaviour ({@link starl_block}, `exercise/0') defines one turn of the work and
%% the calls at the end. It also defines what each call promises once all faults are over
%% ({@link starl_promise}). Every call goes through {@link call/4}, which traces the call and its
%% outcome ({@link event()}); a monitor checks the promise.
-module(starl_block_exercise).

-export([call/3, call/4, again/1, pick/2]).
-export([
    flags/1, block_options/2, prepare/3, final/4, within_ms/2, again_ms/2, hindered_by/1, draw/2
]).
-export([watches/1, seen/2, noted/1, promise/4]).

-export_type([use/0, draw/0, event/0]).

%% The values of the exercise: those of the application `exercise', of the block's own flags, and
%% `team', the number of robots; `within', the time in milliseconds after which a promise has come
%% true; and `last_patience', the patience (ms) of the calls at the end, which exceeds the time
%% until they must have succeeded.
-type use() :: #{
    patience := pos_integer(),
    final := non_neg_integer(),
    team := pos_integer(),
    within => pos_integer(),
    last_patience => pos_integer(),
    atom() => term()
}.

%% The application's trace, in turns: a call with its patience, and its answer.
-type event() ::
    {call, What :: term(), PatienceMs :: pos_integer() | none}
    | {answer, Outcome :: term()}.

%% Draws a value of this name for a seed: one of a list, or a whole number between two.
-type draw() :: fun((Key :: atom(), [term(), ...] | {integer(), integer()}) -> term()).

%% One turn of the work.
-callback work(starl:robot(), Turn :: pos_integer(), use()) -> term().
%% The N-th call at the end.
-callback final(starl:robot(), N :: pos_integer(), use()) -> term().
%% The flags of the exercise.
-callback flags() -> [starl_options:option()].
%% The block's options for these values.
-callback block_options(use()) -> starl_block:options().
%% The steps of the application before its first turn.
-callback prepare(starl:robot(), use()) -> term().
%% The time (ms) after the last fault within which a promise comes true.
-callback within_ms(use()) -> pos_integer().
%% The time (ms) after which the block sends again what SAP has given up; without this callback it does
%% not.
-callback again_ms(use()) -> pos_integer().
%% The classes of faults that can hold up its calls; by default those of radio, clocks, computers, stores and positions.
-callback hindered_by() -> [starl_monitor:fault_class()].
%% The values of its own flags for a soak.
-callback draw(draw()) -> #{atom() => term()}.
%% The machines, besides the application, whose events the promises depend on.
-callback watches() -> [starl_machine:name()].
%% The memory of these events, and of the calls, for the promises: at the beginning, and
%% after an event. The event at the end of a call is `{Us, Robot, app, {answered, Call, Outcome}}'.
-callback seen([starl:robot_id()]) -> Seen :: term().
-callback noted(starl_monitor:trace_event(), Seen) -> Seen when Seen :: term().
%% The promise of a call, with its time. Without this callback every call ends in time, in any way.
-callback promise(starl_promise:call(), starl_promise:team(), Seen :: term()) ->
    starl_promise:t().

-optional_callbacks([
    final/3,
    flags/0,
    block_options/1,
    prepare/2,
    within_ms/1,
    again_ms/1,
    hindered_by/0,
    draw/1,
    watches/0,
    seen/1,
    noted/2,
    promise/3
]).

-define(WITHIN_MS, 20000).
%% What happens to wheels, chassis and senses holds up no message.
-define(CLASSES, [network, clock, process, store, location]).

%% -- for exercises --------------------------------------------------------------------------

%% @doc Makes a call without a patience of its own.
-spec call(starl:robot(), What :: term(), fun(() -> Outcome)) -> Outcome.
call(Robot, What, Call) -> call(Robot, What, none, Call).

%% @doc Makes a call with a patience in milliseconds; it is traced.
-spec call(starl:robot(), What :: term(), Ms :: pos_integer() | none, fun(() -> Outcome)) ->
    Outcome.
call(Robot, What, Patience, Call) ->
    ok = starl:trace(Robot, {call, What, Patience}),
    Outcome = Call(),
    ok = starl:trace(Robot, {answer, Outcome}),
    Outcome.

%% @doc Repeats a call until its machine does not restart during it: for calls that others wait for.
-spec again(fun(() -> Outcome)) -> Outcome when Outcome :: term().
again(Call) ->
    case Call() of
        {error, restarted} -> again(Call);
        Outcome -> Outcome
    end.

%% @doc A number from 1 to N, at random.
-spec pick(starl:robot(), N :: pos_integer()) -> pos_integer().
pick(Robot, N) -> 1 + trunc(starl:random(Robot) * N).

%% -- callbacks or their defaults ------------------------------------------------------------

%% @doc The flags of the exercise.
-spec flags(module()) -> [starl_options:option()].
flags(Exercise) -> starl_callback:call(Exercise, flags, [], []).

%% @doc The options of the block.
-spec block_options(module(), use()) -> starl_block:options().
block_options(Exercise, Use) -> starl_callback:call(Exercise, block_options, [Use], #{}).

%% @doc The steps before the first turn.
-spec prepare(module(), starl:robot(), use()) -> term().
prepare(Exercise, Robot, Use) -> starl_callback:call(Exercise, prepare, [Robot, Use], ok).

%% @doc A call at the end.
-spec final(module(), starl:robot(), N :: pos_integer(), use()) -> term().
final(Exercise, Robot, N, Use) -> starl_callback:call(Exercise, final, [Robot, N, Use], ok).

%% @doc The time (ms) within which a promise comes true, by default 20 s.
-spec within_ms(module(), use()) -> pos_integer().
within_ms(Exercise, Use) -> starl_callback:call(Exercise, within_ms, [Use], ?WITHIN_MS).

%% @doc The time (ms) after which the block sends again what SAP has given up.
-spec again_ms(module(), use()) -> pos_integer() | never.
again_ms(Exercise, Use) -> starl_callback:call(Exercise, again_ms, [Use], never).

%% @doc The classes of faults that can hold up its calls.
-spec hindered_by(module()) -> [starl_monitor:fault_class()].
hindered_by(Exercise) -> starl_callback:call(Exercise, hindered_by, [], ?CLASSES).

%% @doc The values for a soak.
-spec draw(module(), draw()) -> #{atom() => term()}.
draw(Exercise, Draw) -> starl_callback:call(Exercise, draw, [Draw], #{}).

%% @doc The machines whose events the promises depend on.
-spec watches(module()) -> [starl_machine:name()].
watches(Exercise) -> starl_callback:call(Exercise, watches, [], []).

%% @doc The memory at the beginning.
-spec seen(module(), [starl:robot_id()]) -> Seen :: term().
seen(Exercise, Robots) -> starl_callback:call(Exercise, seen, [Robots], none).

%% @doc The update of its memory by an event, as a function, looked up once for all events.
-spec noted(module()) -> fun((starl_monitor:trace_event(), Seen) -> Seen) | none when
    Seen :: term().
noted(Exercise) ->
    case starl_callback:exported(Exercise, noted, 2) of
        true -> fun Exercise:noted/2;
        false -> none
    end.

%% @doc The promise of a call.
-spec promise(module(), starl_promise:call(), starl_promise:team(), Seen :: term()) ->
    starl_promise:t().
promise(Exercise, Call, Team, Seen) ->
    starl_callback:call(Exercise, promise, [Call, Team, Seen], none).
