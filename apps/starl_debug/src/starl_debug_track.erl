%% @doc The track of a robot by its own clock: a line through its known places, and a bound on its
%% distance from that line.
%%
%% Take two samples, `V' mm of its greatest speed apart in time and `L' mm in place. Between them
%% the robot is within √(λ(1−λ)(V² − L²)) of the line between them at the fraction λ of the time.
%% That bound is tight. Motions in closed form are known everywhere, except for the small distance
%% of an arc from its chord.
-module(starl_debug_track).

-export([samples/2, motions/2, extent/1, span/3, place/2, sample_within/3, sharp/1]).

-export_type([t/0, limits/0]).

%% Time (us), place (mm), V² − L² until the next sample (mm²), and the error of the line (mm).
-type sample() ::
    {AtUs :: integer(), X :: number(), Y :: number(), Bulge :: number(), Error :: number()}.

%% The samples, in a tuple.
-opaque t() :: {sample()} | tuple().

%% The greatest speed (mm/s), the error of a sample (mm).
-type limits() :: #{speed := number(), error := number()}.

%% Pieces of an arc (us).
-define(CHORD_US, 20000).

%% @doc A track through samples, with the number of those that the robot cannot have reached in
%% time.
-spec samples([{AtUs :: integer(), starl_geometry:point()}, ...], limits()) ->
    {t(), TooFast :: non_neg_integer()}.
samples(Samples, Limits) ->
    {Track, TooFast} = sampled(later(Samples), Limits, [], 0),
    {list_to_tuple(Track), TooFast}.

%% Of samples at one time the last counts.
later([{At, _}, {Next, _} = Other | Rest]) when Next =< At -> later([Other | Rest]);
later([First | Rest]) -> [First | later(Rest)];
later([]) -> [].

