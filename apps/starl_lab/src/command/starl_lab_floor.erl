%% @doc `./starl floor': shows a floor plan.
-module(starl_lab_floor).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "floor",
        synopsis => "look at a floor plan before robots drive on it",
        argument => {required, "PLAN", {example, "search"}},
        subject => fun subject/2,
        about => fun about/1,
        flags => fun flags/1,
        run => fun run/1
    }.

about(_Subject) ->
    [
        [
            "Tells the size, the walls, rooms, doors and places of a floor plan and draws it. PLAN is a file: "
            "a drawing in characters, a MovingAI .map, the map.yaml of a grid of ROS, an SVG drawing with a layer (group) walls; or a plan that "
            "ships: ",
            lists:join(", ", starl_floor_file:shipped()),
            ". With ./starl run APP --floor PLAN walls and robots are solid."
        ]
    ].

flags(_Subject) ->
    Scale = lists:keyfind(floor_scale, 1, starl_run_scenario:options()),
    [
        {"Flags", [
            Scale, {out, string, none, "directory for the drawing (the next free out/floor-N)"}
        ]}
    ].

-spec subject(string(), [string()]) -> {ok, file:filename(), [string()]}.
subject(Word, Args) -> {ok, Word, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Name, values := #{floor_scale := Scale} = Values}) ->
    case
        {
            starl_floor_file:read(Name, Scale),
            starl_cli_out:directory(maps:get(out, Values), "floor")
        }
    of
        {{ok, Floor}, {[], Out}} -> shown(Floor, Out);
        {{error, Why}, {Unwritable, _}} -> {error, [Why | Unwritable]};
        {_, {Unwritable, _}} -> {error, Unwritable}
    end.

shown(#{name := Name, size := Size} = Floor, Out) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- starl_floor:summary(Floor)]),
    Drawing = #{
        floor => Size, plan => Floor, target => [], ink => #{}, robots => [], title => Name
    },
    starl_lab_drawing:write(Out, "floor", fun(Dir) ->
        written(starl_picture_draw:write(Dir, "floor", Drawing))
    end).

written({partly, Files, Reason}) -> {partly, Files, starl_picture_draw:format_error(Reason)};
written({error, Reason}) -> {error, starl_picture_draw:format_error(Reason)};
written({ok, _Files} = All) -> All.
