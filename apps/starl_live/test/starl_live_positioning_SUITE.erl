%% Positioning of live robots: formats that come back as they were written, hostile datagrams, the
%% process over real sockets, and positioning together with the location service in virtual time.
-module(starl_live_positioning_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0, init_per_testcase/2, end_per_testcase/2]).
-export([
    broadcast_comes_back/1,
    vicon_comes_back/1,
    natnet_comes_back/1,
    hostile_broadcast/1,
    hostile_vicon/1,
    hostile_natnet/1,
    moments_13_hz/1,
    moments_frozen/1,
    moments_vicon_frozen/1,
    process_answers/1,
    process_hears_multicast/1,
    process_asks_natnet/1,
    process_says_silence/1,
    process_refuses/1
]).

%% The log, seen by the test.
-export([log/2]).

-define(HOSTILE, 100000).
%% 13 pictures a second.
-define(PICTURE_US, 77000).
%% A picture from which the source is stuck: one that is never lost, since nobody who has not seen it can
%% tell that those after it repeat it.
-define(STUCK_US, (261 * ?PICTURE_US)).
%% A message that comes at all comes sooner.
-define(LIMIT_MS, 30000).

all() ->
    [
        broadcast_comes_back,
        vicon_comes_back,
        natnet_comes_back,
        hostile_broadcast,
        hostile_vicon,
        hostile_natnet,
        moments_13_hz,
        moments_frozen,
        moments_vicon_frozen,
        process_answers,
        process_hears_multicast,
        process_asks_natnet,
        process_says_silence,
        process_refuses
    ].

