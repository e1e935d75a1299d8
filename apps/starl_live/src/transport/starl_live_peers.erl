%% @doc What a robot knows of the others by their datagrams: where each of them is, when it was last
%% heard, why its datagrams are refused, and which of two robots of the same number is heard. A pure
%% module; {@link starl_live_udp} asks it about each datagram.
%%
%% <em>Addresses.</em> The newest authentic datagram tells where a robot is, never one that is older or
%% was heard before, once nothing comes from its address any more: a robot of two networks does not move
%% with each datagram. One that is silent is called at its last address and at the one that its name has
%% now.
%%
%% <em>Lives.</em> Each start of a robot's program is a life of its own. A newer life takes the place of
%% the one before, of which only what was under way comes then. If both go on speaking there are two robots of one
%% number: the one that has started first is heard, so that all robots hear the same one, and the other
%% is refused until the first is silent.
%%
%% <em>Proof.</em> A robot that has just started cannot know what it took in its former life. A beat that
%% names its present life was sent in it; of each other robot it takes nothing that was sent before the
%% first such beat, which may be a record of what its former life has heard.
%%
%% <em>News</em> are what somebody should know: a robot that falls silent or is back, a new reason of
%% refusal, another address, two robots of one number. Each is told once; {@link starl_live_hearing} has
%% the words.
-module(starl_live_peers).

-export([new/2, address/2, addresses/1, calls/1, heard/4, refused/5, unsent/4, look/2]).
-export([unnamed/2, asked/3, named/3, beat/3, beaten/5, life/2, proved/3, is_proved/2]).
-export([all/2]).

-export_type([t/0, place/0, address/0, reason/0, trouble/0, news/0, peer/0]).

%% Where a robot hears, as its configuration says it.
-type place() :: {inet:hostname() | inet:ip_address(), inet:port_number()}.

-type address() :: {inet:ip_address(), inet:port_number()}.

%% Why a datagram of a robot was refused: {@link starl_live_seal:refusal()}, or those of its contents.
-type reason() :: starl_live_seal:refusal() | former | clone | unproved | atom().

%% Why it could not be called.
-type trouble() :: {unsent | unnamed, inet:posix()}.

-type news() ::
    {silent, starl:robot_id(), peer()}
    | {back, starl:robot_id(), SilentMs :: non_neg_integer() | never}
    | {refused, starl:robot_id() | address(), reason()}
    | {moved, starl:robot_id(), address()}
    | {twice, starl:robot_id(), Heard :: {starl_live_seal:life(), address()},
        Refused ::
            {starl_live_seal:life(), address()}}
    | {once, starl:robot_id()}
    | {unnamed, starl:robot_id(), inet:hostname(), inet:posix()}.

%% A robot, for its state: how long ago it was heard, where, and which of its lives; the difference of
%% its clock from ours and the round trip, as far as they are known; the refusals, by reason: their
%% number, how long ago the last one was, and by how much its clock was ahead then; why it may be silent;
%% the other robot of its number.
-type peer() :: #{
    robot := starl:robot_id(),
    is_silent := boolean(),
    heard_ms := non_neg_integer() | never,
    address := address() | none,
    life := starl_live_seal:life() | none,
    refused := #{atom() => #{count := pos_integer(), ago_ms := integer(), ahead_ms => integer()}},
    why := reason() | trouble() | none,
    ahead_ms => integer(),
    round_trip_us => non_neg_integer(),
    twin => {starl_live_seal:life(), address()}
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
%% What was refused within this time may be why a robot is silent.
-define(RECENT_MS, 10_000).
%% A reason that has not come up for this time is new.
-define(AGAIN_MS, 600_000).
%% Names are looked up again after this time.
-define(LOOKUP_MS, 5000).
%% The largest difference of clocks that is told: centuries.
-define(MOST_AHEAD_MS, 10_000_000_000_000).
%% Reasons that are usual, or somebody else's business: they are counted only.
-define(USUAL, [address, replay, former, clone, unproved]).

