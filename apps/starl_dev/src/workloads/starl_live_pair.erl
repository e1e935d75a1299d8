%% @doc A pair of robots that measure their messages, in real time. Robot 1 sends messages one by
%% one and times each until it is acknowledged. Then it posts many at once, and robot 2 counts them.
%% Further robots do nothing. Robot 1 returns the times in microseconds, robot 2 the time from the
%% first to the last of the posted messages.
-module(starl_live_pair).
-behaviour(starl_app).

-export([options/0, blocks/0, init/2, step/2]).

%% Posted messages that are under way at the same time.
-define(AT_ONCE, 200).

-type state() ::
    idle
    | {send, N :: integer(), Posts :: integer()}
    | {count, Sends :: integer(), Posts :: integer()}.

-spec options() -> [starl_options:option()].
options() ->
    [
        {sends, {integer, 1, 1000000}, 1000, "messages sent one by one"},
        {posts, {integer, 1, 1000000}, 1000, "messages posted at once"}
    ].

-spec blocks() -> [].
blocks() -> [].

-spec init(starl:robot(), #{sends := pos_integer(), posts := pos_integer()}) -> state().
init(Robot, #{sends := Sends, posts := Posts}) ->
    case starl:id(Robot) of
        1 -> {send, Sends, Posts};
        2 -> listen(Robot, {count, Sends, Posts});
        _ -> idle
    end.

listen(Robot, State) ->
    starl:listen(Robot, ping),
    starl:listen(Robot, post),
    State.

-spec step(starl:robot(), state()) -> {done, term()}.
step(_Robot, idle) ->
    {done, idle};
step(Robot, {send, Sends, Posts}) ->
    Times = [timed(Robot, N) || N <- lists:seq(1, Sends)],
    post(Robot, 1, Posts),
    {done, Times};
step(Robot, {count, Sends, Posts}) ->
    _ = [{ok, _, _} = starl:await(Robot, ping) || _ <- lists:seq(1, Sends)],
    {done, counted(Robot, Posts, none)}.

%% In real time the clock of the VM measures.
timed(Robot, N) ->
    Begin = erlang:monotonic_time(microsecond),
    ok = starl:send(Robot, 2, ping, N),
    erlang:monotonic_time(microsecond) - Begin.

%% The last of a batch is awaited.
post(Robot, N, Posts) when N >= Posts ->
    ok = starl:send(Robot, 2, post, N);
post(Robot, N, Posts) when N rem ?AT_ONCE =:= 0 ->
    ok = starl:send(Robot, 2, post, N),
    post(Robot, N + 1, Posts);
post(Robot, N, Posts) ->
    starl:post(Robot, 2, post, N),
    post(Robot, N + 1, Posts).

counted(_Robot, 0, Begin) ->
    erlang:monotonic_time(microsecond) - Begin;
counted(Robot, Left, Begin) ->
    case starl:await(Robot, post) of
        {ok, _, _} when Begin =:= none ->
            counted(Robot, Left - 1, erlang:monotonic_time(microsecond));
        {ok, _, _} ->
            counted(Robot, Left - 1, Begin)
    end.
