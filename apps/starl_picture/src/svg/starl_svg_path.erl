%% @doc Parses path data (SVG 1.1, section 8.3) into commands. A part of the SVG reader,
%% {@link starl_svg}.
%%
%% Every repetition becomes a separate command, and the pairs after a moveto become linetos, so the
%% result contains no short forms. A browser draws a path up to the first mistake; here any mistake
%% is an error, because robots must not paint half a picture.
-module(starl_svg_path).

-export([parse/2]).
-export_type([command/0, problem/0]).

%% The letter as written (small letters are relative) and its numbers; the two flags of an arc
%% are 0.0 or 1.0.
-type command() :: {Letter :: char(), [float()]}.
%% The mistake at the offset reported with it.
-type problem() ::
    expected_moveto | expected_command | expected_number | expected_flag | out_of_range.

-define(IS_NUMBER_START(C), (C >= $0 andalso C =< $9); C =:= $-; C =:= $+; C =:= $.).

%% @doc The commands of a path, at most `Max'; an error comes with the byte offset in the text.
-spec parse(binary(), Max :: non_neg_integer()) ->
    {ok, [command()]} | {error, {Offset :: non_neg_integer(), problem()}} | {error, too_many}.
parse(Text, Max) ->
    case starl_svg_number:skip_space(Text) of
        <<"none">> -> {ok, []};
        Commands -> result(commands(Commands, [], Max), byte_size(Text))
    end.

%%% Internals. Errors carry the rest of the text, from which the offset follows.

result({ok, Commands}, _Size) -> {ok, lists:reverse(Commands)};
result({error, too_many}, _Size) -> {error, too_many};
result({error, Problem, Rest}, Size) -> {error, {Size - byte_size(Rest), Problem}}.

commands(_Text, _Done, Max) when Max < 0 ->
    {error, too_many};
commands(<<>>, Done, _Max) ->
    {ok, Done};
commands(<<Letter, _/binary>> = Text, [], _Max) when Letter =/= $M, Letter =/= $m ->
    {error, expected_moveto, Text};
commands(<<Letter, Rest/binary>> = Text, Done, Max) ->
    case arguments(Letter) of
        unknown -> {error, expected_command, Text};
        [] -> commands(starl_svg_number:skip_space(Rest), [{Letter, []} | Done], Max - 1);
        Kinds -> groups(starl_svg_number:skip_space(Rest), Letter, Kinds, Done, Max)
    end.

%% One or more groups of arguments for the same letter.
groups(_Text, _Letter, _Kinds, _Done, Max) when Max =< 0 ->
    {error, too_many};
groups(Text, Letter, Kinds, Done, Max) ->
    case group(Kinds, Text, []) of
        {ok, Numbers, Rest} ->
            Done1 = [{Letter, Numbers} | Done],
            case starl_svg_number:skip_space(Rest) of
                <<$,, Rest1/binary>> ->
                    Next = starl_svg_number:skip_space(Rest1),
                    groups(Next, repeated(Letter), Kinds, Done1, Max - 1);
                <<C, _/binary>> = Rest1 when ?IS_NUMBER_START(C) ->
                    groups(Rest1, repeated(Letter), Kinds, Done1, Max - 1);
                Rest1 ->
                    commands(Rest1, Done1, Max - 1)
            end;
        {error, _, _} = Error ->
            Error
    end.

group([Kind | Kinds], Text, Numbers) ->
    case argument(Kind, Text) of
        {ok, Number, Rest} when Kinds =:= [] -> {ok, lists:reverse(Numbers, [Number]), Rest};
        {ok, Number, Rest} -> group(Kinds, starl_svg_number:skip_comma(Rest), [Number | Numbers]);
        {error, Problem} -> {error, Problem, Text}
    end.

%% Flags are single characters and need no separator: `a1 1 0 01.5.5'.
argument(flag, <<$0, Rest/binary>>) ->
    {ok, 0.0, Rest};
argument(flag, <<$1, Rest/binary>>) ->
    {ok, 1.0, Rest};
argument(flag, _) ->
    {error, expected_flag};
argument(number, Text) ->
    case starl_svg_number:scan(Text) of
        {ok, Number, Rest} -> {ok, Number, Rest};
        {error, not_a_number} -> {error, expected_number};
        {error, out_of_range} -> {error, out_of_range}
    end.

repeated($M) -> $L;
repeated($m) -> $l;
repeated(Letter) -> Letter.

arguments(C) when C =:= $Z; C =:= $z -> [];
arguments(C) when C =:= $H; C =:= $h; C =:= $V; C =:= $v -> [number];
arguments(C) when C =:= $M; C =:= $m; C =:= $L; C =:= $l; C =:= $T; C =:= $t -> [number, number];
arguments(C) when C =:= $S; C =:= $s; C =:= $Q; C =:= $q -> [number, number, number, number];
arguments(C) when C =:= $C; C =:= $c -> [number, number, number, number, number, number];
arguments(C) when C =:= $A; C =:= $a -> [number, number, number, flag, flag, number, number];
arguments(_) -> unknown.
