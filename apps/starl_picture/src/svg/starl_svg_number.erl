%% @doc Reads numbers, lists of numbers and lengths in SVG's notation. A part of the SVG reader,
%% {@link starl_svg}.
%%
%% The grammar is the compact one of path data (SVG 1.1, section 8.3.9): a number ends at the first
%% character that cannot continue it, so `1-2.5.5e-3' is 1, -2.5 and 0.005. Magnitudes above 1.0e9
%% are refused: no drawing needs them, and products of the others stay far below the largest float.
-module(starl_svg_number).

-export([scan/1, list/1, length/2, skip_space/1, skip_comma/1]).
-export_type([problem/0]).

%% The reason why a text is not a number.
-type problem() :: not_a_number | out_of_range.

-define(MAX_VALUE, 1.0e9).
%% Above this mantissa further digits cannot change a float; they only move the point.
-define(MAX_MANTISSA, 100_000_000_000_000_000).
-define(MAX_EXPONENT, 9999).
-define(IS_DIGIT(C), C >= $0, C =< $9).
-define(IS_SPACE(C), C =:= $\s; C =:= $\t; C =:= $\n; C =:= $\r; C =:= $\f).

%% @doc The number at the start of the text, and the text after it.
-spec scan(binary()) -> {ok, float(), Rest :: binary()} | {error, problem()}.
scan(<<$-, Rest/binary>>) -> unsigned(Rest, -1.0);
scan(<<$+, Rest/binary>>) -> unsigned(Rest, 1.0);
scan(Text) -> unsigned(Text, 1.0).

%% @doc All numbers of a text that contains only numbers, separated by spaces, one comma or a sign.
-spec list(binary()) -> {ok, [float()]} | {error, problem()}.
list(Text) ->
    case skip_space(Text) of
        <<>> -> {ok, []};
        Rest -> list(Rest, [])
    end.

%% @doc A length in user units (CSS pixels, 96 to the inch); `Whole' is the length of 100%.
%% `em' and `ex' refer to the initial font of 16 px.
-spec length(binary(), Whole :: float()) -> {ok, float()} | {error, problem()}.
length(Text, Whole) ->
    case scan(skip_space(Text)) of
        {ok, Number, Rest} ->
            case unit(string:trim(Rest), Whole) of
                {ok, Unit} when abs(Number * Unit) =< ?MAX_VALUE -> {ok, Number * Unit};
                {ok, _} -> {error, out_of_range};
                error -> {error, not_a_number}
            end;
        {error, _} = Error ->
            Error
    end.

%% @doc The text without its leading white space.
-spec skip_space(binary()) -> binary().
skip_space(<<C, Rest/binary>>) when ?IS_SPACE(C) -> skip_space(Rest);
skip_space(Text) -> Text.

%% @doc The text without leading white space and at most one comma.
-spec skip_comma(binary()) -> binary().
skip_comma(Text) ->
    case skip_space(Text) of
        <<$,, Rest/binary>> -> skip_space(Rest);
        Rest -> Rest
    end.

%%% Internals

list(Text, Numbers) ->
    case scan(Text) of
        {ok, Number, Rest} ->
            case skip_space(Rest) of
                <<>> -> {ok, lists:reverse(Numbers, [Number])};
                Rest1 -> list(skip_comma(Rest1), [Number | Numbers])
            end;
        {error, _} = Error ->
            Error
    end.

unsigned(Text, Sign) ->
    case digits(Text, 0, 0, 0, 1) of
        {M, E, N, <<$., Rest/binary>>} -> fraction(digits(Rest, M, E, N, 0), Sign);
        {_, _, 0, _} -> {error, not_a_number};
        {M, E, _, Rest} -> exponent(Rest, M, E, Sign)
    end.

fraction({_, _, 0, _}, _Sign) -> {error, not_a_number};
fraction({M, E, _, Rest}, Sign) -> exponent(Rest, M, E, Sign).

%% Reads digits into mantissa M and decimal exponent E; Integer is 1 before the point, 0 after it.
digits(<<D, Rest/binary>>, M, E, N, Integer) when ?IS_DIGIT(D), M < ?MAX_MANTISSA ->
    digits(Rest, M * 10 + D - $0, E + Integer - 1, N + 1, Integer);
digits(<<D, Rest/binary>>, M, E, N, Integer) when ?IS_DIGIT(D) ->
    digits(Rest, M, E + Integer, N + 1, Integer);
digits(Rest, M, E, N, _Integer) ->
    {M, E, N, Rest}.

%% An `e' without digits after it is not an exponent but the start of a unit such as `em'.
exponent(<<X, S, D, Rest/binary>>, M, E, Sign) when
    (X =:= $e orelse X =:= $E) andalso (S =:= $- orelse S =:= $+), ?IS_DIGIT(D)
->
    {Exponent, After} = exponent_digits(Rest, D - $0),
    value(M, E + (44 - S) * Exponent, Sign, After);
exponent(<<X, D, Rest/binary>>, M, E, Sign) when (X =:= $e orelse X =:= $E), ?IS_DIGIT(D) ->
    {Exponent, After} = exponent_digits(Rest, D - $0),
    value(M, E + Exponent, Sign, After);
exponent(Rest, M, E, Sign) ->
    value(M, E, Sign, Rest).

exponent_digits(<<D, Rest/binary>>, N) when ?IS_DIGIT(D) ->
    exponent_digits(Rest, min(N * 10 + D - $0, ?MAX_EXPONENT));
exponent_digits(Rest, N) ->
    {N, Rest}.

value(0, _E, _Sign, Rest) -> {ok, 0.0, Rest};
value(_M, E, _Sign, _Rest) when E > 9 -> {error, out_of_range};
value(_M, E, _Sign, Rest) when E < -300 -> {ok, 0.0, Rest};
value(M, E, Sign, Rest) when E < 0 -> bounded(Sign * (M / math:pow(10.0, -E)), Rest);
value(M, E, Sign, Rest) -> bounded(Sign * M * math:pow(10.0, E), Rest).

bounded(Value, Rest) when abs(Value) =< ?MAX_VALUE -> {ok, Value, Rest};
bounded(_Value, _Rest) -> {error, out_of_range}.

unit(<<>>, _Whole) -> {ok, 1.0};
unit(<<"px">>, _Whole) -> {ok, 1.0};
unit(<<"%">>, Whole) -> {ok, Whole / 100.0};
unit(<<"mm">>, _Whole) -> {ok, 96.0 / 25.4};
unit(<<"cm">>, _Whole) -> {ok, 960.0 / 25.4};
unit(<<"in">>, _Whole) -> {ok, 96.0};
unit(<<"pt">>, _Whole) -> {ok, 96.0 / 72.0};
unit(<<"pc">>, _Whole) -> {ok, 16.0};
unit(<<"em">>, _Whole) -> {ok, 16.0};
unit(<<"ex">>, _Whole) -> {ok, 8.0};
unit(_, _Whole) -> error.
