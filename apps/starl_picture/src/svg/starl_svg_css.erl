%% @doc Reads CSS: style sheets and `style' attributes (CSS Syntax 3, in the form that drawing
%% programs write). A part of the SVG reader, {@link starl_svg}.
%%
%% A mistake costs its rule or its declaration, never the sheet, as in browsers. Rules of `@media'
%% count if they are for every screen; other at-rules are skipped, and nothing is imported.
-module(starl_svg_css).

-export([sheet/1, declarations/1, applies_to_screens/1]).
-export_type([rule/0, declaration/0]).

%% The name is in lower case; the value has no `!important'.
-type declaration() :: {Name :: binary(), Value :: binary(), Important :: boolean()}.
-type rule() :: {[starl_svg_selector:t()], [declaration()]}.

%% @doc The rules of a style sheet, in order.
-spec sheet(binary()) -> [rule()].
sheet(Text) -> rules(uncommented(Text), []).

%% @doc The declarations of a block or a `style' attribute, in order.
-spec declarations(binary()) -> [declaration()].
declarations(Text) -> declarations(uncommented(Text), []).

%% @doc Whether a list of media queries is fulfilled by a screen of any kind.
-spec applies_to_screens(binary()) -> boolean().
applies_to_screens(Query) ->
    Media = [string:lowercase(string:trim(M)) || M <- binary:split(Query, <<",">>, [global])],
    lists:any(fun is_screen/1, Media).

%%% Internals

is_screen(Medium) -> lists:member(Medium, [<<>>, <<"all">>, <<"screen">>, <<"only screen">>]).

%% Style sheets may be wrapped in XML's old comment marks, which CSS ignores.
uncommented(Text) ->
    Marked = binary:replace(Text, [<<"<!--">>, <<"-->">>], <<" ">>, [global]),
    iolist_to_binary(without_comments(Marked)).

without_comments(Text) ->
    case binary:split(Text, <<"/*">>) of
        [All] -> [All];
        [Before, Rest] -> [Before, $\s | after_comment(binary:split(Rest, <<"*/">>))]
    end.

after_comment([_Comment, Rest]) -> without_comments(Rest);
after_comment([_Open]) -> [].

rules(Text, Rules) ->
    case cut(Text, [${, $;]) of
        {_, none, _} ->
            lists:reverse(Rules);
        {_Statement, $;, Rest} ->
            rules(Rest, Rules);
        {Prelude, ${, Rest} ->
            {Block, _, After} = cut(Rest, [$}]),
            rules(After, lists:reverse(rule(string:trim(Prelude), Block), Rules))
    end.

rule(<<"@media", Query/binary>>, Block) ->
    case applies_to_screens(Query) of
        true -> rules(Block, []);
        false -> []
    end;
rule(<<"@", _/binary>>, _Block) ->
    [];
rule(Prelude, Block) ->
    case starl_svg_selector:parse(Prelude) of
        [] -> [];
        Selectors -> [{Selectors, declarations(Block, [])}]
    end.

declarations(Text, Done) ->
    {Part, End, Rest} = cut(Text, [$;]),
    Declarations = declaration(binary:split(Part, <<":">>)) ++ Done,
    case End of
        none -> lists:reverse(Declarations);
        $; -> declarations(Rest, Declarations)
    end.

declaration([Name, Value]) ->
    {Plain, Important} = importance(string:trim(Value)),
    [{string:lowercase(string:trim(Name)), Plain, Important}];
declaration([_]) ->
    [].

importance(Value) ->
    case
        re:run(Value, <<"^(.*?)\\s*!\\s*important$">>, [caseless, dotall, {capture, [1], binary}])
    of
        {match, [Plain]} -> {Plain, true};
        nomatch -> {Value, false}
    end.

%% The text before the first of the characters that stands outside of strings, brackets and escapes,
%% this character, and the text after it.
cut(Text, Ends) -> cut(Text, 0, [], Ends, Text).

%% `Open' are the brackets that close what is open, innermost first.
cut(<<$\\, _, Rest/binary>>, At, Open, Ends, Text) ->
    cut(Rest, At + 2, Open, Ends, Text);
cut(<<Quote, Rest/binary>>, At, Open, Ends, Text) when Quote =:= $"; Quote =:= $' ->
    Length = quoted(Rest, Quote, 0),
    <<_:Length/binary, After/binary>> = Rest,
    cut(After, At + 1 + Length, Open, Ends, Text);
cut(<<C, Rest/binary>>, At, Open, Ends, Text) ->
    case Open =:= [] andalso lists:member(C, Ends) of
        true -> {binary:part(Text, 0, At), C, Rest};
        false -> cut(Rest, At + 1, open(C, Open), Ends, Text)
    end;
cut(<<>>, _At, _Open, _Ends, Text) ->
    {Text, none, <<>>}.

%% The bytes up to and with the closing quote.
quoted(<<$\\, _, Rest/binary>>, Quote, N) -> quoted(Rest, Quote, N + 2);
quoted(<<Quote, _/binary>>, Quote, N) -> N + 1;
quoted(<<_, Rest/binary>>, Quote, N) -> quoted(Rest, Quote, N + 1);
quoted(<<>>, _Quote, N) -> N.

%% Braces in parentheses are text, as in url(...).
open(C, [C | Open]) -> Open;
open($(, Open) -> [$) | Open];
open($[, Open) -> [$] | Open];
open(${, [$) | _] = Open) -> Open;
open(${, Open) -> [$} | Open];
open(_C, Open) -> Open.
