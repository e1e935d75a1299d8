%% @doc Compares the memory that a run needs with the free memory of the machine, before the run. On
%% a machine that runs out of memory, the system may kill the run, or everything, without a message.
-module(starl_lab_memory).

-export([check/1, check/2, check/3, largest/2, available/0]).

-export_type([use/0]).

%% The number of runs at once, each in a VM of its own, and whether the command can spread a run over
%% other machines.
-type use() :: #{jobs := pos_integer(), nodes := boolean()}.

%% Bytes for each robot, at the peak of a run: measured with teams of 3,000 (`ring_shuttle': 237 kB
%% and 48 kB), rounded up. The bare VM comes on top.
-define(PROCESS, 250_000).
-define(INLINE, 70_000).
-define(BARE, 60_000_000).
%% Processes of a robot: its supervisor, its services, its application and a few blocks.
-define(PROCESSES, 10).

%% @doc One line if a run of this scenario needs more memory, or more processes, than there are.
-spec check(starl_run_scenario:t()) -> [unicode:chardata()].
check(Scenario) -> check(Scenario, #{jobs => 1, nodes => true}).

%% @doc The same for other commands than a run.
-spec check(starl_run_scenario:t(), use()) -> [unicode:chardata()].
check(Scenario, Use) -> check(Scenario, Use, available()).

%% @doc The same for the largest of several scenarios.
-spec largest([starl_run_scenario:t(), ...], use()) -> [unicode:chardata()].
largest(Scenarios, Use) ->
    {_, Largest} = lists:max([{needed(Scenario), Scenario} || Scenario <- Scenarios]),
    check(Largest, Use).

%% @doc The same for a given memory in bytes.
-spec check(starl_run_scenario:t(), use(), Available :: non_neg_integer() | unknown) ->
    [unicode:chardata()].
check(#{robots := Robots} = Scenario, #{jobs := Jobs} = Use, Available) ->
    Mode = mode(Scenario),
    Processes = erlang:system_info(process_limit) div ?PROCESSES,
    Needed = Jobs * needed(Scenario),
    %% An atom is more than every number.
    if
        Mode =:= process, Robots > Processes ->
            [["--mode process: it is for ", up_to(Processes), "; take --mode inline for more"]];
        Needed > Available ->
            [[needs(Robots, Jobs, Needed, Available), ways_out(Mode, Scenario, Use, Available)]];
        true ->
            []
    end.

needs(Robots, Jobs, Needed, Available) ->
    io_lib:format("--robots: ~b robots~ts need about ~ts of memory, and ~ts are free; take ", [
        Robots,
        [io_lib:format(" in each of ~b runs at once", [Jobs]) || Jobs > 1],
        amount(Needed),
        amount(Available)
    ]).

ways_out(Mode, Scenario, #{jobs := Jobs, nodes := Nodes}, Available) ->
    Fewer = Available div needed(Scenario),
    [
        up_to(max(1, (Available div Jobs - ?BARE) div each(Mode))),
        [", or --mode inline" || Mode =:= process],
        [io_lib:format(", or --jobs ~b", [Fewer]) || Fewer >= 1],
        [", or spread the run over other machines (--nodes)" || Nodes]
    ].

up_to(Robots) -> io_lib:format("up to ~b robots", [Robots]).

%% The memory that a run of this scenario needs, in bytes.
-spec needed(starl_run_scenario:t()) -> pos_integer().
needed(#{robots := Robots} = Scenario) when is_integer(Robots) ->
    ?BARE + Robots * each(mode(Scenario)).

mode(Scenario) -> starl_sim_plan:mode(Scenario, #{auto => inline}).

each(process) -> ?PROCESS;
each(inline) -> ?INLINE.

amount(Bytes) when Bytes >= 1_000_000_000 -> io_lib:format("~.1f GB", [Bytes / 1.0e9]);
amount(Bytes) -> io_lib:format("~b MB", [Bytes div 1_000_000]).

%% @doc The memory that this VM may still take, in bytes: the free memory of the machine, or less if
%% a container has a limit; `unknown' where the system does not report it.
-spec available() -> non_neg_integer() | unknown.
available() ->
    %% An atom is more than every number.
    lists:min([machine(), container()]).

machine() ->
    case file:read_file("/proc/meminfo") of
        {ok, Text} -> kilobytes(re:run(Text, "MemAvailable: +([0-9]+) kB", [{capture, [1], list}]));
        {error, _} -> unknown
    end.

kilobytes({match, [Text]}) -> 1024 * list_to_integer(Text);
kilobytes(nomatch) -> unknown.

container() ->
    case {number("/sys/fs/cgroup/memory.max"), number("/sys/fs/cgroup/memory.current")} of
        {Max, Used} when is_integer(Max), is_integer(Used) -> max(0, Max - Used);
        {_, _} -> unknown
    end.

number(File) ->
    case file:read_file(File) of
        {ok, Text} -> whole(string:to_integer(Text));
        {error, _} -> unknown
    end.

whole({N, _}) when is_integer(N) -> N;
whole({error, _}) -> unknown.
