%% @doc Hostile datagrams for a robot's end by UDP: as many as wanted, of every kind, from a seed. A
%% pure module but for the clock and the nonces of what it seals.
%%
%% Outsiders are anybody with a radio; insiders have the fleet's key. The transport takes none of
%% these. It does take `absurd' ones ({@link starl_dev_hostile_absurd}): they are sealed rightly and well
%% formed, and the robot's machines have to bear them.
-module(starl_dev_hostile_packets).

-export([outsiders/0, insiders/0, mark/0, new/1, pool/1, renewed/1, next/1, genuine/3]).

-export_type([t/0, config/0, kind/0]).

-type kind() :: atom().

%% `line': what a robot's end is opened with: fleet, run and key; `robot': the one that gets the
%% datagrams, in the name of the others of the team; `lives': the numbers of their programs' lives, which
%% anybody can read who hears them (0).
-type config() :: #{
    line := #{
        fleet := unicode:chardata(),
        run := non_neg_integer(),
        key := starl_live_key:t(),
        atom() => term()
    },
    robot := starl:robot_id(),
    participants := [starl:robot_id(), ...],
    lives => #{starl:robot_id() => starl_live_seal:life()},
    kinds := [kind(), ...],
    seed := integer()
}.

-record(packets, {
    config :: config(),
    kinds :: tuple(),
    speakers :: tuple(),
    seals :: #{starl:robot_id() | atom() => starl_live_seal:t()},
    bomb :: binary(),
    %% genuine datagrams, that are changed, and played again
    pool :: tuple(),
    random :: rand:state()
}).

-opaque t() :: #packets{}.

%% Tags of external terms.
-define(TAGS,
    {70, 77, 80, 97, 98, 100, 103, 104, 105, 106, 107, 108, 109, 110, 111, 116, 118, 119, 131}
).
-define(POOL, 50).
%% The type of the genuine datagrams: nobody listens to it.
-define(MARK, {app, ?MODULE}).

%% @doc The kinds of datagrams of anybody with a radio.
-spec outsiders() -> [kind()].
outsiders() ->
    [noise, framed, truncated, flipped, lengthened, replayed, wrong_key, other_run, other_fleet].

%% @doc The kinds of datagrams of a robot that has the right key, and that are refused all the same.
-spec insiders() -> [kind()].
insiders() ->
    [
        absurd_time,
        stranger,
        for_others,
        impostor,
        payload,
        terms,
        bomb,
        nested_bomb,
        atoms,
        pids,
        malformed,
        fragments
    ].

%% @doc The type of the packets in all datagrams that must be refused, and in the pool.
-spec mark() -> starl_packet:type().
mark() -> ?MARK.

