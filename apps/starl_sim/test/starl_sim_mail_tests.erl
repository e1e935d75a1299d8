%% What shards tell each other: everything that all must know, and each packet to one of them.
-module(starl_sim_mail_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MOVED, [{1, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}]).

%% Alone, a shard keeps all events, and its news is its own.
alone_test() ->
    Mail = starl_sim_mail:new([], #{1 => self(), 2 => self()}),
    {News, Queue} = starl_sim_mail:tell(1, yields([event(1, 40), event(2, 30)]), queue(), Mail),
    ?assertEqual({30, 1, ?MOVED, []}, News),
    ?assertEqual(2, starl_sim_queue:size(Queue)).

%% Each peer gets the events of its own robots, and all get the same news: the next event is the
%% earliest of all, whoever it is for.
every_event_to_one_shard_test() ->
    {Peer, Other} = {peer(), peer()},
    Mail = starl_sim_mail:new([Peer, Other], #{1 => self(), 2 => Peer, 3 => Other}),
    Later = [event(1, 40), event(2, 30), event(3, 50), event(2, 60)],
    {News, Queue} = starl_sim_mail:tell(7, yields(Later), queue(), Mail),
    ?assertEqual({30, 1, ?MOVED, []}, News),
    ?assertEqual(40, starl_sim_queue:next_time(Queue)),
    ?assertEqual([{mail, self(), 7, {30, 1, ?MOVED, [event(2, 30), event(2, 60)]}}], inbox(Peer)),
    ?assertEqual([{mail, self(), 7, {30, 1, ?MOVED, [event(3, 50)]}}], inbox(Other)).

%% An event that was in the queue before may be the next one.
earlier_event_is_the_next_test() ->
    Peer = peer(),
    Mail = starl_sim_mail:new([Peer], #{1 => self(), 2 => Peer}),
    Queue = starl_sim_queue:add(event(1, 20), queue()),
    {News, _} = starl_sim_mail:tell(1, yields([event(2, 30)]), Queue, Mail),
    ?assertEqual({20, 1, ?MOVED, []}, News),
    ?assertEqual([{mail, self(), 1, {20, 1, ?MOVED, [event(2, 30)]}}], inbox(Peer)).

%% Without any event the next one is infinitely far.
quiet_test() ->
    Peer = peer(),
    Mail = starl_sim_mail:new([Peer], #{1 => self()}),
    {{infinity, 1, _, []}, _} = starl_sim_mail:tell(1, yields([]), queue(), Mail),
    ?assertMatch([{mail, _, 1, {infinity, 1, _, []}}], inbox(Peer)).

held_is_told_to_all_test() ->
    Peers = [peer(), peer()],
    ok = starl_sim_mail:tell_held(3, 99, starl_sim_mail:new(Peers, #{})),
    ?assertEqual([[{mail, self(), 3, {held, 99}}] || _ <- Peers], [inbox(Peer) || Peer <- Peers]).

%% Mail of another window or peer is left; what came early comes again when it is wanted.
await_takes_the_right_one_test() ->
    Peer = peer(),
    Early = starl_sim_mail:keep({mail, Peer, 2, second}, starl_sim_mail:new([Peer], #{})),
    self() ! {mail, self(), 1, of_another},
    self() ! {mail, Peer, 1, first},
    _ = starl_sim_mail:deliver(starl_sim_mail:deliver(Early)),
    ?assertEqual(second, starl_sim_mail:await(Peer, 2)),
    ?assertEqual(first, starl_sim_mail:await(Peer, 1)),
    ?assertEqual(of_another, starl_sim_mail:await(self(), 1)),
    ?assertEqual([], [Left || {mail, _, _, _} = Left <- inbox(self())]).

%% All that came early comes, not only the latest.
all_that_was_kept_comes_test() ->
    {Peer, Other} = {peer(), peer()},
    Kept = lists:foldl(
        fun starl_sim_mail:keep/2,
        starl_sim_mail:new([Peer, Other], #{}),
        [{mail, Peer, 1, of_peer}, {mail, Other, 1, of_other}]
    ),
    _ = starl_sim_mail:deliver(Kept),
    ?assertEqual(
        [of_peer, of_other], [starl_sim_mail:await(P, 1) || P <- starl_sim_mail:peers(Kept)]
    ).

%% Told to abandon the run, a shard waits for none of its peers.
abandoned_test() ->
    self() ! abandon,
    ?assertEqual(abandoned, starl_sim_mail:await(peer(), 1)),
    ?assertEqual(abandoned, starl_sim_mail:await(peer(), 1)),
    receive
        abandon -> ok
    end.

own_robots_test() ->
    Mail = starl_sim_mail:new([], #{1 => self(), 2 => peer()}),
    ?assertEqual([true, false, false], [starl_sim_mail:is_own(Id, Mail) || Id <- [1, 2, 9]]).

yields(Later) -> #{later => Later, moved => ?MOVED, ended => 1, trace => []}.

event(Robot, Time) -> {Robot, Time, 2, 1, 0, x}.

queue() -> starl_sim_queue:new(10).

%% A process whose inbox shows what was sent to it; it ends with the test.
peer() ->
    spawn_link(fun() ->
        receive
            never -> ok
        end
    end).

inbox(Pid) ->
    {messages, Messages} = process_info(Pid, messages),
    Messages.