init_per_testcase(process_says_silence = Case, Config) ->
    ok = logger:add_handler(Case, ?MODULE, #{config => #{to => self()}, level => warning}),
    Config;
init_per_testcase(_, Config) ->
    Config.

end_per_testcase(process_says_silence = Case, _Config) -> logger:remove_handler(Case);
end_per_testcase(_, _Config) -> ok.

log(#{msg := {report, Report}}, #{config := #{to := Pid}}) ->
    Pid ! {logged, Report},
    ok;
log(_, _) ->
    ok.

%% -- formats --------------------------------------------------------------------------------

%% To within half a unit, sealed or not, in as many datagrams as it takes.
broadcast_comes_back(_Config) ->
    holds(
        ?FORALL(
            {Number, Time, Places, Rounded, Sealed},
            {
                frame_number(),
                range(0, 1 bsl 62),
                list({coordinate(), coordinate(), heading()}),
                boolean(),
                boolean()
            },
            begin
                Poses = lists:zip(lists:seq(1, length(Places)), Places),
                Options = maps:merge(
                    #{run => 5, rounded => Rounded},
                    maps:from_list([{seal_key, starl_live_broadcast:seal_key(<<"k">>)} || Sealed])
                ),
                Contents = [
                    starl_live_broadcast:decode(D, Options)
                 || D <- starl_live_broadcast:encode(Number, Time, Poses, Options)
                ],
                Back = lists:append([P || {ok, #{poses := P}} <- Contents]),
                Heads = [{N, T} || {ok, #{number := N, time_us := T}} <- Contents],
                lists:usort(Heads) =:= [{Number, Time}] andalso
                    length(Back) =:= length(Poses) andalso
                    lists:all(
                        fun({A, B}) -> is_close(A, B, unit(Rounded)) end, lists:zip(Poses, Back)
                    )
            end
        )
    ).

unit(true) -> 0.5;
unit(false) -> 0.0005.

is_close({R, {X, Y, A}}, {R, {U, V, B}}, Mm) ->
    More = Mm * 1.000001,
    abs(X - U) =< More andalso abs(Y - V) =< More andalso abs(A - B) * 1000 =< More;
is_close(_, _, _) ->
    false.

vicon_comes_back(_Config) ->
    holds(
        ?FORALL(
            {Frame, Objects},
            {
                frame_number(),
                resize(12, list({name(), vector(), {euler, heading(), heading(), heading()}}))
            },
            begin
                Size = 5 + 75 * length(Objects) + 20,
                Seen = [O || {_, V, R} = O <- Objects, {V, R} =/= nowhere()],
                Datagram = starl_live_mocap_fake:vicon(Frame, Objects, Size),
                {ok, Back, Read} = starl_live_vicon:decode(Datagram),
                Back =:= Frame andalso [O || O <- Read, O =/= unseen] =:= Seen
            end
        )
    ).

nowhere() -> {{0.0, 0.0, 0.0}, {euler, 0.0, 0.0, 0.0}}.

%% In every version, among everything else; the numbers are of single precision.
natnet_comes_back(_Config) ->
    holds(
        ?FORALL(
            {Version, Number, Bodies, Clutter, Times},
            {
                oneof([{3, 0}, {3, 1}, {4, 0}, {4, 1}, {4, 3}]),
                range(-1 bsl 31, 1 bsl 31 - 1),
                resize(20, list({range(-5, 1000), vector(), quaternion(), boolean()})),
                range(0, 6),
                {range(0, 1 bsl 63), range(0, 1 bsl 63)}
            },
            begin
                Frame = #{number => Number, bodies => Bodies, clutter => Clutter, times => Times},
                Packet = starl_live_mocap_fake:frame(Version, Frame),
                {ok, {frame, Back}} = starl_live_natnet_codec:decode(Packet, Version),
                Expected = [expected(Body) || Body <- Bodies],
                Back =:= #{number => Number, times => Times, bodies => Expected}
            end
        )
    ).

expected({_, _, _, false}) ->
    unseen;
expected({Id, {X, Y, Z}, {quaternion, A, B, C, W}, true}) ->
    {Id, {single(X), single(Y), single(Z)},
        {quaternion, single(A), single(B), single(C), single(W)}}.

single(F) ->
    <<S:32/float>> = <<F:32/float>>,
    S.

frame_number() -> range(0, 16#FFFFFFFF).
coordinate() -> float(-1.0e6, 1.0e6).
heading() -> float(-3.14159, 3.14159).
vector() -> {coordinate(), coordinate(), coordinate()}.
quaternion() -> {quaternion, unit(), unit(), unit(), unit()}.
unit() -> float(-1.0, 1.0).
name() -> ?LET(N, resize(24, non_empty(list(range(1, 255)))), list_to_binary(N)).

holds(Property) -> starl_platform_ct:property(Property, 300).

%% -- hostile datagrams ----------------------------------------------------------------------

%% Random, truncated, with flipped bits, with counts that are too large: no crash, nothing is kept, no
%% atom is made; sealed, nothing but what was sealed is shown.
hostile_broadcast(_Config) ->
    Key = starl_live_broadcast:seal_key(<<"key">>),
    Poses = [{R, {1.0 * R, 2.0, 0.5}} || R <- [1, 2, 3]],
    Good = starl_live_broadcast:encode(5, 1000000, Poses, #{seal_key => Key}),
    Source = starl_live_broadcast:new((config())#{key => <<"key">>}),
    hostile(Good, Source, fun(Datagram, Arrived, S) ->
        {Shown, Next} = starl_live_broadcast:datagram(Datagram, 1000000 + Arrived div 100, S),
        ?assert(lists:member(Datagram, Good) orelse Shown =:= []),
        Next
    end),
    Open = starl_live_broadcast:new(config()),
    hostile(
        starl_live_broadcast:encode(5, 1000000, Poses, #{}), Open, fun(Datagram, Arrived, S) ->
            {Shown, Next} = starl_live_broadcast:datagram(Datagram, Arrived, S),
            all_sound(Shown),
            Next
        end
    ).

hostile_vicon(_Config) ->
    Objects = [{<<"a">>, {1.0, 2.0, 3.0}, {euler, 0.0, 0.0, 1.0}} || _ <- [1, 2, 3]],
    Source = starl_live_vicon:new((config())#{names => #{<<"a">> => 1}}),
    Good = [starl_live_mocap_fake:vicon(7, Objects, 256)],
    hostile(Good, Source, fun(Datagram, Arrived, S) ->
        {Shown, Next} = starl_live_vicon:datagram(Datagram, Arrived, S),
        all_sound(Shown),
        Next
    end).

hostile_natnet(_Config) ->
    Bodies = [{R, {1.0, 2.0, 3.0}, {quaternion, 0.0, 0.0, 0.0, 1.0}, true} || R <- [1, 2, 3]],
    Frame = #{number => 7, bodies => Bodies, clutter => 3, times => {10, 20}},
    [
        hostile(
            [starl_live_mocap_fake:frame(Version, Frame)],
            starl_live_natnet:new((config())#{version => Version}),
            fun(Datagram, Arrived, S) ->
                {Shown, _, Next} = starl_live_natnet:packet(Datagram, Arrived, S),
                all_sound(Shown),
                Next
            end
        )
     || Version <- [{3, 1}, {4, 1}]
    ].

all_sound(Shown) ->
    [
        ?assert(is_float(X) andalso is_float(Y) andalso is_float(A) andalso is_integer(Taken))
     || {Robot, {X, Y, A}, Taken} <- Shown, lists:member(Robot, [1, 2, 3])
    ].

%% What is kept does not grow with the number of datagrams.
hostile(Good, Source, Hear) ->
    Seed = starl_platform_ct:seed(),
    Play = fun(From, To, S0, R0) ->
        lists:foldl(
            fun(N, {S, R}) ->
                {Datagram, R1} = hostile_datagram(Good, R),
                {Hear(Datagram, N * 1000, S), R1}
            end,
            {S0, R0},
            lists:seq(From, To)
        )
    end,
    {First, R} = Play(1, ?HOSTILE div 10, Source, rand:seed_s(exsss, Seed)),
    {Size, Atoms} = {erts_debug:flat_size(First), erlang:system_info(atom_count)},
    {Last, _} = Play(?HOSTILE div 10 + 1, ?HOSTILE, First, R),
    ?assertEqual(Atoms, erlang:system_info(atom_count)),
    ?assert(erts_debug:flat_size(Last) =< Size + 100, {Size, erts_debug:flat_size(Last)}).

hostile_datagram(Good, R0) ->
    {Kind, R1} = rand:uniform_s(5, R0),
    {Which, R2} = rand:uniform_s(length(Good), R1),
    spoiled(Kind, lists:nth(Which, Good), R2).

spoiled(1, Good, R0) ->
    {Size, R1} = rand:uniform_s(2 * byte_size(Good), R0),
    rand:bytes_s(Size, R1);
spoiled(2, Good, R0) ->
    {Size, R1} = rand:uniform_s(byte_size(Good), R0),
    {binary:part(Good, 0, Size - 1), R1};
spoiled(3, Good, R0) ->
    {Bit, R1} = rand:uniform_s(bit_size(Good), R0),
    Before = Bit - 1,
    <<Head:Before/bitstring, B:1, Tail/bitstring>> = Good,
    {<<Head/bitstring, (1 - B):1, Tail/bitstring>>, R1};
%% four bytes of ones somewhere: counts, sizes, numbers that are none
spoiled(4, Good, R0) ->
    {At, R1} = rand:uniform_s(byte_size(Good) - 4, R0),
    <<Head:At/binary, _:32, Tail/binary>> = Good,
    {<<Head/binary, 16#FFFFFFFF:32, Tail/binary>>, R1};
spoiled(5, Good, R0) ->
    {Good, R0}.

config() ->
    #{
        robot => 1,
        participants => starl_team:new([1, 2, 3]),
        clock => starl_live_clock:new(0, 1)
    }.

%% -- with the location service, in virtual time ---------------------------------------------

%% 13 pictures a second in whole millimetres, delayed, doubled, overtaken and lost; robot 1 drives and
%% stands. Each question is answered with where the robot is at a moment after the question; nobody is
%% told that this is unknown; the ages are right.
moments_13_hz(_Config) ->
    [
        begin
            Got = play(broadcast, pictures(Seed, #{}), asks(Seed)),
            ?assertEqual(length(asks(Seed)), length(Got)),
            [sound(One) || One <- Got],
            Waits = lists:sort([Told - At || {At, Told, _} <- Got]),
            %% the next picture, or the one after it; some are lost
            ?assert(lists:nth(length(Waits) div 2, Waits) =< 2 * ?PICTURE_US),
            ?assert(lists:last(Waits) =< 6 * ?PICTURE_US)
        end
     || Seed <- seeds()
    ].

%% The sender's picture is stuck for five seconds: nothing is answered from it; all is, afterwards.
moments_frozen(_Config) ->
    From = ?STUCK_US,
    Until = From + 5 * 1000000,
    [
        begin
            Got = play(broadcast, pictures(Seed, #{frozen => {From, Until}}), asks(Seed)),
            ?assertEqual(length(asks(Seed)), length(Got)),
            [sound(One) || One <- Got],
            ?assertEqual([], [
                One
             || {At, Told, _} = One <- Got, At > From + ?PICTURE_US, Told < Until
            ]),
            ?assertNotEqual([], [At || {At, _, _} <- Got, At > From + ?PICTURE_US, At < Until])
        end
     || Seed <- seeds()
    ].

%% Vicon counts its frames on while its picture is stuck: no live system measures the same twice.
moments_vicon_frozen(_Config) ->
    From = ?STUCK_US,
    Until = From + 5 * 1000000,
    [
        begin
            Options = #{frozen => {From, Until}, counts => true, noise => true},
            Got = play(vicon, pictures(Seed, Options), asks(Seed)),
            ?assertEqual(length(asks(Seed)), length(Got)),
            [sound(One) || One <- Got],
            ?assertEqual([], [
                One
             || {At, Told, _} = One <- Got, At > From + ?PICTURE_US, Told < Until
            ])
        end
     || Seed <- seeds()
    ].

seeds() ->
    First = starl_platform_ct:seed(),
    lists:seq(First, First + 9).

%% An answer is the robot's place, to within the rounding, at a moment between question and answer. While
%% it drives, its place tells the moment.
sound({At, Told, {ok, {X, _, _} = Pose}}) ->
    Moments = [T || T <- moments(At, Told), close(Pose, place(1, T))],
    ?assert(Moments =/= [], {asked, At, told, Told, pose, Pose, was, place(1, At), place(1, Told)}),
    ?assert(is_float(X)).

%% All of it in steps of less than half a millimetre.
moments(At, Told) -> lists:seq(At, Told, 1000) ++ [Told].

close({X, Y, A}, {U, V, B}) ->
    abs(X - U) =< 1.0 andalso abs(Y - V) =< 1.0 andalso abs(A - B) < 0.002.

%% It drives for three seconds at 300 mm/s, and stands for two. Robot 2 keeps still.
place(1, T) ->
    {Rounds, Rest} = {T div 5000000, T rem 5000000},
    Driven = Rounds * 3000000 + min(Rest, 3000000),
    {300.0 * Driven / 1000000, 50.0, 0.25};
place(2, _T) ->
    {-1000.0, 7.0, 0.0}.

%% Sixty seconds of pictures, {ArrivedUs, Picture}, as the network brings them.
pictures(Seed, Options) ->
    {Arrived, _} = lists:mapfoldl(
        fun(N, R) -> sent(N, N * ?PICTURE_US, Options, R) end,
        rand:seed_s(exsss, Seed),
        lists:seq(1, 60000000 div ?PICTURE_US)
    ),
    lists:sort(lists:append(Arrived)).

%% A tenth is lost, a tenth comes twice, each takes up to 100 ms: more than the time between two. The
%% first ones, and each tenth, take 1 ms: so soon is the source's clock known.
sent(N, T, Options, R0) ->
    {Delay, R1} = rand:uniform_s(100000, R0),
    {Luck, R2} = rand:uniform_s(10, R1),
    Shown = shown(N, T, Options),
    case Luck of
        _ when N rem 10 =:= 1 -> {[{T + 1000, Shown}], R2};
        1 -> {[], R2};
        2 -> {[{T + 1000 + Delay, Shown}, {T + 1000 + Delay div 2, Shown}], R2};
        _ -> {[{T + 1000 + Delay * maps:get(spread, Options, 1), Shown}], R2}
    end.

%% The number, the time and the moment that a picture shows.
shown(N, T, #{frozen := {From, Until}} = Options) when T >= From, T < Until ->
    Last = From div ?PICTURE_US,
    case Options of
        #{counts := true} -> {N, T, Last * ?PICTURE_US};
        #{} -> {Last, Last * ?PICTURE_US, Last * ?PICTURE_US}
    end;
shown(N, T, _Options) ->
    {N, T, T}.

%% Some hundred questions, fewer than may be open in five seconds, from the second second on.
asks(Seed) ->
    {Times, _} = lists:mapfoldl(
        fun(_, R) ->
            {T, R1} = rand:uniform_s(55000000, R),
            {T + 2000000, R1}
        end,
        rand:seed_s(exsss, {Seed, 1, 2}),
        lists:seq(1, 100)
    ),
    lists:usort(Times).

%% Events in the order of their times: pictures, questions, and the timers of the location service.
play(Kind, Pictures, Asks) ->
    Events = lists:sort(
        [{T, 1, {picture, P}} || {T, P} <- Pictures] ++ [{T, 2, ask} || T <- Asks]
    ),
    Clock = starl_live_clock:new(0, 1),
    Config = (config())#{clock => Clock, exact => Kind =:= broadcast, latency_us => 1000},
    Start = #{
        kind => Kind,
        source => source(Kind, Config),
        seen => starl_live_poses:new(Config, 0),
        machine => machine(),
        timers => #{},
        got => []
    },
    #{got := Got} = lists:foldl(
        fun({T, _, What}, S) -> happens(What, T, due(T, S)) end, Start, Events
    ),
    lists:reverse(Got).

source(broadcast, Config) ->
    starl_live_broadcast:new(Config);
%% Only the times of arrival tell the age here: so the tests of Vicon give its rate.
source(vicon, Config) ->
    starl_live_vicon:new(Config#{
        names => #{<<"one">> => 1, <<"two">> => 2}, rate_hz => 1000000 / ?PICTURE_US
    }).

machine() ->
    {_, M} = starl_machine:new(starl_location, #{exact => true}, #{
        robot => 1,
        participants => [1, 2],
        name => location,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    M.

%% Timers that are due before a time.
due(T, #{timers := Timers} = S) ->
    case lists:sort([{Due, Name} || {Name, Due} <- maps:to_list(Timers), Due < T]) of
        [] ->
            S;
        [{Due, Name} | _] ->
            {Type, again} = {Name, again},
            due(T, event(Due, Type, again, S#{timers := maps:remove(Name, Timers)}))
    end.

happens(ask, T, S) ->
    event(T, {call, {app, T}}, {pose, 1}, S);
happens({picture, Picture}, T, #{kind := Kind, source := Source, seen := Seen} = S) ->
    {Sightings, Next} = heard(Kind, datagram(Kind, Picture), T, Source),
    {Answers, _, Known} = starl_live_poses:show(Sightings, T, Seen),
    lists:foldl(
        fun({N, Poses}, Before) ->
            aged(Poses, T),
            event(T, info, {located, N, Poses}, Before)
        end,
        S#{source := Next, seen := Known},
        Answers
    ).

%% The robot was there at the moment that the age tells.
aged(Poses, T) ->
    [?assert(close(Pose, place(Robot, T - Age)), {T, Age, Pose}) || {Robot, Pose, Age} <- Poses].

heard(broadcast, Datagram, T, Source) -> starl_live_broadcast:datagram(Datagram, T, Source);
heard(vicon, Datagram, T, Source) -> starl_live_vicon:datagram(Datagram, T, Source).

%% The sender's clock is an hour ahead.
datagram(broadcast, {N, Sent, Moment}) ->
    Poses = [{R, place(R, Moment)} || R <- [1, 2]],
    [Datagram] = starl_live_broadcast:encode(N, Sent + 3600000000, Poses, #{rounded => true}),
    Datagram;
datagram(vicon, {N, _, Moment}) ->
    Objects = [object(Name, R, Moment) || {Name, R} <- [{<<"one">>, 1}, {<<"two">>, 2}]],
    starl_live_mocap_fake:vicon(N, Objects, 256).

%% Each measurement is off by a little.
object(Name, Robot, Moment) ->
    {X, Y, A} = place(Robot, Moment),
    Noise = erlang:phash2({Robot, Moment}, 1000) / 10000,
    {Name, {X + Noise, Y - Noise, 0.0}, {euler, 0.0, 0.0, A}}.

event(T, Type, Content, #{machine := M} = S) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => T, robot => 1}, M),
    lists:foldl(fun(Action, Before) -> act(Action, T, Before) end, S#{machine := Next}, Actions).

act({sense, Robots, N}, T, #{seen := Seen} = S) ->
    S#{seen := starl_live_poses:ask(N, Robots, T, Seen)};
act({reply, {app, At}, Answer}, T, #{got := Got} = S) ->
    S#{got := [{At, T, Answer} | Got]};
act({state_timeout, cancel}, _T, #{timers := Timers} = S) ->
    S#{timers := maps:remove(state_timeout, Timers)};
act({Name, Us, again}, T, #{timers := Timers} = S) ->
    S#{timers := Timers#{Name => T + Us}}.

%% -- the process ----------------------------------------------------------------------------

%% A question that was asked before a datagram is answered when it comes.
process_answers(_Config) ->
    Port = free_port(),
    {ok, Positioning} = start(starl_live_broadcast, #{port => Port, exact => true}),
    ok = starl_live_positioning:ask(Positioning, first, [1, 2]),
    #{open := 1} = starl_live_positioning:figures(Positioning),
    {ok, Socket} = gen_udp:open(0, [binary]),
    Poses = [{1, {1.0, 2.0, 0.5}}, {2, {3.0, 4.0, 0.0}}],
    [Datagram] = starl_live_broadcast:encode(1, erlang:system_time(microsecond), Poses, #{}),
    ok = gen_udp:send(Socket, {127, 0, 0, 1}, Port, <<"garbage">>),
    ok = gen_udp:send(Socket, {127, 0, 0, 1}, Port, Datagram),
    [{1, {1.0, 2.0, 0.5}, A}, {2, {3.0, 4.0, +0.0}, B}] = located(Positioning, first),
    ?assert(A >= 0 andalso A =:= B),
    ?assertMatch(
        #{not_ours := 1, datagrams := 1, shown := 2, open := 0},
        starl_live_positioning:figures(Positioning)
    ),
    stop(Positioning).

%% Two robots of one computer hear the same group.
process_hears_multicast(_Config) ->
    Port = free_port(),
    Options = #{
        port => Port, group => "239.255.7.7", interface => "127.0.0.1", exact => true
    },
    {ok, One} = start(starl_live_broadcast, Options),
    {ok, Two} = start(starl_live_broadcast, Options),
    [ok = starl_live_positioning:ask(P, q, [1]) || P <- [One, Two]],
    [#{open := 1} = starl_live_positioning:figures(P) || P <- [One, Two]],
    {ok, Socket} = gen_udp:open(0, [
        binary, {multicast_if, {127, 0, 0, 1}}, {multicast_loop, true}
    ]),
    [Datagram] = starl_live_broadcast:encode(1, 1, [{1, {1.0, 2.0, 0.5}}], #{}),
    ok = gen_udp:send(Socket, {239, 255, 7, 7}, Port, Datagram),
    [[{1, {1.0, 2.0, 0.5}, _}] = located(P, q) || P <- [One, Two]],
    [stop(P) || P <- [One, Two]].

%% A server that sends by unicast: it is asked, describes itself, and sends to who has asked.
process_asks_natnet(_Config) ->
    {ok, Server} = gen_udp:open(0, [binary, {ip, {127, 0, 0, 1}}, {active, true}]),
    {ok, Port} = inet:port(Server),
    {ok, Positioning} = start(starl_live_natnet, #{
        server => "127.0.0.1",
        command_port => Port,
        unicast => true,
        port => free_port(),
        latency_us => 0
    }),
    Client =
        receive
            {udp, Server, _, From, <<0, 0, _/binary>>} -> From
        after ?LIMIT_MS -> error(not_asked)
        end,
    ok = starl_live_positioning:ask(Positioning, q, [1]),
    #{open := 1} = starl_live_positioning:figures(Positioning),
    Info = starl_live_mocap_fake:server(<<"Motive">>, {4, 1}, 1000000),
    ok = gen_udp:send(Server, {127, 0, 0, 1}, Client, Info),
    %% no live system measures the same twice
    Frame = fun(N) ->
        Body = {1, {1.0, 0.1, -2.0 - N / 10000}, {quaternion, 0.0, 0.0, 0.0, 1.0}, true},
        starl_live_mocap_fake:frame({4, 1}, #{number => N, bodies => [Body]})
    end,
    %% nobody else describes the server
    {ok, Other} = gen_udp:open(0, [binary, {ip, {127, 0, 0, 2}}]),
    Forged = starl_live_mocap_fake:server(<<"Motive">>, {3, 1}, 1000000),
    ok = gen_udp:send(Other, {127, 0, 0, 1}, Client, Forged),
    [ok = gen_udp:send(Server, {127, 0, 0, 1}, Client, Frame(N)) || N <- [1, 2]],
    [{1, {1000.0, Y, _}, _}] = located(Positioning, q),
    ?assert(abs(Y - 2000.2) < 0.001),
    receive
        {udp, Server, _, Client, <<10, 0, 0, 0, 0>>} -> ok
    after ?LIMIT_MS -> error(not_kept_alive)
    end,
    stop(Positioning).

%% The robot asks and has not been seen for two seconds: said once, with the counters; said again when
%% it is back. The run's clock goes fast here, so that nobody waits.
process_says_silence(_Config) ->
    Port = free_port(),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1.0e6),
    {ok, Positioning} = start(starl_live_broadcast, #{
        port => Port, clock => Clock, exact => true
    }),
    {ok, Socket} = gen_udp:open(0, [binary]),
    ok = gen_udp:send(Socket, {127, 0, 0, 1}, Port, <<"garbage">>),
    asked_until_said(Positioning, 1),
    [Datagram] = starl_live_broadcast:encode(1, 1, [{1, {1.0, 2.0, 0.5}}], #{}),
    ok = gen_udp:send(Socket, {127, 0, 0, 1}, Port, Datagram),
    receive
        {logged, #{what := position_back, for_us := Us}} -> ?assert(Us >= 2000000)
    after ?LIMIT_MS -> error(not_said)
    end,
    stop(Positioning).

asked_until_said(Positioning, N) ->
    ok = starl_live_positioning:ask(Positioning, N, [1]),
    #{} = starl_live_positioning:figures(Positioning),
    receive
        {logged, #{what := position_silent, figures := #{open := _}}} -> ok
    after 0 -> asked_until_said(Positioning, N + 1)
    end.

%% One line says what is wrong with the configuration, or with the port.
process_refuses(_Config) ->
    Line = fun(Module, Options) ->
        {error, {shutdown, {positioning, Text}}} = start(Module, Options),
        Text
    end,
    ?assertEqual(
        <<"speed must be a speed in mm/s, or infinity, not fast">>,
        Line(starl_live_broadcast, #{speed => fast})
    ),
    ?assertEqual(
        <<"Vicon shows objects by name: give names, as in #{<<\"create1\">> => 1}">>,
        Line(starl_live_vicon, #{})
    ),
    {ok, Taken} = gen_udp:open(0, [binary]),
    {ok, Port} = inet:port(Taken),
    Expected = io_lib:format("cannot open UDP port ~b: address already in use", [Port]),
    ?assertEqual(iolist_to_binary(Expected), Line(starl_live_broadcast, #{port => Port})),
    ok = gen_udp:close(Taken).

%% -- helpers --------------------------------------------------------------------------------

start(Module, Options) ->
    _ = process_flag(trap_exit, true),
    Now = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Config = maps:merge((config())#{clock => Now}, Options),
    starl_live_positioning:start_link(Module, Config, self()).

stop(Positioning) ->
    true = unlink(Positioning),
    gen_server:stop(Positioning).

located(Positioning, Tag) ->
    receive
        {starl_located, Positioning, Tag, Picture} -> Picture
    after ?LIMIT_MS -> error({not_located, Tag})
    end.

free_port() ->
    {ok, Socket} = gen_udp:open(0, [binary]),
    {ok, Port} = inet:port(Socket),
    ok = gen_udp:close(Socket),
    Port.
