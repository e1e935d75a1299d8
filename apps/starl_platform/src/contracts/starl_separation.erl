%% @doc Finds the least distance of any two robots, over all time, from their piecewise motions.
%%
%% Time is cut into slices. A slice is judged when time has passed its end: each robot's motion
%% in it lies in a disc, the discs are put in a grid, and the closest approach is computed for
%% pairs that may come nearer than the limit or the least distance so far. So every encounter
%% below the limit is found, the reported minimum is the true one, and the cost of a slice is
%% about linear in the number of robots. A pair of robots that stand still is skipped.
-module(starl_separation).

-export([new/1, new/2, motion/3, stop/3, advance/2, finish/2]).
-export_type([t/0, encounter/0, least/0]).

%% Two robots (the smaller id first), the least distance (mm) and when (us).
-type encounter() :: {
    DistanceMm :: float(), AtUs :: integer(), {starl:robot_id(), starl:robot_id()}
}.
%% The least distance of any two robots so far, `none' while there are fewer than two.
-type least() :: encounter() | none.
%% A piece of motion and the closed interval in which it was driven.
-type stretch() :: {FromUs :: integer(), ToUs :: integer(), starl_trajectory:piece()}.

%% A robot's motion in one slice: its stretches in order, a disc around them, moved or not.
-record(path, {
    robot :: starl:robot_id(),
    stretches :: [stretch()],
    x :: float(),
    y :: float(),
    radius :: float(),
    moved :: boolean()
}).

-record(separation, {
    limit_mm :: float(),
    slice_us :: pos_integer(),
    %% The start of the slice not judged yet; none before the first motion.
    from = none :: integer() | none,
    %% Pieces that reach into the open slice, latest first.
    pieces = #{} :: #{starl:robot_id() => [starl_trajectory:piece(), ...]},
    least = none :: least(),
    reported = #{} :: #{{starl:robot_id(), starl:robot_id()} => true}
}).

-opaque t() :: #separation{}.

%% Rounding: a distance less than this below the limit is no encounter (mm).
-define(SLACK_MM, 1.0e-6).
-define(SLICE_US, 1_000_000).

%% @doc Watches for pairs nearer than `LimitMm', in slices of one second.
-spec new(LimitMm :: float()) -> t().
new(LimitMm) -> new(LimitMm, ?SLICE_US).

%% @doc Watches for pairs nearer than `LimitMm', in slices of `SliceUs'.
-spec new(LimitMm :: float(), SliceUs :: pos_integer()) -> t().
new(LimitMm, SliceUs) when SliceUs > 0 ->
    #separation{limit_mm = float(LimitMm), slice_us = SliceUs}.

