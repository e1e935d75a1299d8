%% Reloads at random instants of a painting cluster of two nodes, of the application and of machines:
%% the picture is complete, no contract is broken, the answer says what was rolled back and why.
%% STARL_LIVE_RELOADS=20 makes it 20 runs. And two reloads within one step, on robots in one VM.
-module(starl_reload_live_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([painted/1, two_versions_in_one_step/1]).
%% called in the conductor
-export([play/3]).

-define(RUNS, 1).
-define(SPEED, 10).

suite() -> [{timetrap, {minutes, 9}}].

all() -> [painted, two_versions_in_one_step].

%% The cluster makes its VM a distributed node: it has a VM of its own.
init_per_suite(Config) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(D)] || D <- Own, filelib:is_dir(D)]),
    Quiet = ["-nocookie", "-kernel", "logger_level", "none"],
    Whole = ["-kernel", "prevent_overlapping_partitions", "false"],
    {ok, Conductor, _} = peer:start(#{
        connection => standard_io,
        shutdown => close,
        wait_boot => 60000,
        args => Quiet ++ Whole ++ Paths
    }),
    %% held by this process otherwise, which ends
    true = unlink(Conductor),
    [{conductor, Conductor} | Config].

end_per_suite(Config) -> peer:stop(proplists:get_value(conductor, Config)).

painted(Config) ->
    Runs = list_to_integer(os:getenv("STARL_LIVE_RELOADS", integer_to_list(?RUNS))),
    Conductor = proplists:get_value(conductor, Config),
    Dir = proplists:get_value(priv_dir, Config),
    [
        begin
            {Variant, Module, At} = drawn(Seed),
            Played = peer:call(
                Conductor, ?MODULE, play, [Seed, Variant, {Module, At, Dir}], 300000
            ),
            ct:pal("seed ~b, ~p of ~p at ~b us:~n~ts", [
                Seed, Variant, Module, At, element(2, Played)
            ]),
            judged(starl_reload_code:fails(Variant), Played)
        end
     || Seed <- lists:seq(1, Runs)
    ].

judged(Fails, {Answer, Text, Violations, Complete}) ->
    ?assertEqual({[], true}, {Violations, Complete}),
    case {Fails, Answer} of
        {false, ok} ->
            ok;
        {true, error} ->
            Lines = string:lexemes(Text, "\n"),
            ?assert(lists:all(fun(L) -> string:find(L, "rolled back") =/= nomatch end, Lines)),
            ?assertMatch([_, _], Lines);
        {true, ok} ->
            %% the applications were done before the code had anything to do
            ok
    end.

%% Robots in one VM, in real time: the first version crashes, the second has another state.
two_versions_in_one_step(Config) ->
    Second = {app, {converted, next}, {crashes, 0}},
    [
        begin
            Dir = filename:join(proplists:get_value(priv_dir, Config), integer_to_list(N)),
            {Outcomes, Violations} = reloaded([{app, First, {crashes, 0}}, Second], Dir),
            ?assertEqual({First, []}, {First, Violations}),
            ?assertMatch(
                {First, [{1, taken}, {2, taken}, {2, {crashed, _}}, {1, {unproven, 2}} | _]},
                {First, Outcomes}
            )
        end
     || {N, First} <- [{1, same}, {2, {converted, second}}]
    ].

%% What robot 1 of two tells, and the contracts that are broken: by a robot that is not done, too.
reloaded(Versions, Dir) ->
    Watch = [{starl_sim_order_monitor, #{}}],
    {ok, Run} = starl_world_run:start(
        #{app => starl_reload_census, robots => 2, time => 120},
        #{dir => Dir, speed => ?SPEED, watch => Watch}
    ),
    ok = starl_world_run:until(Run, 2000000),
    Orders = [
        order(N, starl_reload_schedule:code(N, Version))
     || {N, Version} <- lists:zip(lists:seq(1, length(Versions)), Versions)
    ],
    Links = [starl_world_run:link(Run, R) || R <- [1, 2]],
    _ = [starl_live_link:reload(Link, Order, self()) || Link <- Links, Order <- Orders],
    done = starl_world_run:await(Run),
    {#{violations := Violations} = Outcome, _} = starl_world_run:finish(Run),
    Told = [{N, O} || {_, 1, app, {reloaded, N, O}} <- starl_sim_ct:trace(Outcome)],
    {Told, [lists:flatten(starl_violation:format(V)) || V <- Violations]}.

order(N, Code) ->
    {ok, #{versions := Versions, code := New}} = starl_version:make([Code]),
    ok = starl_version:load(New),
    #{number => N, versions => Versions, trial_us => 5000000}.

%% The first run has code that fails, in the application.
drawn(1) ->
    {crashes_at_once, starl_painting, 3000000};
drawn(Seed) ->
    _ = rand:seed(exsss, {Seed, 2, 2}),
    Machines = [starl_sap, starl_motion, starl_dpp_participant, starl_dpp_coordinator],
    Module = one_of([starl_painting, one_of(Machines)]),
    Variants = [no_migration, crashes_at_once, good, converts],
    {one_of(Variants), Module, 2000000 + rand:uniform(8000000)}.

one_of(Choices) -> lists:nth(rand:uniform(length(Choices)), Choices).

%% -- in the conductor -----------------------------------------------------------------------

play(Seed, Variant, {Module, At, Dir}) ->
    Caller = self(),
    _ = spawn(fun() -> Caller ! {played, run(Seed, Variant, Module, At, Dir)} end),
    receive
        {played, Played} -> Played
    end.

run(Seed, Variant, Module, At, Dir) ->
    {module, Module} = code:ensure_loaded(Module),
    Code = starl_reload_code:make(Module, Variant),
    Picture = filename:join(Dir, "lines.svg"),
    ok = file:write_file(Picture, picture()),
    {ok, Cluster} = starl_world_run:start(
        #{app => starl_painting, robots => 2, picture => Picture, seed => Seed},
        #{
            dir => filename:join(Dir, integer_to_list(Seed)),
            transport => udp,
            speed => ?SPEED,
            watch => [{starl_reload_monitor, #{}}]
        }
    ),
    ok = starl_world_run:until(Cluster, At),
    {Answer, Text} = starl_world_run:reload(Cluster, [Code]),
    _ = starl_world_run:await(Cluster),
    {#{violations := Violations} = Outcome, #{complete := Complete}} =
        starl_world_run:finish(Cluster),
    #{monitors := #{starl_reload_monitor := #{reloads := Reloads}}} = Outcome,
    %% what the report tells agrees with the answer
    true = (Answer =:= error) =:= lists:any(fun starl_reload_monitor:is_back/1, Reloads),
    Lines = [lists:flatten(starl_violation:format(V)) || V <- Violations],
    {Answer, unicode:characters_to_list(Text), Lines, Complete}.

picture() ->
    [
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>",
        [
            io_lib:format("<path stroke='red' d='M 10 ~b L 40 ~b'/>", [Y, Y])
         || Y <- [10, 30, 50, 70, 90]
        ],
        "</svg>"
    ].
