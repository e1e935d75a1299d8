%% @doc The command `./starl soak live': tests the program that ships on robots, part by part. The parts
%% are the store on its disk, the radio of some robots, and whole robots that use a block
%% ({@link starl_virtual_robot}). It runs each part with many seeds, on one VM per core, and reports
%% like a soak of blocks.
-module(starl_lab_soak_live).

-export([about/0, flags/0, run/1, parts/0, blocks/0, scenario/3, played/3, violations/2]).
%% Called in the VMs of the jobs.
-export([one/1]).

-export_type([part/0, played/0]).

%% What is tested: the store on its disk, the radio of some robots, or whole robots that use a block.
-type part() :: store | radio | sap | mutex | barrier | election | registers.

-type played() :: #{
    violations := [starl_monitor:violation()],
    events := non_neg_integer(),
    digest := non_neg_integer() | binary()
}.

%% A part, a seed, and what was found; the time is of the wall, in seconds.
-type found() ::
    {part(), Seed :: non_neg_integer(), {ok, result()} | {failed, term()}}.
-type result() ::
    {[starl_monitor:violation()], Digest :: non_neg_integer() | binary(), Seconds :: float()}.

%% @doc The parts, each with a line.
-spec parts() -> [{part(), string()}].
parts() ->
    [
        {store, "the store under power cuts"},
        {radio, "datagrams under an attacker"}
        | [{Block, "whole robots that use " ++ atom_to_list(Block)} || Block <- blocks()]
    ].

%% @doc The blocks that whole robots use.
-spec blocks() -> [part()].
blocks() -> [sap, mutex, barrier, election, registers].

%% @doc What the command does.
-spec about() -> [starl_cli_command:paragraph()].
about() ->
    [
        "Runs the program that ships on robots in virtual time, on simulated clocks, sockets and "
        "disks, with one seed after the other. Datagrams are lost, doubled, late, damaged and "
        "replayed; disks are full, fail and forget what was not synced when the power goes; clocks "
        "drift, stand still and are set right; applications get new code, good and bad. The same seed gives the "
        "same run.",
        [
            "Parts: ",
            lists:join("; ", [
                [atom_to_list(Part), ", ", Doc]
             || {Part, Doc} <- parts()
            ])
        ]
    ].

%% @doc The flags of the command.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    Parts = [all | parts(all)],
    [
        {seeds, {integer, 1, 10000000}, 100, "number of runs of each part"},
        {from, {integer, 0, 1 bsl 31}, 1, "the first seed"},
        {part, {one_of, Parts}, all, "what is run"},
        {robots, {optional, {integer, 1, 20}}, none,
            "robots in the team; none: 1, 2, 3 or 5, drawn for each run"},
        {cover, switch, false, "tell which lines of the live half ran; that takes longer"},
        starl_lab_jobs:at_once()
    ].

%% @doc Runs the parts.
-spec run(#{atom() => term()}) -> starl_cli_terminal:status().
run(#{seeds := Count, from := From, part := Part, jobs := Jobs} = Values) ->
    ok = starl_cli_log:install(),
    Parts = parts(Part),
    #{robots := Robots, cover := Cover} = Values,
    Runs = [
        {P, Robots, Seed, Cover}
     || P <- Parts, Seed <- lists:seq(From, From + Count - 1)
    ],
    {How, {Founds, Lines}} = starl_lab_jobs:run(
        Runs,
        #{
            work => {?MODULE, one},
            at_once => min(Jobs, length(Runs)),
            what => "runs",
            each => fun noted/3
        },
        {[], #{}}
    ),
    starl_cli_signal:on_interrupt(quit),
    Sorted = lists:sort(Founds),
    starl_cli_terminal:out([head(), [row(P, of_part(P, Sorted)) || P <- Parts]]),
    starl_cli_terminal:out([failure(Found) || {_, _, {failed, _}} = Found <- Sorted]),
    starl_cli_terminal:out([told(Found, Values) || Found <- first_of_kind(Sorted)]),
    starl_cli_terminal:out(covered(Lines)),
    status(How, Sorted).

%% @doc What a part's run is given: for whole robots, a scenario as of a soak of their block, with the
%% faults that can be carried out on live robots, and with reloads of its application in every second
%% run.
-spec scenario(part(), Robots :: pos_integer() | none, Seed :: integer()) ->
    #{atom() => term()}.
scenario(Part, none, Seed) ->
    Drawn = starl_run_draw:between({Seed, Part, live_robots}, 1, 4),
    scenario(Part, element(Drawn, {1, 2, 3, 5}), Seed);
scenario(Part, Robots, Seed) ->
    case lists:member(Part, blocks()) of
        true -> starl_lab_soak_reloads:add(Seed, with_faults(drawn(Part, Robots, Seed)));
        false when Part =:= radio -> starl_virtual_radio:scenario(Seed);
        false -> #{robots => Robots}
    end.

drawn(Part, Robots, Seed) -> starl_lab_soak_draw:scenario(Part, Robots, Seed).

%% A clock near the bound of its drift must not drift more.
with_faults(#{clock_drift := _} = Scenario) ->
    live(Scenario, starl_virtual_robot:kinds() -- [clock_drift, clock_freeze]);
with_faults(Scenario) ->
    live(Scenario, starl_virtual_robot:kinds()).

live(Scenario, Kinds) -> Scenario#{program => live, random_faults := Kinds}.

parts(all) -> [Part || {Part, _} <- parts()];
parts(Part) -> [Part].

noted({Part, _, Seed, _}, {ok, {Found, Lines}}, {Founds, All}) ->
    {
        [{Part, Seed, {ok, Found}} | Founds],
        maps:merge_with(fun(_, A, B) -> A orelse B end, All, Lines)
    };
noted({Part, _, Seed, _}, {crashed, Reason}, {Founds, All}) ->
    {[{Part, Seed, {failed, Reason}} | Founds], All}.

of_part(Part, Founds) -> [Found || {P, _, _} = Found <- Founds, P =:= Part].

head() ->
    io_lib:format("~-12s ~7s ~10s ~9s ~14s ~10s~n", [
        "part", "seeds", "violations", "failures", "seeds/min/core", "digest"
    ]).

row(Part, Founds) ->
    Ok = [Result || {_, _, {ok, Result}} <- Founds],
    Seconds = lists:sum([S || {_, _, S} <- Ok]),
    io_lib:format("~-12s ~7b ~10b ~9b ~14b ~10.16b~n", [
        atom_to_list(Part),
        length(Founds),
        length([x || {[_ | _], _, _} <- Ok]),
        length(Founds) - length(Ok),
        round(60 * length(Ok) / max(1.0e-6, Seconds)),
        erlang:phash2([Digest || {_, Digest, _} <- Ok])
    ]).

failure({Part, Seed, {failed, Reason}}) ->
    io_lib:format("~ts, seed ~b: ~0tP~n", [Part, Seed, Reason, 30]).

%% The first run with each kind of violation, and the number of such runs.
-spec first_of_kind([found()]) -> [{atom(), integer(), starl_monitor:violation(), pos_integer()}].
first_of_kind(Founds) ->
    Kinds = [{{P, kind(V)}, {Seed, V}} || {P, Seed, {ok, {[V | _], _, _}}} <- Founds],
    [
        {P, Seed, V, length([x || {Key, _} <- Kinds, Key =:= {P, Kind}])}
     || {P, Kind} <- lists:usort([Key || {Key, _} <- Kinds]),
        {Seed, V} <- [proplists:get_value({P, Kind}, Kinds)]
    ].

kind(#{contract := Contract, what := What}) -> {Contract, What}.

told({Part, Seed, Violation, Count}, Values) ->
    [
        "\n",
        starl_violation:format(Violation),
        [io_lib:format(" (and so in ~b more runs)", [Count - 1]) || Count > 1],
        io_lib:format("~nrepeat: ./starl soak live --part ~ts --from ~b --seeds 1", [Part, Seed]),
        [io_lib:format(" --robots ~b", [N]) || #{robots := N} <- [Values], is_integer(N)],
        shrinking(scenario(Part, maps:get(robots, Values), Seed)),
        "\n"
    ].

%% A simulation can be shrunk. New code that a soak has drawn stands in no file.
shrinking(#{program := _, app := App} = Given) when not is_map_key(reloads, Given) ->
    {Name, App} = lists:keyfind(App, 2, starl_cli_target:apps()),
    {ok, Target} = starl_cli_target:resolve(Name),
    {ok, Scenario} = starl_run_scenario:check(Given, starl_app:options(App)),
    ["\nshrink: ", starl_cli_target:command_line("shrink", Target, Scenario)];
shrinking(_Given) ->
    [].

status(interrupted, _) ->
    130;
status(done, Founds) ->
    case {[x || {_, _, {failed, _}} <- Founds], [x || {_, _, {ok, {[_ | _], _, _}}} <- Founds]} of
        {_, [_ | _]} -> 3;
        {[_ | _], []} -> 1;
        {[], []} -> 0
    end.

%% @doc Runs a part once, with robots of a number that is drawn.
-spec violations(part(), Seed :: integer()) -> [starl_monitor:violation()].
violations(Part, Seed) ->
    #{violations := Violations} = played(Part, Seed, scenario(Part, none, Seed)),
    Violations.

%% @doc Runs a part once, up to a violation: whole robots by this scenario, which may name further monitors
%% (`watch').
-spec played(part(), Seed :: integer(), #{atom() => term()}) -> played().
played(store, Seed, _Scenario) ->
    case starl_sim_trial:apart(fun() -> starl_virtual_store:run(Seed) end) of
        {ok, Played} -> Played;
        {error, {failed, Why}} -> error(Why)
    end;
played(_Part, _Seed, Given) ->
    {Watch, Scenario} =
        case maps:take(watch, Given) of
            error -> {[], Given};
            Taken -> Taken
        end,
    case starl_sim_trial:run(Scenario, fun(_Sim) -> ok end, Watch) of
        {ok, Outcome} -> maps:with([violations, events, digest], Outcome);
        {error, {failed, Why}} -> error(Why);
        {error, Why} -> error(Why)
    end.

%% @private One run, in the VM of its job, and the lines of the live half that it ran.
-spec one({part(), pos_integer() | none, Seed :: integer(), Cover :: boolean()}) ->
    {result(), #{{module(), Line :: pos_integer()} => boolean()}}.
one({Part, Robots, Seed, Cover}) ->
    ok = cover(Cover),
    Scenario = scenario(Part, Robots, Seed),
    Begin = erlang:monotonic_time(microsecond),
    #{violations := Violations, digest := Digest} = played(Part, Seed, Scenario),
    Us = erlang:monotonic_time(microsecond) - Begin,
    {{lists:sublist(Violations, 1), Digest, Us / 1.0e6}, lines(Cover)}.

%% -- the lines that ran ---------------------------------------------------------------------

%% The modules of the live half are compiled anew, once in each VM.
cover(false) ->
    ok;
cover(true) ->
    case whereis(cover_server) of
        undefined ->
            {ok, _} = cover:start(),
            _ = [{ok, _} = cover:compile_beam(Module) || Module <- live()],
            ok;
        _ ->
            ok
    end.

live() ->
    _ = application:load(starl_live),
    {ok, Modules} = application:get_key(starl_live, modules),
    Modules.

lines(false) ->
    #{};
lines(true) ->
    {result, Lines, _} = cover:analyse(live(), calls, line),
    maps:from_list([{Line, Calls > 0} || {{_, N} = Line, Calls} <- Lines, N > 0]).

covered(Lines) when map_size(Lines) =:= 0 ->
    [];
covered(Lines) ->
    ByModule = maps:groups_from_list(
        fun({{Module, _}, _}) -> Module end, fun({_, Ran}) -> Ran end, maps:to_list(Lines)
    ),
    Rows = [{M, length([x || true <- Ran]), length(Ran)} || {M, Ran} <- maps:to_list(ByModule)],
    Head = io_lib:format("~n~-32s ~9s ~9s~n", ["module of the live half", "lines run", "of"]),
    All = {'all', lists:sum([N || {_, N, _} <- Rows]), lists:sum([N || {_, _, N} <- Rows])},
    [
        Head,
        [io_lib:format("~-32s ~9b ~9b~n", [M, N, Of]) || {M, N, Of} <- lists:sort(Rows) ++ [All]]
    ].
