%% @doc Counts a live robot's trace events and the packets that it sends. A pure module;
%% {@link text/2} writes the counters in the text format of Prometheus.
-module(starl_live_counts).

-export([new/0, traced/2, transmits/3, sent_until/3, text/2]).
-export([leases/2, peers/1, chassis/1]).

-export_type([t/0, gauge/0]).

%% The upper bounds of the histogram of latencies, in milliseconds.
-define(BOUNDS_MS, [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]).
%% A message whose outcome is not known yet is remembered; beyond this number none is.
-define(MOST_OPEN, 10000).

-record(counts, {
    counters = #{} :: #{counter() => non_neg_integer()},
    %% messages under way: when they were sent, and how often so far
    open = #{} :: #{starl_packet:seq() => {SentUs :: integer(), Times :: non_neg_integer()}},
    %% latencies by bucket, their sum and number
    buckets = #{} :: #{pos_integer() | infinity => pos_integer()},
    sum_us = 0 :: non_neg_integer(),
    count = 0 :: non_neg_integer(),
    %% the ends of leases, by the robot's clock (us)
    leases = #{} :: #{lease() => integer()}
}).

-opaque t() :: #counts{}.

%% What is held under a lease: a token; what allows the robot to send messages of this type, as votes do.
-type lease() :: {token, term()} | {type, starl_packet:type()}.

%% A counter: its name, with a label or without.
-type counter() :: atom() | {atom(), Label :: atom(), Value :: atom()}.

%% A present value from elsewhere.
-type gauge() :: {Name :: atom(), [{Label :: atom(), Value :: term()}], number()}.

%% @doc Nothing is counted yet.
-spec new() -> t().
new() -> #counts{}.

%% @doc Counts a fact.
-spec traced(starl_monitor:trace_event(), t()) -> t().
traced({Us, _, _, {leased, Token, _Fence, LeftUs}}, Counts) ->
    leased({token, Token}, Us + LeftUs, Counts);
traced({_, _, _, {How, Token, _Fence}}, Counts) when How =:= released; How =:= lease_lost ->
    #counts{leases = Leases} = Counts,
    Counts#counts{leases = maps:remove({token, Token}, Leases)};
traced({_, _, Machine, crashed}, Counts) ->
    count({restarts, machine, Machine}, 1, Counts);
traced({_, _, Machine, late}, Counts) ->
    count({late, machine, Machine}, 1, Counts);
traced({Us, _, sap, Event}, Counts) ->
    messages(Us, Event, Counts);
traced(_Fact, Counts) ->
    Counts.

