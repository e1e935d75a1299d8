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

-export([guarantees/0]).
-export([init/2, step/2]).
-export([options/0, scene/1, preview/1, report/2]).

-export_type([event/0]).

%% The event that the application traces: the robot sets out to paint this line, mm.
-type event() :: {stroke, starl_geometry:segment()}.

%% Two consecutive lines whose directions differ by less are one straight line, rad.
-define(STRAIGHT, 0.01).

-type state() :: elect | {paint, Leader :: starl:robot_id()}.

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

-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(Scene) -> starl_painting_preview:preview(Scene).

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(Scene, Outcome) -> starl_painting_report:report(Scene, Outcome).
