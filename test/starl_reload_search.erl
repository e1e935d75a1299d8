%% A search for the tests of reloads: robot 1 gives the rooms out, each robot visits a room and
%% reports it, until robot 1 knows that all are searched and tells everybody.
-module(starl_reload_search).
-behaviour(starl_app).

-export([blocks/0, options/0, init/2, step/2]).

-define(WAIT_MS, 2000).

blocks() -> [].

options() -> [{rooms, {integer, 1, 100}, 6, "the number of rooms"}].

init(Robot, #{rooms := Rooms}) ->
    starl:listen(Robot, word),
    case starl:id(Robot) of
        1 -> {leads, lists:seq(1, Rooms), []};
        _ -> asks
    end.

%% The leader knows the rooms to be given out, and those that somebody searches.
step(Robot, {leads, [], []}) ->
    [starl:send(Robot, R, word, done) || R <- starl:participants(Robot), R =/= 1],
    {done, all_searched};
step(Robot, {leads, Left, Open}) ->
    case starl:await(Robot, word, ?WAIT_MS) of
        {ok, From, asks} -> {continue, give(Robot, From, Left, Open)};
        {ok, _, {searched, Room}} -> {continue, {leads, Left -- [Room], Open -- [Room]}};
        timeout -> {continue, {leads, lists:usort(Left ++ Open), []}}
    end;
step(Robot, asks) ->
    _ = starl:send(Robot, 1, word, asks),
    case starl:await(Robot, word, ?WAIT_MS) of
        {ok, _, {room, Room}} -> {continue, {searches, Room}};
        {ok, _, done} -> {done, told};
        timeout -> {continue, asks}
    end;
step(Robot, {searches, Room}) ->
    _ = starl:go_to(Robot, place(starl:id(Robot), Room)),
    _ = starl:send(Robot, 1, word, {searched, Room}),
    {continue, asks}.

give(_Robot, _From, [], Open) ->
    {leads, [], Open};
give(Robot, From, [Room | Left], Open) ->
    _ = starl:send(Robot, From, word, {room, Room}),
    {leads, Left, [Room | Open]}.

%% Each robot has a lane of its own.
place(Robot, Room) -> {1000.0 + 300.0 * (Room rem 5), 1000.0 + 2000.0 * Robot}.
