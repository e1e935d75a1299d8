%% @doc Reads the part of an XML document before its root element: encoding, declaration, document
%% type (XML 1.0, sections 2.8 and 4.3.3). A part of the SVG reader, {@link starl_svg}.
%%
%% A document type may declare entities that are plain text ({@link starl_svg_entity}), as
%% Illustrator's do; they are expanded here. Nothing outside of the file is ever opened.
%%
%% The result is the document in UTF-8 with a plain declaration and a prolog of line feeds only,
%% which keep the line numbers equal to those of the file.
-module(starl_svg_prolog).

-export([read/1]).

-define(DECLARATION, <<"<?xml version=\"1.0\"?>">>).
-define(IS_SPACE(C), C =:= $\s; C =:= $\t; C =:= $\n; C =:= $\r).
-define(BOM, 16#FEFF).

%% @doc The document as UTF-8, without its prolog.
-spec read(binary()) -> {ok, binary()} | {error, starl_svg_xml:problem()}.
read(Bytes) ->
    case kind(Bytes) of
        xml -> decoded(decode(Bytes));
        empty -> {error, empty};
        Other -> {error, {not_xml, Other}}
    end.

%%% Internals

kind(<<16#89, "PNG", _/binary>>) -> png;
kind(<<16#FF, 16#D8, 16#FF, _/binary>>) -> jpeg;
kind(<<16#1F, 16#8B, _/binary>>) -> gzip;
kind(<<"%PDF", _/binary>>) -> pdf;
kind(<<C, Rest/binary>>) when ?IS_SPACE(C) -> kind(Rest);
kind(<<>>) -> empty;
kind(_) -> xml.

decode(Bytes) ->
    case unicode:bom_to_encoding(Bytes) of
        {latin1, 0} ->
            convert(Bytes, encoding(Bytes));
        {Encoding, Length} ->
            convert(
                binary:part(Bytes, Length, byte_size(Bytes) - Length),
                Encoding
            )
    end.

%% The encoding of a document without a byte order mark.
encoding(<<0, $<, _/binary>>) ->
    {utf16, big};
encoding(<<$<, 0, _/binary>>) ->
    {utf16, little};
encoding(Bytes) ->
    Head = binary:part(Bytes, 0, min(256, byte_size(Bytes))),
    Pattern = <<"^\\s*<\\?xml[^>]*\\sencoding\\s*=\\s*[\"']([A-Za-z0-9._-]{1,40})">>,
    case re:run(Head, Pattern, [{capture, all_but_first, list}]) of
        {match, [Name]} -> named(string:lowercase(Name));
        nomatch -> utf8
    end.

named("utf-8") -> utf8;
named("utf8") -> utf8;
named("us-ascii") -> utf8;
named("ascii") -> utf8;
named("iso-8859-1") -> latin1;
named("latin1") -> latin1;
named("windows-1252") -> latin1;
named(Name) -> {unknown, Name}.

convert(_Bytes, {unknown, Name}) ->
    {error, {bad_encoding, Name}};
convert(Bytes, Encoding) ->
    case unicode:characters_to_binary(Bytes, Encoding, utf8) of
        Text when is_binary(Text) -> {ok, Text};
        {_Problem, _Before, _Rest} -> {error, {bad_encoding, label(Encoding)}}
    end.

label({utf16, _}) -> "utf-16";
label({utf32, _}) -> "utf-32";
label(Name) -> atom_to_list(Name).

decoded({error, _} = Error) ->
    Error;
decoded({ok, Text}) ->
    prolog(Text, starl_svg_entity:none(), Text).

prolog(<<C, Rest/binary>>, Entities, Text) when ?IS_SPACE(C) -> prolog(Rest, Entities, Text);
prolog(<<?BOM/utf8, Rest/binary>>, Entities, Text) ->
    prolog(Rest, Entities, Text);
prolog(<<"<?", Rest/binary>>, Entities, Text) ->
    past(<<"?>">>, Rest, Entities, Text);
prolog(<<"<!--", Rest/binary>>, Entities, Text) ->
    past(<<"-->">>, Rest, Entities, Text);
prolog(<<"<!DOCTYPE", Rest/binary>>, Entities, Text) ->
    doctype(Rest, Entities, Text);
prolog(<<"<", _/binary>> = Root, Entities, Text) ->
    Line = line(Root, Text),
    case starl_svg_entity:expand(Root, Entities) of
        {ok, Expanded} -> body(Expanded, Line);
        {error, Problem} -> {error, {Problem, Line}}
    end;
prolog(<<>>, _Entities, Text) ->
    {error, {truncated, 1 + lines(Text)}};
prolog(_, _Entities, _Text) ->
    {error, {not_xml, unknown}}.

%% A character reference with very many digits would cost quadratic time.
body(Root, Line) ->
    case re:run(Root, <<"&#x?[0-9a-fA-F]{10}">>) of
        {match, [{At, _}]} ->
            Lines = lines(binary:part(Root, 0, At)),
            {error, {bad_xml, Line + Lines, "a character reference is too long"}};
        nomatch ->
            {ok, <<?DECLARATION/binary, (binary:copy(<<"\n">>, Line - 1))/binary, Root/binary>>}
    end.

past(End, Rest, Entities, Text) ->
    case binary:split(Rest, End) of
        [_, After] -> prolog(After, Entities, Text);
        [_] -> {error, {truncated, 1 + lines(Text)}}
    end.

doctype(<<$>, Rest/binary>>, Entities, Text) ->
    prolog(Rest, Entities, Text);
doctype(<<$", Rest/binary>>, Entities, Text) ->
    quoted(<<"\"">>, Rest, Entities, Text);
doctype(<<$', Rest/binary>>, Entities, Text) ->
    quoted(<<"'">>, Rest, Entities, Text);
doctype(<<$[, Rest/binary>>, Entities, Text) ->
    case starl_svg_entity:declared(Rest, Entities) of
        {ok, More, After} -> doctype(After, More, Text);
        {error, truncated, _Place} -> {error, {truncated, 1 + lines(Text)}};
        {error, Problem, Place} -> {error, {Problem, line(Place, Text)}}
    end;
doctype(<<_, Rest/binary>>, Entities, Text) ->
    doctype(Rest, Entities, Text);
doctype(<<>>, _Entities, Text) ->
    {error, {truncated, 1 + lines(Text)}}.

quoted(Quote, Rest, Entities, Text) ->
    case binary:split(Rest, Quote) of
        [_, After] -> doctype(After, Entities, Text);
        [_] -> {error, {truncated, 1 + lines(Text)}}
    end.

%% The line on which a rest of the text begins.
line(Rest, Text) -> 1 + lines(binary:part(Text, 0, byte_size(Text) - byte_size(Rest))).

lines(Text) -> length(binary:matches(Text, <<"\n">>)).
