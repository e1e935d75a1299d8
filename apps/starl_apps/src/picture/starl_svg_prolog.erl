%% @doc Reads the part of an XML document before its root element: encoding, declaration, document
%% type (XML 1.0, sections 2.8 and 4.3.3). A part of the SVG reader, {@link starl_svg}.
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
    %% A character reference with very many digits would cost quadratic time.
    case re:run(Text, <<"&#x?[0-9a-fA-F]{10}">>) of
        {match, [{At, _}]} ->
            Line = 1 + lines(binary:part(Text, 0, At)),
            {error, {bad_xml, Line, "a character reference is too long"}};
        nomatch ->
            prolog(Text, Text)
    end.

prolog(<<C, Rest/binary>>, Text) when ?IS_SPACE(C) -> prolog(Rest, Text);
prolog(<<?BOM/utf8, Rest/binary>>, Text) ->
    prolog(Rest, Text);
prolog(<<"<?", Rest/binary>>, Text) ->
    past(<<"?>">>, Rest, Text);
prolog(<<"<!--", Rest/binary>>, Text) ->
    past(<<"-->">>, Rest, Text);
prolog(<<"<!DOCTYPE", Rest/binary>>, Text) ->
    doctype(Rest, Text);
prolog(<<"<", _/binary>> = Root, Text) ->
    Before = binary:part(Text, 0, byte_size(Text) - byte_size(Root)),
    {ok, <<?DECLARATION/binary, (binary:copy(<<"\n">>, lines(Before)))/binary, Root/binary>>};
prolog(<<>>, Text) ->
    {error, {truncated, 1 + lines(Text)}};
prolog(_, _Text) ->
    {error, {not_xml, unknown}}.

past(End, Rest, Text) ->
    case binary:split(Rest, End) of
        [_, After] -> prolog(After, Text);
        [_] -> {error, {truncated, 1 + lines(Text)}}
    end.

doctype(<<$>, Rest/binary>>, Text) ->
    prolog(Rest, Text);
doctype(<<$", Rest/binary>>, Text) ->
    quoted(<<"\"">>, Rest, Text);
doctype(<<$', Rest/binary>>, Text) ->
    quoted(<<"'">>, Rest, Text);
doctype(<<$[, _/binary>> = Rest, Text) ->
    Before = binary:part(Text, 0, byte_size(Text) - byte_size(Rest)),
    {error, {entities, 1 + lines(Before)}};
doctype(<<_, Rest/binary>>, Text) ->
    doctype(Rest, Text);
doctype(<<>>, Text) ->
    {error, {truncated, 1 + lines(Text)}}.

quoted(Quote, Rest, Text) ->
    case binary:split(Rest, Quote) of
        [_, After] -> doctype(After, Text);
        [_] -> {error, {truncated, 1 + lines(Text)}}
    end.

lines(Text) -> length(binary:matches(Text, <<"\n">>)).
