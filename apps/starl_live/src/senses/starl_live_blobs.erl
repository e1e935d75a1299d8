%% @doc Finds coloured balls in a picture: their direction and distance, as the sense `camera'
%% reports them.
%%
%% The picture is smoothed (the mean of 3 x 3 pixels). Its tint is removed (grey world: each colour
%% is scaled so that all have one mean, by a factor of two at most). Then pixels are compared with
%% thresholds of hue, saturation and value (HSV). Pixels of one colour that touch, even by a corner,
%% are a blob, if it is large enough and about as round as a ball. One pass, row by row, works on
%% runs of pixels.
%%
%% A ball of known radius r, at the distance z along the axis of a camera of focal length f pixels,
%% appears as a disc of radius about f·r/z. Off the axis, at the bearing b, it appears as an ellipse
%% whose mean diameter is larger by 1/√cos b.
-module(starl_live_blobs).

-export([find/2, options/0]).

-export_type([options/0, colour/0]).

%% Hue in degrees, 0 to 360, from one to the other upwards (340 to 10 is red); the least saturation
%% and value, 0 to 255. (OpenCV's hue is half of it.)
-type colour() :: #{
    hue := {number(), number()}, saturation => 0..255, value => 0..255
}.

%% `field': the horizontal angle of view, rad; `ball_mm': the radius of the balls; `most_mm': no
%% farther; `least_px': the pixels of the smallest blob.
-type options() :: #{
    colours := #{atom() => colour()},
    field := float(),
    ball_mm := number(),
    most_mm := number(),
    least_px := pos_integer()
}.

%% A run of pixels of one colour in a row, from a column up to another.
-type run() :: {Colour :: pos_integer(), From :: non_neg_integer(), To :: non_neg_integer()}.

-record(blob, {
    colour :: pos_integer(),
    area = 0 :: non_neg_integer(),
    %% the sums of the columns, of the centres of pixels
    x = 0.0 :: float(),
    left :: non_neg_integer(),
    right :: non_neg_integer(),
    top :: non_neg_integer(),
    bottom :: non_neg_integer()
}).

%% Gains are fixed-point numbers of 12 bits; the sum of nine pixels is divided by nine with them.
-define(ONE, 4096).
-define(MOST_GAIN, 2.0).

%% @doc The usual options: an orange ball of 67 mm.
-spec options() -> options().
options() ->
    #{
        colours => #{orange => #{hue => {5, 40}, saturation => 120, value => 40}},
        field => 1.05,
        ball_mm => 33.5,
        most_mm => 3000,
        least_px => 20
    }.