%% @doc Datagrams for a robot of a team.
-spec new(config()) -> t().
new(#{robot := Robot, participants := Team, kinds := Kinds, seed := Seed} = Config) ->
    Speakers = [R || R <- Team, R =/= Robot],
    [Speaker | _] = Speakers,
    Others = [
        {wrong_key, Speaker, #{key => fun() -> <<8:256>> end}},
        {other_run, Speaker, #{run => 2}},
        {other_fleet, Speaker, #{fleet => "others"}}
    ],
    Own = [{R, R, #{}} || R <- Speakers],
    Seals = [{Key, seal(R, More, Config)} || {Key, R, More} <- Others ++ Own],
    renewed(#packets{
        config = Config,
        kinds = list_to_tuple(Kinds),
        speakers = list_to_tuple(Speakers),
        seals = maps:from_list(Seals),
        %% ten megabytes, or as much of them as one datagram holds
        bomb = term_to_binary(lists:duplicate(100_000, 0), [{compressed, 9}]),
        pool = {},
        random = rand:seed_s(exsss, Seed)
    }).

seal(Robot, More, #{line := Line, participants := Team} = Given) ->
    Life = maps:get(Robot, maps:get(lives, Given, #{}), 0),
    Config = maps:merge(Line#{robot => Robot, participants => Team, life => Life}, More),
    {ok, Seal} = starl_live_seal:new(Config, 0),
    Seal.

%% @doc The genuine datagrams.
-spec pool(t()) -> [binary()].
pool(#packets{pool = Pool}) -> tuple_to_list(Pool).

%% @doc Another pool: the datagrams of the last one are stale after some seconds.
-spec renewed(t()) -> t().
renewed(#packets{} = Packets) ->
    New = [sealed(Speaker, all, packet(Speaker, N), Packets) || {Speaker, N} <- drawn(Packets)],
    Packets#packets{pool = list_to_tuple(New)}.

drawn(#packets{speakers = Speakers}) ->
    [{element(1 + N rem tuple_size(Speakers), Speakers), N} || N <- lists:seq(1, ?POOL)].

%% @doc A genuine datagram from one robot of the team to another.
-spec genuine(starl:robot_id(), starl_packet:t(), t()) -> binary().
genuine(Speaker, Packet, #packets{config = #{robot := Robot}} = Packets) ->
    sealed(Speaker, Robot, encoded(Packet), Packets).

%% @doc The next datagram, and its kind.
-spec next(t()) -> {kind(), binary(), t()}.
next(#packets{kinds = Kinds, random = Random0} = Packets) ->
    {Kind, Random1} = one_of(Kinds, Random0),
    {Datagram, Random} = datagram(Kind, Packets, Random1),
    {Kind, Datagram, Packets#packets{random = Random}}.

one_of(Tuple, Random0) ->
    {Which, Random} = rand:uniform_s(tuple_size(Tuple), Random0),
    {element(Which, Tuple), Random}.

%% -- of anybody -----------------------------------------------------------------------------

datagram(noise, _Packets, Random0) ->
    {Size, Random} = rand:uniform_s(1500, Random0),
    rand:bytes_s(Size, Random);
datagram(Changed, Packets, Random0) when
    Changed =:= framed; Changed =:= truncated; Changed =:= flipped; Changed =:= lengthened
->
    {Known, Random} = known(Packets, Random0),
    changed(Changed, Known, Random);
datagram(replayed, Packets, Random) ->
    known(Packets, Random);
datagram(Other, Packets, Random) when
    Other =:= wrong_key; Other =:= other_run; Other =:= other_fleet
->
    Bytes = packet(element(1, Packets#packets.speakers), 1),
    {sealed(Other, robot(Packets), Bytes, Packets), Random};
datagram(Kind, Packets, Random) ->
    with_key(Kind, Packets, Random).

%% A genuine datagram, changed.
changed(framed, Known, Random0) ->
    {Keep, Random1} = rand:uniform_s(60, Random0),
    {Noise, Random} = rand:bytes_s(byte_size(Known) - Keep, Random1),
    {<<(binary:part(Known, 0, Keep))/binary, Noise/binary>>, Random};
changed(truncated, Known, Random0) ->
    {Size, Random} = rand:uniform_s(byte_size(Known), Random0),
    {binary:part(Known, 0, Size - 1), Random};
changed(flipped, Known, Random0) ->
    {Bit, Random} = rand:uniform_s(bit_size(Known), Random0),
    Before = Bit - 1,
    <<Start:Before/bits, One:1, End/bits>> = Known,
    {<<Start/bits, (1 - One):1, End/bits>>, Random};
changed(lengthened, Known, Random0) ->
    {Noise, Random} = rand:bytes_s(9, Random0),
    {<<Known/binary, Noise/binary>>, Random}.

%% With the right key, and a wrong sender, receiver or time.
with_key(absurd_time, #packets{seals = Seals} = Packets, Random0) ->
    {Speaker, Random1} = speaker(Packets, Random0),
    {Far, Random} = rand:uniform_s(1 bsl 60, Random1),
    Then = erlang:system_time(millisecond) + 100_000_000 + Far,
    Payload = [0, packet(Speaker, 1)],
    #{Speaker := Seal} = Seals,
    {iolist_to_binary(starl_live_seal:seal(robot(Packets), Payload, Then, Seal)), Random};
with_key(stranger, #packets{config = #{participants := Team} = Config}, Random0) ->
    {N, Random} = rand:uniform_s(1 bsl 31, Random0),
    Stranger = lists:max(Team) + N,
    {with(seal(Stranger, #{}, Config), all, [0, packet(Stranger, 1)]), Random};
with_key(for_others, #packets{config = #{participants := Team}} = Packets, Random0) ->
    {Speaker, Random1} = speaker(Packets, Random0),
    {N, Random} = rand:uniform_s(1 bsl 31, Random1),
    {sealed(Speaker, lists:max(Team) + N, packet(Speaker, 1), Packets), Random};
with_key(impostor, Packets, Random0) ->
    {Speaker, Random} = speaker(Packets, Random0),
    {payload(Speaker, [0, packet(robot(Packets), 1)], Packets), Random};
with_key(payload, Packets, Random0) ->
    {Size, Random1} = rand:uniform_s(1000, Random0),
    {<<Kind, Noise/binary>>, Random} = rand:bytes_s(Size, Random1),
    {payload([Kind bor 2, Noise], Packets), Random};
with_key(Kind, Packets, Random) ->
    contents(Kind, Packets, Random).

%% From a robot of the team, which holds no packet.
contents(terms, Packets, Random0) ->
    %% external terms at random: tags that are known, then noise
    {Tag, Random1} = one_of(?TAGS, Random0),
    {Size, Random2} = rand:uniform_s(200, Random1),
    {Noise, Random} = rand:bytes_s(Size, Random2),
    {payload([0, 1, 131, Tag, Noise], Packets), Random};
contents(bomb, #packets{bomb = Bomb} = Packets, Random) ->
    {payload([0, 1, Bomb], Packets), Random};
contents(nested_bomb, #packets{bomb = <<131, Inner/binary>>} = Packets, Random) ->
    {payload([0, 1, 131, 104, 1, Inner], Packets), Random};
contents(atoms, Packets, Random0) ->
    {Noise, Random} = rand:bytes_s(20, Random0),
    Name = binary:encode_hex(Noise),
    {payload([0, 1, around([119, byte_size(Name), Name], Packets)], Packets), Random};
contents(pids, Packets, Random) ->
    <<131, Pid/binary>> = term_to_binary(self()),
    {payload([0, 1, around(Pid, Packets)], Packets), Random};
contents(malformed, Packets, Random0) ->
    {N, Random} = rand:uniform_s(1 bsl 62, Random0),
    Term = starl_dev_hostile_absurd:malformed(first(Packets), N),
    {payload([0, 1, term_to_binary(Term, [{minor_version, 2}])], Packets), Random};
contents(fragments, Packets, Random) ->
    fragments(Packets, Random);
contents(Kind, Packets, Random) ->
    taken(Kind, Packets, Random).

fragments(Packets, Random0) ->
    {Fields, Random1} = rand:bytes_s(10, Random0),
    {Size, Random2} = rand:uniform_s(1123, Random1),
    {Noise, Random} = rand:bytes_s(Size, Random2),
    {payload([1, Fields, Noise], Packets), Random}.

%% That the transport takes.
taken(absurd, Packets, Random0) ->
    {Speaker, Random1} = speaker(Packets, Random0),
    {Packet, Random} = starl_dev_hostile_absurd:packet(Speaker, robot(Packets), Random1),
    {sealed(Speaker, robot(Packets), encoded(Packet), Packets), Random};
taken(shaped, Packets, Random0) ->
    {Speaker, Random1} = speaker(Packets, Random0),
    {Packet, Random} = starl_dev_hostile_absurd:shaped(Speaker, Random1),
    {sealed(Speaker, robot(Packets), encoded(Packet), Packets), Random}.

known(#packets{pool = Pool}, Random) -> one_of(Pool, Random).

speaker(#packets{speakers = Speakers}, Random) -> one_of(Speakers, Random).

robot(#packets{config = #{robot := Robot}}) -> Robot.

first(#packets{speakers = Speakers}) -> element(1, Speakers).

%% -- parts ----------------------------------------------------------------------------------

packet(Robot, N) -> encoded(starl_packet:shout(Robot, ?MARK, {N, <<"body">>, [1.5]})).

encoded(Packet) ->
    {ok, Bytes} = starl_live_codec:encode(Packet),
    Bytes.

%% A packet around a term that is given as bytes.
around(Term, Packets) ->
    Shout = starl_packet:shout(first(Packets), ?MARK, []),
    <<131, Bytes/binary>> = term_to_binary(Shout, [{minor_version, 2}]),
    [131, binary:part(Bytes, 0, byte_size(Bytes) - 1), Term].

payload(Payload, Packets) -> payload(first(Packets), Payload, Packets).

payload(Speaker, Payload, #packets{seals = Seals} = Packets) ->
    with(maps:get(Speaker, Seals), robot(Packets), Payload).

sealed(Who, To, Bytes, #packets{seals = Seals}) -> with(maps:get(Who, Seals), To, [0, Bytes]).

with(Seal, To, Payload) ->
    iolist_to_binary(starl_live_seal:seal(To, Payload, erlang:system_time(millisecond), Seal)).
