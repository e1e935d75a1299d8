%% @doc Registers that all robots share: the interface.
%%
%% A register has a name and a value, both any terms; each robot has a copy of all. A write is
%% seen at once at home and soon everywhere; of two writes the later wins, everywhere the same
%% (by a hybrid logical clock, {@link starl_hlc}). Guarantee: a read returns what somebody wrote;
%% reads at one robot never go back to an earlier write, unless its machine restarted; when
%% writes stop and messages get through, all robots agree. It is no transaction: two robots that
%% read and then write may lose one of the writes; for that there is mutual exclusion.
%%
%% With `owners' in the configuration a register has one writer only.
-module(starl_registers).

-export([block/0, block/1, put/3, get/2, subscribe/2]).

-export_type([name/0]).

-type name() :: term().

%% @doc The machine that a robot needs to share registers, all of them with many writers.
-spec block() -> starl_robot_sup:machine().
block() -> block(#{}).

%% @doc The same with a configuration; `#{owners => #{Name => Robot}}' names single writers.
-spec block(starl_registers_lww:config()) -> starl_robot_sup:machine().
block(Config) -> {registers, starl_registers_lww, Config}.

%% @doc Writes a register. `full': it would be one more than there may be.
-spec put(starl:robot(), name(), Value :: term()) ->
    ok | {error, not_owner | full | restarted}.
put(Robot, Name, Value) -> flatten(starl:call(Robot, registers, {put, Name, Value}, infinity)).

%% @doc Reads the robot's own copy of a register.
-spec get(starl:robot(), name()) -> {ok, Value :: term()} | {error, unset | restarted}.
get(Robot, Name) -> flatten(starl:call(Robot, registers, {get, Name}, infinity)).

%% @doc From now on the application gets each value that the register takes here, the present one
%% included, as the message `register' from its writer: `{ok, Writer, {Name, Value}} =
%% starl:await(Robot, register)'. To be called again after `{error, restarted}'.
-spec subscribe(starl:robot(), name()) -> ok.
subscribe(_Robot, Name) ->
    starl_app_proc:perform([{cast, registers, {subscribe, Name, app}}]).

flatten({ok, Answer}) -> Answer;
flatten({error, restarted}) -> {error, restarted}.
