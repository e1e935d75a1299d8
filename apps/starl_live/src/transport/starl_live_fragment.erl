%% @doc Cuts messages that do not fit into one datagram into fragments, and reassembles them.
%%
%% ```
%%   0 | message                                            the whole message
%%   1 | digest 8 | fragments 1 | number 1 | part           a fragment, numbered from 0
%% '''
%% Fragments are recognized by the digest of their message. So a retransmission of the same message
%% fills the gaps that loss has left in the first transmission, and a message of many fragments
%% arrives after a few of them. All fragments but the last are of the same length.
%%
%% Memory is bounded: a few unfinished messages of each robot, and of all robots; the oldest is
%% dropped for a new one. Time is bounded, too.
-module(starl_live_fragment).

-export([split/2, new/1, join/4]).

-export_type([t/0, refusal/0]).

-define(WHOLE, 0).
-define(PART, 1).
-define(HEADER, 11).
%% The most bytes of a message: those of the codec.
-define(LARGEST, (starl_payload:most_bytes(packet) + 1)).
%% The most unfinished messages of one robot, and of all.
-define(OF_ONE, 8).
-define(OF_ALL, 64).
%% How long an unfinished message waits for its next fragment: longer than SAP's longest back-off.
-define(WAIT_MS, 10_000).

%% Why a fragment is refused: its header cannot be true, or the message is not that of its digest.
-type refusal() :: fragment | digest.

-record(unfinished, {
    count :: pos_integer(),
    heard_ms :: integer(),
    parts = #{} :: #{Number :: non_neg_integer() => binary()}
}).

-type key() :: {From :: starl:robot_id(), Digest :: binary()}.

-record(fragments, {
    %% the length of all parts but the last
    length :: pos_integer(),
    unfinished = #{} :: #{key() => #unfinished{}}
}).

-opaque t() :: #fragments{}.

%% @doc A message as one or more payloads of at most `Room' bytes.
-spec split(Room :: pos_integer(), Message :: binary()) -> [iodata(), ...].
split(Room, Message) when byte_size(Message) < Room ->
    [[?WHOLE, Message]];
split(Room, Message) ->
    Length = Room - ?HEADER,
    Count = count(byte_size(Message), Length),
    Digest = digest(Message),
    [
        [?PART, Digest, Count, N, part(N, Length, Message)]
     || N <- lists:seq(0, Count - 1)
    ].

count(Size, Length) -> (Size + Length - 1) div Length.

part(N, Length, Message) ->
    binary:part(Message, N * Length, min(Length, byte_size(Message) - N * Length)).

digest(Message) ->
    <<Digest:8/binary, _/binary>> = crypto:hash(sha256, Message),
    Digest.

%% @doc No unfinished messages; payloads are of at most `Room' bytes.
-spec new(Room :: pos_integer()) -> t().
new(Room) -> #fragments{length = Room - ?HEADER}.

%% @doc Takes a payload of a robot. `more': the message is not complete yet.
-spec join(From :: starl:robot_id(), Payload :: binary(), NowMs :: integer(), t()) ->
    {whole, Message :: binary(), t()} | {more, t()} | {error, refusal(), t()}.
join(_From, <<?WHOLE, Message/binary>>, _Now, Fragments) ->
    {whole, Message, Fragments};
join(From, <<?PART, Digest:8/binary, Count, N, Part/binary>>, Now, Fragments) ->
    case possible(Count, N, byte_size(Part), Fragments#fragments.length) of
        true -> add({From, Digest}, Count, N, Part, Now, Fragments);
        false -> {error, fragment, Fragments}
    end;
join(_From, _Payload, _Now, Fragments) ->
    {error, fragment, Fragments}.

possible(Count, N, Size, Length) when N < Count - 1 ->
    Size =:= Length andalso Count =< count(?LARGEST, Length);
possible(Count, N, Size, Length) when Count > 1, N =:= Count - 1 ->
    Size > 0 andalso Size =< Length andalso Count =< count(?LARGEST, Length);
possible(_Count, _N, _Size, _Length) ->
    false.

add({From, _} = Key, Count, N, Part, Now, #fragments{unfinished = Unfinished} = Fragments) ->
    case Unfinished of
        #{Key := #unfinished{count = Count, parts = Parts} = Message} ->
            More = Message#unfinished{heard_ms = Now, parts = Parts#{N => Part}},
            added(Key, More, Fragments);
        #{Key := #unfinished{}} ->
            {error, fragment, Fragments};
        #{} ->
            Room = make_room(From, Now, Unfinished),
            Message = #unfinished{count = Count, heard_ms = Now, parts = #{N => Part}},
            added(Key, Message, Fragments#fragments{unfinished = Room})
    end.

added(Key, #unfinished{count = Count, parts = Parts} = Message, Fragments) when
    map_size(Parts) < Count
->
    Unfinished = (Fragments#fragments.unfinished)#{Key => Message},
    {more, Fragments#fragments{unfinished = Unfinished}};
added({_, Digest} = Key, #unfinished{count = Count, parts = Parts}, Fragments) ->
    Left = Fragments#fragments{unfinished = maps:remove(Key, Fragments#fragments.unfinished)},
    Message = iolist_to_binary([maps:get(N, Parts) || N <- lists:seq(0, Count - 1)]),
    case digest(Message) of
        Digest -> {whole, Message, Left};
        _ -> {error, digest, Left}
    end.

%% Room for one more message of a robot.
make_room(From, Now, Unfinished) ->
    Waiting = maps:filter(
        fun(_, #unfinished{heard_ms = Heard}) -> Now - Heard =< ?WAIT_MS end, Unfinished
    ),
    Own = maps:filter(fun({Robot, _}, _) -> Robot =:= From end, Waiting),
    if
        map_size(Own) >= ?OF_ONE -> maps:remove(oldest(Own), Waiting);
        map_size(Waiting) >= ?OF_ALL -> maps:remove(oldest(Waiting), Waiting);
        true -> Waiting
    end.

oldest(Unfinished) ->
    {_, Key} = lists:min([
        {Heard, Key}
     || {Key, #unfinished{heard_ms = Heard}} <- maps:to_list(Unfinished)
    ]),
    Key.
