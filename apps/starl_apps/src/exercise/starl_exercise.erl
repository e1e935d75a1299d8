%% @doc An application that does nothing but use one building block all the time, under the
%% monitor of its contract: as in `./starl run exercise --block mutex --random-faults [network]'.
-module(starl_exercise).
-behaviour(starl_app).

-export([options/0, scene/1, init/2, step/2, report/2]).
-export([blocks_known/0, bears/1]).

-export_type([block/0]).

-type block() :: sap | election | bully | mutex | barrier | geocast | registers.

%% No call is waited for longer, in milliseconds: a robot whose partner is dead goes on.
-define(PATIENCE_MS, 8000).
%% The longest time from a call to its outcome that the monitors bear.
-define(BOUND_US, 20000000).

%% @doc The blocks that can be exercised.
-spec blocks_known() -> [block()].
blocks_known() -> [sap, election, bully, mutex, barrier, geocast, registers].

%% @doc The classes and kinds of faults under which a block's contract is to hold; the others
%% break one of its assumptions, which its page states. No block looks at wheels.
-spec bears(block()) -> [starl_sim_fault:class() | starl_sim_fault:kind()].
bears(Block) when Block =:= sap; Block =:= election; Block =:= bully; Block =:= barrier ->
    [network, clock, process, location, actuation];
bears(registers) ->
    [network, clock, process, location, actuation];
bears(Block) when Block =:= mutex; Block =:= geocast ->
    %% leases and lifetimes rest on clocks that drift within bounds and on robots that go on
    [network, kill_machine, kill_robot, reboot, actuation | [location || Block =:= mutex]].

-spec options() -> [starl_options:option()].
options() ->
    [
        {block, {one_of, blocks_known()}, sap, "the building block to be used"},
        {work, {number, 0.001, 1.0e6}, 25, "how long each robot goes on, s by its own clock"}
    ].

-spec scene(starl_app:context()) -> {ok, starl_app:scene()}.
scene(#{robots := Robots, options := #{block := Block, work := Seconds}}) ->
    {ok, #{
        app => {sequential, ?MODULE, {Block, round(1000 * Seconds)}},
        %% who is dead is given up soon
        sap => #{limit => 6},
        blocks => machines(Block),
        monitors => monitors(Block, Robots)
    }}.

machines(sap) -> [];
machines(election) -> [starl_election:block(ballots)];
machines(bully) -> [starl_election:block(bully)];
machines(mutex) -> [starl_mutex:block(#{lease_ms => 2000})];
machines(barrier) -> [starl_barrier:block()];
machines(geocast) -> [starl_geocast:block(#{listeners => #{news => app}})];
machines(registers) -> [starl_registers:block(#{owners => #{mine => 1}})].

monitors(sap, _Robots) -> [];
monitors(election, Robots) ->
    [{starl_election_monitor, #{robots => Robots, bound_us => ?BOUND_US}}];
monitors(bully, Robots) ->
    [{starl_election_bully_monitor, #{robots => Robots, bound_us => ?BOUND_US}}];
monitors(mutex, _Robots) ->
    [{starl_mutex_monitor, #{}}];
monitors(barrier, Robots) ->
    [{starl_barrier_monitor, #{robots => Robots}}];
monitors(geocast, Robots) ->
    [{starl_geocast_monitor, #{robots => Robots}}];
monitors(registers, Robots) ->
    [{starl_registers_monitor, #{robots => Robots, owners => #{mine => 1}}}].

-spec init(starl:robot(), {block(), Ms :: pos_integer()}) -> {block(), integer(), pos_integer()}.
init(Robot, {Block, Ms}) ->
    _ = [ok = starl:listen(Robot, word) || Block =:= sap],
    {Block, starl:now(Robot) + Ms, 1}.

-spec step(starl:robot(), {block(), integer(), pos_integer()}) ->
    {continue, {block(), integer(), pos_integer()}} | {done, pos_integer()}.
step(Robot, {Block, Until, Turn}) ->
    case starl:now(Robot) >= Until of
        true ->
            {done, Turn};
        false ->
            use(Block, Robot, Turn),
            ok = starl:sleep(Robot, 1 + within(Robot, 400)),
            {continue, {Block, Until, Turn + 1}}
    end.

use(sap, Robot, Turn) ->
    _ = starl:send(Robot, other(Robot), word, Turn),
    _ = [starl:broadcast(Robot, word, {all, Turn}) || Turn rem 4 =:= 0],
    _ = starl:await(Robot, word, 50),
    ok;
use(Block, Robot, Turn) when Block =:= election; Block =:= bully ->
    %% elections that follow one another, entered at different times
    _ = starl_election:elect(Robot, {term, Turn div 2}, ?PATIENCE_MS),
    ok;
use(mutex, Robot, _Turn) ->
    Tokens =
        case within(Robot, 3) of
            1 -> {token, within(Robot, 3)};
            _ -> [{token, within(Robot, 3)} || _ <- [1, 2]]
        end,
    case starl_mutex:acquire(Robot, Tokens, ?PATIENCE_MS) of
        {ok, _} ->
            ok = starl:sleep(Robot, within(Robot, 300)),
            _ = starl_mutex:release(Robot, Tokens),
            ok;
        {error, _} ->
            ok
    end;
use(barrier, Robot, _Turn) ->
    _ = starl_barrier:sync(Robot, round, ?PATIENCE_MS),
    ok;
use(geocast, Robot, Turn) ->
    Area = {circle, {1000.0 * within(Robot, 10), 1000.0 * within(Robot, 3)}, 3000.0},
    Lifetime = lists:nth(within(Robot, 3), [200, 1000, 4000]),
    _ = starl_geocast:send(Robot, Area, news, Turn, #{lifetime_ms => Lifetime}),
    _ = starl:await(Robot, news, 100),
    _ = starl:go_to(Robot, {1000.0 * within(Robot, 10), 1000.0 * within(Robot, 3)}),
    ok;
use(registers, Robot, Turn) ->
    _ = starl_registers:put(Robot, within(Robot, 3), {starl:id(Robot), Turn}),
    _ = starl_registers:put(Robot, mine, Turn),
    _ = [starl_registers:get(Robot, Name) || Name <- [1, 2, 3, mine]],
    ok.

other(Robot) ->
    Others = lists:delete(starl:id(Robot), starl:participants(Robot)),
    case Others of
        [] -> starl:id(Robot);
        [_ | _] -> lists:nth(within(Robot, length(Others)), Others)
    end.

within(Robot, N) -> 1 + trunc(starl:random(Robot) * N).

%% @doc How often the block was used, and what its monitor has counted.
-spec report(starl_app:scene(), starl_app:outcome()) -> starl_app:report().
report(#{monitors := Monitors}, #{robots := Robots, monitors := Results}) ->
    Turns = [Turn || {_, #{result := {done, Turn}}} <- Robots],
    Counted = [
        {Key, Count}
     || {Monitor, _} <- Monitors,
        {Key, Count} <- lists:sort(maps:to_list(maps:get(Monitor, Results, #{}))),
        is_number(Count)
    ],
    #{figures => [{turns, lists:sum(Turns)}, {finished, length(Turns)} | Counted]}.
