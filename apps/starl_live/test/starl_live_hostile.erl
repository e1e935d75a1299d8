%% Hostile datagrams for a robot's end by UDP: as many as wanted, of every kind, from a seed. None is
%% to be taken; atoms and memory stay bounded, and other robots are heard as before.
%%
%% A million, of all kinds, from a shell of the tests: `starl_live_hostile:flood(1_000_000, 1)'.
-module(starl_live_hostile).

-export([flood/2, flood/3, outsiders/0, insiders/0]).

%% Of anybody with a radio; of a robot of the fleet that has the right key.
outsiders() ->
    [noise, framed, truncated, flipped, lengthened, replayed, wrong_key, other_run, other_fleet].

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

flood(Number, Seed) -> flood(outsiders() ++ insiders(), Number, Seed).

%% What came of so many: the packets taken, the new atoms, the words of the state before and after,
%% the counters, and whether another packet is still heard from each robot.
flood(Kinds, Number, Seed) ->
    {ok, Opened} = starl_live_udp:open(config(2, port(), #{})),
    Pool = [sealed(1, all, packet(N), #{}) || N <- lists:seq(1, 50)],
    Heard = lists:foldl(fun(Datagram, Udp) -> element(2, hear(Datagram, Udp)) end, Opened, Pool),
    Context = #{kinds => list_to_tuple(Kinds), pool => list_to_tuple(Pool)},
    %% All code is loaded.
    {_, Known} = flooded(20 * length(Kinds), Context, rand:seed_s(exsss, Seed + 1), Heard),
    Atoms = erlang:system_info(atom_count),
    {Taken, Last} = flooded(Number, Context, rand:seed_s(exsss, Seed), Known),
    Report = #{
        taken => Taken,
        atoms => erlang:system_info(atom_count) - Atoms,
        words => {words(Known), words(Last)},
        figures => starl_live_udp:figures(Last),
        still_heard => [R || R <- [1, 3], {[_], _} <- [hear(sealed(R, 2, shout(R), #{}), Last)]]
    },
    ok = starl_live_udp:close(Last),
    Report.

%% Without the counters: one that was never needed before takes some words too.
words(Udp) -> erts_debug:flat_size(Udp) - erts_debug:flat_size(starl_live_udp:figures(Udp)).

flooded(Number, Context, Random, Udp) -> flooded(Number, Context, Random, [], Udp).

flooded(0, _Context, _Random, Taken, Udp) ->
    {Taken, Udp};
flooded(Number, #{kinds := Kinds} = Context, Random0, Taken, Udp) ->
    {Which, Random1} = rand:uniform_s(tuple_size(Kinds), Random0),
    Kind = element(Which, Kinds),
    {Datagram, Random} = datagram(Kind, Context, Random1),
    {Packets, Next} = hear(Datagram, Udp),
    flooded(Number - 1, Context, Random, [{Kind, P} || P <- Packets] ++ Taken, Next).

hear(Datagram, Udp) -> starl_live_udp:hear({udp, none, {127, 0, 0, 1}, 1, Datagram}, Udp).

%% -- of anybody -----------------------------------------------------------------------------

datagram(noise, _Context, Random0) ->
    {Size, Random} = rand:uniform_s(1500, Random0),
    rand:bytes_s(Size, Random);
datagram(framed, Context, Random0) ->
    {Known, Random1} = known(Context, Random0),
    {Keep, Random2} = rand:uniform_s(60, Random1),
    {Noise, Random} = rand:bytes_s(byte_size(Known) - Keep, Random2),
    {<<(binary:part(Known, 0, Keep))/binary, Noise/binary>>, Random};
datagram(truncated, Context, Random0) ->
    {Known, Random1} = known(Context, Random0),
    {Size, Random} = rand:uniform_s(byte_size(Known), Random1),
    {binary:part(Known, 0, Size - 1), Random};
datagram(flipped, Context, Random0) ->
    {Known, Random1} = known(Context, Random0),
    {Bit, Random} = rand:uniform_s(bit_size(Known), Random1),
    Before = Bit - 1,
    <<Start:Before/bits, One:1, End/bits>> = Known,
    {<<Start/bits, (1 - One):1, End/bits>>, Random};
datagram(lengthened, Context, Random0) ->
    {Known, Random1} = known(Context, Random0),
    {Noise, Random} = rand:bytes_s(9, Random1),
    {<<Known/binary, Noise/binary>>, Random};
datagram(replayed, Context, Random) ->
    known(Context, Random);
datagram(wrong_key, _Context, Random) ->
    {sealed(1, 2, packet(1), #{key => fun() -> <<8:256>> end}), Random};
datagram(other_run, _Context, Random) ->
    {sealed(1, 2, packet(1), #{run => 2}), Random};
datagram(other_fleet, _Context, Random) ->
    {sealed(1, 2, packet(1), #{fleet => "others"}), Random};
%% -- with the right key ---------------------------------------------------------------------
datagram(absurd_time, _Context, Random0) ->
    {Far, Random} = rand:uniform_s(1 bsl 60, Random0),
    Now = erlang:system_time(millisecond) + 1_000_000 + Far,
    {iolist_to_binary(starl_live_seal:seal(2, [0, packet(1)], Now, seal(1, #{}))), Random};
datagram(stranger, _Context, Random0) ->
    {Robot, Random} = rand:uniform_s(1 bsl 31, Random0),
    {sealed(3 + Robot, all, packet(1), #{}), Random};
datagram(for_others, _Context, Random0) ->
    {Robot, Random} = rand:uniform_s(1 bsl 31, Random0),
    {sealed(1, 2 + Robot, packet(1), #{}), Random};
datagram(impostor, _Context, Random) ->
    {sealed(3, 2, packet(1), #{}), Random};
datagram(payload, _Context, Random0) ->
    {Size, Random1} = rand:uniform_s(1000, Random0),
    {<<Kind, Noise/binary>>, Random} = rand:bytes_s(Size, Random1),
    {payload([Kind bor 2, Noise]), Random};
%% External terms at random: tags that are known, then noise.
datagram(terms, _Context, Random0) ->
    Tags =
        {70, 77, 80, 97, 98, 100, 103, 104, 105, 106, 107, 108, 109, 110, 111, 116, 118, 119, 131},
    {Which, Random1} = rand:uniform_s(tuple_size(Tags), Random0),
    {Size, Random2} = rand:uniform_s(200, Random1),
    {Noise, Random} = rand:bytes_s(Size, Random2),
    {payload([0, 1, 131, element(Which, Tags), Noise]), Random};
datagram(bomb, _Context, Random) ->
    {payload([0, 1, bomb()]), Random};
datagram(nested_bomb, _Context, Random) ->
    <<131, Inner/binary>> = bomb(),
    {payload([0, 1, 131, 104, 1, Inner]), Random};
datagram(atoms, _Context, Random0) ->
    {Noise, Random} = rand:bytes_s(20, Random0),
    Name = binary:encode_hex(Noise),
    {payload([0, 1, around([119, byte_size(Name), Name])]), Random};
datagram(pids, _Context, Random) ->
    <<131, Pid/binary>> = term_to_binary(self()),
    {payload([0, 1, around(Pid)]), Random};
datagram(malformed, _Context, Random0) ->
    {Number, Random} = rand:uniform_s(1 bsl 62, Random0),
    Terms = {
        {starl, 1, hello, 1, -Number},
        {starl, 1, hello, 1, Number bsl 100},
        {starl, 1, hello, 1, 1 bsl 58},
        {starl, 2, hello, 1, 1},
        {starl, 1, data, {1, 1, 1, 1, [], app, x}},
        {starl, 1, data, {1, 1, 1, {all, 0}, #{}, app, x}},
        {starl, 1, told, 1, 1, 1, {1, x}},
        #{starl => Number}
    },
    {
        payload([0, 1, term_to_binary(element(1 + Number rem 8, Terms), [{minor_version, 2}])]),
        Random
    };
datagram(fragments, _Context, Random0) ->
    {Fields, Random1} = rand:bytes_s(10, Random0),
    {Size, Random2} = rand:uniform_s(1131, Random1),
    {Noise, Random} = rand:bytes_s(Size, Random2),
    {payload([1, Fields, Noise]), Random}.

known(#{pool := Pool}, Random0) ->
    {Which, Random} = rand:uniform_s(tuple_size(Pool), Random0),
    {element(Which, Pool), Random}.

%% -- parts ----------------------------------------------------------------------------------

%% Ten megabytes in ten kilobytes, or as much of them as one datagram holds.
bomb() ->
    case get(?MODULE) of
        undefined ->
            Bomb = term_to_binary(lists:duplicate(100_000, 0), [{compressed, 9}]),
            _ = put(?MODULE, Bomb),
            Bomb;
        Bomb ->
            Bomb
    end.

packet(N) ->
    {ok, Bytes} = starl_live_codec:encode(starl_packet:shout(1, dpp, {N, <<"body">>, [1.5]})),
    Bytes.

shout(Robot) ->
    {ok, Bytes} = starl_live_codec:encode(starl_packet:shout(Robot, dpp, still)),
    Bytes.

%% A packet around a term that is given as bytes.
around(Term) ->
    <<131, Bytes/binary>> = term_to_binary(starl_packet:shout(1, dpp, dpp), [{minor_version, 2}]),
    Size = byte_size(Bytes) - 5,
    [131, binary:part(Bytes, 0, Size), Term].

payload(Payload) ->
    Now = erlang:system_time(millisecond),
    iolist_to_binary(starl_live_seal:seal(2, Payload, Now, seal(1, #{}))).

sealed(Robot, To, Bytes, More) ->
    Now = erlang:system_time(millisecond),
    iolist_to_binary(starl_live_seal:seal(To, [0, Bytes], Now, seal(Robot, More))).

seal(Robot, More) ->
    case get({seal, Robot, More}) of
        undefined ->
            {ok, Seal} = starl_live_seal:new(config(Robot, 1, More), 0),
            _ = is_small(Robot) andalso put({seal, Robot, More}, Seal),
            Seal;
        Seal ->
            Seal
    end.

is_small(Robot) -> Robot < 4.

config(Robot, Port, More) ->
    Config = #{
        robot => Robot,
        participants => [1, 2, 3],
        key => key(),
        fleet => "tests",
        run => 1,
        %% hours: what is replayed is refused because it was heard, not for its age
        fresh_ms => 10_000_000,
        peers => maps:from_list([{R, {{127, 0, 0, 1}, Port}} || R <- [1, 2, 3]])
    },
    maps:merge(Config, More).

key() -> fun() -> <<7:256>> end.

port() ->
    {ok, Socket} = gen_udp:open(0, []),
    {ok, Port} = inet:port(Socket),
    ok = gen_udp:close(Socket),
    Port.