%% @doc From its start on, the robot moves along this piece.
-spec motion(starl:robot_id(), starl_trajectory:piece(), t()) -> t().
motion(Robot, Piece, #separation{pieces = Pieces} = State) ->
    T0 = starl_trajectory:start_us(Piece),
    Known = maps:get(Robot, Pieces, []),
    %% Pieces announced to start later than this one are no longer going to happen.
    Before = lists:dropwhile(fun(Earlier) -> starl_trajectory:start_us(Earlier) > T0 end, Known),
    start(T0, State#separation{pieces = Pieces#{Robot => [Piece | Before]}}).

%% @doc From `T' on, the robot stays where it is. Unknown robots are ignored.
-spec stop(starl:robot_id(), T :: integer(), t()) -> t().
stop(Robot, T, #separation{pieces = Pieces} = State) ->
    case Pieces of
        #{Robot := Known} ->
            case begun(Known, T) of
                [Current | _] -> stopped(Robot, starl_trajectory:stop(T, Current), Current, State);
                [] -> State
            end;
        #{} ->
            State
    end.

%% A robot that brakes already stops anyway.
stopped(_Robot, Current, Current, State) -> State;
stopped(Robot, Standing, _Current, State) -> motion(Robot, Standing, State).

%% @doc Advances the time to `T': judges the slices that are over. Returns the pairs that came
%% nearer than the limit for the first time, ordered by time.
-spec advance(T :: integer(), t()) -> {[encounter()], t()}.
advance(T, #separation{from = From, slice_us = Slice} = State) when
    From =/= none, T > From + Slice
->
    case at_rest(State) of
        true ->
            Skipped = (T - From - 1) div Slice,
            {[], State#separation{from = From + Skipped * Slice}};
        false ->
            {First, Judged} = judge(From + Slice, State),
            {Later, Now} = advance(T, Judged),
            {First ++ Later, Now}
    end;
advance(_T, State) ->
    {[], State}.

%% @doc Judges everything up to `EndUs'. Returns new encounters and the least distance.
-spec finish(EndUs :: integer(), t()) -> {[encounter()], least()}.
finish(EndUs, State) ->
    {Earlier, #separation{from = From} = Open} = advance(EndUs, State),
    case From =/= none andalso From =< EndUs of
        true ->
            {Last, Closed} = judge(EndUs, Open),
            {Earlier ++ Last, Closed#separation.least};
        false ->
            {Earlier, Open#separation.least}
    end.

start(T0, #separation{from = none} = State) -> State#separation{from = T0};
start(_T0, State) -> State.

%% Nothing moves in the open slice: each robot has one piece, on which it stood before the slice.
at_rest(#separation{pieces = Pieces, from = From}) ->
    Rests = fun
        ([Piece]) -> starl_trajectory:rests_from(Piece) < From;
        (_Several) -> false
    end,
    lists:all(Rests, maps:values(Pieces)).

%%% One slice

judge(To, #separation{pieces = Pieces, from = From, reported = Reported} = State) ->
    Paths = [
        path(Robot, clip(lists:reverse(Known), From, To), From)
     || {Robot, Known} <- started(Pieces, To)
    ],
    {Least, Met} = encounters(Paths, State),
    New = [Meeting || {_, _, Pair} = Meeting <- Met, not is_map_key(Pair, Reported)],
    Seen = maps:from_list([{Pair, true} || {_, _, Pair} <- New]),
    {lists:keysort(2, lists:sort(New)), State#separation{
        from = To,
        pieces = maps:map(fun(_Robot, Known) -> current(Known, To) end, Pieces),
        least = Least,
        reported = maps:merge(Reported, Seen)
    }}.

%% Robots with their pieces up to `To', ordered by id.
started(Pieces, To) ->
    [
        {Robot, Begun}
     || {Robot, Known} <- lists:sort(maps:to_list(Pieces)),
        [_ | _] = Begun <- [begun(Known, To)]
    ].

begun(Known, T) -> [Piece || Piece <- Known, starl_trajectory:start_us(Piece) =< T].

%% The pieces that still matter after `To': later ones and the one that is current then.
current([Piece | _], To) when element(2, Piece) =< To -> [Piece];
current([Piece], _To) -> [Piece];
current([Piece | Earlier], To) -> [Piece | current(Earlier, To)].

clip([Piece], From, To) ->
    [{max(element(2, Piece), From), To, Piece}];
clip([Piece | [Next | _] = Later], From, To) ->
    case element(2, Next) of
        T1 when T1 < From -> clip(Later, From, To);
        T1 -> [{max(element(2, Piece), From), T1, Piece} | clip(Later, From, To)]
    end.

path(Robot, [{T1, T2, Piece}] = Stretches, From) ->
    {{X, Y}, Radius} = starl_trajectory:enclosing(T1, T2, Piece),
    Moved = T1 > From orelse starl_trajectory:rests_from(Piece) >= From,
    #path{robot = Robot, stretches = Stretches, x = X, y = Y, radius = Radius, moved = Moved};
path(Robot, Stretches, _From) ->
    Discs = [starl_trajectory:enclosing(T1, T2, Piece) || {T1, T2, Piece} <- Stretches],
    X = lists:sum([DX || {{DX, _}, _} <- Discs]) / length(Discs),
    Y = lists:sum([DY || {{_, DY}, _} <- Discs]) / length(Discs),
    Radius = lists:max([R + distance(X, Y, DX, DY) || {{DX, DY}, R} <- Discs]),
    #path{robot = Robot, stretches = Stretches, x = X, y = Y, radius = Radius, moved = true}.

encounters([_, _ | _] = Paths, #separation{least = none} = State) ->
    encounters(Paths, State#separation{least = estimate(Paths)});
encounters([_, _ | _] = Paths, #separation{least = {Nearest, _, _} = Least, limit_mm = Limit}) ->
    Reach = max(Nearest, Limit),
    Cell = max(1.0, Reach + 2 * lists:max([R || #path{radius = R} <- Paths])),
    Cells = lists:foldr(fun(Path, Acc) -> enter(Path, Cell, Acc) end, #{}, Paths),
    fold_cells(lists:sort(maps:keys(Cells)), Cells, Limit, {Least, []});
encounters(_TooFew, #separation{least = Least}) ->
    {Least, []}.

%% The distance of some pair of neighbours by place: an upper bound that keeps the grid fine.
estimate(Paths) ->
    [First | Rest] = lists:keysort(#path.x, lists:keysort(#path.y, Paths)),
    {_, Pairs} = lists:foldl(fun(P, {Q, Acc}) -> {P, [{Q, P} | Acc]} end, {First, []}, Rest),
    lists:min([approach(infinity, A, B) || {A, B} <- Pairs]).

enter(#path{x = X, y = Y} = Path, Cell, Cells) ->
    Key = {floor(X / Cell), floor(Y / Cell)},
    Cells#{Key => [Path | maps:get(Key, Cells, [])]}.

%% Each pair of the same cell or of neighbouring cells, once.
fold_cells([], _Cells, _Limit, Found) ->
    Found;
fold_cells([{I, J} = Key | Keys], Cells, Limit, Found) ->
    Ahead = [{I, J + 1}, {I + 1, J - 1}, {I + 1, J}, {I + 1, J + 1}],
    Near = lists:append([maps:get(Next, Cells, []) || Next <- Ahead]),
    fold_cells(Keys, Cells, Limit, fold_paths(map_get(Key, Cells), Near, Limit, Found)).

fold_paths([], _Near, _Limit, Found) ->
    Found;
fold_paths([Path | Paths], Near, Limit, Found) ->
    Met = fold_pairs(Path, Near, Limit, fold_pairs(Path, Paths, Limit, Found)),
    fold_paths(Paths, Near, Limit, Met).

fold_pairs(_A, [], _Limit, Found) ->
    Found;
fold_pairs(A, [B | Bs], Limit, {{Nearest, _, _}, _} = Found) ->
    case apart(max(Nearest, Limit), A, B) of
        true -> fold_pairs(A, Bs, Limit, Found);
        false -> fold_pairs(A, Bs, Limit, meet(A, B, Limit, Found))
    end.

apart(_Reach, #path{moved = false}, #path{moved = false}) ->
    true;
apart(Reach, #path{x = XA, y = YA, radius = RA}, #path{x = XB, y = YB, radius = RB}) ->
    DX = XA - XB,
    DY = YA - YB,
    Far = Reach + RA + RB,
    DX * DX + DY * DY > Far * Far.

meet(A, B, Limit, {{Nearest, _, _} = Least, Met}) ->
    case approach(max(Nearest, Limit), A, B) of
        farther -> {Least, Met};
        {D, _, _} = Meeting when D < Limit - ?SLACK_MM -> {min(Least, Meeting), [Meeting | Met]};
        Meeting -> {min(Least, Meeting), Met}
    end.

%% The closest approach of two robots in the slice, if nearer than `Bound'.
approach(Bound, #path{robot = A, stretches = As}, #path{robot = B, stretches = Bs}) ->
    case over(As, Bs, Bound, farther) of
        farther -> farther;
        {Distance, AtUs} -> {Distance, AtUs, {min(A, B), max(A, B)}}
    end.

over([{FA, TA, A} | As], [{FB, TB, B} | Bs], Bound, Best) ->
    Better = common(max(FA, FB), min(TA, TB), A, B, Bound, Best),
    Nearer = bound(Bound, Better),
    if
        TA < TB -> over(As, [{FB, TB, B} | Bs], Nearer, Better);
        TB < TA -> over([{FA, TA, A} | As], Bs, Nearer, Better);
        true -> over(As, Bs, Nearer, Better)
    end;
over(_As, _Bs, _Bound, Best) ->
    Best.

common(From, To, _A, _B, _Bound, Best) when From > To ->
    Best;
common(From, To, A, B, infinity, _Best) ->
    starl_trajectory:closest_approach(A, B, From, To);
common(From, To, A, B, Bound, Best) ->
    case starl_trajectory:closest_within(Bound, A, B, From, To) of
        farther -> Best;
        Nearer -> Nearer
    end.

bound(Bound, farther) -> Bound;
bound(_Bound, {Distance, _AtUs}) -> Distance.

distance(X1, Y1, X2, Y2) ->
    math:sqrt((X1 - X2) * (X1 - X2) + (Y1 - Y2) * (Y1 - Y2)).
