%% @doc The mail between shards. At the end of a window each shard sends to all others the data that
%% they need to agree on the next window, and the packets for their robots. No shard goes on before
%% it has the mail of all others, so each peer is at most one mail ahead.
-module(starl_sim_mail).

-export([new/2, peers/1, is_own/2, tell/4, tell_held/3, await/2, keep/2, deliver/1]).

-export_type([t/0, mail/0, content/0, news/0]).

-record(mail, {
    peers :: [pid()],
    owners :: #{starl:robot_id() => pid()},
    %% mail of peers that were told to run before this shard, newest first
    early = [] :: [mail()]
}).

-opaque t() :: #mail{}.

-type mail() :: {mail, Peer :: pid(), Window :: pos_integer(), content()}.

%% The news of a window, or the time at which a robot was held in it.
-type content() :: news() | {held, starl_sim_queue:time()}.

%% The time of the sender's next event; the number of applications that have ended; new pieces of
%% motion by robot; events for the receiver's robots.
-type news() :: {
    Next :: starl_sim_queue:time() | infinity,
    Ended :: non_neg_integer(),
    Moved :: [{starl:robot_id(), starl_trajectory:piece()}],
    Events :: [starl_sim_queue:event()]
}.

%% @doc A shard's mail with these peers; `Owners' gives the shard of each robot.
-spec new(Peers :: [pid()], Owners :: #{starl:robot_id() => pid()}) -> t().
new(Peers, Owners) -> #mail{peers = Peers, owners = Owners}.

%% @doc The other shards.
-spec peers(t()) -> [pid()].
peers(#mail{peers = Peers}) -> Peers.

%% @doc Does the calling shard have this robot?
-spec is_own(starl:robot_id(), t()) -> boolean().
is_own(Id, #mail{owners = Owners}) ->
    case Owners of
        #{Id := Shard} -> Shard =:= self();
        #{} -> false
    end.

%% @doc Sends all peers the news of the N-th window. Events for the shard's own robots go to its
%% queue. Returns its own news.
-spec tell(N :: non_neg_integer(), Yields, starl_sim_queue:t(), t()) ->
    {news(), starl_sim_queue:t()}
when
    Yields :: starl_sim_window:yields().
tell(_N, #{later := Later, moved := Moved, ended := Ended}, Queue, #mail{peers = []}) ->
    Own = starl_sim_queue:add_all(Later, Queue),
    {{starl_sim_queue:next_time(Own), Ended, Moved, []}, Own};
tell(N, #{later := Later, moved := Moved, ended := Ended}, Queue, Mail) ->
    #mail{peers = Peers, owners = Owners} = Mail,
    ByShard = maps:groups_from_list(fun(E) -> maps:get(element(1, E), Owners) end, Later),
    Own = starl_sim_queue:add_all(maps:get(self(), ByShard, []), Queue),
    Times = [Time || {_, Time, _, _, _, _} <- Later],
    %% whole numbers sort before the atom infinity
    Next = lists:min([starl_sim_queue:next_time(Own) | Times]),
    _ = [send(Peer, N, {Next, Ended, Moved, maps:get(Peer, ByShard, [])}) || Peer <- Peers],
    {{Next, Ended, Moved, []}, Own}.

%% @doc Tells all peers that a robot was held in the N-th window.
-spec tell_held(N :: pos_integer(), starl_sim_queue:time(), t()) -> ok.
tell_held(N, At, #mail{peers = Peers}) ->
    lists:foreach(fun(Peer) -> send(Peer, N, {held, At}) end, Peers).

send(Peer, N, Content) -> Peer ! {mail, self(), N, Content}.

%% @doc Waits for a peer's mail of the N-th window. A shard that must abandon the run stops waiting
%% for the other peers, too.
-spec await(Peer :: pid(), N :: non_neg_integer()) -> content() | abandoned.
await(Peer, N) ->
    receive
        {mail, Peer, N, Content} ->
            Content;
        abandon ->
            self() ! abandon,
            abandoned
    end.

%% @doc Keeps a mail that arrived before the shard got the command to run.
-spec keep(mail(), t()) -> t().
keep(Early, #mail{early = Others} = Mail) -> Mail#mail{early = [Early | Others]}.

%% @doc Delivers the mail that was kept.
-spec deliver(t()) -> t().
deliver(#mail{early = Early} = Mail) ->
    _ = [self() ! Each || Each <- Early],
    Mail#mail{early = []}.
