%% An application for the tests of the trace debugger: once a second robot 1 passes a token on to robot 2,
%% which waits for it. From robot 2 to robot 1 it goes much later.
-module(starl_debug_app).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2]).

%% From the beginning of a round: when each robot wants the token, and when it releases it (ms).
-define(ROUND, 1000).
-define(HOLDS, #{1 => {0, 300}, 2 => {150, 600}}).
-define(PATIENCE, 5000).

options() ->
    [
        {rounds, {integer, 1, 1000}, 3, "how many times the token goes there and back"},
        {machine, {term, "a machine", fun is_atom/1}, starl_mutex_tokens, "the implementation"}
    ].

scene(#{options := #{machine := Machine} = Options}) ->
    {ok, #{
        app => {sequential, ?MODULE, Options},
        blocks => [{mutex, Machine, #{}}],
        monitors => [{starl_mutex_monitor, #{}}]
    }}.

init(Robot, #{rounds := Rounds}) -> {starl:id(Robot), 1, Rounds}.

%% The last round is an empty one: so both tell of themselves until then.
step(Robot, {_Id, Round, Rounds}) when Round > Rounds ->
    ok = until(Robot, Round, ?ROUND),
    {done, Rounds};
step(Robot, {Id, Round, Rounds}) ->
    #{Id := {Wants, Releases}} = ?HOLDS,
    ok = until(Robot, Round, Wants),
    {ok, _} = starl_mutex:acquire(Robot, token, ?PATIENCE),
    ok = until(Robot, Round, Releases),
    ok = starl_mutex:release(Robot, token),
    {continue, {Id, Round + 1, Rounds}}.

until(Robot, Round, Ms) -> starl:sleep(Robot, max(0, Round * ?ROUND + Ms - starl:now(Robot))).
