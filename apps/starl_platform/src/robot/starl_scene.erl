%% @doc The scene that an application plays in: waypoints, building blocks, where the robots start,
%% the contracts it is held to; and what it tells of a run. An application without a scene of its own
%% ({@link starl_app}) plays on an empty floor, with its blocks and their contracts.
%%
%% A module that is only a scene, for a machine or another module's application, needs nothing else;
%% as an application it may have a table of options, `options/0'.
-module(starl_scene).

-export([make/2, report/3]).

-export_type([t/0, context/0, outcome/0, report/0, format/0]).

%% What a scene is made for.
-type context() :: #{
    robots := [starl:robot_id()],
    world := {WidthMm :: number(), HeightMm :: number()},
    seed := integer(),
    %% what the robots drive on, in turn
    profiles := starl_chassis:profiles(),
    sap := starl_sap:config(),
    options := #{atom() => term()}
}.

%% The surroundings of an application. All keys but `app' may be left out. A scene that {@link make/2}
%% has made has machines in the place of its blocks, and the blocks' contracts among its monitors.
-type t() :: #{
    app := {sequential, module(), Args :: term()} | {machine, module(), Config :: map()},
    blocks => [starl_block:entry()],
    waypoints => #{atom() => starl_geometry:point()},
    poses => #{starl:robot_id() => starl:pose()},
    %% contracts besides those of the blocks
    monitors => [{module(), map()}],
    profile => map(),
    sap => starl_sap:config(),
    %% a crash of the application by itself is a violation, as that of a block is (false)
    never_crashes => boolean(),
    %% another implementation of SAP, for tests
    sap_machine => module(),
    %% whatever report/2 needs
    memo => term()
}.

%% What a run has come to: its end, the monitors' results, each robot's result and last pose.
-type outcome() :: #{
    end_us := integer(),
    monitors := #{module() => map()},
    robots := [{starl:robot_id(), #{result := term(), pose := starl:pose(), atom() => term()}}],
    atom() => term()
}.

%% What is told of a run. The figures are in the order in which they are to stand in the report.
%% Whether the work is complete is the application's to say; if it does not, it is when every robot's
%% application has come to its end. `done' says in a few words how much is done, `summary' has
%% further lines for the terminal; `write' puts further files into a directory and tells their names.
-type report() :: #{
    figures := [{Key :: atom(), Value :: number() | binary() | boolean() | null}],
    formats => #{Key :: atom() => format()},
    complete => boolean(),
    done => unicode:chardata(),
    summary => [unicode:chardata()],
    write => fun((Dir :: file:filename()) -> {ok, [file:filename()]} | {error, string()})
}.

%% How a figure is written: with how many decimals (3) and how they are rounded, `down' for what must
%% not look better than it is (near). What an axis of a plot says, with the unit; and whether it
%% is plotted where nothing else is asked for (false).
-type format() :: #{
    decimals => 0..9,
    rounded => near | down,
    label => string(),
    plotted => boolean()
}.

-callback scene(context()) -> {ok, t()} | {error, Why :: unicode:chardata()}.
-callback report(t(), outcome()) -> report().

-optional_callbacks([report/2]).

%% @doc The scene of an application, with the machines and the contracts of its blocks; or one line
%% that says what is wrong with it.
-spec make(module(), context()) -> {ok, t()} | {error, Why :: unicode:chardata()}.
make(App, Context) ->
    case scene(App, Context) of
        {ok, Scene} -> expanded(App, Scene, Context);
        {error, _} = Error -> Error
    end.

scene(App, #{options := Options} = Context) ->
    case exported(App, scene, 1) of
        true -> App:scene(Context);
        false -> {ok, #{app => {sequential, App, Options}, blocks => blocks(App)}}
    end.

blocks(App) ->
    case exported(App, blocks, 0) of
        true -> App:blocks();
        false -> []
    end.

expanded(App, Scene, Context) ->
    case starl_block:expand(maps:get(blocks, Scene, []), Context) of
        {ok, {Machines, Contracts}} ->
            Monitors = Contracts ++ maps:get(monitors, Scene, []),
            {ok, Scene#{blocks => Machines, monitors => Monitors}};
        {error, Why} ->
            {error, [atom_to_list(App), ": ", Why]}
    end.

%% @doc What an application has to tell of a run.
-spec report(module(), t(), outcome()) -> report().
report(App, Scene, Outcome) ->
    case exported(App, report, 2) of
        true -> App:report(Scene, Outcome);
        false -> #{figures => []}
    end.

exported(App, Function, Arity) ->
    _ = code:ensure_loaded(App),
    erlang:function_exported(App, Function, Arity).
