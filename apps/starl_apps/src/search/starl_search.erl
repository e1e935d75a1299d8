%% @doc Distributed search (the paper's section III-C): robots with cameras search a building for a
%% coloured ball. The scene chooses places from which together all floor is seen
%% ({@link starl_search_cover}). Path planning leads each robot to places where nobody has looked
%% yet; there it looks all around, and drives the short line that marks the place as done. A robot
%% that sees the ball looks again, from where it stands. If the looks agree, it writes the place
%% into a register that all share, and all robots are done. A robot that dies, or whose camera is
%% gone, leaves its places to others.
%%
%% Other robots hide floor. A robot looks again until they have moved. A robot that waits for work
%% looks, too, and writes that into a register: what it has seen needs no second look. What stays
%% hidden, behind a dead robot, is not seen: all end with `incomplete'.
%%
%% Trace: {@link event()} (see {@link starl_search_monitor}).
-module(starl_search).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([guarantees/0]).
-export([options/0, scene/1, preview/1, report/2]).

-export_type([event/0, task/0]).

%% The robot has found the ball, and where it takes it to be (mm).
-type event() :: {found, starl_geometry:point()}.

%% The places to look from, what a camera sees, and how far around its place a robot may hide what is
%% behind it.
-type task() :: #{
    views := [starl_search_cover:view()],
    field := float(),
    most_mm := number(),
    ball_mm := number(),
    hides_mm := float()
}.

%% `wait': the answer to its last request is still due; what it saw of others when it last looked from where
%% it waits. `tell': it has found the ball, and the others do not know.
-type phase() :: elect | search | {wait, look() | none} | {tell, starl_geometry:point()}.
-type state() :: {phase(), task()}.

%% A look all around: from where, and the ways of other robots meanwhile.
-type look() :: {starl_geometry:point(), [starl_geometry:segment()]}.

-define(COLOUR, orange).
%% A robot that waits for work looks so often whether the ball has been found (ms).
-define(WAIT_MS, 5000).
%% After so long it counts as waiting (ms).
-define(SOON_MS, 1000).
%% One whose register could not be written tries again after this time (ms): its store may be full for a while.
-define(TELL_MS, 1000).
%% The looks after the first one, the time between them (ms), and how many of all agree on a place
%% (mm).
-define(LOOKS, 4).
-define(LOOK_MS, 60).
-define(AGREE, 4).
-define(SAME_MM, 400.0).
%% So often a robot looks once more where looks nearly agree; and where others hide floor, after so long (ms).
-define(AGAIN, 4).
-define(PATIENCE, 12).
-define(HIDDEN_MS, 1000).
%% Each of so many times it says what it has seen.
-define(SHARED, 4).
%% Who is seen so near to where it was has not moved (mm).
-define(STILL_MM, 30.0).
%% Fields of view overlap by this (rad), and a field at least so wide is all around.
-define(OVERLAP, 0.2).
-define(AROUND, 6.28).
-define(TURN, 6.283185307179586).

%% One robot shows the lines.
-spec init(starl:robot(), task()) -> state().
init(Robot, #{views := Views} = Task) ->
    IsFirst = hd(starl:participants(Robot)) =:= starl:id(Robot),
    _ = [
        ok = starl:draw(Robot, #{key => {line, N}, line => [A, B], colour => grey})
     || IsFirst, {N, #{line := {A, B}}} <- lists:enumerate(Views)
    ],
    case starl_dpp:coordinator(Robot) of
        {ok, _} -> {search, Task};
        {error, _} -> {elect, Task}
    end.

-spec step(starl:robot(), state()) ->
    {continue, state()} | {done, {found, starl_geometry:point()} | complete | incomplete}.
step(Robot, {Phase, Task}) ->
    case phase(Phase, Robot, Task) of
        {done, Result} -> {done, Result};
        Next -> {continue, {Next, Task}}
    end.

phase(elect, Robot, _Task) ->
    case starl_election:elect(Robot, search) of
        {ok, Leader} -> join(Robot, Leader);
        {error, restarted} -> elect;
        {error, timeout} -> join(Robot, hd(starl:participants(Robot)))
    end;
phase({tell, At}, Robot, _Task) ->
    case starl_registers:put(Robot, found, At) of
        ok ->
            {done, {found, At}};
        {error, _} ->
            ok = starl:sleep(Robot, ?TELL_MS),
            {tell, At}
    end;
phase({wait, Before}, Robot, Task) ->
    case starl_registers:get(Robot, found) of
        {ok, At} -> {done, {found, At}};
        {error, _} -> waits(look_around(Before, Robot, Task), Robot, Task)
    end;
phase(search, Robot, Task) ->
    search(starl_registers:get(Robot, found), starl:sense(Robot, camera), Robot, Task).

search({ok, At}, _Camera, _Robot, _Task) ->
    {done, {found, At}};
search(_Found, {error, _}, Robot, _Task) ->
    %% who does not see leaves the work to others
    ok = starl:sleep(Robot, 1000),
    search;
search(_Found, {ok, _}, Robot, Task) ->
    requested(starl_dpp:request_path(Robot, ?SOON_MS), none, Robot, Task).

waits({found, At}, Robot, _Task) -> found(At, Robot);
waits(Look, Robot, Task) -> requested(starl_dpp:wait_path(Robot, ?WAIT_MS), Look, Robot, Task).

join(Robot, Leader) ->
    _ = starl_dpp:join(Robot, Leader),
    search.

requested({ok, Path}, _Look, Robot, Task) ->
    follow(starl_dpp:lines(Path), Path, Robot, Task);
requested({error, no_coordinator}, _Look, Robot, _Task) ->
    join(Robot, hd(starl:participants(Robot)));
requested({error, no_answer}, _Look, _Robot, _Task) ->
    {done, incomplete};
requested({error, timeout}, Look, _Robot, _Task) ->
    {wait, Look};
requested({error, restarted}, _Look, _Robot, _Task) ->
    search;
requested(complete, _Look, Robot, _Task) ->
    case starl_registers:get(Robot, hidden) of
        {ok, _} -> {done, incomplete};
        {error, _} -> {done, complete}
    end;
requested(incomplete, _Look, _Robot, _Task) ->
    {done, incomplete}.

%% The rest of a path that is not followed goes to the next robot that asks.
follow([{N, _Line, up} | Lines], Path, Robot, Task) ->
    case starl_dpp:drive(Robot, Path, N) of
        ok -> went_on(glance(Robot), Lines, Path, Robot, Task);
        {error, _VoidOrRestarted} -> search
    end;
follow([{N, Line, down} | Lines], Path, Robot, Task) ->
    case viewed(view(Line, Task), {Path, N}, Robot, Task) of
        seen -> driven(starl_dpp:drive(Robot, Path, N), Lines, Path, Robot, Task);
        Other -> went_on(Other, Lines, Path, Robot, Task)
    end;
follow([], _Path, _Robot, _Task) ->
    search.

driven(ok, Lines, Path, Robot, Task) -> follow(Lines, Path, Robot, Task);
driven({error, _VoidOrRestarted}, _Lines, _Path, _Robot, _Task) -> search.

went_on({found, At}, _Lines, _Path, Robot, _Task) ->
    found(At, Robot);
went_on(gone, _Lines, _Path, _Robot, _Task) ->
    search;
went_on(nothing, Lines, Path, Robot, Task) ->
    case starl_registers:get(Robot, found) of
        {ok, _} -> search;
        {error, _} -> follow(Lines, Path, Robot, Task)
    end.

found(At, Robot) ->
    starl:trace(Robot, {found, At}),
    ok = starl:draw(Robot, #{key => found, area => starl_drawing:circle(At, 200)}),
    ok = starl:draw(Robot, #{key => here, text => "found", at => beside(At)}),
    {tell, At}.

beside({X, Y}) -> {X + 250, Y - 250}.

%% -- a place to look from ---------------------------------------------------------------------

%% Where lines cross they are cut, so a line may be a part of its place's.
view({A, B}, #{views := Views}) ->
    Middle = starl_geometry:interpolate(A, B, 0.5),
    Near = [V || #{line := L} = V <- Views, starl_geometry:point_segment(Middle, L) =< 1.0],
    {A, hd(Near)}.

viewed({At, View}, Way, Robot, Task) ->
    Cells = starl_search_cover:cells(View),
    viewed(?PATIENCE, Cells, headings(At, Cells, Task), Way, Robot, Task).

%% Who cannot wait any longer for others says that something is not seen.
viewed(0, _Cells, _Headings, _Way, Robot, _Task) ->
    _ = starl_registers:put(Robot, hidden, true),
    seen;
viewed(Tries, Cells, Headings, Way, Robot, Task) ->
    Before = others(Robot, Task),
    case looked(Headings, Way, Robot) of
        nothing ->
            Others = others(Before, others(Robot, Task), Robot),
            case hidden(Cells, Others, Robot, Task) of
                [] ->
                    seen;
                Hidden ->
                    _ = [shared(Others, Robot, Task) || Tries rem ?SHARED =:= 0],
                    again(Tries, Hidden, Way, Robot, Task)
            end;
        Other ->
            Other
    end.

again(Tries, Hidden, Way, Robot, Task) ->
    ok = starl:sleep(Robot, ?HIDDEN_MS),
    case {starl_registers:get(Robot, found), starl:position(Robot)} of
        {{ok, _}, _} ->
            gone;
        {_, {ok, {X, Y, _}}} ->
            viewed(Tries - 1, Hidden, headings({X, Y}, Hidden, Task), Way, Robot, Task);
        {_, {error, _}} ->
            gone
    end.

%% The directions in which these cells are seen; `around': one look sees them all.
headings(_At, _Cells, #{field := Field}) when Field >= ?AROUND ->
    [around];
headings(At, Cells, #{field := Field}) ->
    N = ceil(?TURN / (Field - ?OVERLAP)),
    Steps = lists:usort([
        round(starl_geometry:heading(At, starl_search_cells:middle(Cell)) * N / ?TURN) rem N
     || Cell <- Cells
    ]),
    [Step * ?TURN / N || Step <- Steps].

looked([], _Way, _Robot) ->
    nothing;
looked([around | _], _Way, Robot) ->
    look(?AGAIN, Robot);
looked([Heading | Headings], {Path, N} = Way, Robot) ->
    case starl_dpp:turn(Robot, Path, N, float(Heading)) of
        ok ->
            case look(?AGAIN, Robot) of
                nothing -> looked(Headings, Way, Robot);
                Other -> Other
            end;
        {error, _VoidOrRestarted} ->
            gone
    end.

%% Where the other robots are that may hide something.
others(Robot, #{most_mm := Range}) ->
    case starl:neighbours(Robot, Range) of
        {ok, Others} -> {ok, [{Id, {X, Y}} || #{robot := Id, pose := {X, Y, _}} <- Others]};
        {error, _} -> unknown
    end.

%% The own place, and the ways of others meanwhile.
others({ok, Before}, {ok, After}, Robot) ->
    Ways = [{P, proplists:get_value(Id, After, P)} || {Id, P} <- Before],
    New = [{P, P} || {Id, P} <- After, not lists:keymember(Id, 1, Before)],
    case starl:position(Robot) of
        {ok, {X, Y, _}} -> {ok, {{X, Y}, Ways ++ New}};
        {error, _} -> unknown
    end;
others(_Before, _After, _Robot) ->
    unknown.

%% The cells that others hid, and that nobody else has seen meanwhile.
hidden(Cells, unknown, _Robot, _Task) -> Cells;
hidden(_Cells, {ok, {_At, []}}, _Robot, _Task) -> [];
hidden(Cells, {ok, Look}, Robot, Task) -> unseen(behind(Look, Cells, Task), Robot, Task).

%% What this robot has seen all around others need not see.
shared({ok, Look}, Robot, #{field := Field}) when Field >= ?AROUND ->
    case starl_registers:put(Robot, {looked, starl:id(Robot)}, Look) of
        ok -> Look;
        {error, _} -> none
    end;
shared(_Others, _Robot, _Task) ->
    none.

%% What stands beside a ball or beyond it does not hide it.
behind({From, Others}, Cells, #{hides_mm := Mm, ball_mm := Ball}) ->
    [
        Cell
     || Cell <- Cells,
        Sight <- [{From, before(Ball, From, starl_search_cells:middle(Cell))}],
        lists:any(fun(Way) -> starl_geometry:closer(Way, Sight, Mm) end, Others)
    ].

before(Ball, From, To) ->
    Far = starl_geometry:distance(From, To),
    starl_geometry:interpolate(From, To, max(0.0, 1.0 - Ball / max(Ball, Far))).

unseen([], _Robot, _Task) ->
    [];
unseen(Cells, Robot, Task) ->
    Others = starl:participants(Robot) -- [starl:id(Robot)],
    Looks = [Look || Id <- Others, {ok, Look} <- [starl_registers:get(Robot, {looked, Id})]],
    case {Looks, starl:floor(Robot)} of
        {[_ | _], {ok, Floor}} -> but_seen(Looks, Cells, starl_walls:new(Floor), Task);
        _ -> Cells
    end.

-spec but_seen([look()], [starl_search_cells:cell()], starl_walls:t(), task()) ->
    [starl_search_cells:cell()].
but_seen(Looks, Cells, Walls, #{most_mm := Range, ball_mm := Ball} = Task) ->
    Sees = #{range_mm => float(Range), ball_mm => float(Ball)},
    IsSeen = fun(Cell, {From, _} = Look) ->
        starl_search_cover:sees(From, Cell, Sees, Walls) andalso behind(Look, [Cell], Task) =:= []
    end,
    [Cell || Cell <- Cells, not lists:any(fun(Look) -> IsSeen(Cell, Look) end, Looks)].

%% A robot that waits looks from there, and once more when others have moved: they need not see what it hides
%% from them.
look_around(Before, Robot, #{field := Field} = Task) when Field >= ?AROUND ->
    Others = others(Robot, Task),
    case is_same(others(Others, Others, Robot), Before) orelse look(?AGAIN, Robot) of
        true -> Before;
        nothing -> shared(others(Others, others(Robot, Task), Robot), Robot, Task);
        gone -> none;
        {found, At} -> {found, At}
    end;
look_around(Before, _Robot, _Task) ->
    Before.

is_same({ok, {At, Ways}}, {Before, Others}) when length(Ways) =:= length(Others) ->
    lists:all(
        fun({{A, B}, {C, D}}) ->
            lists:all(fun(P) -> starl_geometry:distance(A, P) < ?STILL_MM end, [B, C, D])
        end,
        lists:zip([{At, At} | Ways], [{Before, Before} | Others])
    );
is_same(_Now, _Before) ->
    false.

%% -- looking --------------------------------------------------------------------------------

%% On the way one look is enough; who takes something for a ball looks on.
glance(Robot) ->
    case starl:sense(Robot, camera) of
        {ok, Blobs} -> glanced(balls(Blobs), Robot);
        {error, _} -> gone
    end.

glanced([], _Robot) -> nothing;
glanced(_Balls, Robot) -> look(1, Robot).

balls(Blobs) -> [{Bearing, Mm} || #{colour := ?COLOUR, bearing := Bearing, mm := Mm} <- Blobs].

%% A camera may miss a ball or invent one, and one that says the same again to the bit is frozen.
look(0, _Robot) ->
    nothing;
look(Tries, Robot) ->
    case {looks(1 + ?LOOKS, Robot), starl:position(Robot)} of
        {gone, _} -> gone;
        {Looks, {ok, Pose}} -> seen(Looks, Pose, Tries, Robot);
        {_, {error, _}} -> gone
    end.

seen(Looks, Pose, Tries, Robot) ->
    Places = [place(Ball, Pose) || Balls <- lists:usort(Looks), Ball <- Balls],
    case agreed(Places) of
        [_] -> nothing;
        [] -> nothing;
        Group when length(Group) >= ?AGREE -> {found, middle(Group)};
        _ -> look(Tries - 1, Robot)
    end.

looks(0, _Robot) ->
    [];
looks(N, Robot) ->
    case starl:sense(Robot, camera) of
        {ok, Blobs} ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            case looks(N - 1, Robot) of
                gone -> gone;
                More -> [balls(Blobs) | More]
            end;
        {error, _} ->
            gone
    end.

place({Bearing, Mm}, {X, Y, Heading}) ->
    {X + Mm * math:cos(Heading + Bearing), Y + Mm * math:sin(Heading + Bearing)}.

%% The most places that are near to one of them.
agreed(Places) ->
    Near = [[Q || Q <- Places, starl_geometry:distance(P, Q) =< ?SAME_MM] || P <- Places],
    most(Near, []).

most([Group | Groups], Most) when length(Group) > length(Most) -> most(Groups, Group);
most([_ | Groups], Most) -> most(Groups, Most);
most([], Most) -> Most.

middle(Points) ->
    N = length(Points),
    {lists:sum([X || {X, _} <- Points]) / N, lists:sum([Y || {_, Y} <- Points]) / N}.

%% -- scene and report -----------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() -> starl_search_scene:options().

%% @doc The guarantees for the robots that search.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {seen, safety,
            "who says that it has found the ball could see it, and it is where it is said to be", [
                positions, senses
            ]},
        {true, safety,
            "`complete` is reported only when all floor that a camera can come to see was seen", [
                positions, senses, ways, {motion, line}
            ]},
        {searched, progress,
            "until the ball is found all floor that a camera can come to see is seen; then all are done",
            [
                {dpp, assigned}, {dpp, resolved}, {motion, arrives}, senses, ways
            ]}
    ].

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) -> starl_search_scene:scene(Context).

-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(Scene) -> starl_search_scene:preview(Scene).

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(Scene, Outcome) -> starl_search_scene:report(Scene, Outcome).
