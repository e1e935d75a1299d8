%% @doc Scenarios: all values that, with the code, determine a run. A scenario is a map of Erlang
%% terms; a scenario file in `config/scenarios/' holds one, and every key is also a flag of the
%% command line (`delay' is `--delay 5..50').
-module(starl_run_scenario).

-export([options/0, options/1, check/2, read/1, format_error/1, format_problem/1]).

-export_type([t/0, reason/0, problem/0]).

%% A checked scenario: all keys of {@link options/0} and of the application's own options.
-type t() :: #{atom() => term()}.

-type problem() ::
    starl_options:problem()
    | {fault, starl_run_fault:problem()}
    | {no_such_faults, term()}
    | {no_controller, unicode:chardata()}.

-type reason() ::
    {problems, [problem()]}
    | {file, file:filename(), file:posix() | badarg | terminated | system_limit}
    | {syntax, file:filename(), Line :: non_neg_integer(), unicode:chardata()}
    | {shape, file:filename()}.

%% @doc The table of the keys that every scenario has.
-spec options() -> [starl_options:option()].
options() -> place() ++ radio() ++ motion() ++ running() ++ trouble().

%% The team and its place.
place() ->
    [
        {robots, {integer, 1, 100000}, 4, "number of robots"},
        {seed, {integer, 0, 1 bsl 32}, 1, "the number from which every random draw follows"},
        {world, {size, {number, 1000, 1000000}}, {12000, 12000}, "size of the floor, mm"},
        {floor, {optional, file}, none,
            "a floor plan, which says the size of the floor, too: a file, or one that ships; bodies and "
            "walls are solid then (./starl floor PLAN shows it)"},
        {floor_scale, {optional, {number, 0.01, 100000}}, none,
            "width of a cell of a MovingAI map (1000), or of a unit of an SVG drawing (1), mm"},
        {start, {optional, file}, none,
            "where the robots stand at the beginning: grid, line, circle, random, or a file with a line "
            "X Y DEGREES, or the name of a place, for each; none: the application says it"}
    ].

radio() ->
    [
        {loss, {number, 0, 1}, 0.0, "fraction of the packets that the radio loses"},
        {duplicate, {number, 0, 1}, 0.0, "fraction of the packets that arrive twice"},
        {delay, {between, {number, 1, 60000}}, {5, 20}, "delay of a packet, ms"},
        {range, {optional, {number, 1, 10000000}}, none, "range of the radio, mm"},
        {wall_loss, {number, 0, 1}, 0.0,
            "fraction of the packets that each wall in their way takes, on a floor plan"},
        {shadowing, {number, 0, 20}, 0.0,
            "how unevenly a radio of limited range reaches, dB: its range is shorter for some pairs and places"}
    ].

%% The clocks of robots, how they drive, and how well they know where they are.
motion() ->
    [
        {clock_offset, {number, 0, 1.0e9}, 1000,
            "the largest error of a robot's clock at the start, ms"},
        {clock_drift, {number, 0, 10000}, 50, "the largest drift of a robot's clock, ppm"},
        {speed, {number, 1, 500}, 500, "driving speed, mm/s (the Create's limit is 500)"},
        starl_chassis_choice:option(),
        starl_controller:option(),
        {acceleration, {number, 50, 100000}, 2000,
            "limit of acceleration, mm/s2 (holonomic chassis only)"},
        {heading_error, {number, 0, 0.1}, 0.02,
            "the largest error of the heading in each leg, rad"},
        {distance_error, {number, 0, 0.1}, 0.01,
            "the largest error of the distance in each leg, as a fraction"},
        {position_error, {number, 0, 50}, 1.0, "the largest error of the positioning system, mm"},
        {command_latency, {between, {number, 0, 500}}, {0, 0},
            "delay of a drive command on its way to the chassis, ms"}
    ].

running() ->
    [
        {time, {number, 0, 1.0e6}, 7200, "the run ends at this virtual time, s"},
        {mode, {one_of, [auto, process, inline]}, auto,
            "process: each machine of a robot is an Erlang process; inline: none is; auto: "
            "inline; from Erlang, processes for teams of up to 300 robots"},
        {program, {one_of, programs()}, simulated,
            "what the robots run: simulated, their machines in the simulator; live, the program that ships "
            "on robots, with simulated clocks, sockets and disks, which does not drive; radio, only its radio"},
        {shards, {optional, {integer, 1, 256}}, none,
            "number of parts that are simulated at the same time; none: chosen by the number of "
            "robots and cores"}
    ].

%% The simulator's own robots, and other kinds of robots for it that applications list.
programs() -> [simulated | [Name || {Name, _} <- starl_catalogue:listed(starl_programs)]].

