%% @doc The monitor of the painting application: the ink lies on the lines of the picture and
%% nowhere else, and every line is painted.
%%
%% Ink is the track of a robot whose pen is down. It lies on the lines if its distance from a line
%% is at most the ink radius (the r(v) of the tracking guarantee) plus the tolerance with which the
%% picture was flattened. Straight motion is judged exactly: the part of one segment that lies
%% within a radius of another is an interval in closed form ({@link starl_painting_monitor_parts}),
%% and the union of these intervals must cover the ink. An arc is approximated by chords that stay
%% within 0.01 mm of it.
%%
%% Only a drive along a line paints it, because ink may lie near several lines that are close
%% together. So a robot announces the line that it sets out to paint, `{stroke, Segment}'. Its ink
%% up to the next announcement counts for the lines of the picture on which this segment lies, and
%% for no others. The tolerance applies across the line only. Along the line everything must be
%% inked except `ends_mm' at each end; where two strokes meet, each may lack as much. A robot that
%% announces a line and has its pen down has a dot of ink on it where it stands.
%%
%% A robot that reports the picture as complete, `{done, complete}', must be right.
%%
%% Events of machine `chassis': `motion' and `actuated' (the pen is up at first), which report the
%% actual state and not the commanded one; of machine `app': {@link starl_painting:event()}, `done';
%% of machine `robot': `died' (the robot stays where it is).
%%
%% A violation is reported at the end of its piece of motion, at most once for each lowering of a
%% pen, and names the time at which the ink left the lines.
-module(starl_painting_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, vocabulary/0]).

-type segment() :: starl_geometry:segment().

%% One robot: its present motion and the start of it, its pen, the polyline that it is drawing
%% (latest point first; empty with the pen up), whether this polyline left the lines, and the
%% finished ones.
-record(track, {
    piece = none :: starl_trajectory:piece() | none,
    since = 0 :: integer(),
    pen = up :: up | down,
    %% the lines of the present stroke
    stroke = [] :: [pos_integer()],
    drawing = [] :: [starl_geometry:point()],
    strayed = false :: boolean(),
    drawn = [] :: [[starl_geometry:point(), ...]]
}).

