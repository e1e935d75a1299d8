%% A robot that is given a geocast, event by event: what a clock that is set does to it.
-module(starl_geocast_flood_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 1}).
-define(AREA, {circle, {0.0, 0.0}, 1000.0}).
-define(LIFETIME, 1000000).

robot() ->
    Base = #{
        robot => 2,
        participants => [1, 2, 3],
        name => geocast,
        incarnation => 1,
        now => 0,
        random => rand:seed_s(exsss, 1)
    },
    Config = #{listeners => #{news => app}, drift_ppm => 0},
    {_, Machine} = starl_machine:new(starl_geocast_flood, Config, Base),
    Machine.

at(Now, Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => Now, robot => 2}, Machine).

message(Now, From, Message, Machine) -> at(Now, cast, {message, From, geocast, Message}, Machine).

offered(Now, From, Left, Machine) ->
    message(Now, From, {offer, ?ID, ?LIFETIME, Left, 5}, Machine).

given(Now, From, Asked, Left, Machine) ->
    Parcel = {?ID, ?AREA, news, hello, ?LIFETIME, Left, 5},
    message(Now, From, {give, Parcel, [{2, {1, Asked}}]}, Machine).

located(Now, N, Machine) -> at(Now, {reply, {where, N}}, {ok, {0.0, 0.0, 0.0}}, Machine).

traces(Actions) -> [Event || {trace, Event} <- starl_action:without_latest(Actions)].

%% Robot 2 has it from robot 1, and has delivered it.
delivered() ->
    {_, Asking} = offered(100, 1, 900000, robot()),
    {Held, Holding} = given(200, 1, 100, 900000, Asking),
    ?assertEqual([{held, ?ID, 1}], traces(Held)),
    {Told, Delivered} = located(200, 1, Holding),
    ?assertMatch([{delivered, ?ID, _}], traces(Told)),
    Delivered.

%% A clock that is put forward forgets the id too early: the message is held again, for the
%% others, and not delivered again.
not_again_test() ->
    {[], Over} = at(5000000, {timeout, {forget, ?ID}}, forget, delivered()),
    {_, Asking} = offered(5000000, 3, 500000, Over),
    {Held, Holding} = given(5000100, 3, 5000000, 500000, Asking),
    ?assertEqual([{held, ?ID, 3}], traces(Held)),
    {Told, _} = located(5000100, 2, Holding),
    ?assertEqual([], traces(Told)).

%% A clock that is set back after the question lets the message live longer than its id is known.
forgotten_before_it_is_over_test() ->
    {_, Asking} = offered(5000000, 1, 900000, robot()),
    {_, Holding} = given(2000000, 1, 5000000, 900000, Asking),
    {[], Forgotten} = at(3000000, {timeout, {forget, ?ID}}, forget, Holding),
    {_, Over} = at(5900000, {timeout, {over, ?ID}}, over, Forgotten),
    %% and is not known for ever
    {Asked, _} = offered(5900001, 1, 100, Over),
    ?assertMatch([{transmit, 1, _} | _], Asked).

%% Whose deadline it is that counts is told; a worse one is not taken.
better_deadline_test() ->
    {_, Asking} = offered(300, 3, 990000, delivered()),
    {Better, Prolonged} = given(400, 3, 300, 990000, Asking),
    ?assertEqual([{held, ?ID, 3}], traces(Better)),
    {Worse, _} = given(500, 1, 300, 980000, Prolonged),
    ?assertEqual([], traces(Worse)).

%% A delivery that was too late has not been: the message waits again, and is delivered once.
%% Holds: A message delivered to an area is delivered at a position that is fresh
%% Red: 1822124, run
late_delivery_waits_again_test() ->
    {Where, Waits} = at(300, info, {late, {delivered, ?ID}}, delivered()),
    ?assertMatch([{call, location, {pose, 2}, {where, 2}} | _], Where),
    {Told, Delivered} = located(400, 2, Waits),
    ?assertMatch([{delivered, ?ID, _}], traces(Told)),
    %% one whose life is over meanwhile is not
    {_, Over} = at(900000, {timeout, {over, ?ID}}, over, Delivered),
    ?assertEqual([], element(1, at(900000, info, {late, {delivered, ?ID}}, Over))).
