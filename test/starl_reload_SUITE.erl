%% Reloads at random instants of simulated runs: good code, code that crashes, state that cannot be
%% carried over; on the whole team, on half of it, on one robot; of applications and of machines. The
%% picture is completed or all rooms are searched, no contract is broken, what failed is back
%% everywhere. STARL_RELOADS=200 makes it 200 runs.
-module(starl_reload_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    reloads/1,
    replayed/1,
    half_of_the_team/1,
    all_go_back/1,
    down_meanwhile/1,
    killed_meanwhile/1,
    mistakes/1
]).

-define(RUNS, 60).
%% Longer than three steps of the painting application.
-define(TRIAL_MS, 60000).

suite() -> [{timetrap, {minutes, 9}}].

all() ->
    [reloads, replayed, half_of_the_team, all_go_back, down_meanwhile, killed_meanwhile, mistakes].

init_per_suite(Config) ->
    File = filename:join(proplists:get_value(priv_dir, Config), "lines.svg"),
    Lines = [
        io_lib:format("<path stroke='red' d='M 10 ~b L 40 ~b'/>", [Y, Y])
     || Y <- [10, 30, 50, 70, 90]
    ],
    ok = file:write_file(File, [
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>", Lines, "</svg>"
    ]),
    starl_platform_ct:without_log([{picture, File} | Config]).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% -- many runs ------------------------------------------------------------------------------

reloads(Config) ->
    Runs = list_to_integer(os:getenv("STARL_RELOADS", integer_to_list(?RUNS))),
    Taken = [outcomes(Seed, Config) || Seed <- lists:seq(1, Runs)],
    ok = enough(length([T || T <- Taken, T =/= []]), Runs),
    Kinds = lists:usort([kind(O) || Outcomes <- Taken, {_, _, _, O} <- Outcomes]),
    ?assertEqual([back, crashed, migration_failed, taken], Kinds).

%% Some reloads come too late: the applications are done, or in their last steps.
enough(InTime, Runs) ->
    ct:pal("~b runs, ~b with a reload in time", [Runs, InTime]),
    ?assert(2 * InTime > Runs),
    ok.

outcomes(Seed, Config) ->
    {Scenario, Variant} = drawn(Seed, Config),
    try
        judged(Variant, Scenario, run(Scenario))
    catch
        Class:Reason:Stack ->
            #{reloads := [{At, Robots, {Module, _, _}, _}]} = Scenario,
            ct:pal("seed ~b: ~p of ~p on ~p at ~b ms", [Seed, Variant, Module, Robots, At]),
            erlang:raise(Class, Reason, Stack)
    end.

