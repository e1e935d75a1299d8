%% @doc An application that does nothing but use one building block all the time, under the
%% monitor of its contract: as in `./starl run exercise --block mutex --random-faults [network]'.
%% With `final' each robot makes some more calls when its work is done, and another monitor
%% ({@link starl_exercise_monitor}) says which calls should have succeeded and did not.
-module(starl_exercise).
-behaviour(starl_app).

-export([options/0, scene/1, init/2, step/2, report/2]).
-export([blocks_known/0, within_ms/1, final_patience_ms/1]).

-export_type([block/0, use/0, state/0]).

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
    lease := pos_integer(),
    sync := pos_integer(),
    limit := pos_integer(),
    retry := pos_integer(),
    lifetime := pos_integer() | none,
    final := non_neg_integer(),
    team => pos_integer()
}.

%% What it does, until when by its own clock (ms), and the number of the turn; or, when the work is
%% done, how many turns there were, and the number of the call.
-opaque state() ::
    {use(), Until :: integer(), Turn :: pos_integer()}
    | {final, use(), Turns :: non_neg_integer(), N :: pos_integer()}.

%% A call may last so much longer than its patience.
-define(MARGIN_US, 12000000).
%% What is promised has come true so long after nothing goes wrong any more, ms: what clocks that
%% were set add to a lease, some retries, and the exchange between registers.
-define(WITHIN_MS, 20000).
%% One robot comes to its final calls so much later than another: it has restarted at the end of
%% the faults.
-define(APART_MS, 45000).
-define(AHEAD_MS, 60000).
-define(POSITION_ERROR_MM, 400.0).

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
        {lease, {integer, 100, 1000000}, 2000,
            "mutex: how long a hold lasts that is not renewed, ms"},
        {sync, {integer, 10, 1000000}, 1000, "registers: the mean time between two exchanges, ms"},
        {limit, {integer, 1, 1000000}, 1024, "registers: how many there may be"},
        {retry, {integer, 10, 1000000}, 3000,
            "mutex, barrier: who waits asks again after this, ms"},
        {lifetime, {optional, {integer, 1, 1000000}}, none,
            "geocast: lifetime, ms; none: 200, 1000 or 4000 at random"},
        {final, {integer, 0, 1000}, 0,
            "how many further calls each robot makes in the end, judged by how they end"}
    ].

-spec scene(starl_app:context()) -> {ok, starl_app:scene()}.
scene(#{robots := Robots, options := #{block := Block} = Options}) ->
    Use = Options#{team => length(Robots)},
    Calls = #{
        block => Block,
        robots => Robots,
        healed_us => never,
        within_us => 1000 * within_ms(Use),
        margin_us => ?MARGIN_US,
        bound_us => ?MARGIN_US,
        apart_us => 1000 * ?AHEAD_MS
    },
    {ok, #{
        app => {sequential, ?MODULE, Use},
        never_crashes => true,
        %% who is dead is given up soon
        sap => #{limit => 6},
        blocks => machines(Block, Use),
        monitors => monitors(Block, Robots, 1000 * longest_patience_ms(Use) + ?MARGIN_US, Use) ++
            [{starl_exercise_monitor, Calls}]
    }}.

%% @doc With how much patience the final calls are made: more than it takes until they must have
%% succeeded, so that none ends before.
-spec final_patience_ms(use()) -> pos_integer().
final_patience_ms(Use) -> within_ms(Use) + ?APART_MS.

longest_patience_ms(#{final := 0, patience := Ms}) -> Ms;
longest_patience_ms(#{patience := Ms} = Use) -> max(Ms, final_patience_ms(Use)).

%% @doc What is promised of a call has come true so long after nothing goes wrong any more. All
%% robots may be in front, each with its longest holds, and a lease has to end first.
-spec within_ms(use()) -> pos_integer().
within_ms(#{block := mutex, team := N, hold := Hold, lease := Lease, retry := Retry}) ->
    ?WITHIN_MS + round(2 * (Lease + Retry + N * Hold));
within_ms(#{block := registers, sync := Sync}) ->
    5000 + round(15 * Sync);
within_ms(#{retry := Retry}) ->
    ?WITHIN_MS + round(2 * Retry).

machines(sap, _Use) ->
    [];
machines(election, _Use) ->
    [starl_election:block(ballots)];
machines(bully, _Use) ->
    [starl_election:block(bully)];
machines(mutex, #{lease := Lease, retry := Retry}) ->
    [starl_mutex:block(#{lease_ms => Lease, retry_ms => Retry})];
machines(barrier, #{retry := Retry}) ->
    starl_barrier:blocks(#{retry_ms => Retry});
machines(geocast, _Use) ->
    %% more than the faults of positions add up to
    [starl_geocast:block(#{listeners => #{news => app}, position_error_mm => ?POSITION_ERROR_MM})];
machines(registers, #{sync := Sync, limit := Limit}) ->
    [
        starl_registers:block(#{
            owners => #{mine => 1},
            sync_ms => Sync,
            limit => Limit,
            %% more than the faults of clocks add up to
            ahead_ms => ?AHEAD_MS
        })
    ].

monitors(sap, _Robots, _BoundUs, _Use) ->
    [];
monitors(election, Robots, BoundUs, _Use) ->
    [{starl_election_monitor, #{robots => Robots, bound_us => BoundUs}}];
monitors(bully, Robots, BoundUs, _Use) ->
    [{starl_election_bully_monitor, #{robots => Robots, bound_us => BoundUs}}];
monitors(mutex, _Robots, _BoundUs, #{lease := Lease}) ->
    [{starl_mutex_monitor, #{lease_us => 1000 * Lease, broken => []}}];
monitors(barrier, Robots, _BoundUs, _Use) ->
    [{starl_barrier_monitor, #{robots => Robots}}];
monitors(geocast, Robots, _BoundUs, _Use) ->
    [
        {starl_geocast_monitor, #{
            robots => Robots,
            broken => [],
            progress => true,
            healed_us => never,
            delay_us => 0,
            margin_mm => 2.0 * ?POSITION_ERROR_MM
        }}
    ];
monitors(registers, Robots, _BoundUs, Use) ->
    [
        {starl_registers_monitor, #{
            robots => Robots,
            owners => #{mine => 1},
            within_us => 1000 * within_ms(Use),
            apart_us => 1000 * ?AHEAD_MS,
            healed_us => never
        }}
    ].

-spec init(starl:robot(), use()) -> state().
init(Robot, #{block := Block, work := Seconds} = Use) ->
    _ = [ok = starl:listen(Robot, word) || Block =:= sap],
    {Use, starl:now(Robot) + round(1000 * Seconds), 1}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Turns :: pos_integer()}.
step(Robot, {final, #{block := Block, final := Most} = Use, Turn, N}) when N =< Most ->
    _ = starl_exercise_use:final(Block, {Robot, N}, Use),
    {continue, {final, Use, Turn, N + 1}};
step(_Robot, {final, _Use, Turn, _N}) ->
    {done, Turn};
step(Robot, {#{turns := Turns, block := Block, pause := Pause} = Use, Until, Turn}) ->
    %% an atom is more than every number
    case starl:now(Robot) >= Until orelse Turn > Turns of
        true ->
            {continue, {final, Use, Turn, 1}};
        false ->
            _ = starl_exercise_use:work(Block, Robot, Turn, Use),
            ok = starl:sleep(Robot, 2 + trunc(starl:random(Robot) * Pause)),
            {continue, {Use, Until, Turn + 1}}
    end.

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
