%% @doc Seals and opens datagrams: encryption and authentication by a key that the fleet shares
%% (AES-256-GCM). It refuses replays, strangers and packets for others.
%%
%% ```
%%   "S" | version | fleet 4 | run 8 | from 4 | to 4 | life 8 | time 8 | nonce 12 || sealed n | tag 16
%%   '------------------------- authenticated header -------------------------------'
%% '''
%% The key of a run is made from the key of the fleet, the fleet's name and the run's number, so
%% nothing of one run opens in another. Nonces are random: their uniqueness must not rest on a
%% counter in a file. A restored disk image or a second robot of the same number would set such a
%% counter back. With one key for all, a repeated nonce reveals the authentication of the whole
%% fleet. Random nonces are safe for 2^32 packets of a run.
%%
%% A packet is taken once, and only while it is fresh by its sender's clock. So a packet that was
%% recorded longer before a robot's reboot is refused after it, though the robot remembers nothing.
%% Clocks show the time of day: once a wrong clock is set right, its packets are fresh. Neither
%% epochs nor counters order the packets of a sender. So no packet, not even one that was made with
%% the right key, makes others of its sender look old. The number of the sender's life identifies
%% the start of its program. It distinguishes a restart from a second robot of the same number
%% ({@link starl_live_peers}).
-module(starl_live_seal).

-export([new/2, room/0, seal/4, open/3]).

-export_type([t/0, config/0, header/0, life/0, now/0, refusal/0]).

-define(VERSION, 2).
%% The most bytes of a datagram: less than any link's, with room for tunnels.
-define(LONGEST, 1200).
-define(HEADER, 50).
-define(TAG, 16).
-define(CIPHER, aes_256_gcm).
-define(MOST, 16#FFFFFFFF).

%% The number of one start of a robot's program, of 64 bits: a later start has a larger one.
-type life() :: non_neg_integer().

%% The time of day, and monotonic time, in milliseconds.
-type now() :: {TimeOfDayMs :: integer(), MonotonicMs :: integer()}.

%% `key': the fleet's key ({@link starl_live_key}); `run': the run's number, of 64 bits; `life': that of
%% the robot's program; `fresh_ms': the largest difference of a packet's time from this computer's.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    key := starl_live_key:t(),
    fleet := unicode:chardata(),
    run := non_neg_integer(),
    life => life(),
    fresh_ms => pos_integer(),
    atom() => term()
}.

%% What an authentic datagram says of itself.
-type header() :: #{
    from := starl:robot_id(),
    to := starl:robot_id() | all,
    life := life(),
    sent_ms := integer()
}.

%% Why a datagram is refused: its length, the version of its format, another fleet's, another run's,
%% the robot's own, a robot outside the team, for another robot, too old or of the future (by how much
%% its time is ahead of ours), heard before, not sealed with our key or changed under way.
-type refusal() ::
    length
    | version
    | fleet
    | run
    | own
    | stranger
    | address
    | {clock, AheadMs :: integer()}
    | replay
    | seal.

-record(seal, {
    key :: binary(),
    fleet :: binary(),
    run :: non_neg_integer(),
    robot :: starl:robot_id(),
    life :: life(),
    team :: starl_team:t(),
    fresh_ms :: pos_integer(),
    heard :: starl_live_replay:t()
}).

-opaque t() :: #seal{}.

%% @doc The seal of a robot in a run, from this monotonic time on.
-spec new(config(), NowMs :: integer()) -> {ok, t()} | {error, unicode:chardata()}.
new(#{robot := Robot, participants := Team, fleet := Fleet, run := Run} = Config, Now) ->
    Fresh = maps:get(fresh_ms, Config, 15_000),
    case [R || R <- [Robot | starl_team:members(Team)], R > ?MOST] of
        [] ->
            {ok, #seal{
                key = run_key(Config),
                fleet = fleet(Fleet),
                run = Run,
                robot = Robot,
                life = maps:get(life, Config, 0),
                team = Team,
                fresh_ms = Fresh,
                %% A packet of the near future may be played again for twice that time.
                heard = starl_live_replay:new(2 * Fresh, Now)
            }};
        [Large | _] ->
            {error, io_lib:format("robot ~b: numbers up to ~b only", [Large, ?MOST])}
    end.

