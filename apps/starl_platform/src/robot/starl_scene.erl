%% @doc The behaviour of a scene: the surroundings of an application (waypoints, building blocks,
%% start poses, contracts) and its report of a run. An application without a scene of its own
%% ({@link starl_app}) runs on an empty floor, with its blocks and their contracts.
%%
%% A module that is only a scene, for a machine or for the application of another module, needs
%% nothing else. If it is also an application, it may have a table of options, `options/0'.
-module(starl_scene).

-export([make/2, report/3, preview/2, blocks_of/2]).
-export([check/1]).

-export_type([t/0, context/0, outcome/0, report/0, format/0, preview/0, written/0]).

%% The input from which a scene is made.
-type context() :: #{
    robots := [starl:robot_id()],
    world := {WidthMm :: number(), HeightMm :: number()},
    %% the floor plan; of a run without one, an empty floor of that size
    floor := starl_floor:t(),
    seed := integer(),
    %% the profiles of the robots, taken in turn
    profiles := starl_chassis:profiles(),
    sap := starl_sap:config(),
    %% of the radio, mm; `none': everybody hears everybody
    range => number() | none,
    options := #{atom() => term()}
}.

%% The surroundings of an application. All keys but `app' may be left out. {@link make/2} replaces
%% the blocks by their machines, and adds the blocks' contracts to the monitors.
-type t() :: #{
    app := {sequential, module(), Args :: term()} | {machine, module(), Config :: map()},
    blocks => [starl_block:entry()],
    waypoints => #{atom() => starl_geometry:point()},
    %% the application's own floor plan, if the scenario names none
    floor => starl_floor:t(),
    poses => #{starl:robot_id() => starl:pose()},
    %% the least distance of two robots at the beginning (mm), if they need more than not to touch
    apart_mm => number(),
    %% what senses see on the floor, and other measures and errors of senses than the usual ones
    things => [starl_sense:thing()],
    senses => #{starl_sense:kind() => starl_sense:profile()},
    %% contracts besides those of the blocks
    monitors => [{module(), map()}],
    profile => map(),
    sap => starl_sap:config(),
    %% is a crash of the application by itself a violation, as that of a block is (false)?
    never_crashes => boolean(),
    %% is it a violation if a robot touches anything (false)?
    never_bumps => boolean(),
    %% what is told before a run begins, a line each, such as the rooms that cannot be reached
    notes => [unicode:chardata()],
    %% other implementations of SAP and of motion, for tests
    sap_machine => module(),
    motion_machine => module(),
    %% any term for report/2
    memo => term()
}.

%% The result of a run: its end, the monitors' results, each robot's result and last pose.
-type outcome() :: #{
    end_us := integer(),
    monitors := #{module() => map()},
    robots := [{starl:robot_id(), #{result := term(), pose := starl:pose(), atom() => term()}}],
    atom() => term()
}.

%% The report of a run. The figures stand in the order of the report. `complete': is the work
%% complete? A run is complete when it is, and every application of a robot that lives has ended;
%% without this key, when every robot's application has ended. `done' is a short
%% phrase on how much is done, `summary' holds further lines for the terminal; `write' puts further
%% files into a directory and returns their names.
-type report() :: #{
    figures := [{Key :: atom(), Value :: number() | binary() | boolean() | null}],
    formats => #{Key :: atom() => format()},
    complete => boolean(),
    done => unicode:chardata(),
    summary => [unicode:chardata()],
    write => fun((Dir :: file:filename()) -> written()),
    floor => starl_floor:t()
}.

%% The files that were written; `partly': all that matter, and why others are not there.
-type written() ::
    {ok, [file:filename()]}
    | {partly, [file:filename()], Why :: unicode:chardata()}
    | {error, Why :: unicode:chardata()}.

%% How a figure is shown: its decimals (3); its rounding, `down' for a figure that must not look
%% better than it is (near); the label of its axis in a plot, with the unit; and whether it is
%% plotted by default (false).
-type format() :: #{
    decimals => 0..9,
    rounded => near | down,
    label => string(),
    plotted => boolean()
}.

%% What a run of the scene is going to do: lines for the terminal, and a function that puts files into
%% a directory and returns their names.
-type preview() :: #{
    lines := [unicode:chardata()],
    write := fun((Dir :: file:filename()) -> written())
}.

