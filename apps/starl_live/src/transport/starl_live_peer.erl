%% @doc Keeps what a robot knows of another robot from its datagrams. That is its address, the life
%% in which it is heard and when it was last heard, why its datagrams are refused, and whether
%% another robot has the same number. A pure module, a part of {@link starl_live_peers}, which has
%% the rules.
-module(starl_live_peer).

-export([new/1, address/1, calls/1, unnamed/2, asked/2, named/3, unsent/3]).
-export([heard/4, refused/4, look/4, state/3]).
-export([beat/2, beaten/4, life/1, proved/2, is_proved/2]).

-export_type([t/0, place/0, address/0, trouble/0, news/0, state/0]).

%% Where a robot hears, as its configuration says it.
-type place() :: {inet:hostname() | inet:ip_address(), inet:port_number()}.

-type address() :: {inet:ip_address(), inet:port_number()}.

%% Why it could not be called.
-type trouble() :: {unsent | unnamed, inet:posix()}.

-type news() ::
    {silent, starl:robot_id(), state()}
    | {back, starl:robot_id(), SilentMs :: non_neg_integer() | never}
    | {refused, starl:robot_id(), starl_live_refusals:reason()}
    | {moved, starl:robot_id(), address()}
    | {twice, starl:robot_id(), Heard :: speaker(), Refused :: speaker()}
    | {once, starl:robot_id()}
    | {unnamed, starl:robot_id(), inet:hostname(), inet:posix()}.

%% A life of a robot, or of another one of its number, and where it is.
-type speaker() :: {starl_live_seal:life(), address()}.

%% A robot, for its state: how long ago it was heard, where, and which of its lives; the difference of
%% its clock from ours and the round trip, as far as they are known; the refusals; why it may be silent;
%% the other robot of its number.
-type state() :: #{
    robot := starl:robot_id(),
    is_silent := boolean(),
    heard_ms := non_neg_integer() | never,
    address := address() | none,
    life := starl_live_seal:life() | none,
    refused := starl_live_refusals:state(),
    why := starl_live_refusals:reason() | trouble() | none,
    ahead_ms => integer(),
    round_trip_us => non_neg_integer(),
    twin => speaker()
}.

%% A robot that was not heard for this time is silent: some beats.
-define(SILENT_MS, 5000).
%% One that was never heard may still start.
-define(FIRST_MS, 10_000).
%% A robot has moved if nothing has come from its address for this time.
-define(MOVED_MS, 2000).
%% Two lives that both speak for this time are two robots.
-define(BOTH_MS, 3000).
%% After this time nothing is fresh any more that was sent before, whatever clocks say that were set back.
-define(STALE_MS, 20_000).
%% A trouble within this time may be why a robot is silent; a twin that is silent for it is gone.
-define(RECENT_MS, 10_000).
%% Names are looked up again after this time.
-define(LOOKUP_MS, 5000).
%% The other life of a robot's number: the one before, or that of another robot.
-record(other, {
    life :: starl_live_seal:life(),
    address :: address(),
    %% when it was heard first after the robot's present life had begun, and last
    first_ms = none :: integer() | none,
    last_ms = none :: integer() | none,
    is_twin = false :: boolean()
}).

-record(peer, {
    place :: place(),
    %% where its name leads, where and when it was heard last, and when its name was looked up
    found = none :: address() | none,
    address = none :: address() | none,
    at_ms = none :: integer() | none,
    asked_ms = none :: integer() | none,
    %% the life that is heard, the times of its first and of its newest datagram, by its clock
    life = none :: starl_live_seal:life() | none,
    since_ms = 0 :: integer(),
    newest_ms = 0 :: integer(),
    heard_ms = none :: integer() | none,
    %% the time of sending, by its clock, of a beat that names our life: what is later is no record
    proved_ms = none :: integer() | none,
    ahead_ms = none :: integer() | none,
    is_silent = false :: boolean(),
    other = none :: #other{} | none,
    refused = starl_live_refusals:new() :: starl_live_refusals:t(),
    %% why nothing could be sent to it, or its name not be found
    trouble = none :: {AtMs :: integer(), trouble()} | none,
    %% its last beat: its monotonic time, and ours
    beat = none :: {integer(), integer()} | none,
    round_trip_us = none :: non_neg_integer() | none
}).

-opaque t() :: #peer{}.

%% @doc A robot of whom nothing is known but this place.
-spec new(place()) -> t().
new(Place) -> #peer{place = Place, found = numeric(Place)}.

numeric({Host, Port}) when is_tuple(Host) -> {Host, Port};
numeric(_Place) -> none.

