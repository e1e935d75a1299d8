%% @doc Reads the entities that a document declares itself, and puts their text where the document
%% refers to them (XML 1.0, sections 2.8, 4.2 and 4.4). A part of the SVG reader, {@link starl_svg}.
%%
%% An entity may use those declared before it, so none can contain itself. Its text is bounded when
%% it is declared, and all inserted text together when the document is expanded: ten entities of ten
%% references each do not become ten thousand million texts. An entity outside of the file and a
%% parameter entity are refused where they are declared. Other declarations are skipped.
-module(starl_svg_entity).

-export([none/0, declared/2, expand/2]).
-export_type([t/0, problem/0]).

-opaque t() :: #{Name :: binary() => Text :: binary()}.
%% `entities': one that is not plain text; `entities_too_big': too much text.
-type problem() :: entities | entities_too_big.

%% Bytes of the text of one entity, and of all text inserted into a document; Illustrator's have 30.
-define(MAX_ENTITY, 10_000).
-define(MAX_INSERTED, 1_000_000).
%% Those of XML itself, which the parser knows.
-define(PREDEFINED, [<<"amp">>, <<"lt">>, <<"gt">>, <<"quot">>, <<"apos">>]).
-define(NAME, "[^\\s&;<>%#\"'=/!?\\[\\]][^\\s&;<>%\"'=/!?\\[\\]]*").
-define(IS_SPACE(C), C =:= $\s; C =:= $\t; C =:= $\n; C =:= $\r).

%% @doc No entities.
-spec none() -> t().
none() -> #{}.

%% @doc Reads the declarations after `[', and gives the text after `]'. An error comes with the text
%% at its place.
-spec declared(binary(), t()) ->
    {ok, t(), Rest :: binary()} | {error, truncated | problem(), Place :: binary()}.
declared(<<"]", Rest/binary>>, Entities) ->
    {ok, Entities, Rest};
declared(<<C, Rest/binary>>, Entities) when ?IS_SPACE(C) ->
    declared(Rest, Entities);
declared(<<"<!--", Rest/binary>> = Text, Entities) ->
    past(<<"-->">>, Rest, Text, Entities);
declared(<<"<?", Rest/binary>> = Text, Entities) ->
    past(<<"?>">>, Rest, Text, Entities);
declared(<<"<!ENTITY", Rest/binary>> = Text, Entities) ->
    entity(declaration(Rest), Text, Entities);
declared(<<"<!", Rest/binary>> = Text, Entities) ->
    skipped(Rest, Text, Entities);
declared(<<>>, _Entities) ->
    {error, truncated, <<>>};
declared(Text, _Entities) ->
    {error, entities, Text}.

%% @doc The document with the text of the entities; references to others stay for the parser.
-spec expand(binary(), t()) -> {ok, binary()} | {error, problem()}.
expand(Document, Entities) when Entities =:= #{} -> {ok, Document};
expand(Document, Entities) -> inserted(Document, Entities, ?MAX_INSERTED).

%%% Internals

past(End, Rest, Text, Entities) ->
    case binary:split(Rest, End) of
        [_, After] -> declared(After, Entities);
        [_] -> {error, truncated, Text}
    end.

declaration(Text) ->
    Pattern = <<"^\\s+(" ?NAME ")\\s+(?:\"([^\"]*)\"|'([^']*)')\\s*>">>,
    case re:run(Text, Pattern, [{capture, [0, 1, 2, 3]}]) of
        {match, [{0, Length}, Name, {Start, _} = Double | _]} when
            Start >= 0, element(2, Double) > 0
        ->
            {ok, part(Text, Name), part(Text, Double), after_(Text, Length)};
        {match, [{0, Length}, Name, _, Single]} ->
            {ok, part(Text, Name), part(Text, Single), after_(Text, Length)};
        nomatch ->
            error
    end.

part(_Text, {-1, _}) -> <<>>;
part(Text, Part) -> binary:part(Text, Part).

after_(Text, Length) -> binary:part(Text, Length, byte_size(Text) - Length).

entity(error, Text, _Entities) ->
    case re:run(Text, <<">">>) of
        {match, _} -> {error, entities, Text};
        nomatch -> {error, truncated, Text}
    end;
entity({ok, Name, _Value, Rest}, _Text, Entities) when is_map_key(Name, Entities) ->
    %% The first declaration counts.
    declared(Rest, Entities);
entity({ok, Name, Value, Rest}, Text, Entities) ->
    %% Without line feeds the lines of the document keep their numbers.
    Line = binary:replace(Value, [<<"\n">>, <<"\r">>], <<" ">>, [global]),
    case {lists:member(Name, ?PREDEFINED), inserted(Line, Entities, ?MAX_ENTITY)} of
        {true, _} ->
            declared(Rest, Entities);
        {false, {ok, Whole}} when byte_size(Whole) =< ?MAX_ENTITY ->
            declared(Rest, Entities#{Name => Whole});
        {false, _} ->
            {error, entities_too_big, Text}
    end.

%% Declarations of elements, attributes and notations; `>' may stand in quotes.
skipped(Rest, Text, Entities) ->
    case re:run(Rest, <<"^(?:ELEMENT|ATTLIST|NOTATION)\\s(?:[^\"'>]|\"[^\"]*\"|'[^']*')*+>">>) of
        {match, [{0, Length}]} -> declared(after_(Rest, Length), Entities);
        nomatch -> {error, entities, Text}
    end.

%% Comments and sections of literal text have no references.
inserted(Text, Entities, Left) -> inserted(Text, Entities, Left, []).

inserted(_Text, _Entities, Left, _Done) when Left < 0 ->
    {error, entities_too_big};
inserted(Text, Entities, Left, Done) ->
    case binary:match(Text, [<<"&">>, <<"<!--">>, <<"<![CDATA[">>]) of
        nomatch ->
            {ok, iolist_to_binary(lists:reverse(Done, [Text]))};
        {At, Length} ->
            <<Before:At/binary, Mark:Length/binary, Rest/binary>> = Text,
            marked(Mark, Rest, Entities, Left, [Before | Done])
    end.

marked(<<"&">>, Rest, Entities, Left, Done) ->
    case re:run(Rest, <<"^(" ?NAME ");">>, [{capture, [1], binary}]) of
        {match, [Name]} when is_map_key(Name, Entities) ->
            Value = map_get(Name, Entities),
            After = after_(Rest, byte_size(Name) + 1),
            inserted(After, Entities, Left - byte_size(Value), [Value | Done]);
        _ ->
            inserted(Rest, Entities, Left, [<<"&">> | Done])
    end;
marked(Mark, Rest, Entities, Left, Done) ->
    End = closing(Mark),
    case binary:split(Rest, End) of
        [Literal, After] -> inserted(After, Entities, Left, [End, Literal, Mark | Done]);
        [_] -> inserted(<<>>, Entities, Left, [Rest, Mark | Done])
    end.

closing(<<"<!--">>) -> <<"-->">>;
closing(<<"<![CDATA[">>) -> <<"]]>">>.
