%% @doc `./starl picture': shows what a run of the painting application would paint, without a run.
-module(starl_lab_picture).
-behaviour(starl_cli_command).

-export([command/0]).

%% The application, by its name, and those of its options on which its picture depends.
-define(APP, "painting").
-define(KEYS, [
    robots, world, floor, floor_scale, speed, chassis, tolerance, segments, safety_distance
]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "picture",
        synopsis => "look at a picture before it is painted",
        argument => {required, "PICTURE", {example, "my.svg"}},
        subject => fun subject/2,
        about => [
            "Draws the lines that ./starl run painting --picture PICTURE would paint, and tells their "
            "length and number, what is left out of the picture, and the least time. PICTURE is an SVG "
            "file, or a picture that ships; ./starl run painting --help lists them."
        ],
        flags => fun flags/1,
        run => fun run/1
    }.

flags(_Subject) ->
    Of = [
        {Title, [Option || Option <- Options, is_of_picture(Option)]}
     || {Title, Options} <- [
            {"Flags of " ?APP, application()},
            {"Flags of every simulation", starl_run_scenario:options()}
        ]
    ],
    Of ++ [{"Other flags", own_flags()}].

is_of_picture({Key, _, _, _}) -> lists:member(Key, ?KEYS).

application() -> starl_app:options(maps:get(app, target())).

own_flags() ->
    [{out, string, none, "directory for the drawing (the next free out/picture-N)"}].

target() ->
    {ok, Target} = starl_cli_target:resolve(?APP),
    Target.

-spec subject(string(), [string()]) -> {ok, starl_cli_target:t(), [string()]}.
subject(Word, Args) -> {ok, (target())#{given := #{picture => Word}}, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Target, values := Values} = Call) ->
    {Unsound, Scenario} = starl_cli_target:scenario(
        Target, starl_cli_target:given(Call, own_flags())
    ),
    {Unwritable, Out} = starl_cli_out:directory(maps:get(out, Values), "picture"),
    case Unsound ++ Unwritable of
        [] -> shown(preview(Target, Scenario), Out);
        Problems -> {error, Problems}
    end.

preview(#{app := App}, Scenario) ->
    case starl_run_floor:read(Scenario) of
        {ok, Floor} -> preview(App, Floor, starl_run_floor:given(Floor, Scenario));
        {error, _} = Error -> Error
    end.

preview(App, Floor, Scenario) ->
    case starl_scene:make(App, starl_run_plan:context(App, Floor, Scenario)) of
        {ok, Scene} -> {ok, starl_scene:preview(App, Scene)};
        {error, _} = Error -> Error
    end.

shown({error, Why}, _Out) ->
    {error, [Why]};
shown({ok, #{lines := Lines, write := Write}}, Out) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- Lines]),
    starl_lab_drawing:write(Out, "picture", Write).