%% The scenario of a seed, and what is wrong with its new code.
drawn(Seed, Config) ->
    _ = rand:seed(exsss, {Seed, 1, 1}),
    {Given, Module, MostMs} = one_of([painting(Config), search(), machine(Config)]),
    Variant = one_of(starl_reload_code:variants(kind_of(Module))),
    #{robots := N} = Given,
    Robots = one_of([all, lists:seq(1, N, 2), rand:uniform(N)]),
    At = rand:uniform(MostMs),
    Code = starl_reload_code:make(Module, Variant),
    {Given#{seed => Seed, reloads => [{At, Robots, Code, #{trial_ms => ?TRIAL_MS}}]}, Variant}.

painting(Config) ->
    Picture = proplists:get_value(picture, Config),
    {
        #{app => starl_painting, robots => 2 + rand:uniform(2), picture => Picture},
        starl_painting,
        40000
    }.

search() -> {#{app => starl_reload_search, robots => 4, rooms => 20}, starl_reload_search, 12000}.

machine(Config) ->
    {Given, _, MostMs} = painting(Config),
    Machines = [
        starl_sap, starl_motion, starl_location, starl_dpp_participant, starl_dpp_coordinator
    ],
    {Given, one_of(Machines), MostMs}.

kind_of(Module) ->
    {module, Module} = code:ensure_loaded(Module),
    case erlang:function_exported(Module, handle_event, 5) of
        true -> machine;
        false -> app
    end.

one_of(Choices) -> lists:nth(rand:uniform(length(Choices)), Choices).

run(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario, #{watch => [{starl_sim_order_monitor, #{}}]}),
    #{ending := Ending} = starl_sim:run(Sim),
    {Outcome, Report} = starl_sim:finish(Sim),
    {Ending, Outcome, Report}.

%% Violations are shown as the user sees them.
judged(Variant, #{app := App} = Scenario, {Ending, Outcome, Report}) ->
    #{violations := Violations} = Outcome,
    ?assertEqual([], [lists:flatten(starl_violation:format(V)) || V <- Violations]),
    ?assertEqual(done, Ending),
    ?assert(App =/= starl_painting orelse maps:get(complete, Report)),
    Outcomes = reloaded(Outcome),
    ok = failed(Variant, Outcomes),
    ok = only_asked(Scenario, Outcomes),
    ok = all_back(Outcomes, Outcome),
    Outcomes.

reloaded(Outcome) ->
    [{T, R, Name, O} || {T, R, Name, {reloaded, 1, O}} <- starl_sim_ct:trace(Outcome), O =/= done].

%% Good code never fails; some bad code fails as soon as it is taken, other may come too late to.
failed(Variant, Outcomes) ->
    Failures = failures(Outcomes),
    Certain = lists:member(Variant, [no_migration, no_way_back]),
    ?assert(starl_reload_code:fails(Variant) orelse Failures =:= []),
    ?assert(not Certain orelse Outcomes =:= [] orelse Failures =/= []),
    ok.

failures(Outcomes) -> [F || {_, _, _, O} = F <- Outcomes, starl_reload:is_failure(O)].

%% The other half takes no part.
only_asked(#{reloads := [{_, all, _, _}]}, _Outcomes) ->
    ok;
only_asked(#{reloads := [{_, Robots, _, _}]}, Outcomes) ->
    ?assertEqual([], lists:usort([R || {_, R, _, _} <- Outcomes]) -- lists:flatten([Robots])),
    ok.

%% After a failure every machine that has taken the code is back, as soon as the news is there. An
%% application is back at its next step, if it has one.
all_back(Outcomes, #{end_us := End}) ->
    Last = maps:from_list([{{R, Name}, O} || {_, R, Name, O} <- Outcomes, Name =/= app]),
    Early = [T || {T, _, _, _} <- failures(Outcomes), T < End - 1000000],
    ?assert(Early =:= [] orelse not lists:member(taken, maps:values(Last))),
    ok.

kind(Outcome) when is_atom(Outcome) -> Outcome;
kind(Outcome) -> element(1, Outcome).

%% -- single runs ----------------------------------------------------------------------------

%% A reload is an event of the run: the same digest in processes, inline and over shards; another
%% one without it.
replayed(Config) ->
    [
        begin
            {Given, Module, _} = painting(Config),
            Code = starl_reload_code:make(Module, Variant),
            Base = Given#{robots => 4, seed => 7},
            With = Base#{reloads => [{6000, [1, 3], Code, #{trial_ms => ?TRIAL_MS}}]},
            [First | Others] = [
                digest(With#{mode => Mode, shards => Shards})
             || {Mode, Shards} <- [{process, 1}, {process, 1}, {inline, 1}, {inline, 4}]
            ],
            ?assertEqual([First, First, First], Others),
            ?assertNotEqual(First, digest(Base))
        end
     || Variant <- [good, crashes_after_a_step]
    ].

digest(Scenario) ->
    {done, #{digest := Digest}, _} = run(Scenario),
    Digest.

half_of_the_team(_) ->
    Code = starl_reload_code:make(starl_reload_search, converts),
    Scenario = #{app => starl_reload_search, robots => 4, reloads => [{3000, [2, 4], Code}]},
    {done, Outcome, _} = run(Scenario),
    ?assertEqual([2, 4], lists:usort([R || {_, R, app, taken} <- reloaded(Outcome)])).

%% One robot fails: all that have taken the code go back within a tenth of a second, at their next
%% step, and go on.
all_go_back(_) ->
    Code = starl_reload_code:make(starl_reload_search, crashes_later),
    Scenario = #{
        app => starl_reload_search, robots => 4, rooms => 20, reloads => [{3000, all, Code}]
    },
    {done, Outcome, _} = run(Scenario),
    Outcomes = reloaded(Outcome),
    [{_, First, app, {crashed, {"planted", [_ | _] = Frames}}} | _] =
        [O || {_, _, _, {crashed, _}} = O <- Outcomes],
    ?assertMatch({starl_reload_search, step, 2, _, _}, hd(Frames)),
    Back = [R || {_, R, app, O} <- Outcomes, kind(O) =/= taken],
    ?assertEqual([1, 2, 3, 4], lists:usort(Back)),
    ?assert(lists:member(First, Back)).

%% A robot that is down when the others get new code starts with it.
down_meanwhile(_) -> meanwhile({down, 2000, 4000, reboot, 3, #{}}, 1).

%% An application that is killed before it has taken the new code starts with it.
killed_meanwhile(_) -> meanwhile({kill, 3001, 3001, kill_machine, {3, app}, #{}}, 0).

meanwhile(Fault, Least) ->
    Code = starl_reload_code:make(starl_reload_search, no_start),
    Scenario = #{
        app => starl_reload_search, robots => 4, reloads => [{3000, [3], Code}], faults => [Fault]
    },
    {done, Outcome, _} = run(Scenario),
    ?assert(length(reloaded(Outcome)) >= Least - 1),
    ?assertMatch([_ | _], [T || {T, 3, app, started_anew} <- starl_sim_ct:trace(Outcome)]).

mistakes(_) ->
    Base = #{app => starl_reload_search, robots => 2},
    [
        begin
            {error, Reason} = starl_sim:start(Base#{reloads => Reloads}),
            Line = unicode:characters_to_list(starl_sim:format_error(Reason)),
            ?assertEqual({Line, true}, {Line, string:find(Line, Part) =/= nomatch})
        end
     || {Reloads, Part} <- [
            {[{0, all, no_such_module}], "there is no code of no_such_module"},
            {[{0, all, "no/such/file.erl"}], "no/such/file.erl: there is no such file"},
            {[{0, 3, starl_reload_search}], "there is no robot 3"},
            {[{0, all, starl_svg}], "starl_svg: neither the application nor a machine"},
            {[{0, all, {starl_svg, "x", <<>>}}], "x: this is no compiled Erlang module"},
            {[{0, 0, starl_svg}], "{AtMs, all | Robot | Robots, Module | File}"},
            {[{-1, all, starl_svg}], "reloads"},
            {[now], "reloads"}
        ]
    ].
