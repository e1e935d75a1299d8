%% @doc Bounds on the difference of two clocks over time, from the messages between them.
%%
%% A packet that left at s by the sender's clock and came at r by the receiver's says: when the
%% sender's clock showed s, the receiver's showed r at most. Packets in the other direction bound it
%% from below. Between packets a bound fades with the rates of the clocks, so for each direction the
%% bound at a time is the best of all packets, each faded by the time from it: two sweeps find it.
%%
%% For a slice of time the pairs are joined by shortest paths: a third robot may know two clocks
%% better than they know each other. Bounds that contradict each other name their robots.
-module(starl_debug_envelope).

-export([from_packets/2, offset/4, widest/1, least/1]).

-export_type([t/0]).

-record(envelope, {
    slice_us :: pos_integer(),
    from :: integer(),
    count :: pos_integer(),
    %% by how much two clocks run apart in a slice at most (us)
    fade_us :: pos_integer(),
    robots :: [starl:robot_id()],
    %% by slice: how far the second clock is ahead of the first at most (us)
    ahead :: #{integer() => #{{starl:robot_id(), starl:robot_id()} => integer()}}
}).

-opaque t() :: #envelope{}.

-define(SLICE_US, 1000000).
%% What nobody knows: an hour.
-define(MOST_US, 3600000000).

%% @doc The bounds that the packets of a recording give, for clocks whose rates are off by that
%% (ppm).
-spec from_packets(starl_debug_recording:t(), DriftPpm :: number()) ->
    {ok, t()} | {error, unicode:chardata()}.