sampled([{At, {X, Y}}], #{error := Error}, Track, TooFast) ->
    {lists:reverse(Track, [{At, X, Y, 0.0, Error}]), TooFast};
sampled(
    [{At, {X, Y} = P} | [{Next, Q} | _] = Rest],
    #{speed := Speed, error := Error} = Limits,
    Track,
    N
) ->
    V = Speed * (Next - At) / 1.0e6,
    L = max(0.0, starl_geometry:distance(P, Q) - 2 * Error),
    Bulge = V * V - L * L,
    Sample = {At, X, Y, max(0.0, Bulge), Error},
    %% a millimetre for the rounding of times
    sampled(Rest, Limits, [Sample | Track], N + truth(L > V + 1)).

truth(true) -> 1;
truth(false) -> 0.

%% @doc A track along motion segments, in the order of their reports, until a time.
-spec motions([starl_trajectory:piece(), ...], EndUs :: integer()) -> t().
motions(Pieces, End) -> list_to_tuple(lists:append(driven(valid(Pieces, []), End))).

%% A piece replaces those that begin later.
valid([], Valid) ->
    lists:reverse(Valid);
valid([Piece | Pieces], Valid) ->
    From = starl_trajectory:start_us(Piece),
    valid(Pieces, [
        Piece | lists:dropwhile(fun(P) -> starl_trajectory:start_us(P) >= From end, Valid)
    ]).

driven([Piece], End) ->
    From = starl_trajectory:start_us(Piece),
    To = max(From, End),
    [chords(Piece, From, To), [sample(To, Piece, 0.0)]];
driven([Piece | [Next | _] = Pieces], End) ->
    [
        chords(Piece, starl_trajectory:start_us(Piece), starl_trajectory:start_us(Next))
        | driven(Pieces, End)
    ].

chords(_Piece, From, To) when From >= To ->
    [];
chords(Piece, From, To) ->
    case bent_until(Piece) of
        infinity -> arc(Piece, From, To);
        Until when Until =< From -> [sample(From, Piece, 0.0)];
        Until when Until >= To -> arc(Piece, From, To);
        Until -> arc(Piece, From, Until) ++ [sample(Until, Piece, 0.0)]
    end.

arc(Piece, From, To) ->
    Parts = max(1, (To - From) div ?CHORD_US),
    Step = (To - From) / Parts,
    Bow = acceleration(Piece) * (Step / 1.0e6) * (Step / 1.0e6) / 8,
    [sample(From + round(K * Step), Piece, Bow) || K <- lists:seq(0, Parts - 1)].

sample(At, Piece, Error) ->
    {X, Y} = starl_trajectory:position(At, Piece),
    {At, X, Y, 0.0, Error}.

bent_until({piece, T0, _, _, _, V, W}) when V == 0; W == 0 -> T0;
bent_until({piece, _, _, _, _, _, _}) -> infinity;
bent_until({ramp, T0, _, _, _, _, _, Us}) -> T0 + Us.

acceleration({piece, _, _, _, _, V, W}) ->
    abs(V * W);
acceleration({ramp, _, _, _, _, _, _, 0}) ->
    0.0;
acceleration({ramp, _, _, _, _, {VX0, VY0}, {VX1, VY1}, Us}) ->
    math:sqrt((VX1 - VX0) * (VX1 - VX0) + (VY1 - VY0) * (VY1 - VY0)) / (Us / 1.0e6).

%% @doc The first and the last time of a track.
-spec extent(t()) -> starl_debug_set:interval().
extent(Track) -> {element(1, element(1, Track)), element(1, element(tuple_size(Track), Track))}.

%% @doc The same track as if the robot had driven along the lines.
-spec sharp(t()) -> t().
sharp(Track) ->
    list_to_tuple([{At, X, Y, 0.0, Error} || {At, X, Y, _, Error} <- tuple_to_list(Track)]).

%% @doc Places at two times and a radius: from the one to the other time the robot is within that
%% radius (mm) of the point that moves evenly between them.
-spec span(t(), FromUs :: integer(), ToUs :: integer()) ->
    {starl_geometry:point(), starl_geometry:point(), RadiusMm :: float()}.
span(Track, From, To) ->
    I = index(Track, From),
    {P, _} = on(Track, I, From),
    span(Track, I, P, From, To).

span(Track, I, P, From, To) ->
    J = ahead(Track, I, To),
    {Q, _} = on(Track, J, To),
    Chord = {From, max(1, To - From), P, Q},
    {Away, Error} = widest(I, J, Track, From, To, Chord, 0.0, 0.0),
    {P, Q, math:sqrt(Away) + Error}.

%% The squared distance of the samples from the chord; the greatest error on the way.
widest(I, J, Track, From, To, Chord, Away0, Error0) ->
    {At, _, _, Bulge, Error} = element(I, Track),
    Until = next_at(I, Track),
    Whole = max(Error0, Error + bulge(Bulge, At, Until, max(From, At), min(To, Until))),
    case I < J of
        true ->
            widest(
                I + 1,
                J,
                Track,
                From,
                To,
                Chord,
                max(Away0, away(element(I + 1, Track), Chord)),
                Whole
            );
        false ->
            {Away0, Whole}
    end.

away({At, X, Y, _, _}, {From, Length, {PX, PY}, {QX, QY}}) ->
    Part = (At - From) / Length,
    DX = X - PX - Part * (QX - PX),
    DY = Y - PY - Part * (QY - PY),
    DX * DX + DY * DY.

bulge(Bulge, _At, _Until, _From, _To) when Bulge == 0 -> 0.0;
bulge(_Bulge, At, Until, _From, _To) when Until =< At -> 0.0;
bulge(Bulge, At, Until, From, To) ->
    A = (From - At) / (Until - At),
    B = (To - At) / (Until - At),
    Part = max(0.0, min(1.0, nearest_half(A, B))),
    math:sqrt(Part * (1 - Part) * Bulge).

nearest_half(A, _B) when A > 0.5 -> A;
nearest_half(_A, B) when B < 0.5 -> B;
nearest_half(_A, _B) -> 0.5.

%% @doc The place at a time and the bound of its error (mm).
-spec place(t(), AtUs :: integer()) -> {starl_geometry:point(), Mm :: float()}.
place(Track, At) -> on(Track, index(Track, At), At).

on(Track, I, At) ->
    {T0, X0, Y0, Bulge, Error} = element(I, Track),
    case I < tuple_size(Track) andalso At > T0 of
        true ->
            {T1, X1, Y1, _, _} = element(I + 1, Track),
            Part = (At - T0) / (T1 - T0),
            {{X0 + Part * (X1 - X0), Y0 + Part * (Y1 - Y0)}, Error + bulge(Bulge, T0, T1, At, At)};
        false ->
            {{X0, Y0}, Error}
    end.

next_at(I, Track) when I < tuple_size(Track) -> element(1, element(I + 1, Track));
next_at(I, Track) -> element(1, element(I, Track)).

%% @doc The time of a sample between two times, or else the middle.
-spec sample_within(t(), FromUs :: integer(), ToUs :: integer()) -> AtUs :: integer().
sample_within(Track, From, To) ->
    case next_at(index(Track, From), Track) of
        At when At >= From, At =< To -> At;
        _ -> (From + To) div 2
    end.

%% The last sample that is not later.
index(Track, At) -> index(Track, At, 1, tuple_size(Track)).

index(_Track, _At, I, J) when I >= J -> I;
index(Track, At, I, J) ->
    Middle = (I + J + 1) div 2,
    case element(1, element(Middle, Track)) =< At of
        true -> index(Track, At, Middle, J);
        false -> index(Track, At, I, Middle - 1)
    end.

ahead(Track, I, At) when I < tuple_size(Track) ->
    case element(1, element(I + 1, Track)) =< At of
        true -> ahead(Track, I + 1, At);
        false -> I
    end;
ahead(_Track, I, _At) ->
    I.
