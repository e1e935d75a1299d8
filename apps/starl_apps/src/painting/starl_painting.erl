%% @doc The painting application: a team paints a picture together (the paper's Subroutine 6). The
%% team elects a coordinator. Then each robot repeats until the picture is complete: it requests a
%% path, follows it with the pen down on the lines to be painted, and releases the part that it has
%% passed.
%%
%% A robot paints a line by driving along it: it stands at the beginning of the line and faces along
%% it, lowers the pen until the pen's sensor confirms this, and raises it at the end. The robot
%% never drives before the pen is in the required position.
%%
%% Trace: {@link event()} (see {@link starl_painting_monitor}).
-module(starl_painting).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([guarantees/0, omissions/1]).
-export([init/2, step/2]).
-export([options/0, scene/1, preview/1, report/2]).

-export_type([event/0]).

%% The event that the application traces: the robot sets out to paint this line, mm.
-type event() :: {stroke, starl_geometry:segment()}.

%% Two consecutive lines whose directions differ by less are one straight line, rad.
-define(STRAIGHT, 0.01).

-type state() :: elect | {paint, Leader :: starl:robot_id()}.

%% In characters, so that the line fits a terminal.
-define(LONGEST_TITLE, 24).

-type figures() :: [{atom(), number() | null}].

%% -- the application ------------------------------------------------------------------------

-spec init(starl:robot(), none) -> state().
init(Robot, none) -> led(Robot, elect).

-spec step(starl:robot(), state()) -> {continue, state()} | {done, complete | incomplete}.
step(Robot, elect) ->
    case starl_election:elect(Robot, painting) of
        {ok, Leader} -> {continue, {paint, join(Robot, Leader)}};
        {error, restarted} -> {continue, elect};
        {error, timeout} -> {continue, led(Robot, {paint, join_first(Robot)})}
    end;
step(Robot, {paint, Leader}) ->
    case starl_dpp:request_path(Robot) of
        {ok, Path} ->
            follow(Robot, Path),
            {continue, {paint, Leader}};
        {error, no_coordinator} ->
            {continue, {paint, join(Robot, Leader)}};
        {error, restarted} ->
            {continue, {paint, Leader}};
        {error, no_answer} ->
            {done, incomplete};
        End ->
            {done, End}
    end.

%% After a crash a robot may know a coordinator without an election: its path planning has not
%% crashed, or the coordinator has asked for its position.
led(Robot, Else) ->
    case starl_dpp:coordinator(Robot) of
        {ok, Leader} -> {paint, Leader};
        {error, _} -> Else
    end.

%% A robot that is dead or out of reach sends no ballot, so the election fails. Path planning needs
%% only an initial coordinator: if that robot is dead, another one takes over.
join_first(Robot) -> join(Robot, hd(starl:participants(Robot))).

join(Robot, Leader) ->
    _ = starl_dpp:join(Robot, Leader),
    Leader.

%% Follows the path to its end, or until the path must not be followed any further: the unpainted
%% lines go to the next robot that asks. After a crash the position of the pen is unknown.
follow(Robot, Path) ->
    pen(Robot, up),
    follow(Robot, Path, starl_dpp:lines(Path), none),
    pen(Robot, up).

%% `Inked': the last line painted, if the pen is still down at its end.
follow(Robot, Path, [{N, Line, Pen} | Lines], Inked) ->
    case leg(Robot, Path, N, Line, Pen, Inked) of
        ok -> follow(Robot, Path, Lines, inked(Pen, Line));
        {error, _VoidOrRestarted} -> ok
    end;
follow(_Robot, _Path, [], _Inked) ->
    ok.

inked(up, _Line) -> none;
inked(down, Line) -> Line.

leg(Robot, Path, N, _Line, up, Inked) ->
    Inked =:= none orelse pen(Robot, up),
    starl_dpp:drive(Robot, Path, N);
leg(Robot, Path, N, Line, down, Inked) ->
    case goes_on(Inked, Line) orelse starl_dpp:face(Robot, Path, N) of
        {error, _} = Error ->
            Error;
        _Ready ->
            starl:trace(Robot, {stroke, Line}),
            Inked =/= none orelse pen(Robot, down),
            starl_dpp:drive(Robot, Path, N)
    end.

%% A line that continues the last one straight needs no new start.
goes_on({A, B}, {B, C}) ->
    Turn = starl_geometry:angle_diff(starl_geometry:heading(A, B), starl_geometry:heading(B, C)),
    abs(Turn) < ?STRAIGHT;
goes_on(_Inked, _Line) ->
    false.

%% Repeats the command until the pen is in this position.
pen(Robot, State) ->
    case starl_actuator:set(Robot, pen, State) of
        ok -> ok;
        {error, _} -> pen(Robot, State)
    end.

%% -- scene and report -----------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() -> starl_painting_scene:options().

%% @doc What a picture may rely on.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {ink, safety, "ink lies within r(v) + 2 mm of a line of the picture", [{motion, line}]},
        {true, safety,
            "a picture is reported complete only when each line is inked, by a drive along it, except "
            "2 mm at its ends", [{motion, ends}, {actuator, shown}]},
        {complete, progress, "every line is painted", [
            {dpp, assigned}, {dpp, resolved}, {motion, arrives}, {actuator, set}
        ]}
    ].

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) -> starl_painting_scene:scene(Context).

%% -- the preview ------------------------------------------------------------------------------

%% @doc The size of the work, what is left out of the picture, and a drawing of its lines with the
%% robots at their parking spots.
-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(#{memo := Memo} = Scene) ->
    #{picture := Picture} = Memo,
    #{
        lines =>
            work(Memo) ++ starl_painting_walls:left_out(maps:get(lost, Memo)) ++
            omissions(starl_picture:left_out(Picture)),
        write => fun(Dir) -> draw_preview(Dir, Scene) end
    }.

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

draw_preview(Dir, #{poses := Poses, memo := #{picture := Picture, world := World} = Memo}) ->
    Drawing = #{
        floor => World,
        target => starl_picture:segments(Picture),
        plan => maps:get(floor, Memo),
        ink => #{},
        robots => [{Id, {X, Y}, Heading} || {Id, {X, Y, Heading}} <- maps:to_list(Poses)],
        title => starl_picture:title(Picture),
        preview => true
    },
    write(Dir, "picture", Drawing).

write(Dir, Name, Drawing) ->
    case starl_picture_draw:write(Dir, Name, Drawing) of
        {ok, _} = Ok -> Ok;
        {partly, Files, Reason} -> {partly, Files, starl_picture_draw:format_error(Reason)};
        {error, Reason} -> {error, starl_picture_draw:format_error(Reason)}
    end.

%% -- the report -------------------------------------------------------------------------------

%% @doc The report of a run. The picture is complete when all lines are covered with ink.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{memo := Memo}, #{monitors := Monitors} = Outcome) ->
    #{starl_painting_monitor := #{coverage := Covered} = Paint} = Monitors,
    Figures = figures(Memo, Outcome),
    #{
        figures => Figures,
        formats => formats(),
        complete => Covered >= 1.0,
        done => [percent(Covered), " of the lines painted"],
        summary => summary(Figures) ++ left_out(Memo),
        write => fun(Dir) -> draw_picture(Dir, Memo, Paint, Outcome) end
    }.

-spec figures(map(), starl_scene:outcome()) -> figures().
figures(Memo, #{monitors := Monitors, end_us := EndUs}) ->
    #{starl_painting_monitor := Paint, starl_dpp_monitor := Dpp} = Monitors,
    #{lines_mm := Length, robots := N, speed := Speed} = Memo,
    Bound = Length / (N * Speed),
    [
        {ink_mm, maps:get(ink_mm, Paint)},
        {ink_covered, maps:get(coverage, Paint)},
        {ink_per_line, ratio(maps:get(ink_mm, Paint), Length)},
        {lines_inked, maps:get(inked, Paint)},
        {driven_mm, maps:get(driven_mm, Paint)},
        {makespan_bound_ratio, EndUs / 1.0e6 / Bound},
        {min_separation_mm, number(maps:get(min_separation_mm, Dpp))},
        {safety_distance_mm, maps:get(safety_distance, Memo)},
        {deadlocks_resolved, maps:get(deadlocks_resolved, Dpp)},
        {assignments, maps:get(assignments, Dpp)},
        {assignments_per_robot, maps:get(assignments, Dpp) / N},
        {lines_mm, Length}
    ].

ratio(_Mm, Length) when Length == 0 -> null;
ratio(Mm, Length) -> Mm / Length.

%% A single robot has no distance from others.
number(infinity) -> null;
number(X) -> X.

%% Coverage and separation are rounded down.
-spec formats() -> #{atom() => starl_scene:format()}.
formats() ->
    #{
        ink_mm => #{decimals => 1},
        ink_covered => #{decimals => 6, rounded => down, label => "part of the lines painted"},
        ink_per_line => #{decimals => 6},
        lines_inked => #{decimals => 6},
        driven_mm => #{decimals => 1},
        min_separation_mm => #{rounded => down},
        assignments_per_robot => #{label => "assignments per robot", plotted => true}
    }.

%% 99.99 % must not read 100 %.
percent(Covered) when Covered >= 1.0 -> "100 %";
percent(Covered) -> [decimals(2, floor(Covered * 10000) / 100), " %"].

summary(Figures) ->
    Told = maps:from_list(Figures),
    [driven(Told)] ++ closest(Told) ++ [planned(Told)].

%% What a browser shows of the picture and the team does not paint.
left_out(#{picture := Picture, lost := Lost}) ->
    starl_painting_walls:left_out(Lost) ++
        omissions(starl_picture:left_out(Picture)).

driven(#{ink_mm := Ink, driven_mm := Driven, makespan_bound_ratio := Ratio}) ->
    io_lib:format("ink ~ts m of ~ts m driven; ~ts x the least time possible", [
        decimals(1, Ink / 1000), decimals(1, Driven / 1000), decimals(2, Ratio)
    ]).

closest(#{min_separation_mm := null}) ->
    [];
closest(#{min_separation_mm := Least, safety_distance_mm := Safe}) ->
    [
        io_lib:format("the closest two robots came to each other: ~ts mm (at least ~ts)", [
            decimals(1, floor(Least * 10) / 10), decimals(0, Safe)
        ])
    ].

planned(#{assignments := Paths, deadlocks_resolved := Resolved}) ->
    io_lib:format("~b paths assigned, ~b deadlock~ts resolved", [
        Paths, Resolved, [$s || Resolved =/= 1]
    ]).

draw_picture(Dir, #{picture := Picture, world := World} = Memo, #{ink := Ink}, #{robots := Robots}) ->
    Drawing = #{
        floor => World,
        target => starl_picture:segments(Picture),
        plan => maps:get(floor, Memo),
        ink => Ink,
        robots => [{Id, {X, Y}, Heading} || {Id, #{pose := {X, Y, Heading}}} <- Robots],
        title => starl_picture:title(Picture)
    },
    write(Dir, "painting", Drawing).

%% -- omissions --------------------------------------------------------------------------------

%% One line for each kind that is left out, with the remedy.
-spec omissions(starl_picture:left_out()) -> [unicode:chardata()].
omissions(LeftOut) ->
    [line(What, maps:get(What, LeftOut)) || What <- kinds(), maps:get(What, LeftOut) > 0].

kinds() -> [texts, images, markers, clips, backgrounds].

line(texts, 1) ->
    "1 text left out; convert it to a path";
line(texts, N) ->
    io_lib:format("~b texts left out; convert them to paths", [N]);
line(images, 1) ->
    "1 image left out; trace it";
line(images, N) ->
    io_lib:format("~b images left out; trace them", [N]);
line(markers, 1) ->
    "the markers of 1 line (arrow heads) left out; convert them to paths";
line(markers, N) ->
    io_lib:format("the markers of ~b lines (arrow heads) left out; convert them to paths", [N]);
line(clips, 1) ->
    "1 clipping path is too complex, what it hides is painted; cut the lines";
line(clips, N) ->
    Format = "~b clipping paths are too complex, what they hide is painted; cut the lines",
    io_lib:format(Format, [N]);
line(backgrounds, _) ->
    "the page background is not painted".
