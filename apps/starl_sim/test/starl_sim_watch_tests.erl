%% A run that stands still: who is at work is found, in every mode and over several shards.
-module(starl_sim_watch_tests).
-include_lib("eunit/include/eunit.hrl").

-export([scene/1, init/1, handle_event/5, init/2, step/2, options/0]).

options() -> [{kind, {one_of, [loops, machine, ends]}, loops, "what the robots do"}].

scene(#{options := #{kind := machine}}) -> {ok, #{app => {machine, ?MODULE, #{}}}};
scene(#{options := #{kind := Kind}}) -> {ok, #{app => {sequential, ?MODULE, Kind}}}.

init(_Robot, Kind) -> Kind.

step(Robot, Kind) ->
    ok = starl:sleep(Robot, 100),
    _ = starl:id(Robot) =:= 2 andalso Kind =:= loops andalso for_ever(Robot),
    {done, Kind}.

%% An application that is a machine.
init(_Config) -> {waits, none, [{{timeout, t}, 100000, go}]}.

handle_event(_, _, _, none, _) -> for_ever(none).

for_ever(Term) ->
    for_ever(Term).

sequential_app_test_() ->
    [
        {atom_to_list(Mode), fun() ->
            [{2, app, Frames}] = stands(#{mode => Mode, robots => 3, shards => Shards}),
            ?assertMatch({?MODULE, for_ever, 1, _, _}, starl_crash:place(Frames))
        end}
     || {Mode, Shards} <- [{process, 1}, {process, 3}, {inline, 2}]
    ].

%% A machine without a process holds up its shard, which cannot say which robot it is.
inline_machine_test() ->
    [{unknown, machine, Frames}] = stands(#{mode => inline, robots => 1, kind => machine}),
    ?assertMatch({?MODULE, for_ever, 1, _, _}, starl_crash:place(Frames)).

%% A run that goes on, and one that rests, are not told of.
no_stall_test() ->
    {ok, Sim} = starl_sim:start(#{app => ?MODULE, kind => ends, robots => 3}),
    Self = self(),
    Watch = starl_sim:watch(Sim, #{
        patience_ms => 0, period_ms => 1, tell => fun(News) -> Self ! {news, News} end
    }),
    #{ending := done} = starl_sim:run(Sim),
    ?assertEqual([], starl_sim:at_work(Sim)),
    ok = starl_sim_watch:stop(Watch),
    ok = starl_sim:close(Sim),
    ?assertEqual([], starl_sim:at_work(Sim)).

stands(Given) ->
    Self = self(),
    {Driver, Ref} = spawn_monitor(fun() ->
        {ok, Sim} = starl_sim:start(maps:merge(#{app => ?MODULE}, Given)),
        _ = starl_sim:watch(Sim, #{
            patience_ms => 0, period_ms => 100, tell => fun(News) -> Self ! {self(), News} end
        }),
        starl_sim:run(Sim)
    end),
    AtWork = known(),
    exit(Driver, kill),
    receive
        {'DOWN', Ref, process, Driver, _} -> AtWork
    end.

%% The first moments may pass before the loop has begun.
known() ->
    receive
        {_, {stands, _, [Work | _] = AtWork}} when tuple_size(Work) =:= 3 -> AtWork;
        {_, _} -> known()
    end.
