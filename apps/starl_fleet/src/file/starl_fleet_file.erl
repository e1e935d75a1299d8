%% @doc Reads the fleet file: the robots of a fleet, their computers, and the application that they
%% run. The file holds one map of Erlang terms. See `doc/deploy.md'.
%%
%% All problems of a file are reported together, each with its place. The release contains the same
%% file, completed with defaults; each robot's node reads it with the same checks.
-module(starl_fleet_file).

-export([read/1, check/3]).
-export([scenario/1, files/1, portable/2]).

-export_type([t/0, robot/0]).

%% A checked fleet. `options': the values of the scenario; `dir': the directory of the fleet file, to
%% which all paths in it are relative.
-type t() :: #{
    name := string(),
    app := module(),
    options := #{atom() => term()},
    robots := #{starl:robot_id() => robot()},
    transport := starl_fleet_adapters:transport(),
    all := each | {multicast | broadcast, inet:ip4_address(), inet:port_number()},
    positioning := {starl_fleet_adapters:name(), map()},
    keys := file:filename(),
    home := file:filename(),
    service := auto | systemd | plain,
    record_mb := non_neg_integer(),
    metrics := inet:port_number() | none,
    dir := file:filename()
}.

%% A robot: its computer as `ssh' reaches it, the address at which the others reach the robot, and its
%% chassis.
-type robot() :: #{
    host := string(),
    user := string() | none,
    ssh := [string()],
    address := string(),
    port := inet:port_number(),
    chassis := {starl_fleet_adapters:name(), map()}
}.

%% The scenario's keys that mean something outside the simulator.
-define(SCENARIO, [
    seed,
    world,
    delay,
    speed,
    chassis,
    acceleration,
    heading_error,
    distance_error,
    position_error,
    command_latency
]).

-define(WORD, "^[A-Za-z0-9][A-Za-z0-9-]*$").
-define(USER, "^[A-Za-z_][A-Za-z0-9_.-]*$").
-define(HOST, "^[A-Za-z0-9][A-Za-z0-9_.-]*$").
-define(PATH, "^[A-Za-z0-9_./-]+$").
-define(PORT, 5001).

%% The keys of a fleet file.
options() ->
    [
        {name, {term, "a name of letters, digits and '-'", matches(?WORD)}, required,
            "the fleet's name"},
        {app, {term, "an application's name, or the file of one as \"my_app.erl\"", fun is_app/1},
            required, "the application"},
        {options, {term, "a map of the application's options", fun is_map/1}, #{},
            "values of the scenario, as flags of ./starl run"},
        {robots, {term, "a map, number => robot", fun is_map/1}, required, "the robots, from 1 on"},
        {transport, {one_of, starl_fleet_adapters:transports()}, udp,
            "sealed datagrams, or Erlang distribution over TLS"},
        {all, {term, "each, or {multicast | broadcast, {239,1,2,3}, Port}", fun is_all/1}, each,
            "the way of a packet for all robots (udp only)"},
        {positioning, source_type(), none, "the positioning system"},
        {keys, path(), "keys", "the directory of the fleet's keys, on this computer"},
        {home, path(), "starl", "the directory on the robots' computers"},
        {service, {one_of, [auto, systemd, plain]}, auto,
            "what keeps a robot's node running; auto: systemd where it is"},
        {record_mb, {integer, 0, 1000000}, 1000,
            "the recordings that a robot keeps, in MB; 0: it records nothing"},
        {metrics, {optional, {integer, 1, 65535}}, none,
            "the port at which each robot serves its metrics for Prometheus; none: it serves none"}
    ].

%% The keys of a robot.
robot_options() ->
    [
        {host, {term, "the name or IPv4 address of a computer", matches(?HOST)}, required,
            "the robot's computer, for ssh"},
        {user, {optional, {term, "a user's name", matches(?USER)}}, none,
            "the user there; none: as ssh says"},
        {ssh, {term, "a list of texts", fun is_texts/1}, [], "further arguments of ssh"},
        {address, {optional, {term, "a name or an IPv4 address", matches(?HOST)}}, none,
            "where the other robots reach it; none: the host"},
        {port, {integer, 1, 65535}, ?PORT, "the port at which it hears"},
        {chassis, chassis_type(), none, "what drives"},
        {camera, {optional, {term, "a map as #{command => \"ffmpeg ...\"}", fun is_map/1}}, none,
            "the program that writes the camera's pictures, and what is looked for"}
    ].

source_type() -> choice(starl_fleet_adapters:sources()).
chassis_type() -> choice(starl_fleet_adapters:chassis()).

choice(Names) ->
    Known = lists:append(lists:join(", ", [atom_to_list(N) || N <- Names, N =/= exec])),
    Programs = lists:append([", \"exec:PROGRAM\"" || lists:member(exec, Names)]),
    IsName = fun(Name) -> lists:member(Name, Names) orelse is_own(Name) end,
    Is = fun
        ({module, Module}) -> is_atom(Module);
        ({Name, Own}) -> IsName(Name) andalso is_map(Own);
        ("exec:" ++ Command) -> Programs =/= "" andalso is_text(Command);
        (Name) -> IsName(Name)
    end,
    {term, "one of " ++ Known ++ Programs ++ ", \"FILE.erl\", or {NAME, #{...}}", Is}.

%% A file of the user's own, or its module, once it is compiled.
is_own({module, Module}) -> is_atom(Module);
is_own(File) -> is_text(File) andalso filename:extension(File) =:= ".erl".

path() -> {term, "a path without blanks", matches(?PATH)}.

matches(Pattern) ->
    fun(Text) ->
        is_text(Text) andalso re:run(Text, Pattern, [{capture, none}, dollar_endonly]) =:= match
    end.

is_text(Text) -> io_lib:printable_unicode_list(Text) andalso Text =/= "".

is_texts(Texts) -> is_list(Texts) andalso lists:all(fun is_text/1, Texts).

is_app(App) -> is_text(App) orelse (is_atom(App) andalso App =/= none).

is_all(each) ->
    true;
is_all({Kind, {A, B, C, D}, Port}) when Kind =:= multicast; Kind =:= broadcast ->
    lists:all(fun(Byte) -> is_integer(Byte) andalso Byte >= 0 andalso Byte < 256 end, [A, B, C, D]) andalso
        is_integer(Port) andalso Port > 0 andalso Port < 65536;
is_all(_) ->
    false.

%% -- reading --------------------------------------------------------------------------------

%% @doc Reads a fleet file; its values are not checked yet.
-spec read(file:filename()) -> {ok, #{atom() => term()}} | {error, [unicode:chardata(), ...]}.
read(File) ->
    case starl_run_scenario:read(File) of
        {ok, Given} -> {ok, Given};
        {error, {shape, _}} -> {error, [[File, ": a fleet file holds one map; ", how()]]};
        {error, {file, _, enoent}} -> {error, [[File, ": no such file; ", how()]]};
        {error, Reason} -> {error, [starl_run_scenario:format_error(Reason)]}
    end.

how() -> "an example: ./starl deploy --example > fleet.term".

%% @doc Checks a fleet file that has been read. The application is a module that is loaded, or
%% `unknown' while it cannot be: then its options are not checked.
-spec check(file:filename(), #{atom() => term()}, module() | unknown) ->
    {ok, t()} | {error, [unicode:chardata(), ...]}.
check(File, Given, App) ->
    {Fleet, Problems} = checked(Given, options()),
    {Robots, OfRobots} = robots(maps:get(robots, Fleet, #{})),
    {Options, OfOptions} = app_values(maps:get(options, Fleet, #{}), App, File),
    All = Problems ++ OfRobots ++ OfOptions,
    Dir = filename:dirname(filename:absname(File)),
    Whole = normal(Fleet#{robots => Robots, options => Options, app => App, dir => Dir}),
    case All =:= [] andalso together(Whole) of
        false -> {error, [[File, ": ", Problem] || Problem <- All]};
        [] -> {ok, Whole};
        Wrong -> {error, [[File, ": ", Problem] || Problem <- Wrong]}
    end.

%% The values of a table, and the problems in words.
checked(Given, Table) ->
    Missing = [
        io_lib:format("the key ~ts is missing: ~ts", [Key, Doc])
     || {Key, _, required, Doc} <- Table, not is_map_key(Key, Given)
    ],
    case starl_options:check(Given, Table) of
        {ok, Values} -> {maps:filter(fun(_, Value) -> Value =/= required end, Values), Missing};
        {error, Wrong} -> {sound(Given, Wrong), lines(Wrong) ++ Missing}
    end.

lines(Wrong) -> [starl_options:format_problem(Problem) || Problem <- Wrong].

%% What is wrong at the top does not hide what is wrong below it.
sound(Given, Wrong) -> maps:without([Key || {bad_value, Key, _, _} <- Wrong], Given).

robots(Given) ->
    Checked = [
        {Number, robot(Number, Robot)}
     || {Number, Robot} <- lists:sort(maps:to_list(Given))
    ],
    Problems = [P || {_, {_, Some}} <- Checked, P <- Some],
    {
        maps:from_list([{Number, Robot} || {Number, {Robot, _}} <- Checked]),
        numbers(Given) ++ Problems
    }.

numbers(Given) ->
    Wanted = lists:seq(1, map_size(Given)),
    case {Wanted, Wanted -- maps:keys(Given)} of
        {[], _} ->
            ["robots: there is none; write robots => #{1 => #{host => \"robot1\"}}"];
        {_, []} ->
            [];
        {_, [Missing | _]} ->
            [
                io_lib:format("robots: robot ~b is missing; robots are numbered 1, 2, 3 ...", [
                    Missing
                ])
            ]
    end.

robot(Number, #{} = Given) ->
    {Values, Problems} = checked(Given, robot_options()),
    {addressed(Values), [[place(Number), P] || P <- Problems]};
robot(Number, Other) ->
    {#{}, [[place(Number), io_lib:format("a map expected, not ~0tP", [Other, 9])]]}.

place(Number) -> io_lib:format("robot ~0tp: ", [Number]).

addressed(#{address := none, host := Host} = Robot) -> addressed(Robot#{address := Host});
addressed(#{chassis := Chassis} = Robot) -> Robot#{chassis := named(Chassis)};
addressed(Robot) -> Robot.

named({module, _} = Module) -> {Module, #{}};
named({Name, Own}) -> {Name, Own};
named("exec:" ++ Command) -> {exec, #{exec => Command}};
named(Name) -> {Name, #{}}.

normal(#{positioning := Source} = Fleet) -> Fleet#{positioning := named(Source)};
normal(Fleet) -> Fleet.

%% -- the application's options --------------------------------------------------------------

%% The options that a fleet file may set for an application.
app_options(App) ->
    Own = starl_app:options(App),
    Mine = [Key || {Key, _, _, _} <- Own],
    [
        Option
     || {Key, _, _, _} = Option <- starl_run_scenario:options(),
        lists:member(Key, ?SCENARIO),
        not lists:member(Key, Mine)
    ] ++ Own.

app_values(Given, unknown, _File) ->
    {Given, []};
app_values(Given, App, File) ->
    Table = app_options(App),
    Resolved = beside(Given, Table, filename:dirname(File)),
    case starl_options:check(Resolved, Table) of
        {ok, _} -> {Resolved, []};
        {error, Wrong} -> {Resolved, [["options: ", option(P)] || P <- Wrong]}
    end.

option({unknown_key, Key, []} = Problem) ->
    Simulated = [K || {K, _, _, _} <- starl_run_scenario:options()],
    case lists:member(Key, Simulated) of
        true -> io_lib:format("~ts: only the simulator has this", [Key]);
        false -> starl_options:format_problem(Problem)
    end;
option(Problem) ->
    starl_options:format_problem(Problem).

%% Files that options name are found beside the fleet file.
beside(Given, Table, Dir) ->
    Beside = fun(_Key, Name) ->
        File = is_text(Name) andalso filename:join(Dir, Name),
        case File =/= false andalso filelib:is_regular(File) of
            true -> File;
            false -> Name
        end
    end,
    maps:merge(Given, maps:map(Beside, maps:with(of_files(Table), Given))).

of_files(Table) -> [Key || {Key, file, _, _} <- Table].

%% @doc The files that the application's options name, by their keys.
-spec files(t()) -> [{Key :: atom(), file:filename()}].
files(#{app := App, options := Options}) ->
    [
        {Key, File}
     || {Key, File} <- lists:sort(maps:to_list(maps:with(of_files(app_options(App)), Options))),
        is_text(File),
        filelib:is_regular(File)
    ].

%% @doc The text of the fleet file that goes into a release, with the places of these files there.
-spec portable(t(), #{atom() => file:filename()}) -> unicode:chardata().
portable(#{options := Options} = Fleet, Files) ->
    Kept = maps:without([dir], Fleet#{options := maps:merge(Options, Files)}),
    ["%% -*- coding: utf-8 -*-\n", io_lib:format("~tp.~n", [Kept])].

%% @doc The scenario whose robots these are.
-spec scenario(t()) -> #{app := module(), atom() => term()}.
scenario(#{app := App, options := Options, robots := Robots}) ->
    Options#{app => App, robots => map_size(Robots), mode => process}.

%% -- what must fit together -----------------------------------------------------------------

together(Fleet) ->
    available(Fleet) ++ same_places(Fleet) ++ by_distribution(Fleet).

available(#{positioning := {Source, _}, robots := Robots}) ->
    [["positioning: ", Why] || {error, Why} <- [starl_fleet_adapters:source(Source)]] ++
        [
            [place(Number), "chassis: ", Why]
         || {Number, #{chassis := {Chassis, _}}} <- lists:sort(maps:to_list(Robots)),
            {error, Why} <- [starl_fleet_adapters:driver(Chassis)]
        ] ++
        [
            [place(Number), Why]
         || {Number, #{camera := #{} = Camera}} <- lists:sort(maps:to_list(Robots)),
            {error, Why} <- [starl_live_camera:options(Camera)]
        ].

same_places(#{robots := Robots}) ->
    Places = [{{A, P}, N} || {N, #{address := A, port := P}} <- lists:sort(maps:to_list(Robots))],
    [
        io_lib:format("robots ~b and ~b have the same address and port, ~ts port ~b", [A, B, H, P])
     || {{H, P} = Place, A} <- Places, {Other, B} <- Places, Place =:= Other, A < B
    ].

%% Without a port mapper, a node is found at the one port of all nodes.
by_distribution(#{transport := dist, robots := Robots}) ->
    Ports = lists:usort([Port || #{port := Port} <- maps:values(Robots)]),
    [
        "transport dist: all robots hear at the same port, each at an address of its own"
     || length(Ports) > 1
    ] ++
        [
            [place(Number), "address: transport dist needs a name with a dot or an IPv4 address"]
         || {Number, #{address := Address}} <- lists:sort(maps:to_list(Robots)),
            not lists:member($., Address)
        ];
by_distribution(#{}) ->
    [].
