%% @doc How `exercise' uses each building block: during its work now this, now that; at its end the
%% calls that have to succeed when nothing goes wrong any more. Every call leaves what it was and
%% what came of it in the trace ({@link event()}), for {@link starl_exercise_monitor}.
-module(starl_exercise_use).

-export([work/4, final/3]).

-export_type([call/0, event/0]).

%% What the application traces, in turns: a call with its patience, and what it answered.
-type event() ::
    {call, call(), PatienceMs :: pos_integer() | none}
    | {answer, Outcome :: term()}.

%% What is called.
-type call() ::
    {send, To :: starl:robot_id()}
    | broadcast
    | {elect, Election :: term()}
    | {acquire | release, Tokens :: term()}
    | {sync, Name :: term()}
    | {geocast, Type :: atom()}
    | {put | get | learn, Name :: term()}.

%% Registers are read every turn, and written so rarely.
-define(TURNS_A_WRITE, 3).
%% So often a register is looked at that has to come.
-define(LEARN_MS, 500).
-define(FINAL_LIFETIME_MS, 4000).

%% @doc One turn of the work.
-spec work(starl_exercise:block(), starl:robot(), Turn :: pos_integer(), starl_exercise:use()) ->
    term().
work(sap, Robot, Turn, _Use) ->
    _ = send(Robot, other(Robot), Turn),
    _ = [broadcast(Robot, {all, Turn}) || Turn rem 4 =:= 0],
    starl:await(Robot, word, 50);
work(Block, Robot, Turn, #{patience := Patience}) when Block =:= election; Block =:= bully ->
    %% elections that follow one another, entered at different times
    elect(Robot, {term, Turn div 2}, Patience);
work(mutex, Robot, _Turn, #{patience := Patience, tokens := Count, hold := Hold}) ->
    Tokens =
        case within(Robot, 3) of
            1 -> {token, within(Robot, Count)};
            _ -> [{token, within(Robot, Count)} || _ <- [1, 2]]
        end,
    hold(Robot, Tokens, Patience, within(Robot, Hold));
work(barrier, Robot, _Turn, #{patience := Patience}) ->
    sync(Robot, round, Patience);
work(geocast, Robot, Turn, #{lifetime := Given}) ->
    Area = {circle, {1000.0 * within(Robot, 10), 1000.0 * within(Robot, 3)}, 3000.0},
    Lifetime =
        case Given of
            none -> lists:nth(within(Robot, 3), [200, 1000, 4000]);
            _ -> Given
        end,
    _ = geocast(Robot, Area, Turn, Lifetime),
    _ = starl:await(Robot, news, 100),
    starl:go_to(Robot, {1000.0 * within(Robot, 10), 1000.0 * within(Robot, 3)});
work(registers, Robot, Turn, _Use) ->
    %% a write is a broadcast, so they are rare; the first turn is one, for a robot that has
    %% restarted must not write with a clock that has gone back
    _ = [
        put(Robot, Name, {starl:id(Robot), Turn})
     || Turn rem ?TURNS_A_WRITE =:= 1, Name <- [within(Robot, 3), mine]
    ],
    [get(Robot, Name) || Name <- [1, 2, 3, mine]].

%% @doc The N-th of the calls at the end.
-spec final(starl_exercise:block(), {starl:robot(), N :: pos_integer()}, starl_exercise:use()) ->
    term().
final(sap, {Robot, N}, _Use) ->
    _ = [send(Robot, To, {final, N}) || To <- starl:participants(Robot)],
    broadcast(Robot, {final, N});
final(Block, {Robot, N}, Use) when Block =:= election; Block =:= bully ->
    Ms = starl_exercise:final_patience_ms(Use),
    again(fun() -> elect(Robot, {final, N}, Ms) end);
final(mutex, {Robot, N}, #{tokens := Count} = Use) ->
    Tokens = [{token, T} || T <- lists:seq(1, Count)],
    Patience = starl_exercise:final_patience_ms(Use),
    %% one by one, the next time all at once
    [
        hold(Robot, Some, Patience, 50)
     || Some <-
            case N rem 2 of
                1 -> Tokens;
                0 -> [Tokens]
            end
    ];
final(barrier, {Robot, _N}, Use) ->
    Ms = starl_exercise:final_patience_ms(Use),
    again(fun() -> sync(Robot, final, Ms) end);
final(geocast, {Robot, N}, _Use) ->
    _ = geocast(Robot, {circle, {5000.0, 5000.0}, 50000.0}, {final, N}, ?FINAL_LIFETIME_MS),
    starl:sleep(Robot, ?FINAL_LIFETIME_MS + 500);
final(registers, {Robot, N}, Use) ->
    _ = again(fun() -> put(Robot, {final, starl:id(Robot)}, N) end),
    others(N, Robot, Use).

%% In the end the others' writes come, and there is time until all copies have to be equal.
others(N, Robot, #{final := N} = Use) ->
    _ = [learn(Robot, {final, R}, Use) || R <- starl:participants(Robot)],
    starl:sleep(Robot, starl_exercise:within_ms(Use) * 102 div 100);
others(_N, _Robot, _Use) ->
    ok.

%% Others wait for it.
again(Call) ->
    case Call() of
        {error, restarted} -> again(Call);
        Outcome -> Outcome
    end.

hold(Robot, Tokens, Patience, Ms) ->
    Acquire = fun() -> starl_mutex:acquire(Robot, Tokens, Patience) end,
    case traced(Robot, {acquire, Tokens}, Patience, Acquire) of
        {ok, _} ->
            ok = starl:sleep(Robot, Ms),
            traced(Robot, {release, Tokens}, fun() -> starl_mutex:release(Robot, Tokens) end);
        {error, _} = Error ->
            Error
    end.

send(Robot, To, Body) ->
    traced(Robot, {send, To}, fun() -> starl:send(Robot, To, word, Body) end).

broadcast(Robot, Body) ->
    traced(Robot, broadcast, fun() -> starl:broadcast(Robot, word, Body) end).

elect(Robot, Election, Ms) ->
    traced(Robot, {elect, Election}, Ms, fun() -> starl_election:elect(Robot, Election, Ms) end).

sync(Robot, Name, Ms) ->
    traced(Robot, {sync, Name}, Ms, fun() -> starl_barrier:sync(Robot, Name, Ms) end).

geocast(Robot, Area, Body, Lifetime) ->
    traced(Robot, {geocast, news}, fun() ->
        starl_geocast:send(Robot, Area, news, Body, #{lifetime_ms => Lifetime})
    end).

put(Robot, Name, Value) ->
    traced(Robot, {put, Name}, fun() -> starl_registers:put(Robot, Name, Value) end).

get(Robot, Name) ->
    traced(Robot, {get, Name}, fun() -> starl_registers:get(Robot, Name) end).

%% Looks at a register until it is written.
learn(Robot, Name, Use) ->
    Ms = starl_exercise:within_ms(Use) * 110 div 100,
    Until = starl:now(Robot) + Ms,
    traced(Robot, {learn, Name}, Ms, fun() -> learned(Robot, Name, Until) end).

learned(Robot, Name, Until) ->
    case starl_registers:get(Robot, Name) of
        {ok, _} ->
            ok;
        {error, _} ->
            case starl:now(Robot) < Until of
                true ->
                    ok = starl:sleep(Robot, ?LEARN_MS),
                    learned(Robot, Name, Until);
                false ->
                    {error, timeout}
            end
    end.

traced(Robot, What, Call) -> traced(Robot, What, none, Call).

traced(Robot, What, Patience, Call) ->
    ok = starl:trace(Robot, {call, What, Patience}),
    Outcome = Call(),
    ok = starl:trace(Robot, {answer, Outcome}),
    Outcome.

other(Robot) ->
    Others = lists:delete(starl:id(Robot), starl:participants(Robot)),
    case Others of
        [] -> starl:id(Robot);
        [_ | _] -> lists:nth(within(Robot, length(Others)), Others)
    end.

within(Robot, N) -> 1 + trunc(starl:random(Robot) * N).
