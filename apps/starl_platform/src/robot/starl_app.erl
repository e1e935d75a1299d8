%% @doc The behaviour of a sequential application: it reads like the paper's pseudo-code.
%%
%% `step/2' is the body of "repeat … until done". It may block in `starl:send', `starl:await',
%% `starl:go_to', `starl:sleep' and in the calls of the building blocks. The runtime calls it
%% through its fully qualified name, so newly loaded code takes effect at the next step; an
%% optional `code_change/2' (old state, old module version) carries the state over. If that fails,
%% the application waits with its old state in front of the step until other code is loaded that can
%% take it over, the code before among others; the rest of the robot goes on. What it did and what
%% others sent meanwhile is kept.
%%
%% An application may also say what it needs around it: its own options, and the scene it plays
%% in (waypoints, building blocks, where the robots start, the contracts it is held to) and what
%% it has to tell of a run.
-module(starl_app).

-export([options/1, scene/2, report/3]).

-export_type([context/0, scene/0, outcome/0, report/0, format/0]).

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

%% The surroundings of an application. All keys but `app' may be left out. Where a monitor's
%% configuration has a `bound_us', it is widened by what faults of clocks and processes cost.
-type scene() :: #{
    app := {sequential, module(), Args :: term()} | {machine, module(), Config :: map()},
    blocks => [starl_robot_sup:machine()],
    waypoints => #{atom() => starl_geometry:point()},
    poses => #{starl:robot_id() => starl:pose()},
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

-callback init(starl:robot(), Args :: term()) -> State :: term().
-callback step(starl:robot(), State :: term()) -> {continue, State :: term()} | {done, term()}.
-callback code_change(State :: term(), OldVsn :: term()) -> State :: term().
%% The building blocks that it uses, as in `[starl_election:block()]'; not needed with scene/1.
-callback blocks() -> [starl_robot_sup:machine()].
-callback options() -> [starl_options:option()].
-callback scene(context()) -> {ok, scene()} | {error, Why :: unicode:chardata()}.
-callback report(scene(), outcome()) -> report().

-optional_callbacks([
    init/2, step/2, code_change/2, blocks/0, options/0, scene/1, report/2
]).

%% @doc The application's own options.
-spec options(module()) -> [starl_options:option()].
options(App) ->
    case exported(App, options, 0) of
        true -> App:options();
        false -> []
    end.

%% @doc The scene of an application; without one of its own it plays on an empty floor.
-spec scene(module(), context()) -> {ok, scene()} | {error, Why :: unicode:chardata()}.
scene(App, Context) ->
    case exported(App, scene, 1) of
        true -> App:scene(Context);
        false -> {ok, bare_scene(App, Context)}
    end.

%% @doc What an application has to tell of a run.
-spec report(module(), scene(), outcome()) -> report().
report(App, Scene, Outcome) ->
    case exported(App, report, 2) of
        true -> App:report(Scene, Outcome);
        false -> #{figures => []}
    end.

bare_scene(App, #{options := Options}) ->
    Blocks =
        case exported(App, blocks, 0) of
            true -> App:blocks();
            false -> []
        end,
    #{app => {sequential, App, Options}, blocks => Blocks}.

exported(App, Function, Arity) ->
    _ = code:ensure_loaded(App),
    erlang:function_exported(App, Function, Arity).
