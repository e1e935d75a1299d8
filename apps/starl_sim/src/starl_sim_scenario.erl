%% @doc Scenarios: everything that, with the code, decides a run. A scenario is a map of Erlang
%% terms; a scenario file in `config/scenarios/' holds one, and every key is a flag of the
%% command line as well (`delay' is `--delay 5..50').
-module(starl_sim_scenario).

-export([options/0, check/2, read/1, format_error/1]).

-export_type([t/0, fault/0, reason/0]).

%% A checked scenario: all keys of {@link options/0} and of the application's own options.
-type t() :: #{atom() => term()}.

%% A fault: its name, from when to when (ms), what it does to whom.
%% `kill_machine' has the target {Robot, Machine}, `kill_robot' the target Robot.
-type fault() :: {
    Id :: atom(),
    FromMs :: non_neg_integer(),
    ToMs :: non_neg_integer(),
    Kind :: kill_machine | kill_robot,
    Target :: {starl:robot_id(), starl_machine:name()} | starl:robot_id(),
    Params :: map()
}.

-type reason() ::
    {problems, [starl_options:problem()]}
    | {file, file:filename(), file:posix() | badarg | terminated | system_limit}
    | {syntax, file:filename(), Line :: non_neg_integer(), unicode:chardata()}
    | {shape, file:filename()}.

%% @doc The table of the keys that every scenario has.
-spec options() -> [starl_options:option()].
options() ->
    [
        {robots, {integer, 1, 100000}, 4, "how many robots"},
        {seed, {integer, 0, 1 bsl 32}, 1, "decides every random draw"},
        {world, {size, {number, 1000, 1000000}}, {12000, 12000}, "the floor, mm"},
        {loss, {number, 0, 1}, 0.0, "part of the packets lost on the air"},
        {duplicate, {number, 0, 1}, 0.0, "part of the packets that arrive twice"},
        {delay, {between, {number, 1, 60000}}, {5, 20}, "delay of a packet, ms"},
        {range, {optional, {number, 1, 10000000}}, none, "range of the radio, mm"},
        {clock_offset, {number, 0, 1.0e9}, 1000, "clocks differ by up to +- this, ms"},
        {clock_drift, {number, 0, 10000}, 50, "clocks drift by up to +- this, ppm"},
        {speed, {number, 1, 500}, 500, "driving speed, mm/s (the Create's limit is 500)"},
        {heading_error, {number, 0, 0.1}, 0.02, "error of the heading per leg, up to +- rad"},
        {distance_error, {number, 0, 0.1}, 0.01, "error of the distance per leg, up to +- part"},
        {position_error, {number, 0, 50}, 1.0, "error of the positioning system, up to mm"},
        {time, {number, 0, 1.0e6}, 7200, "ends at this virtual time, s"},
        {mode, {one_of, [auto, process, inline]}, auto,
            "process: each machine of a robot is a process; inline: none is; auto: by their number"},
        {shards, {optional, {integer, 1, 256}}, none,
            "over how many shards the robots are spread; none: by their number and the cores"},
        {faults, {term, "a list of {Id, FromMs, ToMs, Kind, Target, Params}", fun faults/1}, [],
            "crashes: kill_machine {Robot, Name}, kill_robot Robot"}
    ].

%% @doc Checks a scenario for an application with these options of its own.
-spec check(#{atom() => term()}, [starl_options:option()]) -> {ok, t()} | {error, reason()}.
check(Given, AppOptions) ->
    case starl_options:check(maps:remove(app, Given), options() ++ AppOptions) of
        {ok, Scenario} -> {ok, maps:merge(maps:with([app], Given), Scenario)};
        {error, Problems} -> {error, {problems, Problems}}
    end.

%% @doc Reads a scenario file; its terms are not checked yet.
-spec read(file:filename()) -> {ok, #{atom() => term()}} | {error, reason()}.
read(File) ->
    case file:consult(File) of
        {ok, [Scenario]} when is_map(Scenario) -> {ok, Scenario};
        {ok, _} -> {error, {shape, File}};
        {error, {Line, Module, What}} when is_integer(Line) ->
            {error, {syntax, File, Line, Module:format_error(What)}};
        {error, Posix} -> {error, {file, File, Posix}}
    end.

%% @doc One line that says what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({problems, Problems}) ->
    lists:join("; ", [starl_options:format_problem(P) || P <- Problems]);
format_error({file, File, Posix}) ->
    io_lib:format("~ts: ~ts", [File, file:format_error(Posix)]);
format_error({syntax, File, Line, What}) ->
    io_lib:format("~ts:~b: ~ts", [File, Line, What]);
format_error({shape, File}) ->
    io_lib:format("~ts: a scenario file holds one map, as in #{app => painting}.", [File]).

faults(List) when length(List) >= 0 -> lists:all(fun fault/1, List);
faults(_) -> false.

fault({Id, From, To, kill_machine, {Robot, Name}, Params}) ->
    span(Id, From, To, Params) andalso is_integer(Robot) andalso is_atom(Name);
fault({Id, From, To, kill_robot, Robot, Params}) ->
    span(Id, From, To, Params) andalso is_integer(Robot);
fault(_) ->
    false.

span(Id, From, To, Params) ->
    is_atom(Id) andalso is_integer(From) andalso From >= 0 andalso is_integer(To) andalso
        To >= From andalso is_map(Params).
