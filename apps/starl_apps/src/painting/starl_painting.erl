%% @doc Collaborative painting (the paper's Subroutine 6): the team elects a coordinator; then
%% each robot, until the picture is complete, asks for a path, follows it with the pen down on
%% the lines that are to be painted, and clears what it has passed.
-module(starl_painting).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, scene/1, report/2]).

%% How often a robot takes part in the election before it gives the picture up.
-define(ELECTIONS, 3).

-type state() :: {elect, Tries :: pos_integer()} | {paint, Leader :: starl:robot_id()}.

%% -- the application ------------------------------------------------------------------------

-spec init(starl:robot(), none) -> state().
init(Robot, none) -> led(Robot, {elect, ?ELECTIONS}).

-spec step(starl:robot(), state()) -> {continue, state()} | {done, complete | incomplete}.
step(Robot, {elect, Tries}) ->
    case starl_election:elect(Robot, painting) of
        {ok, Leader} -> {continue, {paint, join(Robot, Leader)}};
        {error, restarted} -> {continue, {elect, Tries}};
        {error, timeout} when Tries > 1 -> {continue, led(Robot, {elect, Tries - 1})};
        {error, timeout} -> {done, incomplete}
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

join(Robot, Leader) ->
    _ = starl_dpp:join(Robot, Leader),
    Leader.

%% Until the path ends, or must not be followed any further: the lines that are not painted go to
%% whoever asks next.
follow(Robot, Path) ->
    _ = lists:all(
        fun({N, _Point, Pen}) ->
            starl:actuate(Robot, pen, Pen),
            starl_dpp:drive(Robot, Path, N) =:= ok
        end,
        starl_dpp:waypoints(Path)
    ),
    starl:actuate(Robot, pen, up).

%% -- what it needs, and what it tells -------------------------------------------------------

-spec options() -> [starl_options:option()].
options() -> starl_painting_scene:options().

-spec scene(starl_app:context()) -> {ok, starl_app:scene()} | {error, unicode:chardata()}.
scene(Context) -> starl_painting_scene:scene(Context).

-spec report(starl_app:scene(), starl_app:outcome()) -> starl_app:report().
report(Scene, Outcome) -> starl_painting_scene:report(Scene, Outcome).