%% @doc The balls in a picture, from left to right. If the border cuts a ball (`clipped'), its size
%% is at least the reported size, and its distance at most the reported distance.
-spec find(starl_live_ppm:frame(), options()) -> [map()].
find(#{width := Width, height := Height} = Frame, _Options) when Width < 3; Height < 3 ->
    _ = Frame,
    [];
find(#{width := Width, height := Height} = Frame, #{colours := Colours} = Options) ->
    Names = lists:sort(maps:keys(Colours)),
    Thresholds = [thresholds(N, maps:get(Name, Colours)) || {N, Name} <- lists:enumerate(Names)],
    Rows = rows(Frame, gains(Frame), Thresholds),
    Found = [B || B <- blobs(Rows), is_ball(B, Width, Height, Options)],
    Readings = [reading(B, Frame, Names, Options) || B <- Found],
    lists:sort(fun(#{bearing := A}, #{bearing := B}) -> A >= B end, Readings).

thresholds(N, #{hue := {From, To}} = Colour) ->
    {N, From, To, maps:get(saturation, Colour, 120), maps:get(value, Colour, 40)}.

%% -- tint -----------------------------------------------------------------------------------

%% Grey world, from every fourth row: the factor of each colour, for the sum of nine pixels.
gains(#{width := Width, height := Height, pixels := Pixels}) ->
    Row = 3 * Width,
    {R, G, B} = lists:foldl(
        fun(Y, Sums) -> summed(binary:part(Pixels, Y * Row, Row), Sums) end,
        {0, 0, 0},
        lists:seq(0, Height - 1, 4)
    ),
    Mean = (R + G + B) / 3,
    list_to_tuple([round(gain(Mean, Sum) * ?ONE / 9) || Sum <- [R, G, B]]).

gain(_Mean, 0) -> 1.0;
gain(Mean, Sum) -> max(1 / ?MOST_GAIN, min(?MOST_GAIN, Mean / Sum)).

summed(<<R, G, B, Rest/binary>>, {Rs, Gs, Bs}) -> summed(Rest, {Rs + R, Gs + G, Bs + B});
summed(<<>>, Sums) -> Sums.

%% -- runs -----------------------------------------------------------------------------------

%% The runs of each row but the first and the last, which have no mean.
rows(#{width := Width, height := Height, pixels := Pixels}, Gains, Thresholds) ->
    Row = 3 * Width,
    [
        {Y, runs(Y, Row, Pixels, Gains, Thresholds)}
     || Y <- lists:seq(1, Height - 2)
    ].

runs(Y, Row, Pixels, Gains, Thresholds) ->
    <<A:6/binary, As/binary>> = binary:part(Pixels, (Y - 1) * Row, Row),
    <<B:6/binary, Bs/binary>> = binary:part(Pixels, Y * Row, Row),
    <<C:6/binary, Cs/binary>> = binary:part(Pixels, (Y + 1) * Row, Row),
    {First, Second} = {column(A, B, C, 0), column(A, B, C, 3)},
    across(As, Bs, Cs, First, Second, 1, {0, 0}, {Gains, Thresholds}).

column(A, B, C, At) ->
    list_to_tuple([binary:at(A, I) + binary:at(B, I) + binary:at(C, I) || I <- [At, At + 1, At + 2]]).

%% The sums of the two columns before are kept; `{Colour, From}' is the run that has begun.
across(
    <<R1, G1, B1, As/binary>>,
    <<R2, G2, B2, Bs/binary>>,
    <<R3, G3, B3, Cs/binary>>,
    {Rp, Gp, Bp},
    {Rq, Gq, Bq} = Last,
    X,
    {Colour, From} = Run,
    {{Gr, Gg, Gb}, Thresholds} = How
) ->
    {R, G, B} = Next = {R1 + R2 + R3, G1 + G2 + G3, B1 + B2 + B3},
    Red = ((Rp + Rq + R) * Gr) bsr 12,
    Green = ((Gp + Gq + G) * Gg) bsr 12,
    Blue = ((Bp + Bq + B) * Gb) bsr 12,
    case class(Red, Green, Blue, Thresholds) of
        Colour ->
            across(As, Bs, Cs, Last, Next, X + 1, Run, How);
        Other when Colour =:= 0 ->
            across(As, Bs, Cs, Last, Next, X + 1, {Other, X}, How);
        Other ->
            [{Colour, From, X} | across(As, Bs, Cs, Last, Next, X + 1, {Other, X}, How)]
    end;
across(<<>>, <<>>, <<>>, _Before, _Last, _X, {0, _From}, _How) ->
    [];
across(<<>>, <<>>, <<>>, _Before, _Last, X, {Colour, From}, _How) ->
    [{Colour, From, X}].

%% The number of the colour, or 0. Most pixels are too grey or too dark for any.
class(R, G, B, Thresholds) ->
    Most = max(R, max(G, B)),
    Chroma = Most - min(R, min(G, B)),
    class(Thresholds, Most, 255 * Chroma, Chroma, {R, G, B}).

class([], _Most, _Saturation, _Chroma, _Rgb) ->
    0;
class([{_, _, _, S, V} | Others], Most, Saturation, Chroma, Rgb) when
    Most < V; Saturation < S * Most; Chroma =:= 0
->
    class(Others, Most, Saturation, Chroma, Rgb);
class([{N, From, To, _, _} | Others], Most, Saturation, Chroma, Rgb) ->
    Hue = hue(Rgb, Most, Chroma),
    case is_between(Hue, From, To) of
        true -> N;
        false -> class(Others, Most, Saturation, Chroma, Rgb)
    end.

hue({Most, G, B}, Most, Chroma) when G >= B -> 60 * (G - B) / Chroma;
hue({Most, G, B}, Most, Chroma) -> 360 + 60 * (G - B) / Chroma;
hue({R, Most, B}, Most, Chroma) -> 120 + 60 * (B - R) / Chroma;
hue({R, G, Most}, Most, Chroma) -> 240 + 60 * (R - G) / Chroma.

is_between(Hue, From, To) when From =< To -> Hue >= From andalso Hue =< To;
is_between(Hue, From, To) -> Hue >= From orelse Hue =< To.

%% -- blobs ----------------------------------------------------------------------------------

%% Each run of a row joins the blobs of the row above that it touches. `Open' are the runs of the row
%% above with the numbers of their blobs, which `Parents' may have joined to others.
-spec blobs([{non_neg_integer(), [run()]}]) -> [#blob{}].
blobs(Rows) ->
    {_, Parents, Parts, _} = lists:foldl(fun row/2, {[], #{}, #{}, 1}, Rows),
    Joined = maps:fold(
        fun(Id, Part, All) ->
            maps:update_with(root(Id, Parents), fun(B) -> joined(B, Part) end, Part, All)
        end,
        #{},
        Parts
    ),
    maps:values(Joined).

row({Y, Runs}, {Above, Parents, Parts, Next}) ->
    {Open, _, Parents1, Parts1, Next1} = lists:foldl(
        fun(Run, Acc) -> placed(Run, Y, Acc) end, {[], Above, Parents, Parts, Next}, Runs
    ),
    {lists:reverse(Open), Parents1, Parts1, Next1}.

%% Runs above that end before this one begins touch none of the later ones either.
placed({Colour, From, To} = Run, Y, {Open, Above0, Parents0, Parts, Next}) ->
    Above = lists:dropwhile(fun({{_, _, E}, _}) -> E < From end, Above0),
    Touching = [
        Id
     || {{C, _, _}, Id} <- lists:takewhile(fun({{_, S, _}, _}) -> S =< To end, Above),
        C =:= Colour
    ],
    One = #blob{
        colour = Colour,
        area = To - From,
        x = (To - From) * (From + To) / 2,
        left = From,
        right = To,
        top = Y,
        bottom = Y + 1
    },
    case Touching of
        [] ->
            {[{Run, Next} | Open], Above, Parents0, Parts#{Next => One}, Next + 1};
        [First | Others] ->
            Parents = lists:foldl(fun(Id, P) -> union(First, Id, P) end, Parents0, Others),
            Id = root(First, Parents),
            Grown = maps:update_with(Id, fun(B) -> joined(B, One) end, One, Parts),
            {[{Run, Id} | Open], Above, Parents, Grown, Next}
    end.

root(Id, Parents) ->
    case Parents of
        #{Id := Parent} -> root(Parent, Parents);
        #{} -> Id
    end.

%% The smaller number wins.
union(A, B, Parents) ->
    case {root(A, Parents), root(B, Parents)} of
        {Same, Same} -> Parents;
        {X, Y} -> Parents#{max(X, Y) => min(X, Y)}
    end.

joined(#blob{} = A, #blob{} = B) ->
    A#blob{
        area = A#blob.area + B#blob.area,
        x = A#blob.x + B#blob.x,
        left = min(A#blob.left, B#blob.left),
        right = max(A#blob.right, B#blob.right),
        top = min(A#blob.top, B#blob.top),
        bottom = max(A#blob.bottom, B#blob.bottom)
    }.

%% -- balls ----------------------------------------------------------------------------------

%% A disc fills pi/4 of its box; of one that the border cuts nothing is known but its colour.
is_ball(#blob{area = Area} = Blob, Width, Height, #{least_px := Least}) when Area >= Least ->
    {W, H} = extent(Blob),
    Fill = Area / (W * H),
    is_clipped(Blob, Width, Height) orelse
        (Fill >= 0.5 andalso Fill =< 0.95 andalso W =< 2 * H andalso H =< 2 * W);
is_ball(#blob{}, _Width, _Height, _Options) ->
    false.

extent(#blob{left = Left, right = Right, top = Top, bottom = Bottom}) ->
    {Right - Left, Bottom - Top}.

%% The outermost pixels have no mean.
is_clipped(#blob{left = Left, right = Right, top = Top, bottom = Bottom}, Width, Height) ->
    Left =< 1 orelse Top =< 1 orelse Right >= Width - 1 orelse Bottom >= Height - 1.

reading(#blob{colour = N, area = Area, x = X} = Blob, Frame, Names, Options) ->
    #{width := Width, height := Height} = Frame,
    #{field := Field, ball_mm := Ball, most_mm := Most} = Options,
    Focal = Width / (2 * math:tan(Field / 2)),
    Bearing = math:atan((Width / 2 - X / Area) / Focal),
    Clipped = is_clipped(Blob, Width, Height),
    {W, H} = extent(Blob),
    Radius =
        case Clipped of
            true -> max(W, H) / 2;
            false -> math:sqrt(Area / math:pi())
        end,
    Depth = Focal * Ball / Radius / math:sqrt(math:cos(Bearing)),
    Mm = min(float(Most), Depth / math:cos(Bearing)),
    Reading = #{
        colour => lists:nth(N, Names),
        bearing => Bearing,
        size => 2 * math:atan(Ball / Mm),
        mm => Mm
    },
    clipped(Clipped, Reading).

clipped(true, Reading) -> Reading#{clipped => true};
clipped(false, Reading) -> Reading.