messages(Us, {sent, {_, _, Seq}, To, _, _}, #counts{open = Open} = Counts) ->
    Sent = count(messages_sent, length(To), Counts),
    case map_size(Open) < ?MOST_OPEN of
        true -> Sent#counts{open = Open#{Seq => {Us, 0}}};
        false -> Sent
    end;
messages(Us, {outcome, {_, _, Seq}, _, How}, #counts{open = Open} = Counts) ->
    Counted = count({messages_ended, outcome, How}, 1, Counts#counts{open = maps:remove(Seq, Open)}),
    case {How, Open} of
        {acknowledged, #{Seq := {Sent, _}}} -> observed(Us - Sent, Counted);
        _ -> Counted
    end;
messages(_Us, {delivered, _, _, _}, Counts) ->
    count(messages_delivered, 1, Counts);
messages(_Us, {overload, _}, Counts) ->
    count(messages_refused, 1, Counts);
messages(_Us, {dropped, Why, _}, Counts) ->
    count({packets_dropped, reason, Why}, 1, Counts);
messages(_Us, {started, _}, Counts) ->
    %% messages of an earlier life have no outcome any more
    Counts#counts{open = #{}};
messages(_Us, _Event, Counts) ->
    Counts.

%% @doc Counts a packet that the robot sends.
-spec transmits(starl:robot_id() | all, starl_packet:t(), t()) -> t().
transmits(_To, {starl, _, data, {_, _, Seq, _, _, _, _}}, #counts{open = Open} = Counts) ->
    Sent = count({packets_sent, kind, data}, 1, Counts),
    case Open of
        #{Seq := {Us, 0}} ->
            Sent#counts{open = Open#{Seq := {Us, 1}}};
        #{Seq := {Us, N}} ->
            Again = Sent#counts{open = Open#{Seq := {Us, N + 1}}},
            count(retransmissions, 1, Again);
        #{} ->
            Sent
    end;
transmits(_To, Packet, Counts) ->
    count({packets_sent, kind, element(3, Packet)}, 1, Counts).

%% @doc Counts a packet that the robot sends by this time (us) or not at all. A datagram (`shout')
%% has such a time only from a lease.
-spec sent_until(integer(), starl_packet:t(), t()) -> t().
sent_until(Us, {starl, _, shout, _, Type, _}, Counts) -> leased({type, Type}, Us, Counts);
sent_until(_Us, _Packet, Counts) -> Counts.

leased(Lease, Us, #counts{leases = Leases} = Counts) ->
    Counts#counts{leases = Leases#{Lease => Us}}.

count(Counter, N, #counts{counters = Counters} = Counts) ->
    Counts#counts{counters = maps:update_with(Counter, fun(Old) -> Old + N end, N, Counters)}.

observed(Us, #counts{buckets = Buckets, sum_us = Sum, count = Count} = Counts) ->
    Bucket = bucket(Us, ?BOUNDS_MS),
    Counts#counts{
        buckets = maps:update_with(Bucket, fun(N) -> N + 1 end, 1, Buckets),
        sum_us = Sum + max(0, Us),
        count = Count + 1
    }.

bucket(Us, [Ms | _]) when Us =< Ms * 1000 -> Ms;
bucket(Us, [_ | Bounds]) -> bucket(Us, Bounds);
bucket(_Us, []) -> infinity.

%% @doc The gauges of the time that is left, at this time (us), of leases that have not ended.
-spec leases(NowUs :: integer(), t()) -> [gauge()].
leases(Now, #counts{leases = Leases}) ->
    [
        {lease_seconds, [Of], (Until - Now) / 1.0e6}
     || {Of, Until} <- lists:sort(maps:to_list(Leases)), Until > Now
    ].

%% @doc The gauges of what the transport knows of the other robots.
-spec peers([starl_live_peers:peer()]) -> [gauge()].
peers([]) ->
    [];
peers(Peers) ->
    Heard = [Robot || #{robot := Robot, is_silent := false, heard_ms := Ms} <- Peers, Ms =/= never],
    Trips = [Us || #{round_trip_us := Us, is_silent := false} <- Peers],
    [{peers, [], length(Peers)}, {peers_heard, [], length(Heard)}] ++
        [{round_trip_seconds, [], lists:max(Trips) / 1.0e6} || Trips =/= []].

%% @doc The gauges of what a chassis reports of itself.
-spec chassis(map()) -> [gauge()].
chassis(Condition) ->
    [{battery_percent, [], Charge} || #{charge := Charge} <- [Condition], is_integer(Charge)].

%% @doc All counters and some gauges, in the text format of Prometheus 0.0.4.
-spec text([gauge()], t()) -> iolist().
text(Gauges, #counts{counters = Counters} = Counts) ->
    Lines = [{name(Counter), labels(Counter), N} || {Counter, N} <- maps:to_list(Counters)],
    [
        families("counter", "_total", Lines),
        families("gauge", "", [{Name, Labels, N} || {Name, Labels, N} <- Gauges]),
        histogram(Counts)
    ].

name({Name, _, _}) -> Name;
name(Name) -> Name.

labels({_, Label, Value}) -> [{Label, Value}];
labels(_) -> [].

families(Type, Suffix, Lines) ->
    Names = lists:usort([Name || {Name, _, _} <- Lines]),
    [
        [
            io_lib:format("# TYPE starl_~ts~ts ~ts~n", [Name, Suffix, Type])
            | [
                io_lib:format("starl_~ts~ts~ts ~tp~n", [Name, Suffix, shown(Labels), N])
             || {N0, Labels, N} <- lists:sort(Lines), N0 =:= Name
            ]
        ]
     || Name <- Names
    ].

shown([]) ->
    "";
shown(Labels) ->
    ["{", lists:join(",", [[atom_to_list(L), "=\"", text_of(V), "\""] || {L, V} <- Labels]), "}"].

%% Quotes and backslashes of a value have a meaning.
text_of(Value) ->
    re:replace(io_lib:format("~0tp", [Value]), "[\"\\\\]", "\\\\&", [global, unicode]).

histogram(#counts{buckets = Buckets, sum_us = Sum, count = Count}) ->
    {Lines, _} = lists:mapfoldl(
        fun(Ms, Before) ->
            Upto = Before + maps:get(Ms, Buckets, 0),
            {io_lib:format("starl_message_seconds_bucket{le=\"~w\"} ~b~n", [Ms / 1000, Upto]), Upto}
        end,
        0,
        ?BOUNDS_MS
    ),
    [
        "# TYPE starl_message_seconds histogram\n",
        Lines,
        io_lib:format("starl_message_seconds_bucket{le=\"+Inf\"} ~b~n", [Count]),
        io_lib:format("starl_message_seconds_sum ~w~n", [Sum / 1.0e6]),
        io_lib:format("starl_message_seconds_count ~b~n", [Count])
    ].