run_key(#{key := Key, fleet := Fleet, run := Run}) ->
    Name = unicode:characters_to_binary(Fleet),
    crypto:mac(hmac, sha256, Key(), [<<"starl datagram 2", Run:64>>, Name]).

fleet(Name) ->
    <<Short:4/binary, _/binary>> = crypto:hash(sha256, unicode:characters_to_binary(Name)),
    Short.

%% @doc The most bytes that one datagram can carry.
-spec room() -> pos_integer().
room() -> ?LONGEST - ?HEADER - ?TAG.

%% @doc The datagram that carries these bytes to a robot, or to all, at this time of day.
-spec seal(starl:robot_id() | all, iodata(), TimeOfDayMs :: non_neg_integer(), t()) -> iolist().
seal(To, Bytes, Now, #seal{key = Key, fleet = Fleet, run = Run, robot = Robot, life = Life}) ->
    Nonce = crypto:strong_rand_bytes(12),
    Header = <<
        $S,
        ?VERSION,
        Fleet/binary,
        Run:64,
        Robot:32,
        (number(To)):32,
        Life:64,
        Now:64,
        Nonce/binary
    >>,
    {Sealed, Tag} = crypto:crypto_one_time_aead(?CIPHER, Key, Nonce, Bytes, Header, ?TAG, true),
    [Header, Sealed, Tag].

number(all) -> 0;
number(Robot) -> Robot.

%% @doc Opens a datagram. Of one that is refused: the robot that it claims to be from, if that is one
%% of the team.
-spec open(binary(), now(), t()) ->
    {ok, header(), Bytes :: binary(), t()}
    | {error, refusal(), Claimed :: starl:robot_id() | unknown}.
open(<<Header:?HEADER/binary, Rest/binary>>, Now, Seal) when
    byte_size(Rest) > ?TAG, byte_size(Rest) =< ?LONGEST - ?HEADER
->
    case header(Header, Now, Seal) of
        {#{} = Said, Nonce, Id} ->
            opened(bytes(Header, Nonce, Rest, Seal), Said, Id, Now, Seal);
        Refusal ->
            {error, Refusal, claimed(Header, Seal)}
    end;
open(_Datagram, _Now, _Seal) ->
    {error, length, unknown}.

claimed(<<$S, ?VERSION, _Fleet:4/binary, _Run:64, From:32, _/binary>>, #seal{team = Team}) ->
    case starl_team:has(From, Team) of
        true -> From;
        false -> unknown
    end;
claimed(_Header, _Seal) ->
    unknown.

%% Nothing here is believed before the seal is found whole; what cannot be for us needs no opening.
header(<<$S, ?VERSION, Fleet:4/binary, Rest/binary>>, Now, #seal{fleet = Fleet} = Seal) ->
    header_of_run(Rest, Now, Seal);
header(<<$S, ?VERSION, _/binary>>, _Now, _Seal) ->
    fleet;
header(_Header, _Now, _Seal) ->
    version.

header_of_run(
    <<Run:64, From:32, To:32, Life:64, Time:64, Nonce/binary>>,
    {Now, Monotonic},
    #seal{run = Run} = Seal
) ->
    #seal{robot = Robot, team = Team, fresh_ms = Fresh, heard = Heard} = Seal,
    Forgotten = starl_live_replay:may_have(Time, Monotonic, Heard),
    <<Id:58, _/bits>> = Nonce,
    case sender(From, Robot, Team) of
        ok when To =/= 0, To =/= Robot -> address;
        ok when abs(Now - Time) > Fresh -> {clock, Time - Now};
        ok when Forgotten -> {clock, Time - Now};
        ok ->
            Said = #{from => From, to => robot(To), life => Life, sent_ms => Time},
            unheard(starl_live_replay:has(Id, Heard), {Said, Nonce, Id});
        Refusal ->
            Refusal
    end;
header_of_run(_Rest, _Now, _Seal) ->
    run.

sender(Robot, Robot, _Team) ->
    own;
sender(From, _Robot, Team) ->
    case starl_team:has(From, Team) of
        true -> ok;
        false -> stranger
    end.

robot(0) -> all;
robot(To) -> To.

unheard(true, _Header) -> replay;
unheard(false, Header) -> Header.

bytes(Header, Nonce, Rest, #seal{key = Key}) ->
    Size = byte_size(Rest) - ?TAG,
    <<Sealed:Size/binary, Tag/binary>> = Rest,
    crypto:crypto_one_time_aead(?CIPHER, Key, Nonce, Sealed, Header, Tag, false).

opened(error, #{from := From}, _Id, _Now, _Seal) ->
    {error, seal, From};
opened(Bytes, #{sent_ms := Sent} = Said, Id, {_, Now}, #seal{heard = Heard} = Seal) ->
    {ok, Said, Bytes, Seal#seal{heard = starl_live_replay:add(Id, Sent, Now, Heard)}}.
