%% @doc Keeps what a robot knows of the others from their datagrams. That is the address of each,
%% when it was last heard, why its datagrams are refused, and which of two robots of the same number
%% is heard. A pure module; {@link starl_live_udp} asks it about each datagram, and
%% {@link starl_live_peer} keeps what is known of a single robot.
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

-export_type([t/0, place/0, address/0, reason/0, trouble/0, news/0, peer/0]).

-type place() :: starl_live_peer:place().
-type address() :: starl_live_peer:address().
-type reason() :: starl_live_refusals:reason().
-type trouble() :: starl_live_peer:trouble().

%% News of a robot, or of nobody known.
-type news() :: starl_live_peer:news() | {refused, address(), reason()}.

%% The state of a robot.
-type peer() :: starl_live_peer:state().

%% After so long between two looks this computer has stood still.
-define(STILL_MS, 3000).

-record(peers, {
    peers :: #{starl:robot_id() => starl_live_peer:t()},
    %% the last look, and the time since which this computer has not stood still
    looked_ms :: integer(),
    awake_ms :: integer(),
    %% datagrams of nobody known
    strange = starl_live_refusals:new() :: starl_live_refusals:t()
}).

-opaque t() :: #peers{}.

%% @doc Robots of whom nothing is known but these places.
-spec new(#{starl:robot_id() => place()}, NowMs :: integer()) -> t().
new(Places, Now) ->
    Peers = maps:map(fun(_, Place) -> starl_live_peer:new(Place) end, Places),
    #peers{peers = Peers, looked_ms = Now, awake_ms = Now}.

%% -- addresses ------------------------------------------------------------------------------

%% @doc Where a robot is, as far as it is known.
-spec address(starl:robot_id(), t()) -> address() | none | unknown.
address(Robot, #peers{peers = Peers}) ->
    case Peers of
        #{Robot := Peer} -> starl_live_peer:address(Peer);
        #{} -> unknown
    end.

%% @doc Where all robots are whose address is known.
-spec addresses(t()) -> [address()].
addresses(#peers{peers = Peers}) ->
    [A || {_, Peer} <- sorted(Peers), A <- [starl_live_peer:address(Peer)], A =/= none].

sorted(Map) -> lists:sort(maps:to_list(Map)).

%% @doc Where each robot is to be called: a silent one also where its name leads now.
-spec calls(t()) -> [{starl:robot_id(), address()}].
calls(#peers{peers = Peers}) ->
    [{Robot, A} || {Robot, Peer} <- sorted(Peers), A <- starl_live_peer:calls(Peer)].

%% @doc The robots whose names are to be looked up now.
-spec unnamed(NowMs :: integer(), t()) -> [{starl:robot_id(), inet:hostname()}].
unnamed(Now, #peers{peers = Peers}) ->
    [{Robot, Host} || {Robot, Peer} <- sorted(Peers), Host <- starl_live_peer:unnamed(Now, Peer)].

%% @doc The name of a robot is being looked up.
-spec asked(starl:robot_id(), NowMs :: integer(), t()) -> t().
asked(Robot, Now, Peers) ->
    update(Robot, fun(Peer) -> starl_live_peer:asked(Now, Peer) end, Peers).

%% @doc Where the name of a robot leads.
-spec named(starl:robot_id(), {ok, inet:ip_address()} | {error, inet:posix()}, t()) ->
    {[news()], t()}.
named(Robot, Found, Peers) ->
    noted(Robot, fun(Peer) -> starl_live_peer:named(Robot, Found, Peer) end, Peers).

update(Robot, Change, #peers{peers = All} = Peers) ->
    Peers#peers{peers = maps:update_with(Robot, Change, All)}.

%% A change that may be news.
noted(Robot, Change, #peers{peers = All} = Peers) ->
    {News, Peer} = Change(maps:get(Robot, All)),
    {News, Peers#peers{peers = All#{Robot := Peer}}}.

%% -- what is heard --------------------------------------------------------------------------

%% @doc An authentic datagram has come that was not heard before. `late': it is from a former life, and
%% was sent before the present one began; `former', `clone': it is not taken, since the robot is heard in
%% another life.
-spec heard(starl_live_seal:header(), address(), starl_live_seal:now(), t()) ->
    {heard | late | former | clone, [news()], t()}.
heard(#{from := Robot} = Said, Address, At, #peers{peers = All} = Peers) ->
    #{Robot := Before} = All,
    {Verdict, News, Peer} = starl_live_peer:heard(Said, Address, At, Before),
    {Verdict, News, Peers#peers{peers = All#{Robot := Peer}}}.

%% @doc A datagram was refused that claims to be this robot's, or came from this address. A robot's own
%% that come back from a group are nobody's.
-spec refused(starl:robot_id() | unknown, reason(), address(), NowMs :: integer(), t()) ->
    {[news()], t()}.
refused(_Robot, own, _Address, _Now, Peers) ->
    {[], Peers};
refused(Robot, Reason, Address, Now, #peers{peers = All} = Peers) ->
    case [R || R <- [Robot | at(Address, All)], is_map_key(R, All)] of
        [Known | _] ->
            noted(Known, fun(P) -> starl_live_peer:refused(Known, Reason, Now, P) end, Peers);
        [] ->
            refused_strange(Reason, Address, Now, Peers)
    end.

at(Address, All) ->
    [Robot || {Robot, Peer} <- sorted(All), starl_live_peer:address(Peer) =:= Address].

refused_strange(Reason, Address, Now, #peers{strange = Strange} = Peers) ->
    {IsNews, Known} = starl_live_refusals:add(Reason, Now, Strange),
    {[{refused, Address, Reason} || IsNews], Peers#peers{strange = Known}}.

%% @doc A datagram could not be sent to this address.
-spec unsent(address(), inet:posix(), NowMs :: integer(), t()) -> t().
unsent(Address, Why, Now, #peers{peers = All} = Peers) ->
    Trouble = fun(Peer) -> starl_live_peer:unsent(Why, Now, Peer) end,
    lists:foldl(fun(Robot, P) -> update(Robot, Trouble, P) end, Peers, at(Address, All)).

%% -- beats ----------------------------------------------------------------------------------

%% @doc The content of a heartbeat for a robot: our monotonic time, the time of its last heartbeat,
%% and for how long we have had that (`none': we have none).
-spec beat(starl:robot_id(), NowUs :: integer(), t()) ->
    {NowUs :: integer(), EchoUs :: integer(), HeldUs :: non_neg_integer() | none}.
beat(Robot, Now, #peers{peers = All}) -> starl_live_peer:beat(Now, maps:get(Robot, All)).

%% @doc A heartbeat of a robot has come: its echo of ours gives the round trip.
-spec beaten(starl:robot_id(), TheirUs :: integer(), {EchoUs, HeldUs}, NowUs :: integer(), t()) ->
    t()
when
    EchoUs :: integer(), HeldUs :: non_neg_integer() | none.
beaten(Robot, Theirs, Echo, Now, Peers) ->
    update(Robot, fun(Peer) -> starl_live_peer:beaten(Theirs, Echo, Now, Peer) end, Peers).

%% @doc The life of a robot, as far as it was heard; 0: it was not.
-spec life(starl:robot_id(), t()) -> starl_live_seal:life().
life(Robot, #peers{peers = All}) -> starl_live_peer:life(maps:get(Robot, All)).

%% @doc A heartbeat of a robot names our present life. So the robot sent it, and everything later,
%% in that life. A clock that was set back since shows an earlier time.
-spec proved(starl:robot_id(), SentMs :: integer(), t()) -> t().
proved(Robot, Sent, Peers) ->
    update(Robot, fun(Peer) -> starl_live_peer:proved(Sent, Peer) end, Peers).

%% @doc Was a datagram certainly sent in our present life?
-spec is_proved(starl_live_seal:header(), t()) -> boolean().
is_proved(#{from := Robot, sent_ms := Sent}, #peers{peers = All}) ->
    starl_live_peer:is_proved(Sent, maps:get(Robot, All)).

%% @doc Looks for robots that have fallen silent, each some time. When this computer itself has stood
%% still, they all get their time anew.
-spec look(NowMs :: integer(), t()) -> {[news()], t()}.
look(Now, #peers{peers = All, looked_ms = Looked, awake_ms = Awake0} = Peers) ->
    Awake =
        case Now - Looked >= ?STILL_MS of
            true -> Now;
            false -> Awake0
        end,
    {News, Looks} = lists:mapfoldl(
        fun({Robot, Peer}, Acc) ->
            {Told, Next} = starl_live_peer:look(Robot, Now, Awake, Peer),
            {Told, Acc#{Robot := Next}}
        end,
        All,
        sorted(All)
    ),
    {lists:append(News), Peers#peers{peers = Looks, looked_ms = Now, awake_ms = Awake}}.

%% @doc The state of all robots.
-spec all(NowMs :: integer(), t()) -> [peer()].
all(Now, #peers{peers = All}) ->
    [starl_live_peer:state(Robot, Now, Peer) || {Robot, Peer} <- sorted(All)].
