%% @doc The seal of a datagram: encryption and authentication by a key that the fleet shares
%% (AES-256-GCM), refusal of replays, strangers and packets for others.
%%
%% ```
%%   "S" | version | fleet 4 | run 8 | from 4 | to 4 | time 8 | nonce 12 || sealed n | tag 16
%%   '--------------------- authenticated header -----------------------'
%% '''
%% The key of a run is made from the key of the fleet, the fleet's name and the run's number, so
%% nothing of one run opens in another. Nonces are random: their uniqueness must not rest on a
%% counter in a file, which a restored disk image or a second robot of the same number would set
%% back, since with one key for all, a repeated nonce gives away the authentication of the whole
%% fleet. Random ones are safe for 2^32 packets of a run.
%%
%% A packet is taken once, and only while it is fresh by its sender's clock: what was recorded
%% longer before a robot's reboot is refused after it, though the robot remembers nothing. Neither epochs
%% nor counters order the packets of a sender, so no packet, not even one that was made with the
%% right key, makes others of its sender look old.
-module(starl_live_seal).

-export([new/2, room/0, seal/4, open/3]).

-export_type([t/0, config/0, refusal/0]).

-define(VERSION, 1).
%% The most bytes of a datagram: less than any link's, with room for tunnels.
-define(LONGEST, 1200).
-define(HEADER, 42).
-define(TAG, 16).
-define(CIPHER, aes_256_gcm).
-define(MOST, 16#FFFFFFFF).

%% `key': the fleet's key ({@link starl_live_key}); `run': the run's number, of 64 bits; `fresh_ms':
%% the largest difference of a packet's time from this computer's.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    key := starl_live_key:t(),
    fleet := unicode:chardata(),
    run := non_neg_integer(),
    fresh_ms => pos_integer(),
    atom() => term()
}.

%% Why a datagram is refused: its length, the version of its format, another fleet's, another run's,
%% the robot's own, a robot outside the team, for another robot, too old or of the future, heard
%% before, not sealed with our key or changed under way.
-type refusal() ::
    length | version | fleet | run | own | stranger | address | clock | replay | seal.

-record(seal, {
    key :: binary(),
    fleet :: binary(),
    run :: non_neg_integer(),
    robot :: starl:robot_id(),
    team :: starl_team:t(),
    fresh_ms :: pos_integer(),
    heard :: starl_live_replay:t()
}).

-opaque t() :: #seal{}.

%% @doc The seal of a robot in a run.
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
    crypto:mac(hmac, sha256, Key(), [<<"starl datagram 1", Run:64>>, Name]).

fleet(Name) ->
    <<Short:4/binary, _/binary>> = crypto:hash(sha256, unicode:characters_to_binary(Name)),
    Short.

%% @doc The most bytes that one datagram can carry.
-spec room() -> pos_integer().
room() -> ?LONGEST - ?HEADER - ?TAG.

%% @doc The datagram that carries these bytes to a robot, or to all.
-spec seal(starl:robot_id() | all, iodata(), NowMs :: non_neg_integer(), t()) -> iolist().
seal(To, Bytes, Now, #seal{key = Key, fleet = Fleet, run = Run, robot = Robot}) ->
    Nonce = crypto:strong_rand_bytes(12),
    Header = <<
        $S, ?VERSION, Fleet/binary, Run:64, Robot:32, (number(To)):32, Now:64, Nonce/binary
    >>,
    {Sealed, Tag} = crypto:crypto_one_time_aead(?CIPHER, Key, Nonce, Bytes, Header, ?TAG, true),
    [Header, Sealed, Tag].

number(all) -> 0;
number(Robot) -> Robot.

%% @doc Opens a datagram.
-spec open(binary(), NowMs :: integer(), t()) ->
    {ok, From :: starl:robot_id(), starl:robot_id() | all, Bytes :: binary(), t()}
    | {error, refusal()}.
open(<<Header:?HEADER/binary, Rest/binary>>, Now, Seal) when
    byte_size(Rest) > ?TAG, byte_size(Rest) =< ?LONGEST - ?HEADER
->
    case header(Header, Now, Seal) of
        {From, To, Nonce, Id} -> opened(From, To, Id, bytes(Header, Nonce, Rest, Seal), Now, Seal);
        Refusal -> {error, Refusal}
    end;
open(_Datagram, _Now, _Seal) ->
    {error, length}.

%% Nothing here is believed before the seal is found whole; what cannot be for us needs no opening.
header(<<$S, ?VERSION, Fleet:4/binary, Rest/binary>>, Now, #seal{fleet = Fleet} = Seal) ->
    header_of_run(Rest, Now, Seal);
header(<<$S, ?VERSION, _/binary>>, _Now, _Seal) ->
    fleet;
header(_Header, _Now, _Seal) ->
    version.

header_of_run(<<Run:64, From:32, To:32, Time:64, Nonce/binary>>, Now, #seal{run = Run} = Seal) ->
    #seal{robot = Robot, team = Team, fresh_ms = Fresh, heard = Heard} = Seal,
    Floor = starl_live_replay:floor_ms(Heard),
    <<Id:58, _/bits>> = Nonce,
    case sender(From, Robot, Team) of
        ok when To =/= 0, To =/= Robot -> address;
        ok when abs(Now - Time) > Fresh -> clock;
        ok when Time < Floor -> clock;
        ok -> unheard(starl_live_replay:has(Id, Heard), {From, robot(To), Nonce, Id});
        Refusal -> Refusal
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

opened(_From, _To, _Id, error, _Now, _Seal) ->
    {error, seal};
opened(From, To, Id, Bytes, Now, #seal{heard = Heard} = Seal) ->
    {ok, From, To, Bytes, Seal#seal{heard = starl_live_replay:add(Id, Now, Heard)}}.