-record(state, {
    lines :: #{pos_integer() => segment()},
    grid :: starl_grid:t(pos_integer()),
    %% The largest distance of ink from a line (mm).
    reach_mm :: float(),
    %% The same for single robots, if it is smaller.
    reaches = #{} :: #{starl:robot_id() => float()},
    complete :: boolean(),
    %% The length of a line that may be missing at each end (mm).
    ends_mm :: float(),
    %% The painted parts of each line, ascending and disjoint; up to `ends_mm' beyond its ends.
    painted = #{} :: #{pos_integer() => [starl_painting_monitor_parts:part(), ...]},
    tracks = #{} :: #{starl:robot_id() => #track{}},
    ink_mm = 0.0 :: float(),
    driven_mm = 0.0 :: float()
}).

%% Rounding (mm).
-define(SLACK_MM, 1.0e-6).
%% The largest distance of the chords of an arc from it (mm).
-define(CHORD_MM, 0.01).
%% Two points at most this far apart are one; a larger jump starts a new polyline (mm).
-define(JUMP_MM, 1.0e-3).
%% A stroke lies on a line if it is at most this far from it (mm). A line that is shorter may have no
%% stroke of its own, as its ends may be one point of the plan: it lies on a stroke in the same way.
-define(ON_MM, 0.5).

%% @doc `lines': the picture; `ink_radius_mm' plus `tolerance_mm': the largest distance of ink from
%% a line; `tracking_mm': the ink radius of single robots, if it is smaller; `ends_mm' (default 2):
%% the length of a line that may be missing at each end; `complete' (default true): whether
%% unpainted lines at the finish break the contract even if no robot has reported the picture as
%% complete.
-spec init(#{
    lines := [segment()],
    ink_radius_mm := float(),
    tolerance_mm := float(),
    tracking_mm => #{starl:robot_id() => float()},
    ends_mm => float(),
    complete => boolean()
}) -> #state{}.
init(#{lines := Lines, ink_radius_mm := Radius, tolerance_mm := Tolerance} = Config) ->
    Numbered = lists:zip(lists:seq(1, length(Lines)), Lines),
    Reach = Radius + Tolerance + ?SLACK_MM,
    Own = fun(_Robot, Mm) -> min(Reach, Mm + Tolerance + ?SLACK_MM) end,
    Empty = starl_grid:new(max(50.0, 4 * Reach)),
    #state{
        lines = maps:from_list(Numbered),
        grid = lists:foldl(fun({N, Line}, G) -> starl_grid:add(N, Line, G) end, Empty, Numbered),
        reach_mm = Reach,
        reaches = maps:map(Own, maps:get(tracking_mm, Config, #{})),
        ends_mm = maps:get(ends_mm, Config, 2.0),
        complete = maps:get(complete, Config, true)
    }.

%% @doc The motions and pens, the strokes, and the end of robots.
-spec interests() -> [atom()].
interests() -> [chassis, app, robot].

%% @doc {@link starl_painting:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{stroke, 1}]}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, chassis, {motion, Piece}}, State) ->
    Since = max(T, starl_trajectory:start_us(Piece)),
    change(Since, Robot, fun(Track) -> on_paper(Track#track{piece = Piece}) end, State);
step({T, Robot, chassis, {actuated, pen, Pen}}, State) when Pen =:= up; Pen =:= down ->
    change(T, Robot, fun(Track) -> pen(Pen, Track) end, State);
step({T, Robot, app, {stroke, {{_, _}, {_, _}} = Segment}}, State) ->
    Lines = lines_under(Segment, State),
    change(T, Robot, fun(Track) -> Track#track{stroke = Lines} end, State);
step({_T, _Robot, app, {done, complete}}, State) ->
    {ok, State#state{complete = true}};
step({T, Robot, robot, {died, _Reason}}, #state{tracks = Tracks} = State) ->
    case Tracks of
        #{Robot := #track{piece = Piece}} when Piece =/= none ->
            Still = starl_trajectory:stop(T, Piece),
            change(T, Robot, fun(Track) -> Track#track{piece = Still} end, State);
        #{} ->
            {ok, State}
    end;
step(_Other, State) ->
    {ok, State}.

%% @doc Judges the time until `EndTimeUs'. Results: `coverage' (0..1, the painted fraction of the
%% lines' length; what may be missing at the ends counts as painted), `ink_covered' (whether
%% everything is painted), `unpainted_mm', `inked' (0..1, the fraction of the length with ink on it,
%% to the millimetre), `ink_mm' and `driven_mm' (lengths driven with the pen down, and in total),
%% `ink' (polylines by robot).
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, #state{tracks = Tracks} = State) ->
    Close = fun(Robot, {Found, S}) ->
        case change(EndTimeUs, Robot, fun(Track) -> pen(up, Track) end, S) of
            {ok, Next} -> {Found, Next};
            {violation, Violation, Next} -> {[Violation | Found], Next}
        end
    end,
    {Found, Closed} = lists:foldl(Close, {[], State}, lists:sort(maps:keys(Tracks))),
    Results = starl_unjudged:with(unjudged(Closed), results(Closed)),
    starl_violation:finish(lists:reverse(Found) ++ unfinished(EndTimeUs, Results, Closed), Results).

results(#state{lines = Lines, tracks = Tracks} = State) ->
    Lengths = [{N, starl_geometry:length(Line)} || {N, Line} <- lists:sort(maps:to_list(Lines))],
    Total = lists:sum([Length || {_, Length} <- Lengths]),
    Unpainted = lists:sum([0.0 | [unpainted(N, Length, State) || {N, Length} <- Lengths]]),
    #{
        coverage => fraction(Total - Unpainted, Total),
        ink_covered => Unpainted =< 1.0e-9 * Total,
        unpainted_mm => Unpainted,
        inked => fraction(lists:sum([inked(N, Length, State) || {N, Length} <- Lengths]), Total),
        ink_mm => State#state.ink_mm,
        driven_mm => State#state.driven_mm,
        ink => maps:map(fun(_Robot, #track{drawn = Drawn}) -> lists:reverse(Drawn) end, Tracks)
    }.

fraction(_Part, Total) when Total == 0 -> 1.0;
fraction(Part, Total) -> max(0.0, Part / Total).

unpainted(N, Length, #state{ends_mm = Ends} = State) ->
    Gaps = starl_painting_monitor_parts:gaps(Length, Ends, parts(N, State)),
    lists:sum([0.0 | [To - From || {From, To} <- Gaps]]).

inked(N, Length, State) ->
    lists:sum([max(0.0, min(Length, To) - max(0.0, From)) || {From, To} <- parts(N, State)]).

parts(N, #state{painted = Painted}) -> maps:get(N, Painted, []).

%% Nobody need ever report it.
unjudged(#state{complete = true}) -> [];
unjudged(_State) -> [{"every line is painted", "no robot has reported the picture as complete"}].

unfinished(T, #{ink_covered := false, unpainted_mm := Unpainted}, #state{complete = true}) ->
    [violation(unfinished, T, [], #{unpainted_mm => Unpainted})];
unfinished(_T, _Results, _State) ->
    [].

%%% Tracks

%% Judges the robot's motion up to `T'; `Change' then updates its track.
change(T, Robot, Change, #state{tracks = Tracks} = State) ->
    Track = maps:get(Robot, Tracks, #track{}),
    {Found, #state{tracks = Judged} = Next} = drive(T, Robot, Track, State),
    Since = max(T, Track#track.since),
    Changed = Change((maps:get(Robot, Judged, Track))#track{since = Since}),
    Begins = Changed#track.stroke =/= Track#track.stroke,
    answer(Found, dot(T, Robot, Begins, Changed, Next)).

answer([], {[], State}) -> {ok, State};
answer(Found, {More, State}) -> {violation, hd(Found ++ More), State}.

drive(T, _Robot, #track{piece = Piece, since = Since}, State) when Piece =:= none; T =< Since ->
    {[], State};
drive(T, Robot, #track{pen = Pen, piece = Piece, since = Since} = Track, State) ->
    Length = starl_trajectory:moved(Since, T, Piece),
    Driven = State#state{driven_mm = State#state.driven_mm + Length},
    case Pen of
        up -> {[], Driven};
        down -> draw(T, Robot, Track, Driven#state{ink_mm = Driven#state.ink_mm + Length})
    end.

draw(T, Robot, #track{piece = Piece, since = Since} = Track, State) ->
    [Start | Points] = starl_trajectory:polyline(Piece, Since, T, ?CHORD_MM),
    Step = (T - Since) / max(1, length(Points)),
    Stroke = fun(Point, {N, From, Found, S}) ->
        {Strays, Inked} = ink({From, Point}, Track#track.stroke, reach(Robot, S), S),
        Times = [moment(N, Share, Since, Step, Piece) || {Share, _} <- Strays],
        {N + 1, Point, lists:zip(Times, Strays) ++ Found, Inked}
    end,
    {_, _, Found, Inked} = lists:foldl(Stroke, {0, Start, [], State}, Points),
    Drawn = Track#track{drawing = lists:reverse(Points, Track#track.drawing)},
    report(lists:sort(Found), Robot, Drawn, Inked).

%% All chords take the same time.
moment(N, Share, Since, Step, Piece) ->
    [From, To] = [Since + round(Chord * Step) || Chord <- [N, N + 1]],
    starl_trajectory:passing(Share, Piece, From, To).

%% A pen that is lowered, or is down when a motion or another stroke starts, makes a dot.
dot(T, Robot, Begins, #track{pen = down, drawing = Drawing} = Track, State) when
    Track#track.piece =/= none, Drawing =:= [] orelse Begins
->
    Point = starl_trajectory:position(T, Track#track.piece),
    {Strays, Inked} = ink({Point, Point}, Track#track.stroke, reach(Robot, State), State),
    report([{T, Stray} || Stray <- Strays], Robot, dotted(Point, Track), Inked);
dot(_T, Robot, _Begins, Track, State) ->
    {[], store(Robot, Track, State)}.

dotted(Point, #track{drawing = []} = Track) -> Track#track{drawing = [Point], strayed = false};
dotted(_Point, Track) -> Track.

report([{At, {_Share, Point}} | _], Robot, #track{strayed = false} = Track, State) ->
    Distance = lists:min([
        infinity
        | [
            starl_geometry:point_segment(Point, Line)
         || Line <- maps:values(State#state.lines)
        ]
    ]),
    Details = #{at => Point, distance_mm => Distance, limit_mm => reach(Robot, State)},
    {
        [violation(ink_off_the_lines, At, [Robot], Details)],
        store(Robot, Track#track{strayed = true}, State)
    };
report(_Strays, Robot, Track, State) ->
    {[], store(Robot, Track, State)}.

store(Robot, Track, #state{tracks = Tracks} = State) ->
    State#state{tracks = Tracks#{Robot => Track}}.

pen(up, Track) -> lift(Track#track{pen = up});
pen(down, Track) -> Track#track{pen = down}.

lift(#track{drawing = []} = Track) ->
    Track;
lift(#track{drawing = Drawing, drawn = Drawn} = Track) ->
    Track#track{drawing = [], drawn = [lists:reverse(Drawing) | Drawn]}.

%% A motion that starts away from the end of the last one is not connected to it by ink.
on_paper(#track{drawing = [Last | _], since = Since, piece = Piece} = Track) ->
    case starl_geometry:distance(Last, starl_trajectory:position(Since, Piece)) > ?JUMP_MM of
        true -> lift(Track);
        false -> Track
    end;
on_paper(Track) ->
    Track.

violation(What, T, Robots, Details) ->
    starl_violation:new(painting, What, T, Robots, Details).

%%% Ink and lines

%% The lines of the picture on which a stroke lies.
lines_under({P, Q}, #state{grid = Grid, lines = Lines}) ->
    [
        N
     || N <- starl_grid:near({P, Q}, ?ON_MM, Grid),
        Line <- [map_get(N, Lines)],
        lies_on({P, Q}, Line) orelse
            (starl_geometry:length(Line) < ?ON_MM andalso lies_on(Line, {P, Q}))
    ].

lies_on({P, Q}, Line) ->
    starl_geometry:point_segment(P, Line) =< ?ON_MM andalso
        starl_geometry:point_segment(Q, Line) =< ?ON_MM.

%% Enters a straight piece of ink that is to paint these lines. Returns the place where it leaves
%% the lines of the picture: the fraction of its length at which the stray part begins, and a point
%% in the middle of that part.
ink(Ink, Stroke, Reach, #state{lines = Lines, ends_mm = Ends} = State) ->
    Near = [map_get(N, Lines) || N <- starl_grid:near(Ink, Reach, State#state.grid)],
    Inked = [starl_painting_monitor_parts:within(Reach, Ink, Line) || Line <- Near],
    Covered = lists:foldl(fun starl_painting_monitor_parts:unite/2, [], [P || {_, _} = P <- Inked]),
    Paint = fun(N, Acc) ->
        case starl_painting_monitor_parts:beside(Reach, Ends, map_get(N, Lines), Ink) of
            none -> Acc;
            Part -> Acc#{N => starl_painting_monitor_parts:unite(Part, maps:get(N, Acc, []))}
        end
    end,
    {strays(Ink, Covered), State#state{painted = lists:foldl(Paint, State#state.painted, Stroke)}}.

reach(Robot, #state{reaches = Reaches, reach_mm = Most}) -> maps:get(Robot, Reaches, Most).

strays({From, To} = Ink, Covered) ->
    case starl_geometry:length(Ink) of
        Length when Length > ?SLACK_MM ->
            strays(From, To, Length, starl_painting_monitor_parts:gap(Length, Covered));
        _Dot ->
            [{0.0, From} || Covered =:= []]
    end.

strays(_From, _To, _Length, none) ->
    [];
strays(From, To, Length, {A, B}) ->
    [{A / Length, starl_geometry:interpolate(From, To, (A + B) / 2 / Length)}].
