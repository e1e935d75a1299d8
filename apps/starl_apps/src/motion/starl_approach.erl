%% @doc Drives to a place among other robots: avoids them on the way ({@link starl_avoidance}), and
%% drives straight near its place. Robots that already stand may be in its way. A robot that gets no
%% nearer for a time drives round them, along a path of its application, and tries again if it gets
%% stuck there, too. Nothing is guaranteed. Lengths are millimetres.
-module(starl_approach).

-export([arrive/3]).

-export_type([options/0]).

-record(approach, {
    goal :: starl_geometry:point(),
    %% the corners of the way round that it still has to drive
    round = [] :: [starl_geometry:point()],
    %% how near it has come to its place, and when, by its own clock (ms)
    nearest = none :: number() | none,
    since :: integer()
}).

%% `within_mm': so near it has arrived. `speed': the fastest, mm/s. `shy_mm': from where it avoids another, the distance of the
%% centres. `pace_ms': of its looks; at each the distance from the place is noted as this `measure'. `round': the
%% corners of a way round, from where it is.
-type options() :: #{
    within_mm := number(),
    speed := number(),
    shy_mm := number(),
    pace_ms := pos_integer(),
    measure := atom(),
    round := fun((starl_geometry:point()) -> [starl_geometry:point()])
}.

%% From where it drives straight.
-define(NEAR_MM, 150).
%% Who has not come nearer by so much for so long (ms) drives round; it goes on at a corner from here.
-define(NEARER_MM, 100).
-define(STUCK_MS, 15000).
-define(CORNER_MM, 300).

%% @doc Drives to a place, and returns when it is there.
-spec arrive(starl:robot(), starl_geometry:point(), options()) -> ok.
arrive(Robot, Goal, Options) ->
    look(Robot, #approach{goal = Goal, since = starl:now(Robot)}, Options).

look(Robot, #approach{goal = Goal} = Approach, Options) ->
    #{within_mm := Within, pace_ms := Ms, measure := Key} = Options,
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            Mm = starl_geometry:distance(Goal, {X, Y}),
            ok = starl:measure(Robot, Key, Mm),
            case Mm =< Within of
                true -> ok;
                false -> look(Robot, drive(Robot, {X, Y}, Mm, Approach, Options), Options)
            end;
        {error, _} ->
            ok = starl:sleep(Robot, Ms),
            look(Robot, Approach, Options)
    end.

drive(Robot, _At, Mm, #approach{goal = Goal} = Approach, _Options) when Mm =< ?NEAR_MM ->
    _ = starl:go_to(Robot, Goal),
    Approach;
drive(Robot, At, Mm, #approach{goal = Goal} = Approach, #{pace_ms := Ms} = Options) ->
    #approach{round = Round} = Next = ahead(Robot, At, Mm, Approach, Options),
    Avoid = (maps:with([speed, shy_mm], Options))#{ms => 3 * Ms},
    _ = starl_avoidance:drive(Robot, hd(Round ++ [Goal]), Avoid),
    ok = starl:sleep(Robot, Ms),
    Next.

ahead(Robot, At, _Mm, #approach{round = [Corner | Corners], since = Since} = Approach, _Options) ->
    Now = starl:now(Robot),
    case starl_geometry:distance(At, Corner) =< ?CORNER_MM of
        true ->
            Approach#approach{round = Corners, nearest = none, since = Now};
        %% no way there, either
        false when Now - Since > ?STUCK_MS ->
            Approach#approach{round = [], nearest = none, since = Now};
        false ->
            Approach
    end;
ahead(Robot, At, Mm, #approach{round = [], nearest = Nearest, since = Since} = Approach, Options) ->
    #{round := Round} = Options,
    Now = starl:now(Robot),
    case is_nearer(Mm, Nearest) of
        true ->
            Approach#approach{nearest = Mm, since = Now};
        false when Now - Since > ?STUCK_MS ->
            Approach#approach{round = Round(At), nearest = none, since = Now};
        false ->
            Approach
    end.

is_nearer(_Mm, none) -> true;
is_nearer(Mm, Nearest) -> Mm < Nearest - ?NEARER_MM.
