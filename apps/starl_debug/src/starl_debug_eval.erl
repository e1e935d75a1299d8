%% @doc Evaluates a predicate over a time line, for clocks within windows. It computes when the
%% predicate may be true, and when it must be true.
%%
%% The time line is a time T. The clock of robot R shows T + o with o in R's window; o may be
%% different at each moment. The answer is a pair: the times T at which the predicate may be true,
%% and those at which it must be true, for all clocks within the windows. Narrow windows give sharp
%% answers.
%%
%% Parts that depend on places are decided by halving the time. If a bound decides a piece of time,
%% the whole piece is decided. A piece that stays open is tried at one of its moments.
-module(starl_debug_eval).

-export([sets/3, local/3, slack_us/2]).

-export_type([facts/0, windows/0, locals/0]).

%% The robots: what they were and where; by how much the rate of a clock is off at most. `locals':
%% what was computed already, by the robot's own clock.
-type facts() :: #{
    drift_ppm := non_neg_integer(),
    states := #{starl:robot_id() => starl_debug_state:t()},
    tracks := #{starl:robot_id() => starl_debug_track:t()},
    locals := locals()
}.

-type locals() :: #{
    {local, starl:robot_id(), starl_debug_ground:local()} => starl_debug_set:three()
}.

-type windows() :: #{starl:robot_id() => {LoUs :: integer(), HiUs :: integer()}}.

%% Pieces of time that are not halved any more (us).
-define(FINE_US, 5000).
-define(MILLION, 1000000).

%% @doc The times within a range at which a predicate may and must be true.
-spec sets(starl_debug_ground:t(), {starl_debug_set:interval(), windows()}, facts()) ->
    starl_debug_set:three().
sets(true, {Range, _}, _Facts) ->
    starl_debug_set:exactly([Range]);
sets(false, _When, _Facts) ->
    starl_debug_set:nothing();
sets({local, R, _} = Formula, {Range, Windows}, #{locals := Locals}) ->
    #{R := {Lo, Hi}} = Windows,
    #{Formula := {May, Must}} = Locals,
    {
        starl_debug_set:intersect(starl_debug_set:dilate(May, Lo, Hi), [Range]),
        starl_debug_set:intersect(starl_debug_set:erode(Must, Lo, Hi), [Range])
    };
sets({'and', Parts}, When, Facts) ->
    conjunction(Parts, When, Facts);
sets({'or', Parts}, When, Facts) ->
    both(fun starl_debug_set:union/1, Parts, When, Facts);
sets({at_least, K, Parts}, When, Facts) ->
    both(fun(Sets) -> starl_debug_set:at_least(K, Sets) end, Parts, When, Facts);
sets({How, Us, A}, {{From, To} = Range, Windows}, Facts) when
    How =:= held; How =:= once; How =:= ago
->
    %% the time line is a clock, or runs like one
    Slack = slack_us(Us, Facts),
    lasting_within(Range, How, Us, Slack, sets(A, {{From - Us - Slack, To}, Windows}, Facts));
sets({Comparison, R, Q, Mm}, When, Facts) ->
    apart(Comparison, R, Q, Mm, When, Facts).

both(Join, Parts, When, Facts) ->
    {Mays, Musts} = lists:unzip([sets(Part, When, Facts) || Part <- Parts]),
    {Join(Mays), Join(Musts)}.

%% Distances come last, and only where all else may be true.
conjunction(Parts, {Range, Windows}, Facts) ->
    {Costly, Cheap} = lists:partition(fun is_costly/1, Parts),
    Begin = starl_debug_set:exactly([Range]),
    Narrow = fun
        (_Part, {[], Must}) ->
            {[], Must};
        (Part, {May, Must}) ->
            Hull = {element(1, hd(May)), element(2, lists:last(May))},
            {PartMay, PartMust} = sets(Part, {Hull, Windows}, Facts),
            {starl_debug_set:intersect(May, PartMay), starl_debug_set:intersect(Must, PartMust)}
    end,
    lists:foldl(Narrow, Begin, Cheap ++ Costly).

is_costly({local, _, _}) -> false;
is_costly(_) -> true.

%% With slack what lasts must last longer, or may last less.
lasting(held, Us, Slack, Set) ->
    starl_debug_set:held(Set, Us + Slack);
lasting(once, Us, Slack, Set) ->
    starl_debug_set:once(Set, Us - Slack);
lasting(ago, Us, Slack, Set) when Slack >= 0 ->
    starl_debug_set:erode(Set, -Us - Slack, -Us + Slack);
lasting(ago, Us, Slack, Set) ->
    starl_debug_set:dilate(Set, -Us + Slack, -Us - Slack).

%% @doc By how much a clock is off at most when it has measured a duration (us).
-spec slack_us(Us :: non_neg_integer(), facts()) -> non_neg_integer().
slack_us(Us, #{drift_ppm := Ppm}) -> (Us * Ppm + ?MILLION - 1) div ?MILLION.

%% -- by one clock ---------------------------------------------------------------------------

%% @doc The times of its own clock at which something is true of a robot.
-spec local(starl:robot_id(), starl_debug_ground:local(), facts()) -> starl_debug_set:three().
local(R, Local, #{states := States} = Facts) ->
    #{R := State} = States,
    own(Local, R, starl_debug_state:extent(State), Facts).

own(true, _R, Extent, _Facts) ->
    starl_debug_set:exactly([Extent]);
own(false, _R, _Extent, _Facts) ->
    starl_debug_set:nothing();
own({state, What}, R, _Extent, #{states := States}) ->
    starl_debug_state:times(What, maps:get(R, States));
own({delivered, _} = What, R, _Extent, #{states := States}) ->
    starl_debug_state:times(What, maps:get(R, States));
own(serves, R, _Extent, #{states := States}) ->
    starl_debug_state:times(serves, maps:get(R, States));
own({between, A, B}, _R, {From, To}, _Facts) ->
    starl_debug_set:exactly(starl_debug_set:new([{max(From, A), min(To, B)}]));
own({'not', A}, R, Extent, Facts) ->
    own_not(A, R, Extent, Facts);
own({'and', Parts}, R, Extent, Facts) ->
    {Mays, Musts} = lists:unzip([own(Part, R, Extent, Facts) || Part <- Parts]),
    {starl_debug_set:intersect(Mays), starl_debug_set:intersect(Musts)};
own({'or', Parts}, R, Extent, Facts) ->
    {Mays, Musts} = lists:unzip([own(Part, R, Extent, Facts) || Part <- Parts]),
    {starl_debug_set:union(Mays), starl_debug_set:union(Musts)};
own({How, Us, A}, R, Extent, Facts) when How =:= held; How =:= once; How =:= ago ->
    lasting_within(Extent, How, Us, slack_us(Us, Facts), own(A, R, Extent, Facts));
own(Spatial, R, Extent, #{tracks := Tracks}) ->
    case Tracks of
        #{R := Track} -> along(Track, depth(Spatial), Extent);
        #{} -> starl_debug_set:nothing()
    end.

lasting_within(Range, How, Us, Slack, {May, Must}) ->
    {
        starl_debug_set:intersect(lasting(How, Us, -Slack, May), [Range]),
        starl_debug_set:intersect(lasting(How, Us, Slack, Must), [Range])
    }.

%% A negation is taken inwards, to where times are known.
own_not({'not', A}, R, Extent, Facts) ->
    own(A, R, Extent, Facts);
own_not({'and', Parts}, R, Extent, Facts) ->
    own({'or', [{'not', Part} || Part <- Parts]}, R, Extent, Facts);
own_not({'or', Parts}, R, Extent, Facts) ->
    own({'and', [{'not', Part} || Part <- Parts]}, R, Extent, Facts);
own_not({held, Us, A}, R, Extent, Facts) ->
    own({once, Us, {'not', A}}, R, Extent, Facts);
own_not({once, Us, A}, R, Extent, Facts) ->
    own({held, Us, {'not', A}}, R, Extent, Facts);
own_not({ago, Us, A}, R, Extent, Facts) ->
    own({ago, Us, {'not', A}}, R, Extent, Facts);
own_not(A, R, Extent, Facts) ->
    starl_debug_set:negate(own(A, R, Extent, Facts), domain(A, R, Extent, Facts)).

%% Where a place is asked for, that is known from the first sample to the last.
domain(A, R, Extent, #{tracks := Tracks}) ->
    case {is_spatial(A), Tracks} of
        {false, _} ->
            [Extent];
        {true, #{R := Track}} ->
            starl_debug_set:intersect([Extent], [starl_debug_track:extent(Track)]);
        {true, _} ->
            []
    end.

is_spatial({Kind, _, _}) -> Kind =:= near;
is_spatial({Kind, _}) -> lists:member(Kind, [left, below, inside]);
is_spatial(_) -> false.

%% How deep a point is inside (mm); it changes by no more than the point moves.
depth({near, P, Mm}) ->
    fun(Q) -> Mm - starl_geometry:distance(P, Q) end;
depth({left, Mm}) ->
    fun({X, _}) -> Mm - X end;
depth({below, Mm}) ->
    fun({_, Y}) -> Mm - Y end;
depth({inside, {circle, P, Mm}}) ->
    fun(Q) -> Mm - starl_geometry:distance(P, Q) end;
depth({inside, {rectangle, {X0, Y0, X1, Y1}}}) ->
    fun({X, Y}) -> lists:min([X - X0, X1 - X, Y - Y0, Y1 - Y]) end.

along(Track, Depth, Extent) ->
    Bounds = fun(From, To) ->
        {{X0, Y0} = P, {X1, Y1} = Q, Radius} = starl_debug_track:span(Track, From, To),
        Middle = Depth({(X0 + X1) / 2, (Y0 + Y1) / 2}),
        Reach = starl_geometry:distance(P, Q) / 2 + Radius,
        {Middle - Reach, Middle + Reach}
    end,
    Try = fun(From, To) -> starl_debug_track:sample_within(Track, From, To) end,
    scanned(starl_debug_set:intersect([Extent], [starl_debug_track:extent(Track)]), Bounds, Try).

%% -- distances of two robots ----------------------------------------------------------------

apart(Comparison, R, Q, Mm, {Range, Windows}, #{tracks := Tracks}) ->
    case {Tracks, Windows} of
        {#{R := A, Q := B}, #{R := WindowA, Q := WindowB}} ->
            Known = starl_debug_set:intersect([
                [Range], known(A, WindowA), known(B, WindowB)
            ]),
            Bounds = fun(From, To) ->
                inside(
                    Comparison, Mm, starl_debug_pair:distance(From, To, {A, WindowA}, {B, WindowB})
                )
            end,
            {Lo, Hi} = WindowA,
            Shift = (Lo + Hi) div 2,
            Try = fun(From, To) ->
                starl_debug_track:sample_within(A, From + Shift, To + Shift) - Shift
            end,
            {May, Must} = scanned(Known, Bounds, Try),
            Sure = starl_debug_set:intersect(surely(A, WindowA), surely(B, WindowB)),
            {May, starl_debug_set:intersect(Must, Sure)};
        _ ->
            starl_debug_set:nothing()
    end.

%% The times at which the robot's clock may be, and must be, within its track.
known(Track, {Lo, Hi}) -> starl_debug_set:dilate([starl_debug_track:extent(Track)], Lo, Hi).

surely(Track, {Lo, Hi}) -> starl_debug_set:erode([starl_debug_track:extent(Track)], Lo, Hi).

inside('<', Mm, {Least, Greatest}) -> {Mm - Greatest, Mm - Least};
inside('>', Mm, {Least, Greatest}) -> {Least - Mm, Greatest - Mm}.

%% -- halving --------------------------------------------------------------------------------

%% Where a value with these bounds is at least 0.
scanned(Ranges, Bounds, Try) ->
    Pieces = lists:foldl(
        fun({From, To}, Acc) -> halved(From, To, Bounds, Try, Acc) end, [], Ranges
    ),
    {
        starl_debug_set:new([{From, To} || {From, To, _} <- Pieces]),
        starl_debug_set:new([{From, To} || {_, _, {From, To}} <- Pieces])
    }.

halved(From, To, Bounds, Try, Pieces) ->
    case Bounds(From, To) of
        {Low, _} when Low > 0 ->
            [{From, To, {From, To}} | Pieces];
        {_, High} when High < 0 ->
            Pieces;
        _ when To - From =< ?FINE_US ->
            [{From, To, tried(Try(From, To), Bounds)} | Pieces];
        _ ->
            Middle = (From + To) div 2,
            halved(Middle + 1, To, Bounds, Try, halved(From, Middle, Bounds, Try, Pieces))
    end.

tried(At, Bounds) ->
    case Bounds(At, At) of
        {Low, _} when Low > 0 -> {At, At};
        _ -> none
    end.