%% -- addresses ------------------------------------------------------------------------------

%% @doc Where it is, as far as it is known.
-spec address(t()) -> address() | none.
address(#peer{address = none, found = Found}) -> Found;
address(#peer{address = Address}) -> Address.

%% @doc Where it is to be called: if it is silent, also where its name leads now.
-spec calls(t()) -> [address()].
calls(#peer{is_silent = true, address = Address, found = Found}) ->
    lists:usort([A || A <- [Address, Found], A =/= none]);
calls(Peer) ->
    [A || A <- [address(Peer)], A =/= none].

%% @doc Its name, if that is to be looked up now.
-spec unnamed(NowMs :: integer(), t()) -> [inet:hostname()].
unnamed(_Now, #peer{place = {Ip, _}}) when is_tuple(Ip) ->
    [];
unnamed(Now, #peer{place = {Host, _}, is_silent = IsSilent, asked_ms = Asked} = Peer) ->
    [Host || address(Peer) =:= none orelse IsSilent, is_over(Asked, ?LOOKUP_MS, Now)].

is_over(none, _Ms, _Now) -> true;
is_over(At, Ms, Now) -> Now - At >= Ms.

%% @doc Its name is being looked up.
-spec asked(NowMs :: integer(), t()) -> t().
asked(Now, Peer) -> Peer#peer{asked_ms = Now}.

%% @doc Where the name of this robot leads.
-spec named(starl:robot_id(), {ok, inet:ip_address()} | {error, inet:posix()}, t()) ->
    {[news()], t()}.
named(_Robot, {ok, Ip}, #peer{place = {_, Port}} = Peer) ->
    {[], Peer#peer{found = {Ip, Port}, trouble = none}};
named(Robot, {error, Why}, #peer{place = {Host, _}, trouble = Before, asked_ms = Asked} = Peer) ->
    Trouble = {unnamed, Why},
    News = [{unnamed, Robot, Host, Why} || not is_same(Trouble, Before)],
    {News, Peer#peer{trouble = {Asked, Trouble}}}.

is_same(Trouble, {_, Trouble}) -> true;
is_same(_Trouble, _Before) -> false.

%% @doc A datagram could not be sent to it.
-spec unsent(inet:posix(), NowMs :: integer(), t()) -> t().
unsent(Why, Now, Peer) -> Peer#peer{trouble = {Now, {unsent, Why}}}.

%% -- what is heard --------------------------------------------------------------------------

%% @doc A datagram of it has come: see {@link starl_live_peers:heard/4}.
-spec heard(starl_live_seal:header(), address(), starl_live_seal:now(), t()) ->
    {heard | late | former | clone, [news()], t()}.
heard(#{from := Robot} = Said, Address, {_, Now} = At, Before) ->
    {Verdict, Lived} = lived(Said, Address, At, Before),
    Noted = noted(Verdict, Said, Address, At, Lived),
    {Verdict, came_back(Robot, Now, Before, Noted) ++ lives(Robot, Address, Before, Noted), Noted}.

%% Which life speaks: the present one, one that has begun later, or another. A later one that speaks from
%% elsewhere while the robot is heard where it is may be a lie: it is another until the robot is silent.
lived(#{life := Life}, _Address, _At, #peer{life = Life} = Peer) ->
    {heard, Peer};
lived(Said, Address, At, #peer{life = none} = Peer) ->
    {heard, begun(Said, Address, At, Peer)};
lived(#{life := Life} = Said, Address, {_, Now} = At, #peer{other = #other{life = Life}} = Peer) ->
    lived_too(Said, spoken(Now, Address, Peer#peer.other), At, Peer);
lived(#{life := Life, sent_ms := Sent} = Said, Address, {_, Now} = At, Peer) ->
    IsLater = Life > Peer#peer.life andalso Sent >= Peer#peer.newest_ms,
    case IsLater andalso may_move(Address, Now, Peer) of
        true ->
            {heard, begun(Said, Address, At, Peer)};
        false ->
            lived_too(Said, spoken(Now, Address, #other{life = Life, address = Address}), At, Peer)
    end.

%% Is the robot called there already, or has nothing come for a while from where it is?
may_move(Address, _Now, #peer{address = Address}) -> true;
may_move(_Address, Now, #peer{at_ms = At}) -> Now - At >= ?MOVED_MS.

%% It has begun by now, whatever time it says: what another life sends later is not late.
begun(#{life := Life, sent_ms := Sent}, Address, {Day, _}, Peer) ->
    #peer{life = Former, heard_ms = Last} = Peer,
    Other =
        case Former of
            none -> none;
            _ -> #other{life = Former, address = Peer#peer.address, last_ms = Last}
        end,
    Peer#peer{
        life = Life,
        address = Address,
        since_ms = min(Sent, Day),
        newest_ms = Sent,
        other = Other,
        beat = none,
        round_trip_us = none
    }.

spoken(Now, Address, #other{first_ms = none} = Other) ->
    Other#other{first_ms = Now, last_ms = Now, address = Address};
spoken(Now, Address, Other) ->
    Other#other{last_ms = Now, address = Address}.

%% What was sent before the present life began was under way. A later datagram is that of a robot whose
%% clock was set back, if the present life is silent, or else of a second robot.
lived_too(#{sent_ms := Sent}, Other, {_, Now}, #peer{since_ms = Since, heard_ms = Last} = Peer) when
    Sent =< Since, Now - Last < ?STALE_MS
->
    {late, Peer#peer{other = Other}};
lived_too(Said, #other{address = Address}, {_, Now} = At, #peer{heard_ms = Last} = Peer) when
    Now - Last >= ?BOTH_MS
->
    {heard, begun(Said, Address, At, Peer)};
lived_too(Said, #other{first_ms = First} = Other, {_, Now} = At, Peer) when
    Now - First >= ?BOTH_MS
->
    twins(Said, Other, At, Peer);
lived_too(_Said, Other, _At, Peer) ->
    {former, Peer#peer{other = Other}}.

%% The one that has started first is heard.
twins(#{life := Life} = Said, #other{address = Address} = Other, At, #peer{} = Peer) ->
    case Life < Peer#peer.life of
        true ->
            #peer{other = Former} = Elder = begun(Said, Address, At, Peer),
            #other{last_ms = Last} = Former,
            {heard, Elder#peer{other = Former#other{first_ms = Last, is_twin = true}}};
        false ->
            {clone, Peer#peer{other = Other#other{is_twin = true}}}
    end.

noted(heard, #{sent_ms := Sent}, Address, {Day, Now}, Peer) ->
    Heard = Peer#peer{heard_ms = Now, ahead_ms = Sent - Day, is_silent = false, trouble = none},
    placed(Sent, Address, Now, Heard);
noted(_Other, _Said, _Address, _At, Peer) ->
    Peer.

placed(Sent, Address, Now, #peer{address = Address, newest_ms = Newest} = Peer) ->
    Peer#peer{at_ms = Now, newest_ms = max(Sent, Newest)};
placed(Sent, Address, Now, #peer{at_ms = At, newest_ms = Newest} = Peer) when
    Sent > Newest, Now - At >= ?MOVED_MS; Now - At >= ?STALE_MS
->
    Peer#peer{address = Address, at_ms = Now, newest_ms = Sent};
placed(Sent, _Address, _Now, #peer{newest_ms = Newest} = Peer) ->
    Peer#peer{newest_ms = max(Sent, Newest)}.

came_back(Robot, Now, #peer{is_silent = true, heard_ms = Last}, #peer{is_silent = false}) ->
    [{back, Robot, silence(Now, Last)}];
came_back(_Robot, _Now, _Before, _After) ->
    [].

silence(_Now, none) -> never;
silence(Now, Last) -> Now - Last.

%% Two robots of one number are not one that moves.
lives(Robot, _Address, #peer{other = Before}, #peer{other = #other{is_twin = true} = Other} = Peer) ->
    #peer{life = Life, address = Address} = Peer,
    [
        {twice, Robot, {Life, Address}, {Other#other.life, Other#other.address}}
     || #other{is_twin = false} <- [Before]
    ];
lives(Robot, _Address, #peer{other = Other}, _After) when Other#other.is_twin ->
    [{once, Robot}];
lives(Robot, Address, Before, #peer{address = Address}) ->
    [{moved, Robot, Address} || Was <- [address(Before)], Was =/= none, Was =/= Address];
lives(_Robot, _Address, _Before, _After) ->
    [].

%% @doc A datagram of this robot was refused.
-spec refused(starl:robot_id(), starl_live_refusals:reason(), NowMs :: integer(), t()) ->
    {[news()], t()}.
refused(Robot, Reason, Now, #peer{refused = Refused} = Peer) ->
    {IsNews, Known} = starl_live_refusals:add(Reason, Now, Refused),
    {[{refused, Robot, Reason} || IsNews], Peer#peer{refused = Known}}.

%% -- beats ----------------------------------------------------------------------------------

%% @doc The content of a heartbeat for this robot: see {@link starl_live_peers:beat/3}.
-spec beat(NowUs :: integer(), t()) ->
    {NowUs :: integer(), EchoUs :: integer(), HeldUs :: non_neg_integer() | none}.
beat(Now, #peer{beat = {Theirs, At}}) -> {Now, Theirs, Now - At};
beat(Now, #peer{beat = none}) -> {Now, 0, none}.

%% @doc A heartbeat of this robot has come: its echo of ours gives the round trip.
-spec beaten(TheirUs :: integer(), {EchoUs, HeldUs}, NowUs :: integer(), t()) -> t() when
    EchoUs :: integer(), HeldUs :: non_neg_integer() | none.
beaten(Theirs, {_Echo, none}, Now, Peer) ->
    Peer#peer{beat = {Theirs, Now}};
beaten(Theirs, {Echo, Held}, Now, Peer) ->
    Peer#peer{beat = {Theirs, Now}, round_trip_us = max(0, Now - Echo - Held)}.

%% @doc Its life, as far as it was heard; 0: it was not.
-spec life(t()) -> starl_live_seal:life().
life(#peer{life = none}) -> 0;
life(#peer{life = Life}) -> Life.

%% @doc A heartbeat of this robot that was sent at this time names our present life.
-spec proved(SentMs :: integer(), t()) -> t().
proved(Sent, #peer{proved_ms = none} = Peer) -> Peer#peer{proved_ms = Sent};
proved(Sent, #peer{proved_ms = Proved} = Peer) -> Peer#peer{proved_ms = min(Sent, Proved)}.

%% @doc Was what it sent at this time certainly sent in our present life?
-spec is_proved(SentMs :: integer(), t()) -> boolean().
is_proved(Sent, #peer{proved_ms = Proved}) -> Proved =/= none andalso Sent >= Proved.

%% @doc Checks whether this robot has fallen silent. This computer has not stalled since it is
%% awake.
-spec look(starl:robot_id(), NowMs :: integer(), AwakeMs :: integer(), t()) -> {[news()], t()}.
look(Robot, Now, Awake, Peer) ->
    {Alone, Without} = without_twin(Robot, Now, Peer),
    {Silent, Next} = falls_silent(Robot, Now, Awake, Without),
    {Alone ++ Silent, Next}.

without_twin(Robot, Now, #peer{other = #other{is_twin = true, last_ms = Last}} = Peer) when
    Now - Last >= ?RECENT_MS
->
    {[{once, Robot}], Peer#peer{other = none}};
without_twin(_Robot, _Now, Peer) ->
    {[], Peer}.

falls_silent(Robot, Now, Awake, #peer{is_silent = false} = Peer) ->
    {Since, Patience} = patience(Awake, Peer),
    case Now - Since >= Patience of
        true ->
            Silent = Peer#peer{is_silent = true},
            {[{silent, Robot, state(Robot, Now, Silent)}], Silent};
        false ->
            {[], Peer}
    end;
falls_silent(_Robot, _Now, _Awake, Peer) ->
    {[], Peer}.

patience(Awake, #peer{heard_ms = none}) -> {Awake, ?FIRST_MS};
patience(Awake, #peer{heard_ms = Last}) -> {max(Last, Awake), ?SILENT_MS}.

%% -- its state ------------------------------------------------------------------------------

%% @doc The state of this robot.
-spec state(starl:robot_id(), NowMs :: integer(), t()) -> state().
state(Robot, Now, Peer) ->
    #peer{is_silent = IsSilent, heard_ms = Heard, life = Life, refused = Refused} = Peer,
    Known = #{
        robot => Robot,
        is_silent => IsSilent,
        heard_ms => silence(Now, Heard),
        address => address(Peer),
        life => Life,
        refused => starl_live_refusals:state(Now, Refused),
        why => why(Now, Peer)
    },
    More =
        [{ahead_ms, Ms} || Ms <- [Peer#peer.ahead_ms], Ms =/= none] ++
            [{round_trip_us, Us} || Us <- [Peer#peer.round_trip_us], Us =/= none] ++
            [{twin, {L, A}} || #other{life = L, address = A, is_twin = true} <- [Peer#peer.other]],
    maps:merge(Known, maps:from_list(More)).

%% The latest refusal that is not usual, or else what kept us from calling it.
why(Now, #peer{refused = Refused, trouble = Trouble}) ->
    case {starl_live_refusals:latest(Now, Refused), Trouble} of
        {none, {At, What}} when Now - At < ?RECENT_MS -> What;
        {Reason, _} -> Reason
    end.
