%% @doc Reads a picture to paint: turns an ordinary SVG drawing into line segments on the floor. The
%% reader proper is {@link starl_svg}.
%%
%% ```
%% {ok, Picture} = starl_picture:read("house.svg", #{area => {0.0, 0.0, 10000.0, 10000.0}}),
%% Segments = starl_picture:segments(Picture).
%% '''
%% The drawing is scaled uniformly into the area, centred, with y turned upwards. The fitted box is
%% the viewBox (or else width and height) of the document if the whole drawing lies inside it, else
%% the drawing's own bounding box. Curves are mapped to the floor first and then cut into chords, so
%% the tolerance is a distance on the floor. Corners are rounded to a micrometre, so that the same
%% picture gives the same segments on machines with different sine functions. The tolerance includes
%% the errors of rounding and of the removal of tiny segments.
%%
%% Reading is safe with any input: nothing outside the file is fetched, memory and work are bounded,
%% and no atoms come from the file.
-module(starl_picture).

-export([read/2, parse/2, segments/1, only/2, tolerance/1, title/1, left_out/1, format_error/1]).
-export_type([t/0, segment/0, options/0, left_out/0, reason/0]).

-include_lib("kernel/include/file.hrl").

-type segment() :: {starl_geometry:point(), starl_geometry:point()}.
%% The area to fill, the largest distance between a curve and its chords (at least 0.1 mm), and
%% the number of segments above which a picture is refused.
-type options() :: #{
    area := {X0 :: number(), Y0 :: number(), X1 :: number(), Y1 :: number()},
    tolerance_mm => float(),
    max_segments => pos_integer()
}.
%% Numbers of what a browser shows and the picture has not.
-type left_out() :: starl_svg_walk:left_out().
%% The reason why a picture cannot be read; {@link format_error/1} turns it into a line of text.
-type reason() ::
    {cannot_read, file:filename(),
        missing | directory | no_permission | too_big | badarg | file:posix()}
    | {no_lines, left_out()}
    | {too_many_segments, Max :: pos_integer()}
    | starl_svg:problem().

-record(picture, {
    segments :: [segment()],
    tolerance :: float(),
    title :: string(),
    left_out :: left_out()
}).
-opaque t() :: #picture{}.

-define(MAX_BYTES, 20_000_000).
-define(DEFAULT_TOLERANCE_MM, 2.0).
-define(MIN_TOLERANCE_MM, 0.1).
-define(DEFAULT_MAX_SEGMENTS, 5000).
%% The share of the tolerance for rounding and the removal of tiny segments.
-define(SLACK_MM, 0.012).
-define(SHORTEST_MM, 0.01).
%% The length of a line without length that is seen.
-define(DOT_MM, 0.1).
%% Duplicates are dropped late, so a drawing may have this multiple of the curves that it may keep.
-define(DUPLICATES, 4).

%% @doc Reads an SVG file. The title is that of the document, or else the name of the file.
-spec read(file:filename(), options()) -> {ok, t()} | {error, reason()}.
read(File, Options) ->
    case file_bytes(File) of
        {ok, Bytes} -> named(filename:basename(File, ".svg"), parse(Bytes, Options));
        {error, Why} -> {error, {cannot_read, File, Why}}
    end.

%% @doc Reads an SVG document from a binary.
-spec parse(binary(), options()) -> {ok, t()} | {error, reason()}.
parse(Bytes, #{area := Area} = Options) when is_binary(Bytes) ->
    Tolerance = maps:get(tolerance_mm, Options, ?DEFAULT_TOLERANCE_MM),
    Max = maps:get(max_segments, Options, ?DEFAULT_MAX_SEGMENTS),
    ok = check(Area, Tolerance, Max),
    case byte_size(Bytes) =< ?MAX_BYTES of
        true -> starl_svg_bounded:run(fun() -> drawn(Bytes, Area, float(Tolerance), Max) end);
        false -> {error, {cannot_read, "picture", too_big}}
    end.

drawn(Bytes, Area, Tolerance, Max) ->
    case starl_svg:read(Bytes, Max * ?DUPLICATES) of
        {ok, Drawing} -> picture(Drawing, Area, Tolerance, Max);
        {error, too_many_shapes} -> {error, {too_many_segments, Max}};
        {error, _} = Error -> Error
    end.

%% @doc The lines to paint, in the order of the document; no two are the same, in either direction.
-spec segments(t()) -> [segment()].
segments(#picture{segments = Segments}) -> Segments.

%% @doc The picture with these lines in the place of its own.
-spec only([segment()], t()) -> t().
only(Segments, Picture) -> Picture#picture{segments = Segments}.

%% @doc The largest distance of the segments from the original curves, in mm.
-spec tolerance(t()) -> float().
tolerance(#picture{tolerance = Tolerance}) -> Tolerance.

%% @doc The title, one line of text, possibly empty.
-spec title(t()) -> string().
title(#picture{title = Title}) -> Title.

%% @doc What is left out of the picture.
-spec left_out(t()) -> left_out().
left_out(#picture{left_out = LeftOut}) -> LeftOut.

%% @doc One line of text that states the problem, its place and the remedy.
-spec format_error(reason()) -> binary().
format_error(Reason) ->
    case error_text(Reason) of
        {svg, Problem} -> starl_svg_error:format(Problem);
        {Format, Arguments} -> starl_svg_error:line(Format, Arguments)
    end.

%%% Files and options

file_bytes(File) ->
    case file:read_file_info(File) of
        {ok, #file_info{type = Type, size = Size}} -> file_bytes(File, Type, Size);
        {error, Posix} -> {error, why(Posix)}
    end.

file_bytes(_File, directory, _Size) ->
    {error, directory};
file_bytes(_File, _Type, Size) when Size > ?MAX_BYTES -> {error, too_big};
file_bytes(File, regular, _Size) ->
    case file:read_file(File) of
        {ok, Bytes} -> {ok, Bytes};
        {error, Posix} -> {error, why(Posix)}
    end;
file_bytes(_File, _Device, _Size) ->
    {error, einval}.

why(enoent) -> missing;
why(enotdir) -> missing;
why(eisdir) -> directory;
why(eacces) -> no_permission;
why(Posix) -> Posix.

named(Name, {ok, #picture{title = ""} = Picture}) -> {ok, Picture#picture{title = line(Name)}};
named(_Name, Result) -> Result.

%% Wrong options are a mistake of the caller.
check({X0, Y0, X1, Y1}, Tolerance, Max) when
    is_number(X0),
    is_number(Y0),
    X1 > X0,
    Y1 > Y0,
    is_number(X1),
    is_number(Y1),
    is_number(Tolerance),
    Tolerance >= ?MIN_TOLERANCE_MM,
    is_integer(Max),
    Max > 0
->
    ok;
check(Area, Tolerance, Max) ->
    error(badarg, [Area, Tolerance, Max]).

%% Control characters and runs of space become single spaces.
line(Text) ->
    Printable = [
        case C >= 32 andalso C =/= 127 of
            true -> C;
            false -> $\s
        end
     || C <- unicode:characters_to_list(Text)
    ],
    lists:flatten(lists:join($\s, string:lexemes(Printable, " "))).

%%% From the drawing to the floor

picture(#{shapes := Shapes, frame := Frame, left_out := LeftOut} = Drawing, Area, Tolerance, Max) ->
    case place(Shapes, Frame, Area) of
        {ok, Map} ->
            case chords([on_floor(Map, Tolerance, Shape) || Shape <- Shapes], Tolerance, Max) of
                {ok, []} -> {error, {no_lines, LeftOut}};
                {ok, Segments} -> {ok, made(Segments, Tolerance, Drawing)};
                {error, _} = Error -> Error
            end;
        nothing ->
            {error, {no_lines, LeftOut}}
    end.

made(Segments, Tolerance, #{title := Title, left_out := LeftOut}) ->
    #picture{
        segments = Segments, tolerance = Tolerance, title = line(Title), left_out = LeftOut
    }.

on_floor(Map, Tolerance, {line, Outline, Clips}) ->
    {line, on_floor_outline(Map, Outline), [starl_svg_clip:placed(Map, Tolerance, C) || C <- Clips]};
on_floor(Map, Tolerance, {edges, Outlines, Clips}) ->
    {
        edges,
        [on_floor_outline(Map, Outline) || Outline <- Outlines],
        [starl_svg_clip:placed(Map, Tolerance, Clip) || Clip <- Clips]
    }.

on_floor_outline(Map, Outline) -> [starl_svg_curve:transform(Map, Curve) || Curve <- Outline].

%% The map from the drawing to the floor.
place(Shapes, Frame, {AX0, AY0, AX1, AY1}) ->
    case boxes(Shapes) of
        [] ->
            nothing;
        [First | Rest] ->
            Box = lists:foldl(fun starl_svg_curve:merge_bounds/2, First, Rest),
            {X0, Y0, X1, Y1} = fitted(Frame, Box),
            case scale(X1 - X0, AX1 - AX0, Y1 - Y0, AY1 - AY0) of
                none ->
                    nothing;
                S ->
                    {CX, CY} = {(X0 + X1) / 2.0, (Y0 + Y1) / 2.0},
                    {FX, FY} = {(AX0 + AX1) / 2.0, (AY0 + AY1) / 2.0},
                    {ok, {S, 0.0, 0.0, -S, FX - CX * S, FY + CY * S}}
            end
    end.

%% The boxes of what can be seen through the windows.
boxes(Shapes) ->
    lists:append([
        seen(Box, [starl_svg_clip:box(Clip) || Clip <- Clips])
     || {_, _, Clips} = Shape <- Shapes, Box <- unclipped(Shape)
    ]).

unclipped({line, Outline, _Clips}) -> [starl_svg_curve:bounds(Curve) || Curve <- Outline];
unclipped({edges, Outlines, _Clips}) -> [starl_svg_area:box(Outlines)].

seen({X0, Y0, X1, Y1}, _Windows) when X0 > X1; Y0 > Y1 -> [];
seen(Box, []) ->
    [Box];
seen({A0, B0, A1, B1}, [{C0, D0, C1, D1} | Windows]) ->
    seen({max(A0, C0), max(B0, D0), min(A1, C1), min(B1, D1)}, Windows).

fitted(none, Box) ->
    Box;
fitted({FX0, FY0, FX1, FY1} = Frame, {X0, Y0, X1, Y1} = Box) ->
    Give = 1.0e-6 * max(FX1 - FX0, FY1 - FY0),
    Inside =
        X0 >= FX0 - Give andalso Y0 >= FY0 - Give andalso
            X1 =< FX1 + Give andalso Y1 =< FY1 + Give,
    case Inside of
        true -> Frame;
        false -> Box
    end.

%% A drawing without width or height (one straight line) is scaled by the other.
scale(W, AreaW, H, AreaH) ->
    Least = max(1.0e-9, 1.0e-9 * max(W, H)),
    case [Area / Size || {Size, Area} <- [{W, AreaW}, {H, AreaH}], Size > Least] of
        [] -> none;
        Scales -> lists:min(Scales)
    end.

%%% Segments

chords(Shapes, Tolerance, Max) ->
    case chords(Shapes, Tolerance - ?SLACK_MM, Max * ?DUPLICATES, []) of
        {ok, Segments} ->
            Unique = unique(Segments),
            case length(Unique) =< Max of
                true -> {ok, Unique};
                false -> {error, {too_many_segments, Max}}
            end;
        too_many ->
            {error, {too_many_segments, Max}}
    end.

chords([], _Tolerance, _Left, Chains) ->
    {ok, [Segment || Chain <- lists:reverse(Chains), Segment <- Chain]};
chords([Shape | Shapes], Tolerance, Left, Chains) ->
    Counted = [counted(Outline, Tolerance) || Outline <- outlines(Shape)],
    case lists:sum([N || Curves <- Counted, {_, N} <- Curves]) of
        Count when Count > Left -> too_many;
        Count ->
            Chain = seen_of(Shape, lists:append([flattened(Curves) || Curves <- Counted])),
            chords(Shapes, Tolerance, Left - Count, [Chain | Chains])
    end.

outlines({line, Outline, _Clips}) -> [Outline];
outlines({edges, Outlines, _Clips}) -> Outlines.

counted(Outline, Tolerance) ->
    [{Curve, starl_svg_curve:steps(Curve, Tolerance)} || Curve <- Outline].

flattened([{First, _} | _] = Curves) ->
    Points = [P || {Curve, N} <- Curves, P <- starl_svg_curve:flatten(Curve, N)],
    chain(rounded(starl_svg_curve:start(First)), Points).

seen_of({line, [{line, P, P}], Clips}, []) -> clipped(Clips, dot(rounded(P)));
seen_of({line, _, Clips}, Chain) -> clipped(Clips, Chain);
seen_of({edges, _, Clips}, Boundary) -> long_enough(starl_svg_clip:edges(Clips, Boundary)).

%% Joins the points; a point too close to the last one taken is left out.
chain(_From, []) ->
    [];
chain(From, [Point | Points]) ->
    To = rounded(Point),
    case length_of(From, To) < ?SHORTEST_MM of
        true -> chain(From, Points);
        false -> [{From, To} | chain(To, Points)]
    end.

dot({X, Y}) -> [{{X, Y}, rounded({X + ?DOT_MM, Y})}].

clipped([], Chain) ->
    Chain;
clipped([Clip | Clips], Chain) ->
    Inside = [Part || Segment <- Chain, Part <- starl_svg_clip:cut(Clip, Segment)],
    clipped(Clips, long_enough(Inside)).

long_enough(Segments) ->
    Rounded = [{rounded(P), rounded(Q)} || {P, Q} <- Segments],
    [Segment || {P, Q} = Segment <- Rounded, length_of(P, Q) >= ?SHORTEST_MM].

length_of({X0, Y0}, {X1, Y1}) ->
    math:sqrt((X1 - X0) * (X1 - X0) + (Y1 - Y0) * (Y1 - Y0)).

rounded({X, Y}) -> {round(X * 1000.0) / 1000, round(Y * 1000.0) / 1000}.

unique(Segments) -> unique(Segments, #{}, []).

unique([], _Seen, Done) ->
    lists:reverse(Done);
unique([{P, Q} = Segment | Rest], Seen, Done) ->
    Key = {min(P, Q), max(P, Q)},
    case is_map_key(Key, Seen) of
        true -> unique(Rest, Seen, Done);
        false -> unique(Rest, Seen#{Key => []}, [Segment | Done])
    end.

%% -- errors -----------------------------------------------------------------------------------

%% One line that states the problem, its place and the remedy.
error_text({cannot_read, File, Why}) ->
    {"cannot read ~ts: ~ts", [starl_svg_error:quote(File, 200), file_text(Why)]};
error_text({no_lines, #{texts := Texts, unseen := 0}}) when Texts > 0 ->
    {
        "the picture draws no lines, only text; convert the text to paths "
        "(in Inkscape: Path, Object to Path)",
        []
    };
error_text({no_lines, #{unseen := Unseen}}) when Unseen > 0 ->
    {
        "the picture draws no lines: ~ts; give them a stroke",
        [unseen(Unseen)]
    };
error_text({no_lines, #{images := Images}}) when Images > 0 ->
    {"the picture draws no lines, only an image; trace the image to paths first", []};
error_text({no_lines, _LeftOut}) ->
    {"the picture draws no lines; it needs a visible line, path or other shape", []};
error_text({too_many_segments, Max}) ->
    {
        "the picture has more than ~b line segments; simplify it, or allow a larger --tolerance or "
        "more --segments",
        [Max]
    };
error_text(Problem) ->
    {svg, Problem}.

unseen(1) -> "its only shape has neither stroke nor fill that is visible";
unseen(N) -> io_lib:format("its ~b shapes have neither stroke nor fill that is visible", [N]).

file_text(missing) -> "there is no such file";
file_text(directory) -> "it is a directory; give an SVG file";
file_text(no_permission) -> "no permission; make the file readable";
file_text(too_big) -> "it is larger than 20 MB; simplify the drawing";
file_text(Posix) -> file:format_error(Posix).