%% The other life of a robot's number: the one before, or that of another robot.
-record(other, {
    life :: starl_live_seal:life(),
    address :: address(),
    %% when it was heard first after the robot's present life had begun, and last
    first_ms = none :: integer() | none,
    last_ms = none :: integer() | none,
    is_twin = false :: boolean()
}).

-record(refusals, {
    count = 0 :: non_neg_integer(),
    last_ms :: integer(),
    ahead_ms = none :: integer() | none
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
    refused = #{} :: #{atom() => #refusals{}},
    %% why nothing could be sent to it, or its name not be found
    trouble = none :: {AtMs :: integer(), trouble()} | none,
    %% its last beat: its monotonic time, and ours
    beat = none :: {integer(), integer()} | none,
    round_trip_us = none :: non_neg_integer() | none
}).

-record(peers, {
    peers :: #{starl:robot_id() => #peer{}},
    %% the last look, and the time since which this computer has not stood still
    looked_ms :: integer(),
    awake_ms :: integer(),
    %% when a reason came up last in a datagram of nobody known
    strange = #{} :: #{atom() => integer()}
}).

-opaque t() :: #peers{}.

%% @doc Robots of whom nothing is known but these places.
-spec new(#{starl:robot_id() => place()}, NowMs :: integer()) -> t().
new(Places, Now) ->
    Peers = maps:map(fun(_, Place) -> #peer{place = Place, found = numeric(Place)} end, Places),
    #peers{peers = Peers, looked_ms = Now, awake_ms = Now}.

numeric({Host, Port}) when is_tuple(Host) -> {Host, Port};
numeric(_Place) -> none.

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

sorted(Map) -> lists:sort(maps:to_list(Map)).

%% @doc Where each robot is to be called: a silent one also where its name leads now.
-spec calls(t()) -> [{starl:robot_id(), address()}].
calls(#peers{peers = Peers}) ->
    [{Robot, A} || {Robot, Peer} <- sorted(Peers), A <- places(Peer)].

places(#peer{is_silent = true, address = Address, found = Found}) ->
    lists:usort([A || A <- [Address, Found], A =/= none]);
places(Peer) ->
    [A || A <- [address(Peer)], A =/= none].

%% @doc The robots whose names are to be looked up now.
-spec unnamed(NowMs :: integer(), t()) -> [{starl:robot_id(), inet:hostname()}].
unnamed(Now, #peers{peers = Peers}) ->
    [
        {Robot, Host}
     || {Robot, #peer{place = {Host, _}} = Peer} <- sorted(Peers),
        not is_tuple(Host),
        address(Peer) =:= none orelse Peer#peer.is_silent,
        is_over(Peer#peer.asked_ms, ?LOOKUP_MS, Now)
    ].

is_over(none, _Ms, _Now) -> true;
is_over(At, Ms, Now) -> Now - At >= Ms.

%% @doc The name of a robot is being looked up.
-spec asked(starl:robot_id(), NowMs :: integer(), t()) -> t().
asked(Robot, Now, Peers) -> update(Robot, fun(Peer) -> Peer#peer{asked_ms = Now} end, Peers).

%% @doc Where the name of a robot leads.
-spec named(starl:robot_id(), {ok, inet:ip_address()} | {error, inet:posix()}, t()) ->
    {[news()], t()}.
named(Robot, {ok, Ip}, Peers) ->
    Found = fun(#peer{place = {_, Port}} = Peer) ->
        Peer#peer{found = {Ip, Port}, trouble = none}
    end,
    {[], update(Robot, Found, Peers)};
named(Robot, {error, Why}, #peers{peers = All} = Peers) ->
    #{Robot := #peer{place = {Host, _}, trouble = Before, asked_ms = Asked}} = All,
    Trouble = {unnamed, Why},
    News = [{unnamed, Robot, Host, Why} || not is_same(Trouble, Before)],
    {News, update(Robot, fun(Peer) -> Peer#peer{trouble = {Asked, Trouble}} end, Peers)}.

is_same(Trouble, {_, Trouble}) -> true;
is_same(_Trouble, _Before) -> false.

update(Robot, Change, #peers{peers = All} = Peers) ->
    Peers#peers{peers = maps:update_with(Robot, Change, All)}.

%% -- what is heard --------------------------------------------------------------------------

%% @doc An authentic datagram has come that was not heard before. `late': it is from a former life, and
%% was sent before the present one began; `former', `clone': it is not taken, since the robot is heard in
%% another life.
-spec heard(starl_live_seal:header(), address(), starl_live_seal:now(), t()) ->
    {heard | late | former | clone, [news()], t()}.
heard(#{from := Robot} = Said, Address, {_, Now} = At, #peers{peers = All} = Peers) ->
    #{Robot := Before} = All,
    {Verdict, Lived} = lived(Said, Address, Now, Before),
    Noted = noted(Verdict, Said, Address, At, Lived),
    News = came_back(Robot, Now, Before, Noted) ++ lives(Robot, Address, Before, Noted),
    {Verdict, News, Peers#peers{peers = All#{Robot := Noted}}}.

%% Which life speaks: the present one, one that has begun later, or another.
lived(#{life := Life}, _Address, _Now, #peer{life = Life} = Peer) ->
    {heard, Peer};
lived(Said, Address, _Now, #peer{life = none} = Peer) ->
    {heard, begun(Said, Address, Peer)};
lived(#{life := Life} = Said, Address, Now, #peer{other = #other{life = Life} = Other} = Peer) ->
    lived_too(Said, spoken(Now, Address, Other), Now, Peer);
lived(#{life := Life, sent_ms := Sent} = Said, Address, _Now, Peer) when
    Life > Peer#peer.life, Sent >= Peer#peer.newest_ms
->
    {heard, begun(Said, Address, Peer)};
lived(#{life := Life} = Said, Address, Now, Peer) ->
    lived_too(Said, spoken(Now, Address, #other{life = Life, address = Address}), Now, Peer).

begun(#{life := Life, sent_ms := Sent}, Address, #peer{life = Former, heard_ms = Last} = Peer) ->
    Other =
        case Former of
            none -> none;
            _ -> #other{life = Former, address = Peer#peer.address, last_ms = Last}
        end,
    Peer#peer{
        life = Life,
        address = Address,
        since_ms = Sent,
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
lived_too(#{sent_ms := Sent}, Other, Now, #peer{since_ms = Since, heard_ms = Last} = Peer) when
    Sent =< Since, Now - Last < ?STALE_MS
->
    {late, Peer#peer{other = Other}};
lived_too(Said, #other{address = Address}, Now, #peer{heard_ms = Last} = Peer) when
    Now - Last >= ?BOTH_MS
->
    {heard, begun(Said, Address, Peer)};
lived_too(Said, #other{first_ms = First} = Other, Now, #peer{heard_ms = Last} = Peer) when
    Now - First >= ?BOTH_MS, Last > First
->
    twins(Said, Other, Peer);
lived_too(_Said, Other, _Now, Peer) ->
    {former, Peer#peer{other = Other}}.

%% The one that has started first is heard.
twins(#{life := Life} = Said, #other{address = Address} = Other, #peer{life = Present} = Peer) ->
    case Life < Present of
        true ->
            #peer{other = Former} = Elder = begun(Said, Address, Peer),
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
     || not is_twin(Before)
    ];
lives(Robot, _Address, #peer{other = Other}, _After) when Other#other.is_twin ->
    [{once, Robot}];
lives(Robot, Address, Before, #peer{address = Address}) ->
    [{moved, Robot, Address} || Was <- [address(Before)], Was =/= none, Was =/= Address];
lives(_Robot, _Address, _Before, _After) ->
    [].

is_twin(#other{is_twin = IsTwin}) -> IsTwin;
is_twin(none) -> false.

%% @doc A datagram was refused that claims to be this robot's, or came from this address. A robot's own
%% that come back from a group are nobody's.
-spec refused(starl:robot_id() | unknown, reason(), address(), NowMs :: integer(), t()) ->
    {[news()], t()}.
refused(_Robot, own, _Address, _Now, Peers) ->
    {[], Peers};
refused(Robot, Reason, Address, Now, #peers{peers = All} = Peers) ->
    case [R || R <- [Robot | at(Address, All)], is_map_key(R, All)] of
        [Known | _] -> refused_of(Known, Reason, Now, Peers);
        [] -> refused_strange(Reason, Address, Now, Peers)
    end.

at(Address, All) -> [Robot || {Robot, Peer} <- sorted(All), address(Peer) =:= Address].

refused_of(Robot, Reason, Now, #peers{peers = All} = Peers) ->
    Name = name(Reason),
    #{Robot := #peer{refused = Refused} = Peer} = All,
    Before = maps:get(Name, Refused, #refusals{last_ms = Now - ?AGAIN_MS}),
    News = [{refused, Robot, Reason} || is_new(Name, Before#refusals.last_ms, Now)],
    After = Before#refusals{
        count = Before#refusals.count + 1, last_ms = Now, ahead_ms = ahead(Reason)
    },
    {News, Peers#peers{peers = All#{Robot := Peer#peer{refused = Refused#{Name => After}}}}}.

refused_strange(Reason, Address, Now, #peers{strange = Strange} = Peers) ->
    Name = name(Reason),
    Last = maps:get(Name, Strange, Now - ?AGAIN_MS),
    News = [{refused, Address, Reason} || is_new(Name, Last, Now)],
    {News, Peers#peers{strange = Strange#{Name => Now}}}.

name({clock, _Ahead}) -> clock;
name(Reason) -> Reason.

%% An absurd time takes no more room than another.
ahead({clock, Ahead}) -> max(-?MOST_AHEAD_MS, min(?MOST_AHEAD_MS, Ahead));
ahead(_Reason) -> none.

is_new(Name, Last, Now) -> Now - Last >= ?AGAIN_MS andalso not lists:member(Name, ?USUAL).

%% @doc A datagram could not be sent to this address.
-spec unsent(address(), inet:posix(), NowMs :: integer(), t()) -> t().
unsent(Address, Why, Now, #peers{peers = All} = Peers) ->
    Trouble = fun(Peer) -> Peer#peer{trouble = {Now, {unsent, Why}}} end,
    lists:foldl(fun(Robot, P) -> update(Robot, Trouble, P) end, Peers, at(Address, All)).

%% -- beats ----------------------------------------------------------------------------------

%% @doc What a beat for a robot says: our monotonic time, that of its last beat, and for how long we
%% have had that (`none': we have none).
-spec beat(starl:robot_id(), NowUs :: integer(), t()) ->
    {NowUs :: integer(), EchoUs :: integer(), HeldUs :: non_neg_integer() | none}.
beat(Robot, Now, #peers{peers = All}) ->
    case All of
        #{Robot := #peer{beat = {Theirs, At}}} -> {Now, Theirs, Now - At};
        #{Robot := #peer{beat = none}} -> {Now, 0, none}
    end.

%% @doc A beat of a robot has come: its echo of ours tells the round trip.
-spec beaten(starl:robot_id(), TheirUs :: integer(), {EchoUs, HeldUs}, NowUs :: integer(), t()) ->
    t()
when
    EchoUs :: integer(), HeldUs :: non_neg_integer() | none.
beaten(Robot, Theirs, {_Echo, none}, Now, Peers) ->
    update(Robot, fun(Peer) -> Peer#peer{beat = {Theirs, Now}} end, Peers);
beaten(Robot, Theirs, {Echo, Held}, Now, Peers) ->
    Trip = max(0, Now - Echo - Held),
    update(
        Robot, fun(Peer) -> Peer#peer{beat = {Theirs, Now}, round_trip_us = Trip} end, Peers
    ).

%% @doc The life of a robot, as far as it was heard; 0: it was not.
-spec life(starl:robot_id(), t()) -> starl_live_seal:life().
life(Robot, #peers{peers = All}) ->
    case maps:get(Robot, All) of
        #peer{life = none} -> 0;
        #peer{life = Life} -> Life
    end.

%% @doc A beat of a robot names our present life: the robot sent it in that, and all that is later. A clock
%% that was set back since shows an earlier time.
-spec proved(starl:robot_id(), SentMs :: integer(), t()) -> t().
proved(Robot, Sent, Peers) ->
    update(
        Robot, fun(Peer) -> Peer#peer{proved_ms = earliest(Sent, Peer#peer.proved_ms)} end, Peers
    ).

earliest(Sent, none) -> Sent;
earliest(Sent, Proved) -> min(Sent, Proved).

%% @doc Was a datagram certainly sent in our present life?
-spec is_proved(starl_live_seal:header(), t()) -> boolean().
is_proved(#{from := Robot, sent_ms := Sent}, #peers{peers = All}) ->
    #{Robot := #peer{proved_ms = Proved}} = All,
    Proved =/= none andalso Sent >= Proved.

%% @doc Looks for robots that have fallen silent, each some time. When this computer itself has stood
%% still, they all get their time anew.
-spec look(NowMs :: integer(), t()) -> {[news()], t()}.
look(Now, #peers{peers = All, looked_ms = Looked, awake_ms = Awake0} = Peers) ->
    Awake =
        case Now - Looked >= ?BOTH_MS of
            true -> Now;
            false -> Awake0
        end,
    {News, Looks} = lists:mapfoldl(
        fun({Robot, Peer}, Acc) ->
            {Told, Next} = looked(Robot, Now, Awake, Peer),
            {Told, Acc#{Robot := Next}}
        end,
        All,
        sorted(All)
    ),
    {lists:append(News), Peers#peers{peers = Looks, looked_ms = Now, awake_ms = Awake}}.

looked(Robot, Now, Awake, Peer) ->
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
            {[{silent, Robot, shown(Robot, Now, Silent)}], Silent};
        false ->
            {[], Peer}
    end;
falls_silent(_Robot, _Now, _Awake, Peer) ->
    {[], Peer}.

patience(Awake, #peer{heard_ms = none}) -> {Awake, ?FIRST_MS};
patience(Awake, #peer{heard_ms = Last}) -> {max(Last, Awake), ?SILENT_MS}.

%% -- its state ------------------------------------------------------------------------------

%% @doc The state of all robots.
-spec all(NowMs :: integer(), t()) -> [peer()].
all(Now, #peers{peers = All}) -> [shown(Robot, Now, Peer) || {Robot, Peer} <- sorted(All)].

shown(Robot, Now, Peer) ->
    #peer{is_silent = IsSilent, heard_ms = Heard, life = Life, refused = Refused} = Peer,
    Known = #{
        robot => Robot,
        is_silent => IsSilent,
        heard_ms => silence(Now, Heard),
        address => address(Peer),
        life => Life,
        refused => maps:map(fun(_, Each) -> shown_refusals(Now, Each) end, Refused),
        why => why(Now, Peer)
    },
    More =
        [{ahead_ms, Ms} || Ms <- [Peer#peer.ahead_ms], Ms =/= none] ++
            [{round_trip_us, Us} || Us <- [Peer#peer.round_trip_us], Us =/= none] ++
            [{twin, {L, A}} || #other{life = L, address = A, is_twin = true} <- [Peer#peer.other]],
    maps:merge(Known, maps:from_list(More)).

shown_refusals(Now, #refusals{count = Count, last_ms = Last, ahead_ms = Ahead}) ->
    Shown = #{count => Count, ago_ms => Now - Last},
    case Ahead of
        none -> Shown;
        _ -> Shown#{ahead_ms => Ahead}
    end.

%% The latest refusal that is not usual, or else what kept us from calling it.
why(Now, #peer{refused = Refused, trouble = Trouble}) ->
    Recent = [
        {Last, reason(Name, Ahead)}
     || {Name, #refusals{last_ms = Last, ahead_ms = Ahead}} <- sorted(Refused),
        Now - Last < ?RECENT_MS,
        not lists:member(Name, ?USUAL)
    ],
    case {lists:reverse(lists:sort(Recent)), Trouble} of
        {[{_, Reason} | _], _} -> Reason;
        {[], {At, What}} when Now - At < ?RECENT_MS -> What;
        {[], _} -> none
    end.

reason(clock, Ahead) -> {clock, Ahead};
reason(Name, _Ahead) -> Name.
