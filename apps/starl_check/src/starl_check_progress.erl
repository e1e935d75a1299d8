%% @doc Finds the states from which the clients cannot finish any more. A team whose only events are
%% timers that restart one another passes through endless states, but is stuck all the same. So the
%% search notes all steps between states without failures (no fault is used and no message reported
%% lost arrives). At the end this module finds the states from which no state with all clients done
%% is reachable: EF of temporal logic, backwards from its goal. Fairness is not considered, so a
%% state that is found is certainly stuck.
-module(starl_check_progress).

-export([new/0, leads/3, ends/2, hopeless/2]).

-export_type([t/0]).

-type state_number() :: starl_check_visited:state_number().

%% Pairs of numbers, latest first. Most pairs lead to a state that comes earlier in this order, so a
%% few passes over all of them are enough.
-record(progress, {pairs = [] :: [binary()], latest = <<>> :: binary()}).

-opaque t() :: #progress{}.

-define(END, 16#FFFFFFFF).
-define(PAIR_BYTES, 8).
-define(PIECE_BYTES, 800000).

%% @doc No steps noted.
-spec new() -> t().
new() -> #progress{}.

%% @doc Notes that one state leads to another without a failure.
-spec leads(state_number(), state_number(), t()) -> t().
leads(State, State, Progress) ->
    Progress;
leads(From, To, #progress{pairs = Pairs, latest = Latest} = Progress) ->
    case <<Latest/binary, From:32, To:32>> of
        Full when byte_size(Full) >= ?PIECE_BYTES ->
            Progress#progress{pairs = [Full | Pairs], latest = <<>>};
        More ->
            Progress#progress{latest = More}
    end.

%% @doc Notes that all clients are done in this state.
-spec ends(state_number(), t()) -> t().
ends(State, Progress) -> leads(State, ?END, Progress).

%% @doc Of the first `Count' states, those from which no end can be reached.
-spec hopeless(Count :: non_neg_integer(), t()) -> [state_number()].
hopeless(Count, #progress{pairs = Pairs, latest = Latest}) ->
    Bits = atomics:new(Count div 64 + 1, [{signed, false}]),
    ok = passes([Latest | Pairs], Bits),
    [State || State <- lists:seq(0, Count - 1), not is_hopeful(State, Bits)].

passes(Pieces, Bits) ->
    case lists:foldl(fun(P, Found) -> pass(byte_size(P), P, Bits, Found) end, false, Pieces) of
        true -> passes(Pieces, Bits);
        false -> ok
    end.

pass(0, _Piece, _Bits, Found) ->
    Found;
pass(End, Piece, Bits, Found) ->
    At = End - ?PAIR_BYTES,
    <<_:At/binary, From:32, To:32, _/binary>> = Piece,
    case is_hopeful(To, Bits) andalso not is_hopeful(From, Bits) of
        true ->
            Word = atomics:get(Bits, From div 64 + 1),
            ok = atomics:put(Bits, From div 64 + 1, Word bor (1 bsl (From rem 64))),
            pass(At, Piece, Bits, true);
        false ->
            pass(At, Piece, Bits, Found)
    end.

is_hopeful(?END, _Bits) -> true;
is_hopeful(State, Bits) -> atomics:get(Bits, State div 64 + 1) band (1 bsl (State rem 64)) =/= 0.
