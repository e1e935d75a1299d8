%% @doc An intersection: robots drive round a road in the form of an eight. A token of mutual
%% exclusion guards each section of the road, and another token the crossing, which both strands
%% share. A robot acquires the next section, drives there, and releases the section behind it
%% ({@link starl_sections}).
%%
%% Measures: `wait_s', how long a robot has waited for a section, and `passes_per_min', how often it
%% passes the crossing. Trace: {@link event()} (see {@link starl_crossing_monitor}).
-module(starl_crossing).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([sections/1, most/1, starts/2, nearest/2, token/2]).
-export([options/0, scene/1, guarantees/0, measures/0, report/2, knows_walls/0]).

-export_type([event/0, road/0, token/0]).

%% The robot is in the crossing.
-type event() :: passes.

%% `held': the token of the section where it is, if it holds it. Times by the robot's own clock (ms).
-type state() :: #{
    road := [starl_geometry:point(), ...],
    begun := integer(),
    until := integer(),
    %% since when it waits for the next section
    since := integer(),
    at := non_neg_integer(),
    held := [token()],
    passes := non_neg_integer()
}.

%% The middles of the sections in the order of driving, the crossing first, and once more in the middle of
%% the list. Sections are counted from 0.
-type road() :: [starl_geometry:point(), ...].

-type token() :: crossing | {section, pos_integer()}.

%% What stays free at the edge of the floor, the length of a section at least, and the steps in which the
%% road's length is measured.
-define(EDGE_MM, 600).
-define(SECTION_MM, 1150).
-define(STEPS, 4000).
%% A section is free if no robot is nearer than this to its middle.
-define(FREE_MM, 700).
%% Who is farther from the middle of its next section than so many of its lengths is not on the road.
-define(FAR, 1.5).

-spec options() -> [starl_options:option()].
options() -> [{duration, {integer, 1, 86400}, 120, "how long they drive, s"}].

-spec measures() -> [{atom(), string()}].
measures() ->
    [
        {wait_s, "waiting for a section of the road, s"},
        {passes_per_min, "passes of the crossing by a robot per minute"}
    ].

%% @doc Robots drive as if the floor were free.
-spec knows_walls() -> false.
knows_walls() -> false.

%% @doc The guarantees for the robots that drive.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {apart, safety, "no two robots come nearer to each other than half a metre", [
            {mutex, exclusion}, {motion, line}, delivery, alive, no_restart, positions
        ]},
        {flows, progress, "the crossing is passed at least every two minutes", [
            alive, {mutex, granted}, {motion, arrives}
        ]}
    ].

%% @doc The road on the floor of the run, with the robots on it.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(#{robots := Ids, world := World, options := Options}) ->
    Road = sections(World),
    Most = most(Road),
    case length(Ids) =< Most of
        true ->
            {ok, #{
                app => {sequential, starl_crossing, Options#{road => Road}},
                blocks => [starl_mutex],
                poses => maps:from_list(starts(Ids, Road)),
                apart_mm => 500,
                monitors => [{starl_crossing_monitor, #{}}],
                never_crashes => true
            }};
        false ->
            Why = "this road has room for ~b robots: use fewer, or a larger floor (--world)",
            {error, io_lib:format(Why, [Most])}
    end.

-spec init(starl:robot(), map()) -> state().
init(Robot, #{road := Road, duration := Seconds}) ->
    Now = starl:now(Robot),
    At = nearest(starl_sections:position(Robot), Road),
    ok = draw(Robot, Road),
    #{
        road => Road,
        begun => Now,
        until => Now + 1000 * Seconds,
        since => Now,
        at => At,
        held => starl_sections:take(Robot, token(At, Road)),
        passes => 0
    }.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Passes :: non_neg_integer()}.
step(Robot, #{road := Road, until := Until, at := At, held := Held} = State) ->
    Next = (At + 1) rem length(Road),
    #{token := Token, way := [Place]} = Section = section(Next, Road),
    Begins = fun() -> begins(Robot, Place, State) end,
    case starl:now(Robot) < Until andalso entered(Next, Section, Begins, Robot, Road) of
        false ->
            ok = starl_sections:leave(Robot, Held),
            {done, maps:get(passes, State)};
        occupied ->
            {continue, State};
        {astray, Nearest} ->
            ok = starl_sections:leave(Robot, Held),
            {continue, State#{at := (Nearest + length(Road) - 1) rem length(Road), held := []}};
        ok ->
            ok = starl_sections:leave(Robot, Held),
            Here = State#{at := Next, held := [Token], since := starl:now(Robot)},
            {continue, passed(Token, Robot, Here)}
    end.

%% Who was led off the road goes on from the section that is nearest now, however far that is, and crosses no others
%% to get to its own.
entered(Next, Section, Begins, Robot, Road) ->
    case starl_sections:enter(Robot, Section, Begins) of
        {lost, Here} ->
            case nearest(Here, Road) of
                Next -> starl_sections:enter(Robot, maps:remove(far_mm, Section), Begins);
                Nearest -> {astray, Nearest}
            end;
        Answer ->
            Answer
    end.

begins(Robot, Place, #{since := Since}) ->
    ok = starl:measure(Robot, wait_s, (starl:now(Robot) - Since) / 1000),
    starl:draw(Robot, #{key => section, area => starl_drawing:circle(Place, 350)}).

passed(crossing, Robot, #{passes := Passes, begun := Begun} = State) ->
    ok = starl:trace(Robot, passes),
    Minutes = max(1, starl:now(Robot) - Begun) / 60000,
    ok = starl:measure(Robot, passes_per_min, (Passes + 1) / Minutes),
    State#{passes := Passes + 1};
passed(_Section, _Robot, State) ->
    State.

%% One robot shows the road.
draw(Robot, Road) ->
    case hd(starl:participants(Robot)) =:= starl:id(Robot) of
        true ->
            ok = starl:draw(Robot, #{key => road, line => Road ++ [hd(Road)], colour => grey}),
            starl:draw(Robot, crossing(Road));
        false ->
            ok
    end.

%% @doc How often the crossing was passed, and how near robots came to each other.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{end_us := EndUs, monitors := #{starl_crossing_monitor := Results}}) ->
    #{passes := Passes, least_mm := Least} = Results,
    PerMinute = Passes * 6.0e7 / max(1, EndUs),
    #{
        figures => [{passes, Passes}, {throughput_per_min, PerMinute}, {least_mm, Least}],
        formats => #{
            throughput_per_min => #{
                decimals => 2, label => "passes of the crossing per minute", plotted => true
            },
            least_mm => #{decimals => 1, rounded => down}
        },
        done => io_lib:format("~b passes of the crossing, ~.1f a minute", [Passes, PerMinute])
    }.

%% -- the road ---------------------------------------------------------------------------------

%% The road of the intersection: an eight (Bernoulli's lemniscate), which crosses itself at a right angle in
%% the middle of the floor, in sections of equal length. A pure module; lengths are millimetres.

%% The sections of the road on a floor of this size: an even number, eight at least.
-spec sections({WidthMm :: number(), HeightMm :: number()}) -> road().
sections({W, H}) ->
    Half = max(1.0, min(W / 2, 1.4 * H) - ?EDGE_MM),
    Points = [point(Half, {W / 2, H / 2}, I) || I <- lists:seq(0, ?STEPS)],
    Along = along(Points, 0.0),
    {Length, _} = lists:last(Along),
    N = 2 * max(4, trunc(Length / ?SECTION_MM / 2)),
    [at(I * Length / N, Along) || I <- lists:seq(0, N - 1)].

%% The road begins at the crossing.
point(Half, {CX, CY}, I) ->
    T = math:pi() / 2 + 2 * math:pi() * I / ?STEPS,
    {Sin, Cos} = {math:sin(T), math:cos(T)},
    Scale = Half / (1 + Sin * Sin),
    {CX + Scale * Cos, CY + Scale * Sin * Cos}.

along([P], Mm) -> [{Mm, P}];
along([P, Q | Points], Mm) -> [{Mm, P} | along([Q | Points], Mm + starl_geometry:distance(P, Q))].

at(Mm, [{From, P}, {To, Q} | _]) when Mm < To ->
    starl_geometry:interpolate(P, Q, (Mm - From) / (To - From));
at(Mm, [_ | Along]) ->
    at(Mm, Along).

%% The most robots for which somebody can always drive on: not enough to fill one of the two loops.
-spec most(road()) -> pos_integer().
most(Road) -> length(Road) div 2 - 1.

%% Where robots begin: evenly along the road, not in the crossing, each towards its next section.
-spec starts([starl:robot_id(), ...], road()) -> [{starl:robot_id(), starl:pose()}].
starts(Ids, Road) ->
    Sections = length(Road),
    Free = [I || I <- lists:seq(0, Sections - 1), token(I, Road) =/= crossing],
    Every = length(Free) / length(Ids),
    [
        {Id, pose(lists:nth(1 + trunc(K * Every), Free), Road)}
     || {K, Id} <- lists:enumerate(0, Ids)
    ].

pose(I, Road) ->
    {X, Y} = From = lists:nth(I + 1, Road),
    {X, Y, starl_geometry:heading(From, lists:nth((I + 1) rem length(Road) + 1, Road))}.

%% The section whose middle is nearest.
-spec nearest(starl_geometry:point(), road()) -> non_neg_integer().
nearest(Point, Road) ->
    {_, I} = lists:min([
        {starl_geometry:distance(Point, Middle), I}
     || {I, Middle} <- lists:enumerate(0, Road)
    ]),
    I.

%% The token of a section: both strands share that of the crossing.
-spec token(non_neg_integer(), road()) -> token().
token(I, Road) ->
    case I rem (length(Road) div 2) of
        0 -> crossing;
        _ -> {section, I}
    end.

%% What is to be known of a section to drive there.
-spec section(non_neg_integer(), road()) -> starl_sections:section().
section(I, Road) ->
    [Before, Middle] = [lists:nth(K rem length(Road) + 1, Road) || K <- [I + length(Road) - 1, I]],
    Far = ?FAR * starl_geometry:distance(Before, Middle),
    #{token => token(I, Road), way => [Middle], free_mm => ?FREE_MM, far_mm => Far}.

%% The drawing of the crossing.
-spec crossing(road()) -> starl_drawing:shape().
crossing([Middle | _]) ->
    #{key => crossing, area => starl_drawing:circle(Middle, ?FREE_MM), colour => orange}.
