%% @doc The pace at which a simulation is played: the time that it should have reached by now, and
%% whether it is paused. Virtual time follows wall time at a chosen speed, or runs as fast as it
%% can. It also does so on its way to a goal, where it pauses. A pure module; wall time is in ms,
%% virtual time in us.
-module(starl_lab_player_pace).

-export([new/3, speed/2, go/3, goal/2, goal/3, rest/1, anchored/3]).
-export([rests/1, target/3, piece/1, wait_ms/3, ran/3, arrived/3, measured/3, clock/1]).

-export_type([t/0, speed/0]).

%% Of virtual time; `max': as fast as it can.
-type speed() :: number() | max.

-define(TICK_MS, 30).
%% Behind by more than this, the run gives up the time that it has lost.
-define(LATE_MS, 250).
-define(FIRST_US, 20000).
-define(MEASURED_MS, 500).

-record(pace, {
    speed :: speed(),
    paused :: boolean(),
    goal = none :: non_neg_integer() | none,
    %% goes on from its goal
    goes_on = false :: boolean(),
    %% this time of the wall is this virtual time
    anchor :: {integer(), non_neg_integer()},
    piece_us = ?FIRST_US :: pos_integer(),
    %% speed as measured, since an anchor of its own
    measured :: {integer(), non_neg_integer(), float()}
}).

-opaque t() :: #pace{}.

%% @doc The pace of a run that begins now.
-spec new(speed(), Paused :: boolean(), Wall :: integer()) -> t().
new(Speed, Paused, Wall) ->
    #pace{speed = Speed, paused = Paused, anchor = {Wall, 0}, measured = {Wall, 0, 0.0}}.

%% @doc Another speed; a run that rests goes on to rest.
-spec speed(speed(), t()) -> t().
speed(Speed, Pace) -> Pace#pace{speed = Speed}.

%% @doc The run goes on from now.
-spec go(Wall :: integer(), non_neg_integer(), t()) -> t().
go(Wall, Now, Pace) -> anchored(Wall, Now, Pace#pace{paused = false, goal = none}).

%% @doc The run goes as fast as it can to a time and rests there.
-spec goal(non_neg_integer(), t()) -> t().
goal(Us, Pace) -> goal(Us, false, Pace).

%% @doc The same; there it goes on, or rests.
-spec goal(non_neg_integer(), GoesOn :: boolean(), t()) -> t().
goal(Us, GoesOn, Pace) -> Pace#pace{paused = true, goal = Us, goes_on = GoesOn}.

%% @doc The run rests.
-spec rest(t()) -> t().
rest(Pace) -> Pace#pace{paused = true, goal = none}.

%% @doc From now on virtual time is counted from this moment.
-spec anchored(Wall :: integer(), non_neg_integer(), t()) -> t().
anchored(Wall, Now, Pace) -> Pace#pace{anchor = {Wall, Now}}.

%% @doc Does the run rest?
-spec rests(t()) -> boolean().
rests(#pace{paused = Paused, goal = Goal}) -> Paused andalso Goal =:= none.

%% @doc The virtual time that should be now, which is not beyond the end of the run.
-spec target(Wall :: integer(), Until :: non_neg_integer(), t()) -> non_neg_integer().
target(_Wall, Until, #pace{goal = Goal}) when Goal =/= none -> min(Goal, Until);
target(_Wall, Until, #pace{speed = max}) ->
    Until;
target(Wall, Until, #pace{speed = Speed, anchor = {Then, At}}) ->
    min(Until, At + round((Wall - Then) * 1000 * Speed)).

%% @doc The most virtual time that is run at once: commands wait meanwhile.
-spec piece(t()) -> pos_integer().
piece(#pace{piece_us = Piece}) -> Piece.

%% @doc The time until the next piece, of a run whose last piece began at a time.
-spec wait_ms(Begun :: integer(), Wall :: integer(), t()) -> non_neg_integer().
wait_ms(_Begun, _Wall, #pace{goal = Goal}) when Goal =/= none -> 0;
wait_ms(_Begun, _Wall, #pace{speed = max}) ->
    0;
wait_ms(Begun, Wall, _Pace) when is_integer(Begun), is_integer(Wall) ->
    max(0, Begun + ?TICK_MS - Wall).

%% @doc A piece has been run: the next should take no longer than a tick.
-spec ran(Us :: pos_integer(), Ms :: non_neg_integer(), t()) -> t().
ran(Us, Ms, #pace{piece_us = Piece} = Pace) when Us >= Piece ->
    Pace#pace{piece_us = max(1000, min(2 * Piece, Piece * ?TICK_MS div max(1, Ms)))};
ran(Us, Ms, Pace) when Ms > ?TICK_MS -> Pace#pace{piece_us = max(1000, Us * ?TICK_MS div Ms)};
ran(_Us, _Ms, Pace) ->
    Pace.

%% @doc The run has come to a time: it rests at its goal, and gives up time that it has lost.
-spec arrived(Wall :: integer(), Now :: non_neg_integer(), t()) -> t().
arrived(Wall, Now, #pace{goal = Goal, goes_on = true} = Pace) when Goal =/= none, Now >= Goal ->
    go(Wall, Now, Pace);
arrived(_Wall, Now, #pace{goal = Goal} = Pace) when Goal =/= none, Now >= Goal ->
    rest(Pace);
arrived(Wall, Now, #pace{goal = none, speed = Speed, anchor = {Then, At}} = Pace) when
    Speed =/= max, (Wall - Then) - (Now - At) / 1000 / Speed > ?LATE_MS
->
    anchored(Wall, Now, Pace);
arrived(_Wall, _Now, Pace) ->
    Pace.

%% @doc Measures the speed, about twice a second.
-spec measured(Wall :: integer(), Now :: non_neg_integer(), t()) -> t().
measured(_Wall, Now, #pace{measured = {Then, At, _}} = Pace) when Now < At ->
    Pace#pace{measured = {Then, Now, 0.0}};
measured(Wall, Now, #pace{measured = {Then, At, _}} = Pace) when Wall - Then >= ?MEASURED_MS ->
    Pace#pace{measured = {Wall, Now, round((Now - At) / (Wall - Then) / 10) / 100}};
measured(_Wall, _Now, Pace) ->
    Pace.

%% @doc What a page's clock shows of it.
-spec clock(t()) -> #{speed := speed(), real := float(), paused := boolean()}.
clock(#pace{speed = Speed, measured = {_, _, Real}} = Pace) ->
    #{speed => Speed, real => Real, paused => rests(Pace)}.
