%% A transport by UDP without a network, for its tests: its sockets are this module, which hands datagrams to the
%% test, and its clock shows what the test sets. Robots are at port 5000 and their number.
-module(starl_live_udp_fake).
-behaviour(starl_live_clock).

-export([robot/2, robot/3, config/2, places/0, now_set/0, after_ms/2, seal/2]).
-export([datagrams/0, addresses/0, address/1, hears/2, transmits/3, messages/0, logged/1]).
-export([packet/0, packet/1, sized/1, large/0]).
%% The sockets.
-export([open/2, send/4, close/1]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

-define(START, 1_700_000_000_000_000).

%% -- sockets and clock -------------------------------------------------------------------------------

open(7, _Options) -> {error, eaddrinuse};
open(Port, [binary, {active, 100}, {recbuf, 1_000_000}, inet, {broadcast, true}]) -> {ok, Port}.

%% Nobody can be reached at port 9.
send(_Socket, _Ip, 9, _Bytes) ->
    {error, enetunreach};
send(Socket, Ip, Port, Bytes) ->
    self() ! {datagram, Socket, {Ip, Port}, iolist_to_binary(Bytes)},
    ok.

close(Socket) ->
    self() ! {closed, Socket},
    ok.

system_time(Unit, Time) -> erlang:convert_time_unit(atomics:get(Time, 1), microsecond, Unit).
time_of_day(Unit, Time) -> system_time(Unit, Time).
monotonic_time(Unit, Time) -> system_time(Unit, Time).

start_timer(Ms, What, [], _Time) ->
    self() ! {timer, What, Ms},
    What.

send_after(Ms, Message, _Time) ->
    self() ! {held, Ms, Message},
    make_ref().

%% -- robots ------------------------------------------------------------------------------------------

%% The end of a robot of three on port 5000 and its number, and the time that they share.
robot(Robot, Given) -> robot(Robot, Given, now_set()).

robot(Robot, Given, Time) ->
    {ok, Udp} = starl_live_udp:open(maps:merge(config(Robot, Time), Given)),
    Udp.

config(Robot, Time) ->
    #{
        robot => Robot,
        participants => starl_team:new([1, 2, 3]),
        fleet => "tests",
        run => 1,
        key => fun() -> <<7:256>> end,
        peers => places(),
        life => Robot,
        spread_ms => 0,
        beat_ms => infinity,
        clock => starl_live_clock:on({?MODULE, Time}, starl_live_clock:new(0, 1)),
        sockets => ?MODULE,
        random => fun() -> rand:seed_s(exsss, Robot) end
    }.

now_set() ->
    starl_platform_ct:forget(),
    Time = atomics:new(1, [{signed, true}]),
    ok = atomics:put(Time, 1, ?START),
    Time.

after_ms(Ms, Time) -> atomics:add(Time, 1, 1000 * Ms).

%% What has gone on the air: to whom.
datagrams() ->
    receive
        {datagram, Socket, To, Bytes} -> [{Socket, To, Bytes} | datagrams()]
    after 0 -> []
    end.

addresses() -> [To || {_, To, _} <- datagrams()].

address(Robot) -> {{10, 0, 0, Robot}, 5000 + Robot}.

%% A robot hears what another one has sent to it.
hears(From, Udp) ->
    lists:foldl(
        fun({_, _, Bytes}, {Packets, U}) ->
            {Ip, Port} = address(From),
            {Some, Next} = starl_live_udp:hear({udp, socket, Ip, Port, Bytes}, U),
            {Packets ++ Some, Next}
        end,
        {[], Udp},
        datagrams()
    ).

packet() -> packet(1).

packet(From) -> starl_packet:shout(From, hello, here).

large() -> starl_packet:shout(1, hello, binary:copy(<<"large">>, 1000)).

transmits(To, Packet, Udp) ->
    {ok, Next} = starl_live_udp:transmit(To, Packet, Udp),
    Next.

places() -> maps:from_list([{N, address(N)} || N <- [1, 2, 3]]).

%% A packet of so many bytes more than one without any.
sized(Bytes) -> starl_packet:shout(1, hello, binary:copy(<<7>>, Bytes)).

seal(Robot, Time) ->
    {ok, Seal} = starl_live_seal:new(config(Robot, Time), 0),
    Seal.

messages() ->
    receive
        Message -> [Message | messages()]
    after 0 -> []
    end.

%% What a function answers, and the lines that it has logged.
logged(Fun) ->
    Self = self(),
    Reports = starl_live_log_ct:reports(fun() -> Self ! {answer, Fun()} end),
    receive
        {answer, Answer} -> {Answer, [Why || {_Level, #{why := Why}, _Meta} <- Reports]}
    end.