from_packets(#{packets := []}, _Drift) ->
    {error,
        "no messages bound the clocks of these robots; give a sigma, or the robots' own recordings "
        "(what ./starl merge makes has no stamps of both ends)"};
from_packets(#{packets := Packets, robots := Robots, extent := {From, To}}, Drift) ->
    Links = maps:groups_from_list(
        fun({A, B, _, _}) -> {A, B} end, fun({_, _, S, R}) -> {S, R} end, met(Packets)
    ),
    Count = (To - From) div ?SLICE_US + 1,
    Rate = 2.0 * Drift / (1.0e6 - Drift),
    Fade = ceil(Rate * ?SLICE_US) + 1,
    Curves = maps:map(
        fun(_Link, Stamps) -> curve(lists:sort(Stamps), From, Count, Fade) end, Links
    ),
    slices(0, Count, Curves, Robots, #envelope{
        slice_us = ?SLICE_US,
        from = From,
        count = Count,
        fade_us = Fade,
        robots = Robots,
        ahead = #{}
    }).

%% Of what came only one packet is known to be it: the earliest that was sent with that number,
%% which weakens the bound at most. A number that came before it was ever sent tells nothing.
met(Packets) ->
    Sent = lists:foldl(
        fun
            ({sent, A, B, Hash, At}, Acc) ->
                maps:update_with({A, B, Hash}, fun(Known) -> min(Known, At) end, At, Acc);
            (_, Acc) ->
                Acc
        end,
        #{},
        Packets
    ),
    [{A, B, S, R} || {packet, A, B, S, R} <- Packets] ++
        [
            {A, B, maps:get({A, B, Hash}, Sent), R}
         || {came, A, B, Hash, R} <- Packets, is_map_key({A, B, Hash}, Sent)
        ].

%% How far the receiver is ahead at most, for each slice: the least of r − s, faded.
curve(Stamps, From, Count, Fade) ->
    Best = lists:foldl(
        fun({S, R}, Acc) ->
            Slice = max(0, min(Count - 1, (S - From) div ?SLICE_US)),
            maps:update_with(Slice, fun(Known) -> min(Known, R - S) end, R - S, Acc)
        end,
        #{},
        Stamps
    ),
    Forward = swept(lists:seq(0, Count - 1), Best, Fade, none),
    Backward = swept(lists:seq(Count - 1, 0, -1), Best, Fade, none),
    maps:merge_with(
        fun(_, A, B) -> min(A, B) end, maps:from_list(Forward), maps:from_list(Backward)
    ).

swept([], _Best, _Fade, _Last) ->
    [];
swept([Slice | Slices], Best, Fade, Last) ->
    Faded = [Last + Fade || Last =/= none],
    %% a packet may lie at the other end of its slice, or beyond it by the receiver's clock
    case Faded ++ [Here + 2 * Fade || #{Slice := Here} <- [Best]] of
        [] -> swept(Slices, Best, Fade, none);
        Bounds -> [{Slice, lists:min(Bounds)} | swept(Slices, Best, Fade, lists:min(Bounds))]
    end.

slices(Slice, Count, _Curves, _Robots, Envelope) when Slice >= Count ->
    {ok, Envelope};
slices(Slice, Count, Curves, Robots, #envelope{ahead = Ahead} = Envelope) ->
    Direct = maps:from_list([{Link, Us} || {Link, #{Slice := Us}} <- maps:to_list(Curves)]),
    Closed = closed(Robots, Direct),
    case [R || R <- Robots, maps:get({R, R}, Closed, 0) < 0] of
        [] ->
            slices(Slice + 1, Count, Curves, Robots, Envelope#envelope{
                ahead = Ahead#{Slice => Closed}
            });
        Wrong ->
            {error, inconsistent(Slice, Wrong, Closed)}
    end.

%% Floyd and Warshall.
closed(Robots, Direct) ->
    lists:foldl(fun(K, Known) -> through(K, Robots, Known) end, Direct, Robots).

through(K, Robots, Known) ->
    Pairs = [
        {{I, J}, A + B}
     || I <- Robots,
        #{{I, K} := A} <- [via(I, K, Known)],
        J <- Robots,
        #{{K, J} := B} <- [via(K, J, Known)]
    ],
    lists:foldl(
        fun({Link, Us}, Acc) -> maps:update_with(Link, fun(Old) -> min(Old, Us) end, Us, Acc) end,
        Known,
        Pairs
    ).

via(I, K, Known) -> maps:with([{I, K}], Known).

inconsistent(Slice, Robots, Closed) ->
    Us = lists:min([maps:get({R, R}, Closed) || R <- Robots]),
    io_lib:format(
        "the packets of robots ~ts contradict each other by ~.1f ms around second ~b: "
        "a clock was set, drifts more than --drift, or a file is of another run",
        [lists:join(", ", [integer_to_list(R) || R <- Robots]), -Us / 1000, Slice]
    ).

%% @doc How far the second robot's clock is ahead of the first one's in a slice of time. Before and
%% behind the recording the bounds of its ends fade.
-spec offset(starl:robot_id(), starl:robot_id(), starl_debug_set:interval(), t()) ->
    {LeastUs :: integer(), MostUs :: integer()}.
offset(R, R, _Slice, _Envelope) ->
    {0, 0};
offset(R, Q, {From, To}, #envelope{from = First, ahead = Ahead} = Envelope) ->
    #envelope{slice_us = Length, count = Count, fade_us = Fade} = Envelope,
    Begin = within((From - First) div Length, Count),
    End = within((To - First) div Length, Count),
    Outside = max(0, First - From) + max(0, To - (First + Count * Length)),
    Faded = Fade * ((Outside + Length - 1) div Length),
    Slices = [maps:get(N, Ahead) || N <- lists:seq(Begin, End)],
    Most = lists:max([maps:get({R, Q}, Known, ?MOST_US) || Known <- Slices]),
    Least = lists:min([-maps:get({Q, R}, Known, ?MOST_US) || Known <- Slices]),
    {Least - Faded, Most + Faded}.

within(N, Count) -> max(0, min(Count - 1, N)).

%% @doc The greatest difference of two clocks that the messages leave open (us).
-spec widest(t()) -> non_neg_integer().
widest(#envelope{ahead = Ahead, robots = Robots}) ->
    Pairs = [{R, Q} || R <- Robots, Q <- Robots, R =/= Q],
    Bounds = [maps:get(Pair, Known, ?MOST_US) || Known <- maps:values(Ahead), Pair <- Pairs],
    lists:foldl(fun(Us, Widest) -> max(abs(Us), Widest) end, 0, Bounds).

%% @doc The greatest difference of two clocks that the messages prove (us), and these robots; `none'
%% if all clocks may be equal.
-spec least(t()) -> none | {Us :: pos_integer(), starl:robot_id(), starl:robot_id()}.
least(#envelope{ahead = Ahead}) ->
    %% one that is ahead by less than nothing is behind
    Behind = [{-Us, R, Q} || Known <- maps:values(Ahead), {{R, Q}, Us} <- maps:to_list(Known)],
    lists:max([none | [Found || {Us, _, _} = Found <- Behind, Us > 0]]).
