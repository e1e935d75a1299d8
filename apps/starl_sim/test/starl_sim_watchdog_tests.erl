%% A run that stands still: who is at work is found, in every mode and over several shards.
-module(starl_sim_watchdog_tests).
-include_lib("eunit/include/eunit.hrl").

-export([scene/1, init/1, handle_event/5, init/2, step/2, options/0]).

options() -> [{kind, {one_of, [loops, goes, machine, waits, ends]}, loops, "what the robots do"}].

scene(#{options := #{kind := machine}}) -> {ok, #{app => {machine, ?MODULE, #{}}}};
scene(#{options := #{kind := Kind}}) -> {ok, #{app => {sequential, ?MODULE, Kind}}}.

init(_Robot, Kind) -> Kind.

step(Robot, Kind) ->
    ok = starl:sleep(Robot, 100),
    _ = starl:id(Robot) =:= 2 andalso busy(Kind, Robot),
    {done, Kind}.

busy(loops, Robot) ->
    for_ever(Robot);
busy(goes, Robot) ->
    {ok, {X, Y, _}} = starl:position(Robot),
    goes(Robot, {X, Y});
busy(waits, _Robot) ->
    receive
        never -> ok
    end;
busy(_Kind, _Robot) ->
    none.

goes(Robot, Here) ->
    ok = starl:go_to(Robot, Here),
    goes(Robot, Here).

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

%% Its machines are at work all the time; the application is who keeps them so.
a_loop_of_calls_names_the_application_test() ->
    {module, starl_motion} = code:ensure_loaded(starl_motion),
    Given = #{mode => process, robots => 2, kind => goes},
    [
        begin
            [{2, app, Frames}] = AtWork,
            ?assertEqual(goes, innermost(Frames))
        end
     || AtWork <- stands(Given, 3)
    ].

%% A machine without a process holds up its shard, which cannot say which robot it is.
inline_machine_test() ->
    [{unknown, machine, Frames}] = stands(#{mode => inline, robots => 1, kind => machine}),
    ?assertMatch({?MODULE, for_ever, 1, _, _}, starl_crash:place(Frames)).

%% Work is counted, not time: an endless loop is found when it has done much, and what only waits, or gets
%% no processor, is none, however often it is looked at.
an_endless_loop_is_told_from_a_wait_test_() ->
    [
        {atom_to_list(Kind), fun() -> ?assertEqual(Cause, cause(#{kind => Kind, robots => 2})) end}
     || {Kind, Cause} <- [{loops, loop}, {waits, slow}]
    ].

%% A run that goes on, and one that rests, are not told of.
no_stall_test() ->
    {ok, Sim} = starl_sim:start(#{app => ?MODULE, kind => ends, robots => 3}),
    Self = self(),
    Watch = starl_sim:watch(Sim, #{
        patience_ms => 0, period_ms => 1, tell => fun(News) -> Self ! {news, News} end
    }),
    #{ending := done} = starl_sim:run(Sim),
    ?assertEqual([], starl_sim:at_work(Sim)),
    ok = starl_sim_watchdog:stop(Watch),
    ok = starl_sim:close(Sim),
    ?assertEqual([], starl_sim:at_work(Sim)).

stands(Given) ->
    [AtWork] = stands(Given, 1),
    AtWork.

%% So many looks at who is at work, one after the other.
stands(Given, Looks) ->
    Self = self(),
    Tag = make_ref(),
    {Driver, Ref} = spawn_monitor(fun() ->
        {ok, Sim} = starl_sim:start(maps:merge(#{app => ?MODULE}, Given)),
        _ = starl_sim:watch(Sim, #{
            patience_ms => 0, period_ms => 20, tell => fun(News) -> Self ! {Tag, News} end
        }),
        starl_sim:run(Sim)
    end),
    AtWork = [known(Tag) | [look(Tag) || _ <- lists:seq(2, Looks)]],
    exit(Driver, kill),
    receive
        {'DOWN', Ref, process, Driver, _} -> AtWork
    end.

look(Tag) ->
    receive
        {Tag, {stands, _, _, AtWork}} -> AtWork
    end.

%% The first moments may pass before the loop has begun, as while code is loaded.
known(Tag) ->
    receive
        {Tag, {stands, _, _, [{_, _, [_ | _] = Frames}] = AtWork}} ->
            case lists:member(innermost(Frames), [for_ever, goes]) of
                true -> AtWork;
                false -> known(Tag)
            end;
        {Tag, _} ->
            known(Tag)
    end.

%% The innermost function of this module.
innermost(Frames) -> hd([Function || {?MODULE, Function, _, _, _} <- Frames] ++ [none]).

%% A loop as soon as it is told, else what is told ten times.
cause(Given) ->
    Self = self(),
    Tag = make_ref(),
    {Driver, Ref} = spawn_monitor(fun() ->
        {ok, Sim} = starl_sim:start(maps:merge(#{app => ?MODULE}, Given)),
        _ = starl_sim:watch(Sim, #{
            patience_ms => 0,
            period_ms => 20,
            reductions => 5_000_000,
            tell => fun(News) -> Self ! {Tag, News} end
        }),
        starl_sim:run(Sim)
    end),
    Cause = told(Tag, 10),
    exit(Driver, kill),
    receive
        {'DOWN', Ref, process, Driver, _} -> Cause
    end.

told(_Tag, 0) ->
    slow;
told(Tag, Left) ->
    receive
        {Tag, {stands, _, loop, [{2, app, _}]}} -> loop;
        {Tag, {stands, _, slow, [{2, app, _}]}} -> told(Tag, Left - 1);
        {Tag, _} -> told(Tag, Left)
    end.
