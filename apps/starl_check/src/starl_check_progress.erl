%% @doc From which states can all clients still come to their end? A team that waits while nothing
%% but timers happen that start one another again has states without end, and is stuck all the
%% same. So the search notes which state leads to which when nothing fails (no fault is used up and
%% nothing that was reported lost arrives), and in the end looks from which of them no state can be
%% reached any more in which all clients are done: EF of temporal logic, backwards from its goal.
%% Whether a fair team would take the way is not asked, so what is found is surely stuck.
-module(starl_check_progress).

-export([new/0, leads/3, ends/2, hopeless/2]).

-export_type([t/0]).

-type state_number() :: starl_check_visited:state_number().

%% Pairs of numbers, the latest ones first; so most lead to one that comes earlier here, and a few
%% passes through all of them are enough.
-record(progress, {pairs = [] :: [binary()], latest = <<>> :: binary()}).

-opaque t() :: #progress{}.

-define(END, 16#FFFFFFFF).
-define(PAIR_BYTES, 8).
-define(PIECE_BYTES, 800000).

%% @doc Nothing is noted.
-spec new() -> t().
new() -> #progress{}.

%% @doc One state leads to another when nothing fails.
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

%% @doc In this state all clients are done.
-spec ends(state_number(), t()) -> t().
ends(State, Progress) -> leads(State, ?END, Progress).

%% @doc Of so many states those from which no end can be reached.
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
