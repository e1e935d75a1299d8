%% @doc The interface of registers that all robots share.
%%
%% A register has a name and a value, both plain data ({@link starl_payload}). Each robot has a copy
%% of all registers. A write is visible at once at its writer and soon at all robots. Of two writes
%% the later wins, the same at all robots (by a hybrid logical clock, {@link starl_hlc}). Guarantee:
%% a read returns a value that a robot wrote. Reads at one robot never go back to an earlier write,
%% unless its machine restarted. When writes stop and messages get through, all robots agree. A read
%% followed by a write is no transaction: if two robots do this at once, one may lose its write. Use
%% mutual exclusion then.
%%
%% With the option `owners' a register has a single writer.
-module(starl_registers).
-behaviour(starl_block).

-export([put/3, get/2, subscribe/2, within_ms/1]).
-export([
    options/0, machines/1, monitors/2, guarantees/0, contract/0, exercise/0, models/0, history/0
]).

-export_type([name/0]).

-type name() :: term().

%% @doc Writes a register. `full': the robot may add no further register, or its registers take too
%% many bytes. `refused': nothing is written, since most of the others accept no writes of this
%% robot, whose clock is far ahead of theirs.
-spec put(starl:robot(), name(), Value :: term()) ->
    ok | {error, not_owner | full | refused | restarted}.
put(Robot, Name, Value) ->
    ok = starl_caller:payload({?MODULE, put, 3}, 'Name', label, Name),
    ok = starl_caller:payload({?MODULE, put, 3}, 'Value', content, Value),
    flatten(starl:call(Robot, registers, {put, Name, Value}, infinity)).

%% @doc Returns the value in the robot's own copy of a register.
-spec get(starl:robot(), name()) -> {ok, Value :: term()} | {error, unset | restarted}.
get(Robot, Name) ->
    ok = starl_caller:payload({?MODULE, get, 2}, 'Name', label, Name),
    flatten(starl:call(Robot, registers, {get, Name}, infinity)).

%% @doc Subscribes the application to a register. From now on it gets each value that the register
%% takes at this robot, including the present value. Each comes as the message `register' from its
%% writer: `{ok, Writer, {Name, Value}} = starl:await(Robot, register)'. Call it again after
%% `{error, restarted}'.
-spec subscribe(starl:robot(), name()) -> ok.
subscribe(_Robot, Name) ->
    ok = starl_caller:payload({?MODULE, subscribe, 2}, 'Name', label, Name),
    starl_app_turn:perform([{cast, registers, {subscribe, Name, app}}]).

flatten({ok, Answer}) -> Answer;
flatten({error, restarted}) -> {error, restarted}.

%% -- the block ------------------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() ->
    [
        {owners, {term, "a map of registers and robots, as #{plan => 1}", fun is_map/1}, #{},
            "the only writers of these registers"},
        {ahead_ms, {integer, 1, 1000000000}, 10000, "more than clocks differ by, ms"},
        {sync_ms, {integer, 1, 1000000000}, 1000, "the mean time between two exchanges, ms"},
        {recover_ms, {integer, 1, 1000000000}, 1000,
            "the time that a restarted robot waits for others before it answers, ms"},
        {limit, {integer, 1, 1000000000}, 1024, "the most registers that a robot adds"},
        {bytes, {integer, 1000, 1000000000}, 2000000,
            "the most bytes of the registers that a robot has written last"}
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) -> [{registers, starl_registers_lww, Options}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{owners := Owners, sync_ms := Sync, ahead_ms := Ahead}, #{robots := Robots}) ->
    [
        {starl_registers_monitor, #{
            robots => Robots,
            owners => Owners,
            within_us => 1000 * within_ms(Sync),
            apart_us => 1000 * Ahead
        }}
    ].

%% @doc The time (ms) after the last write within which all robots agree, when messages get through.
%% `SyncMs' is the mean time between two exchanges.
-spec within_ms(SyncMs :: pos_integer()) -> pos_integer().
within_ms(Sync) -> 5000 + round(15 * Sync).

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {written, safety,
            "a read returns what was written, and goes back only if its robot's machine has crashed "
            "since", []},
        {order, safety, "of two writes of one robot the later one wins", [
            {any, [store, clock_forward]}
        ]},
        {agree, progress, "all robots agree", [delivery, clock_near]}
    ].

-spec contract() -> string().
contract() ->
    "a read returns what was written and goes back only with a crash; all robots come to agree".

-spec exercise() -> module().
exercise() -> starl_registers_exercise.

-spec history() -> module().
history() -> starl_registers_history.

-spec models() -> [starl_block:model_entry()].
models() ->
    Doc = "shared registers: two writers of one register, and who reads it",
    [{registers, Doc, fun model/1}].

%% Time stands still, so only the counts of stamps decide, and robots' clocks are as far apart as
%% their numbers. All draw the same again and again, so each exchanges with one other robot.
model(#{robots := Ids, clock_us := Clock}) ->
    #{
        blocks => machines(#{ahead_ms => Clock(8) div 1000}),
        script => fun script/1,
        crash => [registers],
        monitor => {starl_registers_monitor, #{robots => Ids}},
        fixed => lists:seq(1, length(Ids)),
        draws => same
    }.

script(1) -> [{'try', registers, {put, x, a}}, {'try', registers, {put, x, b}}];
script(2) -> [{'try', registers, {put, x, c}} | gets(2)];
script(_) -> gets(1).

gets(Count) -> lists:duplicate(Count, {'try', registers, {get, x}}).
