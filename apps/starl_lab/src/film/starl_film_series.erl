%% @doc Values over time, with linear changes between the kept points. A pure module.
-module(starl_film_series).

-export([thin/2, at/2, slice/3, slices/2]).

-export_type([point/0]).

%% A time (us) and numbers.
-type point() :: {T :: integer(), [float()]}.

%% @doc Leaves out the points that follow from the others to within a tolerance, at their times.
-spec thin(Tolerance :: number(), [point()]) -> [point()].
thin(_Tolerance, Points) when length(Points) =< 2 -> Points;
thin(Tolerance, [First | Others]) ->
    Last = lists:last(Others),
    case farthest(First, Last, Others) of
        {Error, _, _} when Error =< Tolerance ->
            [First, Last];
        {_, N, _} ->
            {Before, [Middle | _] = After} = lists:split(N, [First | Others]),
            Left = thin(Tolerance, Before ++ [Middle]),
            lists:droplast(Left) ++ thin(Tolerance, After)
    end.

%% The greatest error of the even change from one point to another, and the place of that point.
farthest(First, Last, Points) ->
    Inner = lists:enumerate(1, lists:droplast(Points)),
    lists:foldl(
        fun({N, {T, _} = Point}, {Most, _, _} = Found) ->
            case distance(Point, between(T, First, Last)) of
                Error when Error > Most -> {Error, N, Point};
                _ -> Found
            end
        end,
        {-1.0, 1, First},
        Inner
    ).

distance({_, Values}, {_, Others}) ->
    math:sqrt(lists:sum([(A - B) * (A - B) || {A, B} <- lists:zip(Values, Others)])).

between(T, {T1, _}, {T2, Values}) when T2 =< T1 -> {T, Values};
between(T, {T1, Values}, {T2, Others}) ->
    Part = (T - T1) / (T2 - T1),
    {T, [A + Part * (B - A) || {A, B} <- lists:zip(Values, Others)]}.

%% @doc The values at a time; before the first point and after the last one they do not change.
-spec at(integer(), [point(), ...]) -> [float()].
at(T, [{T1, Values} | _]) when T =< T1 -> Values;
at(_T, [{_, Values}]) -> Values;
at(T, [Point, {T2, _} = Next | _]) when T < T2 -> element(2, between(T, Point, Next));
at(T, [_ | Points]) -> at(T, Points).

%% @doc The points from a time to another, with one at each end.
-spec slice(From :: integer(), To :: integer(), [point(), ...]) -> [point(), ...].
slice(From, To, Points) ->
    After = skip(From, Points),
    Inner = lists:takewhile(fun({T, _}) -> T < To end, after_time(From, After)),
    [{From, at(From, After)}] ++ Inner ++ [{To, at(To, After)} || To > From].

%% @doc The slices of some spans, in ascending order.
-spec slices([{integer(), integer()}], [point(), ...]) -> [[point(), ...]].
slices([], _Points) ->
    [];
slices([{From, To} | Spans], Points) ->
    Left = skip(From, Points),
    [slice(From, To, Left) | slices(Spans, Left)].

%% The points that matter from a time on.
skip(From, [_, {T, _} = Next | Points]) when T =< From -> skip(From, [Next | Points]);
skip(_From, Points) -> Points.

after_time(From, Points) -> lists:dropwhile(fun({T, _}) -> T =< From end, Points).
