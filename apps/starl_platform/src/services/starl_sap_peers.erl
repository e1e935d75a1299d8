%% @doc What a robot knows of the sources of messages: the incarnation of each, and which of its
%% sequence numbers have been taken. Pure; the part of {@link starl_sap} that "at most once" rests
%% on.
%%
%% The numbers are kept from the source's own low mark on, below which nothing comes any more: so
%% they are no more than the messages under way.
-module(starl_sap_peers).

-export([new/0, incarnation/2, later/2, heard/3, take/4]).

-export_type([t/0]).

%% The incarnation, the lowest sequence number that may still come, and those taken from there on,
%% ascending.
-record(peer, {
    incarnation = 1 :: starl_packet:incarnation(),
    low = 1 :: starl_packet:seq(),
    seen = [] :: [starl_packet:seq()]
}).

-opaque t() :: #{starl:robot_id() => #peer{}}.

%% @doc Nobody has been heard yet.
-spec new() -> t().
new() -> #{}.

%% @doc The latest incarnation of a robot that has been heard; 1 if none has.
-spec incarnation(starl:robot_id(), t()) -> starl_packet:incarnation().
incarnation(Robot, Peers) ->
    case Peers of
        #{Robot := #peer{incarnation = Incarnation}} -> Incarnation;
        #{} -> 1
    end.

%% @doc The incarnations of those of the robots that have restarted.
-spec later([starl:robot_id()], t()) -> #{starl:robot_id() => starl_packet:incarnation()}.
later([Robot], Peers) ->
    case Peers of
        #{Robot := #peer{incarnation = Incarnation}} when Incarnation > 1 ->
            #{Robot => Incarnation};
        #{} ->
            #{}
    end;
later(Robots, Peers) ->
    maps:from_list([
        {Robot, Incarnation}
     || Robot <- Robots, Incarnation <- [incarnation(Robot, Peers)], Incarnation > 1
    ]).

%% @doc Learns a robot's incarnation from any of its packets. What was taken of an earlier one
%% need not be known any more.
-spec heard(starl:robot_id(), starl_packet:incarnation(), t()) -> t().
heard(Robot, Incarnation, Peers) ->
    case incarnation(Robot, Peers) < Incarnation of
        true -> Peers#{Robot => #peer{incarnation = Incarnation}};
        false -> Peers
    end.

%% @doc Takes a message of the source's present incarnation, of which nothing below `Low' comes
%% any more, unless it has been taken before.
-spec take(starl:robot_id(), Low :: starl_packet:seq(), starl_packet:seq(), t()) ->
    {new | seen, t()}.
take(Source, Low, Seq, Peers) ->
    #peer{low = Lowest, seen = Seen} = Peer =
        forget_below(Low, maps:get(Source, Peers, #peer{})),
    case Seq < Lowest orelse lists:member(Seq, Seen) of
        true -> {seen, Peers#{Source => Peer}};
        false -> {new, Peers#{Source => Peer#peer{seen = lists:merge([Seq], Seen)}}}
    end.

%% The source waits for nothing below Low any more.
forget_below(Low, #peer{low = Known} = Peer) when Low =< Known -> Peer;
forget_below(Low, #peer{seen = Seen} = Peer) ->
    Peer#peer{low = Low, seen = lists:dropwhile(fun(Seq) -> Seq < Low end, Seen)}.