%% Faults and reloads, and what is to come of them.
trouble() ->
    [
        {faults, {term, "a list of {Id, FromMs, ToMs, Kind, Target, Params}", fun is_list/1}, [],
            "faults of the run; ./starl faults lists the kinds"},
        {random_faults,
            {term, "a list of classes and kinds of faults, as in [network, kill_machine], or [all]",
                fun is_list/1},
            [], "further faults of these kinds are drawn from the seed"},
        {reloads,
            {term, "a list of {AtMs, all | Robot | Robots, Module | File}",
                fun starl_run_reloads:are_entries/1},
            [], "new code for some robots or all, at these virtual times"},
        {heal, {number, 0.001, 1.0e6}, 60, "drawn faults are over by this virtual time, s"},
        {longest_fault, {optional, {number, 0.001, 1.0e6}}, none,
            "the longest that a drawn fault lasts, s; none: a third of --heal"},
        {converge, {optional, {number, 0, 1.0e6}}, none,
            "all applications must be done this long after the heal, s"}
    ].

%% @doc The options of a simulation and of its application.
-spec options(module()) -> [starl_options:option()].
options(App) -> options() ++ starl_app:options(App).

%% @doc Checks a scenario for an application that has these options of its own.
-spec check(#{atom() => term()}, [starl_options:option()]) -> {ok, t()} | {error, reason()}.
check(Given, AppOptions) ->
    Checked = starl_options:check(maps:remove(app, Given), options() ++ AppOptions),
    Faults =
        [{fault, P} || P <- fault_problems(maps:get(faults, Given, []))] ++
            [{no_such_faults, W} || W <- unknown(maps:get(random_faults, Given, []))] ++
            [{no_controller, Why} || {error, Why} <- [controller(Given)]],
    case {Checked, Faults} of
        {{ok, Scenario}, []} -> {ok, maps:merge(maps:with([app], Given), Scenario)};
        {{ok, _}, _} -> {error, {problems, Faults}};
        {{error, Problems}, _} -> {error, {problems, Problems ++ Faults}}
    end.

%% What is no text is a problem of its type.
controller(#{controller := Text}) when is_list(Text) ->
    io_lib:printable_unicode_list(Text) andalso starl_controller:named(Text);
controller(_) ->
    none.

%% What is no list is a problem of its type; the tail of a list may be anything.
unknown([W | What]) -> [W || starl_run_fault:kinds_of(W) =:= []] ++ unknown_tail(What);
unknown(_) -> [].

unknown_tail(What) when is_list(What) -> unknown(What);
unknown_tail(What) -> [What].

fault_problems(Faults) when is_list(Faults) -> starl_run_fault:check(Faults);
fault_problems(_) -> [].

%% @doc Reads a scenario file; its terms are not checked yet.
-spec read(file:filename()) -> {ok, #{atom() => term()}} | {error, reason()}.
read(File) ->
    case starl_terms:consult(File) of
        {ok, [Scenario]} when is_map(Scenario) -> {ok, Scenario};
        {ok, _} ->
            {error, {shape, File}};
        {error, {Line, Module, What}} when is_integer(Line) ->
            {error, {syntax, File, Line, Module:format_error(What)}};
        {error, Posix} ->
            {error, {file, File, Posix}}
    end.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({problems, Problems}) ->
    lists:join("; ", [format_problem(P) || P <- Problems]);
format_error({file, File, Posix}) ->
    io_lib:format("~ts: ~ts", [File, file:format_error(Posix)]);
format_error({syntax, File, Line, What}) ->
    io_lib:format("~ts:~b: ~ts", [File, Line, What]);
format_error({shape, File}) ->
    io_lib:format("~ts: a scenario file holds one map, as in #{app => painting}.", [File]).

%% @doc One line on one problem.
-spec format_problem(problem()) -> unicode:chardata().
format_problem({no_such_faults, What}) ->
    io_lib:format("there is no class or kind of faults ~0tP~ts", [What, 12, near(What)]);
format_problem({no_controller, Why}) ->
    Why;
format_problem({fault, Problem}) ->
    starl_run_fault:format_problem(Problem);
format_problem(Problem) ->
    starl_options:format_problem(Problem).

near(What) ->
    Classes = starl_run_fault:classes(),
    Known = [all | Classes] ++ [element(1, Spec) || Spec <- starl_run_fault:kinds()],
    All = ["; classes: ", lists:join(", ", [atom_to_list(Class) || Class <- [all | Classes]])],
    starl_similar:meant(starl_similar:atoms(What, Known), All).
