%% @doc Drives actuators, such as a pen: it repeats a command until the device's sensor confirms it.
%% ```
%%   caller               actuator                       chassis
%%     |--- set ------------->|--- actuate, mark ----------->|   heard, or not
%%     |                      |<-- actuated, mark, state ----|   what the sensor shows
%%     |<-- ok ---------------|   if the state is the one that was wanted; else again, and again
%% '''
%% A time-out reveals a lost command or answer. A stuck device gets its command again and again
%% until it moves. The caller waits until then, since its next step depends on the device.
%%
%% Call: `{set, Device, Value}'. The answer is `ok' when the device has this value, or `{error,
%% replaced}' when a later call sets the same device first.
-module(starl_actuator).
-behaviour(starl_machine).
-behaviour(starl_block).

-export([set/3]).
-export([options/0, machines/1, monitors/2, guarantees/0, contract/0]).
-export([init/1, handle_event/5]).

%% The time after which a command is repeated to a device that has not confirmed it.
-define(AGAIN_US, 200000).

-export_type([event/0]).

%% It traces nothing of its own.
-type event() :: none().

-type device() :: atom().

-record(actuator, {
    %% the number of the last command
    n :: non_neg_integer(),
    wanted = #{} :: #{device() => {starl_machine:from(), Value :: term(), N :: non_neg_integer()}}
}).

-spec options() -> [].
options() -> [].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(_Options) -> [{actuator, ?MODULE, #{}}].

-spec monitors(starl_block:options(), starl_block:context()) -> [].
monitors(_Options, _Context) -> [].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {shown, safety, "when a call returns ok, the device's sensor shows the requested value",
            []},
        {set, progress, "every call returns ok", [devices]}
    ].

-spec contract() -> string().
contract() -> "when a call returns ok, the device's sensor shows the requested value".

%% @doc Sets a device, as in `starl_actuator:set(Robot, pen, down)', and waits until its sensor
%% confirms the value.
-spec set(starl:robot(), device(), Value :: term()) -> ok | {error, replaced | restarted}.
set(Robot, Device, Value) ->
    case starl:call(Robot, actuator, {set, Device, Value}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

-spec init(starl_machine:config()) -> {ready, #actuator{}, []}.
init(#{incarnation := Incarnation}) ->
    %% an answer to a command of an earlier incarnation is not accepted
    {ready, #actuator{n = Incarnation bsl 32}, []}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #actuator{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {set, Device, Value}, ready, #actuator{wanted = Wanted} = A, _Meta) ->
    Replaced = [{reply, Old, {error, replaced}} || #{Device := {Old, _, _}} <- [Wanted]],
    tell(Device, From, Value, A, Replaced);
handle_event(info, {actuated, N, Device, State}, ready, #actuator{wanted = Wanted} = A, _Meta) ->
    case Wanted of
        #{Device := {From, State, N}} ->
            Done = A#actuator{wanted = maps:remove(Device, Wanted)},
            {keep_state, Done, [{{timeout, Device}, cancel}, {reply, From, ok}]};
        #{} ->
            keep_state_and_data
    end;
handle_event({timeout, Device}, again, ready, #actuator{wanted = Wanted} = A, _Meta) ->
    case Wanted of
        #{Device := {From, Value, _}} -> tell(Device, From, Value, A, []);
        #{} -> keep_state_and_data
    end;
handle_event(info, {restarted, _}, ready, _A, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

tell(Device, From, Value, #actuator{n = N, wanted = Wanted} = A, Actions) ->
    Told = A#actuator{n = N + 1, wanted = Wanted#{Device => {From, Value, N + 1}}},
    {keep_state, Told,
        Actions ++
            [
                {actuate, Device, Value, N + 1}, {{timeout, Device}, ?AGAIN_US, again}
            ]}.
