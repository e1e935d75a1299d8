%% @doc Affine maps of the plane, and a parser of the `transform' attribute (SVG 1.1, section 7.6).
%% The parser also accepts the form of style sheets (CSS Transforms 1, section 7, in the plane, with
%% px and deg). A part of the SVG reader, {@link starl_svg}.
%%
%% A matrix is `{A, B, C, D, E, F}' and maps `{X, Y}' to `{A*X + C*Y + E, B*X + D*Y + F}'.
-module(starl_svg_transform).

-export([identity/0, translation/2, multiply/2, apply/2, apply_vector/2, parse/1]).
-export_type([matrix/0]).

%% Six finite entries, none above 1.0e12.
-type matrix() :: {float(), float(), float(), float(), float(), float()}.

-define(MAX_ENTRY, 1.0e12).

%% @doc The identity.
-spec identity() -> matrix().
identity() -> {1.0, 0.0, 0.0, 1.0, 0.0, 0.0}.

%% @doc Moves by `X' and `Y'.
-spec translation(float(), float()) -> matrix().
translation(X, Y) -> {1.0, 0.0, 0.0, 1.0, X, Y}.

%% Scales about the origin.
-spec scaling(float(), float()) -> matrix().
scaling(X, Y) -> {X, 0.0, 0.0, Y, 0.0, 0.0}.

%% @doc The composition: the second map is applied first, then the first one. Entries that grow
%% beyond 1.0e12 are an error: a chain of transforms could otherwise leave the range of floats.
-spec multiply(matrix(), matrix()) -> {ok, matrix()} | {error, out_of_range}.
multiply({A1, B1, C1, D1, E1, F1}, {A2, B2, C2, D2, E2, F2}) ->
    bounded({
        A1 * A2 + C1 * B2,
        B1 * A2 + D1 * B2,
        A1 * C2 + C1 * D2,
        B1 * C2 + D1 * D2,
        A1 * E2 + C1 * F2 + E1,
        B1 * E2 + D1 * F2 + F1
    }).

%% @doc The image of a point.
-spec apply(matrix(), starl_geometry:point()) -> starl_geometry:point().
apply({A, B, C, D, E, F}, {X, Y}) -> {A * X + C * Y + E, B * X + D * Y + F}.

%% @doc The image of a vector: as for a point, but without the translation.
-spec apply_vector(matrix(), starl_geometry:point()) -> starl_geometry:point().
apply_vector({A, B, C, D, _E, _F}, {X, Y}) -> {A * X + C * Y, B * X + D * Y}.

%% @doc The map of a `transform' attribute; empty text and `none' mean the identity.
-spec parse(binary()) -> {ok, matrix()} | {error, syntax | out_of_range}.
parse(Text) ->
    case starl_svg_number:skip_space(Text) of
        <<"none", Rest/binary>> -> none(starl_svg_number:skip_space(Rest));
        Rest -> functions(Rest, identity())
    end.

%%% Internals

none(<<>>) -> {ok, identity()};
none(_) -> {error, syntax}.

functions(<<>>, Matrix) ->
    {ok, Matrix};
functions(Text, Matrix) ->
    case function(Text) of
        {ok, Next, Rest} ->
            case multiply(Matrix, Next) of
                {ok, Product} -> functions(starl_svg_number:skip_comma(Rest), Product);
                {error, _} = Error -> Error
            end;
        {error, _} = Error ->
            Error
    end.

function(Text) ->
    case binary:split(Text, <<")">>) of
        [Call, Rest] ->
            case binary:split(Call, <<"(">>) of
                [Name, Arguments] -> function(string:trim(Name), Arguments, Rest);
                [_] -> {error, syntax}
            end;
        [_] ->
            {error, syntax}
    end.

function(Name, Arguments, Rest) ->
    case starl_svg_number:list(without_units(Arguments)) of
        {ok, Numbers} ->
            case matrix(Name, Numbers) of
                {ok, Matrix} -> {ok, Matrix, Rest};
                {error, _} = Error -> Error
            end;
        {error, out_of_range} ->
            {error, out_of_range};
        {error, not_a_number} ->
            {error, syntax}
    end.

%% In style sheets numbers have units, of which only these two keep the number.
without_units(Text) ->
    re:replace(Text, <<"(?<=[0-9.])(px|deg)\\b">>, <<>>, [global, {return, binary}]).

matrix(<<"matrix">>, [A, B, C, D, E, F]) -> {ok, {A, B, C, D, E, F}};
matrix(<<"translateX">>, [X]) -> {ok, translation(X, 0.0)};
matrix(<<"translateY">>, [Y]) -> {ok, translation(0.0, Y)};
matrix(<<"scaleX">>, [S]) -> {ok, scaling(S, 1.0)};
matrix(<<"scaleY">>, [S]) -> {ok, scaling(1.0, S)};
matrix(<<"translate">>, [X]) -> {ok, translation(X, 0.0)};
matrix(<<"translate">>, [X, Y]) -> {ok, translation(X, Y)};
matrix(<<"scale">>, [S]) -> {ok, scaling(S, S)};
matrix(<<"scale">>, [X, Y]) -> {ok, scaling(X, Y)};
matrix(<<"rotate">>, [Degrees]) -> {ok, rotation(Degrees, 0.0, 0.0)};
matrix(<<"rotate">>, [Degrees, X, Y]) -> {ok, rotation(Degrees, X, Y)};
matrix(<<"skewX">>, [Degrees]) -> bounded({1.0, 0.0, tan(Degrees), 1.0, 0.0, 0.0});
matrix(<<"skewY">>, [Degrees]) -> bounded({1.0, tan(Degrees), 0.0, 1.0, 0.0, 0.0});
matrix(_, _) -> {error, syntax}.

rotation(Degrees, X, Y) ->
    Cos = math:cos(radians(Degrees)),
    Sin = math:sin(radians(Degrees)),
    {Cos, Sin, -Sin, Cos, X - Cos * X + Sin * Y, Y - Sin * X - Cos * Y}.

tan(Degrees) -> math:tan(radians(Degrees)).

radians(Degrees) -> Degrees * math:pi() / 180.0.

bounded({A, B, C, D, E, F} = Matrix) ->
    case lists:all(fun(X) -> abs(X) =< ?MAX_ENTRY end, [A, B, C, D, E, F]) of
        true -> {ok, Matrix};
        false -> {error, out_of_range}
    end.
