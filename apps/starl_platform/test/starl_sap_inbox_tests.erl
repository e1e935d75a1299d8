%% To whom messages go, which of them wait for a listener, and which are not taken.
-module(starl_sap_inbox_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {2, 1, 7}).

new() -> starl_sap_inbox:new(2).

deliver(Type, Body, Inbox) -> starl_sap_inbox:deliver(2, Type, Body, ?ID, Inbox).

%% Delivers a message that is taken.
taken(Type, Body, Inbox) ->
    {_, Next} = deliver(Type, Body, Inbox),
    Next.

traced(Type, Body) -> {trace, {delivered, ?ID, Type, erlang:phash2(Body)}}.

message(Machine, Type, Body) -> {cast, Machine, {message, 2, Type, Body}}.

listening(Type, Machine, Inbox) ->
    {[], Next} = starl_sap_inbox:listen(Type, Machine, Inbox),
    Next.

to_its_listener_test() ->
    Inbox = listening(t, door, listening(u, window, new())),
    ?assertEqual({[traced(t, a), message(door, t, a)], Inbox}, deliver(t, a, Inbox)),
    ?assertEqual({[traced(u, b), message(window, u, b)], Inbox}, deliver(u, b, Inbox)).

%% Messages wait for a listener, so many in all; who listens gets its own, the oldest first.
waits_for_a_listener_test() ->
    {[T1], One} = deliver(t, a, new()),
    ?assertEqual(traced(t, a), T1),
    Three = starl_sap_inbox:new(3),
    Full = taken(t, c, taken(u, b, taken(t, a, Three))),
    ?assertEqual(unclaimed_full, deliver(t, d, Full)),
    {Waited, Next} = starl_sap_inbox:listen(t, door, Full),
    ?assertEqual([message(door, t, a), message(door, t, c)], Waited),
    ?assertEqual([], element(1, starl_sap_inbox:listen(t, door, Next))),
    ?assertEqual([message(bell, u, b)], element(1, starl_sap_inbox:listen(u, bell, Next))),
    ?assertEqual([message(door, t, a)], element(1, starl_sap_inbox:listen(t, door, One))).

%% The limit is met exactly; of none, nothing waits.
limit_test() ->
    One = taken(t, a, new()),
    ?assertMatch({[_], _}, deliver(t, b, One)),
    ?assertEqual(unclaimed_full, deliver(t, c, taken(t, b, One))),
    ?assertEqual(unclaimed_full, deliver(t, a, starl_sap_inbox:new(0))).

%% What has been handed on makes room for others to wait.
handed_on_makes_room_test() ->
    {_, Next} = starl_sap_inbox:listen(t, door, taken(t, b, taken(t, a, new()))),
    ?assertMatch({[_], _}, deliver(u, c, taken(u, d, Next))).

%% A type has one listener, which may say so again.
one_listener_test() ->
    Inbox = listening(t, door, new()),
    ?assertEqual({held_by, door}, starl_sap_inbox:listen(t, window, Inbox)),
    ?assertEqual({[], Inbox}, starl_sap_inbox:listen(t, door, Inbox)),
    ?assertMatch({[], _}, starl_sap_inbox:listen(u, window, Inbox)).

%% A listener that keeps messages is given as many as it has room for, and more when it has read.
room_test() ->
    Inbox = starl_sap_inbox:room(app, 2, listening(t, app, new())),
    One = taken(t, a, Inbox),
    Two = taken(t, b, One),
    ?assertEqual(full, deliver(t, c, Two)),
    {[], Read} = starl_sap_inbox:read(app, 1, Two),
    ?assertEqual([traced(t, c), message(app, t, c)], element(1, deliver(t, c, Read))),
    ?assertEqual(full, deliver(t, d, taken(t, c, Read))),
    {[], Both} = starl_sap_inbox:read(app, 2, Two),
    ?assertEqual(full, deliver(t, e, taken(t, d, taken(t, c, Both)))).

%% The room is the machine's, for all types together, and of no other machine.
room_of_all_types_test() ->
    Two = listening(u, app, listening(t, app, listening(v, door, new()))),
    Full = taken(u, a, starl_sap_inbox:room(app, 1, Two)),
    ?assertEqual([full, full], [deliver(T, b, Full) || T <- [t, u]]),
    ?assertMatch({[_, _], _}, deliver(v, c, Full)).

%% What it says of its room counts, whatever it had.
room_again_test() ->
    Inbox = starl_sap_inbox:room(app, 5, listening(t, app, new())),
    ?assertEqual(full, deliver(t, a, starl_sap_inbox:room(app, 0, Inbox))),
    ?assertMatch({_, _}, deliver(t, a, starl_sap_inbox:room(app, 1, Inbox))).

%% Who has not said what room it has is told everything; that it has read is nothing new.
read_without_room_test() ->
    Inbox = listening(t, app, new()),
    ?assertEqual({[], Inbox}, starl_sap_inbox:read(app, 3, Inbox)).

%% What waits goes as far as there is room; the rest waits on, in its order, and comes with reading.
waits_for_room_test() ->
    Waiting = taken(t, c, taken(t, b, taken(t, a, starl_sap_inbox:new(3)))),
    Roomy = starl_sap_inbox:room(app, 1, Waiting),
    {First, Left} = starl_sap_inbox:listen(t, app, Roomy),
    ?assertEqual([message(app, t, a)], First),
    {Rest, Empty} = starl_sap_inbox:read(app, 2, Left),
    ?assertEqual([message(app, t, b), message(app, t, c)], Rest),
    ?assertMatch({[], _}, starl_sap_inbox:read(app, 0, Empty)),
    ?assertEqual(full, deliver(t, d, Empty)).

%% A datagram goes to who listens, by its plain name, and waits for nobody; it takes no room.
overhear_test() ->
    Overheard = fun(Type, Inbox) -> starl_sap_inbox:overhear(2, Type, hi, Inbox) end,
    ?assertEqual({trace, {unheard, 2, {app, t}}}, Overheard({app, t}, new())),
    ?assertEqual({trace, {unheard, 2, t}}, Overheard(t, new())),
    Inbox = listening(t, door, listening({app, t}, app, new())),
    ?assertEqual(message(app, t, hi), Overheard({app, t}, starl_sap_inbox:room(app, 0, Inbox))),
    ?assertEqual(message(door, t, hi), Overheard(t, Inbox)).
