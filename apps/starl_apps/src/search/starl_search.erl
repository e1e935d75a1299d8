%% @doc Distributed search (the paper's section III-C): robots with cameras search the rooms of a
%% building for a coloured ball. Path planning leads each to lines that nobody has driven yet; after
%% each leg it looks. Who sees the ball looks again, from where it stands; if the looks agree it
%% writes the place into a register that all share, and everybody is done. A robot that dies, or
%% whose camera is gone, gives its lines back.
%%
%% Trace: {@link event()} (see {@link starl_search_monitor}).
-module(starl_search).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([guarantees/0]).
-export([options/0, scene/1, preview/1, report/2]).

-export_type([event/0]).

%% The robot has found the ball, and where it takes it to be (mm).
-type event() :: {found, starl_geometry:point()}.

%% `wait': the answer to its last request is still due. `tell': it has found the ball, and the others do not know.
-type state() :: elect | search | wait | {tell, starl_geometry:point()}.

-define(COLOUR, orange).
%% A robot that waits for work looks so often whether the ball has been found (ms).
-define(WAIT_MS, 5000).
%% One whose register could not be written tries again after this time (ms): its store may be full for a while.
-define(TELL_MS, 1000).
%% The looks after the first one, the time between them (ms), and how many of all agree on a place
%% (mm).
-define(LOOKS, 4).
-define(LOOK_MS, 60).
-define(AGREE, 4).
-define(SAME_MM, 400.0).

%% One robot shows the lines.
-spec init(starl:robot(), [starl_geometry:segment()]) -> elect | search.
init(Robot, Lines) ->
    IsFirst = hd(starl:participants(Robot)) =:= starl:id(Robot),
    _ = [
        ok = starl:draw(Robot, #{key => {line, N}, line => [A, B], colour => grey})
     || IsFirst, {N, {A, B}} <- lists:enumerate(Lines)
    ],
    case starl_dpp:coordinator(Robot) of
        {ok, _} -> search;
        {error, _} -> elect
    end.

-spec step(starl:robot(), state()) ->
    {continue, state()} | {done, {found, starl_geometry:point()} | complete | incomplete}.
step(Robot, elect) ->
    case starl_election:elect(Robot, search) of
        {ok, Leader} -> join(Robot, Leader);
        {error, restarted} -> {continue, elect};
        {error, timeout} -> join(Robot, hd(starl:participants(Robot)))
    end;
step(Robot, {tell, At}) ->
    case starl_registers:put(Robot, found, At) of
        ok ->
            {done, {found, At}};
        {error, _} ->
            ok = starl:sleep(Robot, ?TELL_MS),
            {continue, {tell, At}}
    end;
step(Robot, wait) ->
    case starl_registers:get(Robot, found) of
        {ok, At} -> {done, {found, At}};
        {error, _} -> requested(starl_dpp:wait_path(Robot, ?WAIT_MS), Robot)
    end;
step(Robot, search) ->
    search(starl_registers:get(Robot, found), starl:sense(Robot, camera), Robot).

search({ok, At}, _Camera, _Robot) ->
    {done, {found, At}};
search(_Found, {error, _}, Robot) ->
    %% who does not see leaves the work to others
    ok = starl:sleep(Robot, 1000),
    {continue, search};
search(_Found, {ok, _}, Robot) ->
    requested(starl_dpp:request_path(Robot, ?WAIT_MS), Robot).

join(Robot, Leader) ->
    _ = starl_dpp:join(Robot, Leader),
    {continue, search}.

requested({ok, Path}, Robot) -> follow(starl_dpp:lines(Path), Path, Robot);
requested({error, no_coordinator}, Robot) -> join(Robot, hd(starl:participants(Robot)));
requested({error, no_answer}, _Robot) -> {done, incomplete};
requested({error, timeout}, _Robot) -> {continue, wait};
requested({error, restarted}, _Robot) -> {continue, search};
requested(End, _Robot) -> {done, End}.

%% The rest of a path that is not followed goes to the next robot that asks.
follow([{N, _Line, _Pen} | Lines], Path, Robot) ->
    case starl_dpp:drive(Robot, Path, N) of
        ok -> looked(look(Robot), Lines, Path, Robot);
        {error, _VoidOrRestarted} -> {continue, search}
    end;
follow([], _Path, _Robot) ->
    {continue, search}.

looked({found, At}, _Lines, _Path, Robot) ->
    starl:trace(Robot, {found, At}),
    ok = starl:draw(Robot, #{key => found, area => starl_drawing:circle(At, 200)}),
    ok = starl:draw(Robot, #{key => here, text => "found", at => beside(At)}),
    {continue, {tell, At}};
looked(gone, _Lines, _Path, _Robot) ->
    {continue, search};
looked(nothing, Lines, Path, Robot) ->
    case starl_registers:get(Robot, found) of
        {ok, _} -> {continue, search};
        {error, _} -> follow(Lines, Path, Robot)
    end.

beside({X, Y}) -> {X + 250, Y - 250}.

%% -- looking --------------------------------------------------------------------------------

look(Robot) ->
    case starl:sense(Robot, camera) of
        {ok, Blobs} -> look_again(balls(Blobs), Robot);
        {error, _} -> gone
    end.

balls(Blobs) -> [{Bearing, Mm} || #{colour := ?COLOUR, bearing := Bearing, mm := Mm} <- Blobs].

%% A camera may invent a ball, and one that says the same again to the bit is frozen.
look_again([], _Robot) ->
    nothing;
look_again(First, Robot) ->
    case starl:position(Robot) of
        {ok, Pose} ->
            Looks = lists:usort([First | [again(Robot) || _ <- lists:seq(1, ?LOOKS)]]),
            agreed([place(Ball, Pose) || Balls <- Looks, Ball <- Balls]);
        {error, _} ->
            nothing
    end.

again(Robot) ->
    ok = starl:sleep(Robot, ?LOOK_MS),
    case starl:sense(Robot, camera) of
        {ok, Blobs} -> balls(Blobs);
        {error, _} -> []
    end.

place({Bearing, Mm}, {X, Y, Heading}) ->
    {X + Mm * math:cos(Heading + Bearing), Y + Mm * math:sin(Heading + Bearing)}.

agreed(Places) ->
    Near = [[Q || Q <- Places, starl_geometry:distance(P, Q) =< ?SAME_MM] || P <- Places],
    case [Group || Group <- Near, length(Group) >= ?AGREE] of
        [Group | _] -> {found, middle(Group)};
        [] -> nothing
    end.

middle(Points) ->
    N = length(Points),
    {lists:sum([X || {X, _} <- Points]) / N, lists:sum([Y || {_, Y} <- Points]) / N}.

%% -- scene and report -----------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() -> starl_search_scene:options().

%% @doc What those who search may rely on.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {seen, safety, "who says that it has found the ball could see it", [positions, senses]},
        {true, safety,
            "`complete` is reported only when each line of each room that can be reached was driven",
            [
                {motion, line}
            ]},
        {searched, progress,
            "until the ball is found every such room is searched; then all are done", [
                {dpp, assigned}, {dpp, resolved}, {motion, arrives}, senses
            ]}
    ].

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) -> starl_search_scene:scene(Context).

-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(Scene) -> starl_search_scene:preview(Scene).

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(Scene, Outcome) -> starl_search_scene:report(Scene, Outcome).