-callback scene(context()) -> {ok, t()} | {error, Why :: unicode:chardata()}.
-callback report(t(), outcome()) -> report().
-callback preview(t()) -> preview().

-optional_callbacks([report/2, preview/1]).

%% @doc The scene of an application, with the machines and the contracts of its blocks; or one line
%% on an error in it.
-spec make(module(), context()) -> {ok, t()} | {error, Why :: unicode:chardata()}.
make(App, Context) ->
    case walls(App, Context) of
        [] -> made(scene(App, Context), App, Context);
        Walls -> {error, unknown_walls(App, length(Walls), Context)}
    end.

made({ok, Scene}, App, Context) -> expanded(App, Scene, Context);
made({error, _} = Error, _App, _Context) -> Error.

%% The walls of the plan, if the application knows none.
walls(App, #{floor := #{walls := Walls}}) ->
    case
        starl_callback:exported(App, knows_walls, 0) andalso
            starl_app:declared(App, knows_walls, [])
    of
        {ok, false} -> Walls;
        _ -> []
    end;
walls(_App, _Context) ->
    [].

unknown_walls(App, N, #{floor := #{name := Name}}) ->
    io_lib:format(
        "the floor plan~ts has ~b wall~ts inside, and ~ts knows no walls: use a plan without them, or an "
        "application that knows them, such as search, painting or convoy",
        [
            [[$\s, Name] || Name =/= <<>>],
            N,
            [$s || N =/= 1],
            string:replace(atom_to_list(App), "starl_", "", leading)
        ]
    ).

%% @doc The building blocks that an application lists, without what every robot has.
-spec blocks_of(module(), context()) -> {ok, [module()]} | {error, unicode:chardata()}.
blocks_of(App, Context) ->
    case scene(App, Context) of
        {ok, Scene} -> {ok, lists:append([block(Entry) || Entry <- maps:get(blocks, Scene, [])])};
        {error, _} = Error -> Error
    end.

block({Block, Options}) when is_map(Options) -> [Block];
block(Block) when is_atom(Block) -> [Block];
block(_Machine) -> [].

scene(App, #{options := Options} = Context) ->
    case starl_callback:exported(App, scene, 1) of
        true -> own(starl_app:declared(App, scene, [Context]), App);
        false -> plain(blocks(App), monitors(App, Context), App, Options)
    end.

own({ok, {ok, Scene}}, App) -> sound(check(Scene), Scene, App);
own({ok, {error, Why}}, _App) -> {error, Why};
own({ok, Other}, App) -> {error, at(App, scene, 1, no_answer(Other))};
own({error, _} = Error, _App) -> Error.

sound(ok, Scene, _App) -> {ok, Scene};
sound({error, Why}, _Scene, App) -> {error, at(App, scene, 1, Why)}.

plain({ok, Blocks}, {ok, Monitors}, App, Options) ->
    {ok, #{app => {sequential, App, Options}, blocks => Blocks, monitors => Monitors}};
plain({error, _} = Error, _Monitors, _App, _Options) ->
    Error;
plain(_Blocks, {error, _} = Error, _App, _Options) ->
    Error.

blocks(App) ->
    case starl_callback:exported(App, blocks, 0) of
        true -> starl_app:declared(App, blocks, []);
        false -> {ok, []}
    end.

monitors(App, Context) ->
    case starl_callback:exported(App, monitors, 1) of
        true -> listed(starl_app:declared(App, monitors, [Context]), App);
        false -> {ok, []}
    end.

listed({ok, Monitors} = Listed, App) ->
    case monitor_list(Monitors) of
        true ->
            Listed;
        Expected ->
            Why = io_lib:format("~ts expected, not ~0tP", [Expected, Monitors, 12]),
            {error, at(App, monitors, 1, Why)}
    end;
listed({error, _} = Error, _App) ->
    Error.

expanded(App, Scene, Context) ->
    case starl_block:expand(maps:get(blocks, Scene, []), Context) of
        {ok, {Machines, Contracts}} ->
            Whole = Scene#{
                blocks => Machines, monitors => Contracts ++ maps:get(monitors, Scene, [])
            },
            judged(Whole, [Module || {Module, _} <- Contracts], App);
        {error, Why} ->
            {error, listed_at(App, Why)}
    end.

%% The monitors are checked before they judge.
judged(#{blocks := Machines, monitors := Monitors} = Scene, Contracts, App) ->
    case starl_monitor_check:check(Monitors, [Name || {Name, _, _} <- Machines]) of
        ok ->
            {ok, Scene};
        {error, {listed, Module, Why}} ->
            {error,
                case lists:member(Module, Contracts) of
                    true -> listed_at(App, Why);
                    false -> monitors_at(App, Why)
                end};
        {error, {mistake, Line}} ->
            {error, Line}
    end.

monitors_at(App, Why) ->
    case starl_callback:exported(App, scene, 1) of
        true -> at(App, scene, 1, ["monitors: ", Why]);
        false -> at(App, monitors, 1, Why)
    end.

%% The blocks stand in the list of blocks/0, or in the scene.
listed_at(App, Why) ->
    case starl_callback:exported(App, scene, 1) of
        true -> at(App, scene, 1, Why);
        false -> at(App, blocks, 0, Why)
    end.

at(App, Function, Arity, Why) ->
    [starl_app:place(App, Function, Arity), io_lib:format(": ~ts/~b: ", [Function, Arity]), Why].

%% @doc The report of an application on a run. If it crashes, a line says so in its place: the results
%% of the run are kept.
-spec report(module(), t(), outcome()) -> report().
report(App, Scene, Outcome) ->
    Report =
        case starl_callback:exported(App, report, 2) of
            true -> reported(starl_app:declared(App, report, [Scene, Outcome]));
            false -> #{figures => []}
        end,
    maps:merge(maps:with([floor], Scene), Report).

reported({ok, Report}) -> Report;
reported({error, Line}) -> #{figures => [], complete => false, summary => [Line]}.

%% @doc What a run of an application's scene is going to do.
-spec preview(module(), t()) -> preview().
preview(App, Scene) ->
    Nothing = #{lines => [], write => fun(_Dir) -> {ok, []} end},
    starl_callback:call(App, preview, [Scene], Nothing).

%% -- the check --------------------------------------------------------------------------------

%% Checks a scene that an application has made: its keys and their values.

%% @doc Is this a scene? Otherwise one line on the first problem.
-spec check(term()) -> ok | {error, unicode:chardata()}.
check(#{app := _} = Scene) ->
    case [Key || Key <- lists:sort(maps:keys(Scene)), not lists:member(Key, keys())] of
        [] -> values([{Key, maps:get(Key, Scene)} || Key <- keys(), is_checked(Key, Scene)]);
        [Key | _] -> unknown("the scene", Key, keys())
    end;
check(Scene) when is_map(Scene) ->
    {error, "the scene lacks the key app, as in app => {sequential, my_app, Args}"};
check(Other) ->
    {error, no_answer({ok, Other})}.

%% Another implementation of SAP has a configuration of its own.
is_checked(sap, #{sap_machine := _}) -> false;
is_checked(Key, Scene) -> is_map_key(Key, Scene).

%% One line on an answer that is none.
-spec no_answer(term()) -> unicode:chardata().
no_answer(Other) ->
    io_lib:format("{ok, #{app => ...}} or {error, \"Why\"} expected, not ~0tP", [Other, 12]).

keys() ->
    [app, blocks, waypoints, floor, poses, apart_mm, things, senses, monitors, profile, sap] ++
        [never_crashes, never_bumps, notes, sap_machine, motion_machine, memo].

values([]) ->
    ok;
values([{Key, Value} | Values]) ->
    case value(Key, Value) of
        true ->
            values(Values);
        {error, _} = Error ->
            Error;
        Expected ->
            {error, io_lib:format("~tp: ~ts expected, not ~0tP", [Key, Expected, Value, 12])}
    end.

value(app, {sequential, App, _Args}) when is_atom(App) -> callbacks(App, [{init, 2}, {step, 2}]);
value(app, {machine, App, Config}) when is_atom(App), is_map(Config) ->
    callbacks(App, [{init, 1}, {handle_event, 5}]);
value(app, _) ->
    "{sequential, Module, Args} or {machine, Module, Config}";
value(monitors, Monitors) ->
    monitor_list(Monitors);
value(profile, Profile) ->
    known("the profile", Profile, profile_keys());
value(sap, Sap) ->
    known("sap", Sap, sap_keys());
value(Key, Is) when Key =:= never_crashes; Key =:= never_bumps ->
    is_boolean(Is) orelse "true or false";
value(notes, Notes) ->
    is_list(Notes) orelse "a list of lines";
value(Machine, Module) when Machine =:= sap_machine; Machine =:= motion_machine ->
    is_atom(Module) orelse "a module";
value(Key, Value) ->
    surroundings(Key, Value).

%% Where the robots are, and among what.
surroundings(waypoints, Points) ->
    is_map_of(fun is_atom/1, fun is_point/1, Points, "#{Name => {X, Y}}");
surroundings(poses, Poses) ->
    is_map_of(fun is_robot/1, fun is_pose/1, Poses, "#{Robot => {X, Y, Heading}}");
surroundings(apart_mm, Mm) ->
    (is_number(Mm) andalso Mm >= 0) orelse "a distance in mm";
surroundings(floor, Floor) ->
    starl_floor:is_floor(Floor) orelse
        "a floor plan, of starl_floor_file:read/1 or starl_floor:new/1";
surroundings(things, Things) ->
    is_list(Things) andalso lists:all(fun is_thing/1, Things) orelse
        "a list of #{at => {X, Y}, colour => Colour}, with radius_mm and lamp_mm, mm";
surroundings(senses, Senses) ->
    case starl_sense:profiles(Senses) of
        {ok, _} -> true;
        {error, Why} -> {error, ["senses: ", Why]}
    end;
surroundings(_Key, _Value) ->
    true.

callbacks(Module, Wanted) ->
    case {code:ensure_loaded(Module), missing(Module, Wanted)} of
        {{error, _}, _} ->
            {error, io_lib:format("app: there is no module ~tp", [Module])};
        {_, []} ->
            true;
        {_, [{Function, Arity} | _]} ->
            {error, io_lib:format("app: ~tp does not export ~tp/~b", [Module, Function, Arity])}
    end.

missing(Module, Wanted) -> [{F, A} || {F, A} <- Wanted, not starl_callback:exported(Module, F, A)].

is_map_of(IsKey, IsValue, Map, Expected) ->
    Is = fun({Key, Value}) -> IsKey(Key) andalso IsValue(Value) end,
    (is_map(Map) andalso lists:all(Is, maps:to_list(Map))) orelse Expected.

is_point({X, Y}) -> is_number(X) andalso is_number(Y);
is_point(_) -> false.

is_thing(#{at := At} = Thing) ->
    is_point(At) andalso is_atom(maps:get(colour, Thing, none)) andalso
        lists:all(
            fun(Mm) -> is_number(Mm) andalso Mm > 0 end,
            maps:values(maps:with([radius_mm, lamp_mm], Thing))
        );
is_thing(_) ->
    false.

is_pose({X, Y, Heading}) -> is_point({X, Y}) andalso is_number(Heading);
is_pose(_) -> false.

is_robot(Id) -> is_integer(Id) andalso Id > 0.

%% Is this a list of monitors? What they export is another matter ({@link starl_monitor_check}).
-spec monitor_list(term()) -> true | (Expected :: string()).
monitor_list([{Module, Config} | Monitors]) when is_atom(Module), is_map(Config) ->
    monitor_list(Monitors);
monitor_list([]) ->
    true;
monitor_list(_) ->
    "a list of {Module, #{...}}".

known(What, Map, Keys) when is_map(Map) ->
    case [Key || Key <- lists:sort(maps:keys(Map)), not lists:member(Key, Keys)] of
        [] -> true;
        [Key | _] -> unknown(What, Key, Keys)
    end;
known(_What, _Other, Keys) ->
    io_lib:format("a map with keys of ~0tp", [Keys]).

unknown(What, Key, Keys) ->
    Known = lists:join(", ", [atom_to_list(K) || K <- Keys]),
    Meant = starl_similar:meant(starl_similar:atoms(Key, Keys), [" (keys: ", Known, ")"]),
    {error, io_lib:format("~ts has no key ~tp~ts", [What, Key, Meant])}.

%% The keys of every chassis.
profile_keys() ->
    Profiles = [starl_chassis_choice:profiles(Name, #{}) || Name <- starl_chassis_choice:names()],
    Keys = [Key || Profile <- lists:append(Profiles), Key <- maps:keys(Profile)],
    lists:usort([latency_ms, radius_mm | Keys]).

sap_keys() -> [retransmit_ms, backoff, longest_ms, limit, window, unclaimed].
