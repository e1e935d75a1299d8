%% @doc The exercise of the registers: each robot reads some registers every turn, and writes now
%% and then.
%%
%% It promises that each call is answered. It also promises that another robot's write arrives,
%% unless the writer's machine has crashed since, or the writer has died.
-module(starl_registers_exercise).
-behaviour(starl_block_exercise).

-export([flags/0, block_options/1, within_ms/1, draw/1, work/3, final/3]).
-export([watches/0, seen/1, noted/2, promise/3]).

%% The last write of a register: its time and writer; and the time at which, at the latest, all
%% clocks admit the stamps of machines with damaged stores ({@link starl_registers_monitor}).
-type seen() :: {#{Name :: term() => {starl:robot_id(), integer()}}, AdmittedUs :: integer()}.

%% Registers are read every turn, and written so rarely.
-define(TURNS_A_WRITE, 3).
%% The number of times that a robot looks for a register that has to come.
-define(LEARN_MS, 500).
%% More than the faults of clocks add up to.
-define(AHEAD_MS, 60000).

-spec flags() -> [starl_options:option()].
flags() ->
    [
        {sync, {integer, 10, 1000000}, 1000, "registers: the mean time between two exchanges, ms"},
        {limit, {integer, 1, 1000000}, 1024, "registers: the largest number of registers"}
    ].

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(#{sync := Sync, limit := Limit}) ->
    #{owners => #{mine => 1}, sync_ms => Sync, limit => Limit, ahead_ms => ?AHEAD_MS}.

-spec within_ms(starl_block_exercise:use()) -> pos_integer().
within_ms(#{sync := Sync}) -> starl_registers:within_ms(Sync).

-spec draw(starl_block_exercise:draw()) -> #{atom() => term()}.
draw(Draw) ->
    %% now and then there is no room for all
    #{sync => Draw(sync, [200, 1000, 3000]), limit => Draw(limit, [1024, 1024, 3, 6])}.

%% A write is a broadcast, so they are rare; the first turn is one, for a robot that has restarted
%% must not write with a clock that has gone back.
-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, Turn, _Use) ->
    _ = [
        put(Robot, Name, {starl:id(Robot), Turn})
     || Turn rem ?TURNS_A_WRITE =:= 1, Name <- [starl_block_exercise:pick(Robot, 3), mine]
    ],
    [get(Robot, Name) || Name <- [1, 2, 3, mine]].

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, Use) ->
    Put = fun() -> put(Robot, {final, starl:id(Robot)}, N) end,
    _ = starl_block_exercise:again(Put),
    others(N, Robot, Use).

%% In the end the others' writes come, and there is time until all copies have to be equal.
others(N, Robot, #{final := N, within := Within}) ->
    _ = [learn(Robot, {final, R}, Within * 110 div 100) || R <- starl:participants(Robot)],
    starl:sleep(Robot, Within * 102 div 100);
others(_N, _Robot, _Use) ->
    ok.

put(Robot, Name, Value) ->
    Put = fun() -> starl_registers:put(Robot, Name, Value) end,
    starl_block_exercise:call(Robot, {put, Name}, Put).

get(Robot, Name) ->
    starl_block_exercise:call(Robot, {get, Name}, fun() -> starl_registers:get(Robot, Name) end).

%% Looks at a register until it is written.
learn(Robot, Name, Ms) ->
    Until = starl:now(Robot) + Ms,
    starl_block_exercise:call(Robot, {learn, Name}, Ms, fun() -> learned(Robot, Name, Until) end).

learned(Robot, Name, Until) ->
    case starl_registers:get(Robot, Name) of
        {ok, _} -> ok;
        {error, _} -> learned_later(starl:now(Robot) < Until, Robot, Name, Until)
    end.

learned_later(true, Robot, Name, Until) ->
    ok = starl:sleep(Robot, ?LEARN_MS),
    learned(Robot, Name, Until);
learned_later(false, _Robot, _Name, _Until) ->
    {error, timeout}.

-spec watches() -> [starl_machine:name()].
watches() -> [registers].

-spec seen([starl:robot_id()]) -> seen().
seen(_Robots) -> {#{}, 0}.

-spec noted(starl_monitor:trace_event(), seen()) -> seen().
noted({T, Robot, app, {answered, #{what := {put, Name}}, ok}}, {Written, Admitted}) ->
    {Written#{Name => {Robot, T}}, Admitted};
noted({_, Robot, registers, crashed}, Seen) ->
    forgotten(Robot, Seen);
noted({_, Robot, robot, {died, _Reason}}, Seen) ->
    forgotten(Robot, Seen);
noted({T, _Robot, registers, store_damaged}, {Written, _Admitted}) ->
    {Written, T + 1000 * ?AHEAD_MS};
noted(_Event, Seen) ->
    Seen.

forgotten(Robot, {Written, Admitted}) ->
    {maps:filter(fun(_, {Writer, _}) -> Writer =/= Robot end, Written), Admitted}.

-spec promise(starl_promise:call(), starl_promise:team(), seen()) -> starl_promise:t().
promise(#{what := {learn, Name}} = Call, #{within_us := Within} = Team, {Written, Admitted}) ->
    case Written of
        #{Name := {Writer, T}} ->
            Due = max(max(T, Admitted) + Within, starl_promise:due_us(Call, Team)),
            case starl_promise:has_died([Writer], Team) of
                true -> none;
                false -> {Due, fun starl_promise:is_ok/1}
            end;
        #{} ->
            none
    end;
promise(Call, Team, _Seen) ->
    starl_promise:soon(Call, fun starl_promise:is_answer/1, Team).
