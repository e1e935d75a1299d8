%% @doc An application that does nothing but use one building block all the time, under the
%% monitor of its contract: as in `./starl run exercise --block mutex --random-faults [network]'.
-module(starl_exercise).
-behaviour(starl_app).

-export([options/0, scene/1, init/2, step/2, report/2]).
-export([blocks_known/0]).

-export_type([block/0, state/0]).

-type block() :: sap | election | bully | mutex | barrier | geocast | registers.

%% How the block is used: the application's options, times in milliseconds.
-type use() :: #{
    block := block(),
    work := number(),
    turns := pos_integer() | none,
    pause := pos_integer(),
    patience := pos_integer(),
    tokens := pos_integer(),
    hold := pos_integer(),
    lifetime := pos_integer() | none
}.

%% What it does, until when by its own clock (ms), and the how many-eth turn it is.
-opaque state() :: {use(), Until :: integer(), Turn :: pos_integer()}.

%% A call may last so much longer than its patience.
-define(MARGIN_US, 12000000).
-define(LEASE_MS, 2000).
%% Registers are read every turn, and written so rarely.
-define(TURNS_A_WRITE, 3).

%% @doc The blocks that can be exercised.
-spec blocks_known() -> [block()].
blocks_known() -> [sap, election, bully, mutex, barrier, geocast, registers].

-spec options() -> [starl_options:option()].
options() ->
    [
        {block, {one_of, blocks_known()}, sap, "the building block to be used"},
        {work, {number, 0.001, 1.0e6}, 25, "how long each robot goes on, s by its own clock"},
        {turns, {optional, {integer, 1, 1000000}}, none, "or how often it uses the block, at most"},
        {pause, {integer, 1, 1000000}, 400, "the longest pause between two uses, ms"},
        %% a robot whose partner is dead goes on
        {patience, {integer, 1, 10000000}, 8000, "no call is waited for longer, ms"},
        {tokens, {integer, 1, 100000}, 3, "mutex: how many tokens there are"},
        {hold, {integer, 1, 1000000}, 300, "mutex: the longest hold, ms"},
        {lifetime, {optional, {integer, 1, 1000000}}, none,
            "geocast: lifetime, ms; none: 200, 1000 or 4000 at random"}
    ].

-spec scene(starl_app:context()) -> {ok, starl_app:scene()}.
scene(#{robots := Robots, options := #{block := Block, patience := Patience} = Options}) ->
    {ok, #{
        app => {sequential, ?MODULE, Options},
        never_crashes => true,
        %% who is dead is given up soon
        sap => #{limit => 6},
        blocks => machines(Block),
        monitors => monitors(Block, Robots, 1000 * Patience + ?MARGIN_US)
    }}.

machines(sap) ->
    [];
machines(election) ->
    [starl_election:block(ballots)];
machines(bully) ->
    [starl_election:block(bully)];
machines(mutex) ->
    [starl_mutex:block(#{lease_ms => ?LEASE_MS})];
machines(barrier) ->
    starl_barrier:blocks();
machines(geocast) ->
    %% more than the faults of positions add up to
    [starl_geocast:block(#{listeners => #{news => app}, position_error_mm => 400.0})];
machines(registers) ->
    [starl_registers:block(#{owners => #{mine => 1}})].

monitors(sap, _Robots, _BoundUs) ->
    [];
monitors(election, Robots, BoundUs) ->
    [{starl_election_monitor, #{robots => Robots, bound_us => BoundUs}}];
monitors(bully, Robots, BoundUs) ->
    [{starl_election_bully_monitor, #{robots => Robots, bound_us => BoundUs}}];
monitors(mutex, _Robots, _BoundUs) ->
    [{starl_mutex_monitor, #{lease_us => 1000 * ?LEASE_MS, broken => []}}];
monitors(barrier, Robots, _BoundUs) ->
    [{starl_barrier_monitor, #{robots => Robots}}];
monitors(geocast, Robots, _BoundUs) ->
    [{starl_geocast_monitor, #{robots => Robots, broken => []}}];
monitors(registers, Robots, _BoundUs) ->
    [{starl_registers_monitor, #{robots => Robots, owners => #{mine => 1}}}].

-spec init(starl:robot(), use()) -> state().
init(Robot, #{block := Block, work := Seconds} = Use) ->
    _ = [ok = starl:listen(Robot, word) || Block =:= sap],
    {Use, starl:now(Robot) + round(1000 * Seconds), 1}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Turns :: pos_integer()}.
step(Robot, {#{turns := Turns, block := Block, pause := Pause} = Use, Until, Turn}) ->
    %% an atom is more than every number
    case starl:now(Robot) >= Until orelse Turn > Turns of
        true ->
            {done, Turn};
        false ->
            use(Block, Robot, Turn, Use),
            ok = starl:sleep(Robot, 1 + within(Robot, Pause)),
            {continue, {Use, Until, Turn + 1}}
    end.

use(sap, Robot, Turn, _Use) ->
    _ = starl:send(Robot, other(Robot), word, Turn),
    _ = [starl:broadcast(Robot, word, {all, Turn}) || Turn rem 4 =:= 0],
    _ = starl:await(Robot, word, 50),
    ok;
use(Block, Robot, Turn, #{patience := Patience}) when Block =:= election; Block =:= bully ->
    %% elections that follow one another, entered at different times
    _ = starl_election:elect(Robot, {term, Turn div 2}, Patience),
    ok;
use(mutex, Robot, _Turn, #{patience := Patience, tokens := Count, hold := Hold}) ->
    Tokens =
        case within(Robot, 3) of
            1 -> {token, within(Robot, Count)};
            _ -> [{token, within(Robot, Count)} || _ <- [1, 2]]
        end,
    case starl_mutex:acquire(Robot, Tokens, Patience) of
        {ok, _} ->
            ok = starl:sleep(Robot, within(Robot, Hold)),
            _ = starl_mutex:release(Robot, Tokens),
            ok;
        {error, _} ->
            ok
    end;
use(barrier, Robot, _Turn, #{patience := Patience}) ->
    _ = starl_barrier:sync(Robot, round, Patience),
    ok;
use(geocast, Robot, Turn, #{lifetime := Given}) ->
    Area = {circle, {1000.0 * within(Robot, 10), 1000.0 * within(Robot, 3)}, 3000.0},
    Lifetime =
        case Given of
            none -> lists:nth(within(Robot, 3), [200, 1000, 4000]);
            _ -> Given
        end,
    _ = starl_geocast:send(Robot, Area, news, Turn, #{lifetime_ms => Lifetime}),
    _ = starl:await(Robot, news, 100),
    _ = starl:go_to(Robot, {1000.0 * within(Robot, 10), 1000.0 * within(Robot, 3)}),
    ok;
use(registers, Robot, Turn, _Use) ->
    %% a write is a broadcast, so they are rare; the first turn is one, for a robot that has
    %% restarted must not write with a clock that has gone back
    _ = [
        starl_registers:put(Robot, Name, {starl:id(Robot), Turn})
     || Turn rem ?TURNS_A_WRITE =:= 1, Name <- [within(Robot, 3), mine]
    ],
    _ = [starl_registers:get(Robot, Name) || Name <- [1, 2, 3, mine]],
    ok.

other(Robot) ->
    Others = lists:delete(starl:id(Robot), starl:participants(Robot)),
    case Others of
        [] -> starl:id(Robot);
        [_ | _] -> lists:nth(within(Robot, length(Others)), Others)
    end.

within(Robot, N) -> 1 + trunc(starl:random(Robot) * N).

%% @doc How often the block was used, and what its monitor has counted: of the mutex, the longest
%% and the mean wait for a token and how unfair they are (the longest by the mean).
-spec report(starl_app:scene(), starl_app:outcome()) -> starl_app:report().
report(#{monitors := Monitors}, #{robots := Robots, monitors := Results}) ->
    Turns = [Turn - 1 || {_, #{result := {done, Turn}}} <- Robots],
    Counted = [
        {Key, Count}
     || {Monitor, _} <- Monitors,
        {Key, Count} <- lists:sort(maps:to_list(maps:get(Monitor, Results, #{}))),
        is_number(Count)
    ],
    #{figures => [{turns, lists:sum(Turns)}, {finished, length(Turns)} | Counted]}.
