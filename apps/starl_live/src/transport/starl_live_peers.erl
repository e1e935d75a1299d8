%% @doc Keeps what a robot knows of the others from their datagrams. That is the address of each,
%% the life in which it is heard, when it was last heard, why its datagrams are refused, and which of
%% two robots of the same number is heard. A pure module; {@link starl_live_udp} asks it about each
%% datagram.
%%
%% <em>Addresses.</em> The newest authentic datagram gives a robot's address, once nothing comes
%% from its old address any more. A datagram that is older or was heard before does not. So a robot
%% on two networks does not move with each datagram. A silent robot is sent to at its last address
%% and at the address that its name has now.
%%
%% <em>Lives.</em> Each start of a robot's program is a life of its own. A newer life replaces the
%% one before; of the earlier life only datagrams that were under way are still taken. If both go on
%% sending, there are two robots of one number. The robot that started first is heard, so that all
%% robots hear the same one. The other is refused until the first is silent.
%%
%% <em>Proof.</em> A robot that has just started cannot know what it took in its former life. A
%% heartbeat that names its present life was sent in that life. So of each other robot it takes
%% nothing that was sent before the first such heartbeat: that may be a recording of what its former
%% life has heard.
%%
%% <em>News</em> are what somebody should know: a robot that falls silent or is back, a new reason
%% of refusal, another address, two robots of one number. Each is reported once;
%% {@link starl_live_hearing} has the texts.
-module(starl_live_peers).

-export([new/2, address/2, addresses/1, calls/1, heard/4, refused/5, unsent/4, look/2]).
-export([unnamed/2, asked/3, named/3, beat/3, beaten/5, life/2, proved/3, is_proved/2]).
-export([all/2]).

-export_type([t/0, place/0, address/0, trouble/0, news/0, peer/0]).

%% Where a robot hears, as its configuration says it.
-type place() :: {inet:hostname() | inet:ip_address(), inet:port_number()}.

-type address() :: {inet:ip_address(), inet:port_number()}.

%% Why it could not be called.
-type trouble() :: {unsent | unnamed, inet:posix()}.

%% News of a robot, or of nobody known.
-type news() ::
    {silent, starl:robot_id(), peer()}
    | {back, starl:robot_id(), SilentMs :: non_neg_integer() | never}
    | {refused, starl:robot_id() | address(), starl_live_refusals:reason()}
    | {moved, starl:robot_id(), address()}
    | {twice, starl:robot_id(), Heard :: speaker(), Refused :: speaker()}
    | {once, starl:robot_id()}
    | {unnamed, starl:robot_id(), inet:hostname(), inet:posix()}.

%% A life of a robot, or of another one of its number, and where it is.
-type speaker() :: {starl_live_seal:life(), address()}.

%% A robot, for its state: how long ago it was heard, where, and which of its lives; the difference of
%% its clock from ours and the round trip, as far as they are known; the refusals; why it may be silent;
%% the other robot of its number.
-type peer() :: #{
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
%% After so long between two looks this computer has stalled.
-define(STALLED_MS, 3000).

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

-record(peers, {
    peers :: #{starl:robot_id() => #peer{}},
    %% the last look, and the time since which this computer has not stalled
    looked_ms :: integer(),
    awake_ms :: integer(),
    %% datagrams of nobody known
    strange = starl_live_refusals:new() :: starl_live_refusals:t()
}).

-opaque t() :: #peers{}.

