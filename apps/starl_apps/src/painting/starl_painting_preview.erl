%% @doc Shows what a run of the painting application is going to paint, before it runs.
-module(starl_painting_preview).

-export([preview/1]).

%% In characters, so that the line fits a terminal.
-define(LONGEST_TITLE, 24).

%% @doc The size of the work, what is left out of the picture, and a drawing of its lines with the
%% robots at their parking spots.
-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(#{memo := Memo} = Scene) ->
    #{picture := Picture} = Memo,
    #{
        lines =>
            work(Memo) ++ starl_painting_walls:left_out(maps:get(lost, Memo)) ++
            starl_picture_omissions:lines(starl_picture:left_out(Picture)),
        write => fun(Dir) -> draw(Dir, Scene) end
    }.

%%% Internals

work(#{picture := Picture, lines_mm := Length, edges := Edges, robots := N, speed := Speed}) ->
    Segments = length(starl_picture:segments(Picture)),
    [
        [
            string:slice(starl_picture:title(Picture), 0, ?LONGEST_TITLE),
            ": ",
            counted(Segments, "line segment"),
            ", ",
            counted(Edges, "edge"),
            " after cutting, ",
            decimals(1, Length / 1000),
            " m to paint"
        ],
        [
            "at least ",
            decimals(0, Length / (N * Speed)),
            " s with ",
            counted(N, "robot"),
            " at ",
            decimals(0, Speed),
            " mm/s, plus the ways between the lines"
        ]
    ].

counted(1, What) -> ["1 ", What];
counted(N, What) -> [integer_to_list(N), " ", What, "s"].

decimals(N, X) -> float_to_list(float(X), [{decimals, N}]).

draw(Dir, #{poses := Poses, memo := #{picture := Picture, world := World} = Memo}) ->
    Drawing = #{
        floor => World,
        target => starl_picture:segments(Picture),
        plan => maps:get(floor, Memo),
        ink => #{},
        robots => [{Id, {X, Y}, Heading} || {Id, {X, Y, Heading}} <- maps:to_list(Poses)],
        title => starl_picture:title(Picture),
        preview => true
    },
    case starl_picture_draw:write(Dir, "picture", Drawing) of
        {ok, _} = Ok -> Ok;
        {partly, Files, Reason} -> {partly, Files, starl_picture_draw:format_error(Reason)};
        {error, Reason} -> {error, starl_picture_draw:format_error(Reason)}
    end.
