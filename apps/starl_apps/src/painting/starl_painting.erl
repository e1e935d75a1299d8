%% @doc Collaborative painting (the paper's Subroutine 6): the team elects a coordinator; then
%% each robot, until the picture is complete, asks for a path, follows it with the pen down on
%% the lines that are to be painted, and clears what it has passed.
%%
%% A line is painted by a drive along it: the robot stands at its beginning and looks along it, the
%% pen is down, as its sensor shows, and comes up again at the end. Nothing is driven before the pen
%% is as it should be.
%%
%% Trace: {@link event()} (see {@link starl_painting_monitor}).
-module(starl_painting).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([options/0, scene/1, report/2]).

-export_type([event/0]).

%% What it traces: the robot sets out to paint this line, mm.
-type event() :: {stroke, starl_geometry:segment()}.

%% Two lines whose directions differ by less are one, rad.
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

%% After a crash a robot may know of a coordinator without an election: the path planning of its
%% own has not crashed, or the coordinator has asked it where it is.
led(Robot, Else) ->
    case starl_dpp:coordinator(Robot) of
        {ok, Leader} -> {paint, Leader};
        {error, _} -> Else
    end.

%% A robot that is dead or out of reach has no ballot, so nobody is elected. Path planning needs no
%% more than somebody to begin with: if that one is dead, another takes over.
join_first(Robot) -> join(Robot, hd(starl:participants(Robot))).

join(Robot, Leader) ->
    _ = starl_dpp:join(Robot, Leader),
    Leader.

%% Until the path ends, or must not be followed any further: the lines that are not painted go to
%% whoever asks next. After a crash the pen may be anyhow.
follow(Robot, Path) ->
    pen(Robot, up),
    follow(Robot, Path, starl_dpp:lines(Path), none),
    pen(Robot, up).

%% `Inked': the line to the end of which the pen is down, if it is.
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

%% A line that goes on straight where the last one ends is begun already.
goes_on({A, B}, {B, C}) ->
    Turn = starl_geometry:angle_diff(starl_geometry:heading(A, B), starl_geometry:heading(B, C)),
    abs(Turn) < ?STRAIGHT;
goes_on(_Inked, _Line) ->
    false.

%% Waits until it is so.
pen(Robot, State) ->
    case starl_actuator:set(Robot, pen, State) of
        ok -> ok;
        {error, _} -> pen(Robot, State)
    end.

%% -- what it needs, and what it tells -------------------------------------------------------

-spec options() -> [starl_options:option()].
options() -> starl_painting_scene:options().

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) -> starl_painting_scene:scene(Context).

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(Scene, Outcome) -> starl_painting_report:report(Scene, Outcome).