%% @doc Robots of whom nothing is known but these places.
-spec new(#{starl:robot_id() => place()}, NowMs :: integer()) -> t().
new(Places, Now) ->
    Peers = maps:map(fun(_, Place) -> #peer{place = Place, found = numeric(Place)} end, Places),
    #peers{peers = Peers, looked_ms = Now, awake_ms = Now}.

numeric({Host, Port}) when is_tuple(Host) -> {Host, Port};
numeric(_Place) -> none.

update(Robot, Change, #peers{peers = All} = Peers) ->
    Peers#peers{peers = maps:update_with(Robot, Change, All)}.

sorted(Map) -> lists:sort(maps:to_list(Map)).

%% -- addresses ------------------------------------------------------------------------------

%% @doc Where a robot is, as far as it is known.
-spec address(starl:robot_id(), t()) -> address() | none | unknown.
address(Robot, #peers{peers = Peers}) ->
    case Peers of
        #{Robot := Peer} -> address(Peer);
        #{} -> unknown
    end.

address(#peer{address = none, found = Found}) -> Found;
address(#peer{address = Address}) -> Address.

%% @doc Where all robots are whose address is known.
-spec addresses(t()) -> [address()].
addresses(#peers{peers = Peers}) ->
    [A || {_, Peer} <- sorted(Peers), A <- [address(Peer)], A =/= none].

%% @doc Where each robot is to be called: a silent one also where its name leads now.
-spec calls(t()) -> [{starl:robot_id(), address()}].
calls(#peers{peers = Peers}) ->
    [{Robot, A} || {Robot, Peer} <- sorted(Peers), A <- called_at(Peer)].

called_at(#peer{is_silent = true, address = Address, found = Found}) ->
    lists:usort([A || A <- [Address, Found], A =/= none]);
called_at(Peer) ->
    [A || A <- [address(Peer)], A =/= none].

%% @doc The robots whose names are to be looked up now.
-spec unnamed(NowMs :: integer(), t()) -> [{starl:robot_id(), inet:hostname()}].
unnamed(Now, #peers{peers = Peers}) ->
    [
        {Robot, Host}
     || {Robot, #peer{place = {Host, _}, asked_ms = Asked} = Peer} <- sorted(Peers),
        not is_tuple(Host),
        address(Peer) =:= none orelse Peer#peer.is_silent,
        is_over(Asked, ?LOOKUP_MS, Now)
    ].

is_over(none, _Ms, _Now) -> true;
is_over(At, Ms, Now) -> Now - At >= Ms.

%% @doc The name of a robot is being looked up.
-spec asked(starl:robot_id(), NowMs :: integer(), t()) -> t().
asked(Robot, Now, Peers) ->
    update(Robot, fun(Peer) -> Peer#peer{asked_ms = Now} end, Peers).

%% @doc Where the name of a robot leads.
-spec named(starl:robot_id(), {ok, inet:ip_address()} | {error, inet:posix()}, t()) ->
    {[news()], t()}.
named(Robot, Found, #peers{peers = All} = Peers) ->
    {News, Peer} = found(Robot, Found, maps:get(Robot, All)),
    {News, Peers#peers{peers = All#{Robot := Peer}}}.

found(_Robot, {ok, Ip}, #peer{place = {_, Port}} = Peer) ->
    {[], Peer#peer{found = {Ip, Port}, trouble = none}};
found(Robot, {error, Why}, #peer{place = {Host, _}, trouble = Before, asked_ms = Asked} = Peer) ->
    Trouble = {unnamed, Why},
    News = [{unnamed, Robot, Host, Why} || not is_same(Trouble, Before)],
    {News, Peer#peer{trouble = {Asked, Trouble}}}.

is_same(Trouble, {_, Trouble}) -> true;
is_same(_Trouble, _Before) -> false.

%% @doc A datagram could not be sent to this address.
-spec unsent(address(), inet:posix(), NowMs :: integer(), t()) -> t().
unsent(Address, Why, Now, #peers{peers = All} = Peers) ->
    Trouble = fun(Peer) -> Peer#peer{trouble = {Now, {unsent, Why}}} end,
    lists:foldl(fun(Robot, P) -> update(Robot, Trouble, P) end, Peers, at(Address, All)).

at(Address, All) -> [Robot || {Robot, Peer} <- sorted(All), address(Peer) =:= Address].

%% -- what is refused ------------------------------------------------------------------------

%% @doc A datagram was refused that claims to be this robot's, or came from this address. A robot's own
%% that come back from a group are nobody's.
-spec refused(
    starl:robot_id() | unknown,
    starl_live_refusals:reason(),
    address(),
    NowMs :: integer(),
    t()
) ->
    {[news()], t()}.
refused(_Robot, own, _Address, _Now, Peers) ->
    {[], Peers};
refused(Robot, Reason, Address, Now, #peers{peers = All, strange = Strange} = Peers) ->
    case [R || R <- [Robot | at(Address, All)], is_map_key(R, All)] of
        [Known | _] ->
            #{Known := #peer{refused = Before} = Peer} = All,
            {IsNews, Refused} = starl_live_refusals:add(Reason, Now, Before),
            Next = Peers#peers{peers = All#{Known := Peer#peer{refused = Refused}}},
            {[{refused, Known, Reason} || IsNews], Next};
        [] ->
            {IsNews, Refused} = starl_live_refusals:add(Reason, Now, Strange),
            {[{refused, Address, Reason} || IsNews], Peers#peers{strange = Refused}}
    end.

%% -- what is heard --------------------------------------------------------------------------

%% @doc An authentic datagram has come that was not heard before. `late': it is from a former life, and
%% was sent before the present one began; `former', `clone': it is not taken, since the robot is heard in
%% another life.
-spec heard(starl_live_seal:header(), address(), starl_live_seal:now(), t()) ->
    {heard | late | former | clone, [news()], t()}.
heard(#{from := Robot} = Said, Address, {_, Now} = At, #peers{peers = All} = Peers) ->
    #{Robot := Before} = All,
    {Verdict, Lived} = lived(Said, Address, At, Before),
    Peer = noted(Verdict, Said, Address, At, Lived),
    News = came_back(Robot, Now, Before, Peer) ++ lives(Robot, Address, Before, Peer),
    {Verdict, News, Peers#peers{peers = All#{Robot := Peer}}}.

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

%% -- beats ----------------------------------------------------------------------------------

%% @doc The content of a heartbeat for a robot: our monotonic time, the time of its last heartbeat,
%% and for how long we have had that (`none': we have none).
-spec beat(starl:robot_id(), NowUs :: integer(), t()) ->
    {NowUs :: integer(), EchoUs :: integer(), HeldUs :: non_neg_integer() | none}.
beat(Robot, Now, #peers{peers = All}) ->
    case All of
        #{Robot := #peer{beat = {Theirs, At}}} -> {Now, Theirs, Now - At};
        #{Robot := #peer{beat = none}} -> {Now, 0, none}
    end.

%% @doc A heartbeat of a robot has come: its echo of ours gives the round trip.
-spec beaten(starl:robot_id(), TheirUs :: integer(), {EchoUs, HeldUs}, NowUs :: integer(), t()) ->
    t()
when
    EchoUs :: integer(), HeldUs :: non_neg_integer() | none.
beaten(Robot, Theirs, {_Echo, none}, Now, Peers) ->
    update(Robot, fun(Peer) -> Peer#peer{beat = {Theirs, Now}} end, Peers);
beaten(Robot, Theirs, {Echo, Held}, Now, Peers) ->
    RoundTrip = max(0, Now - Echo - Held),
    Beaten = fun(Peer) -> Peer#peer{beat = {Theirs, Now}, round_trip_us = RoundTrip} end,
    update(Robot, Beaten, Peers).

%% @doc The life of a robot, as far as it was heard; 0: it was not.
-spec life(starl:robot_id(), t()) -> starl_live_seal:life().
life(Robot, #peers{peers = All}) ->
    case maps:get(Robot, All) of
        #peer{life = none} -> 0;
        #peer{life = Life} -> Life
    end.

%% @doc A heartbeat of a robot names our present life. So the robot sent it, and everything later,
%% in that life. A clock that was set back since shows an earlier time.
-spec proved(starl:robot_id(), SentMs :: integer(), t()) -> t().
proved(Robot, Sent, Peers) ->
    %% an atom is greater than any number
    Proved = fun(#peer{proved_ms = Ms} = Peer) -> Peer#peer{proved_ms = min(Sent, Ms)} end,
    update(Robot, Proved, Peers).

%% @doc Was a datagram certainly sent in our present life?
-spec is_proved(starl_live_seal:header(), t()) -> boolean().
is_proved(#{from := Robot, sent_ms := Sent}, #peers{peers = All}) ->
    #{Robot := #peer{proved_ms = Proved}} = All,
    Proved =/= none andalso Sent >= Proved.

%% -- silence --------------------------------------------------------------------------------

%% @doc Looks for robots that have fallen silent, each some time. When this computer itself has
%% stalled, they all get their time anew.
-spec look(NowMs :: integer(), t()) -> {[news()], t()}.
look(Now, #peers{peers = All, looked_ms = Looked, awake_ms = Awake0} = Peers) ->
    Awake =
        case Now - Looked >= ?STALLED_MS of
            true -> Now;
            false -> Awake0
        end,
    {News, Looks} = lists:mapfoldl(
        fun({Robot, Peer}, Acc) ->
            {Alone, Without} = without_twin(Robot, Now, Peer),
            {Silent, Next} = falls_silent(Robot, Now, Awake, Without),
            {Alone ++ Silent, Acc#{Robot := Next}}
        end,
        All,
        sorted(All)
    ),
    {lists:append(News), Peers#peers{peers = Looks, looked_ms = Now, awake_ms = Awake}}.

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

%% -- states ---------------------------------------------------------------------------------

%% @doc The state of all robots.
-spec all(NowMs :: integer(), t()) -> [peer()].
all(Now, #peers{peers = All}) -> [state(Robot, Now, Peer) || {Robot, Peer} <- sorted(All)].

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
