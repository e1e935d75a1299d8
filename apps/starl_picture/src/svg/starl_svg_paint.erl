%% @doc Decides whether an element can be seen: the properties for which this matters, their
%% inheritance, and their effect (SVG 2, sections 13.2-13.5; CSS Color 4). A part of the SVG reader,
%% {@link starl_svg}.
-module(starl_svg_paint).

-export([initial/0, inherit/2, is_displayed/1, is_visible/1, stroke_width/1, has_dots/1]).
-export([seen/2, is_valid/2]).
-export_type([t/0, seen/0]).

-record(paint, {
    fill = {rgb, 0, 0, 0} :: starl_svg_colour:paint(),
    stroke = none :: starl_svg_colour:paint(),
    colour = {rgb, 0, 0, 0} :: starl_svg_colour:colour(),
    fill_opacity = 1.0 :: float(),
    stroke_opacity = 1.0 :: float(),
    stroke_width = 1.0 :: float(),
    %% Do the ends of a line reach beyond it?
    capped = false :: boolean(),
    visible = true :: boolean(),
    %% No group around the element is wholly transparent.
    opaque = true :: boolean()
}).
-opaque t() :: #paint{}.
%% The colours in which fill and stroke can be seen; `none' if they cannot.
-type seen() :: #{
    fill := none | starl_svg_colour:paint(), stroke := none | starl_svg_colour:paint()
}.

-define(WIDE, [<<"inherit">>, <<"initial">>, <<"unset">>, <<"revert">>]).
%% The properties of which this module keeps the value.
-define(PAINT, [
    <<"color">>,
    <<"fill">>,
    <<"stroke">>,
    <<"fill-opacity">>,
    <<"stroke-opacity">>,
    <<"stroke-width">>,
    <<"stroke-linecap">>,
    <<"visibility">>
]).
-define(CAPS, [<<"round">>, <<"square">>]).
-define(VISIBILITIES, [<<"visible">>, <<"hidden">>, <<"collapse">>]).

%% @doc What the root element inherits.
-spec initial() -> t().
initial() -> #paint{}.

%% @doc The properties of an element inside another one.
-spec inherit(starl_svg_xml:element_(), t()) -> t().
inherit(Element, #paint{opaque = Opaque} = Parent) ->
    Inherited = [
        {<<"color">>, #paint.colour},
        {<<"fill">>, #paint.fill},
        {<<"stroke">>, #paint.stroke},
        {<<"fill-opacity">>, #paint.fill_opacity},
        {<<"stroke-opacity">>, #paint.stroke_opacity},
        {<<"stroke-width">>, #paint.stroke_width},
        {<<"stroke-linecap">>, #paint.capped},
        {<<"visibility">>, #paint.visible}
    ],
    Paint = lists:foldl(fun(Each, Acc) -> property(Each, Element, Acc) end, Parent, Inherited),
    Paint#paint{opaque = Opaque andalso opacity(Element) > 0.0}.

%% @doc Whether an element and everything in it is displayed.
-spec is_displayed(starl_svg_xml:element_()) -> boolean().
is_displayed(Element) ->
    lowercase(starl_svg_xml:attribute(<<"display">>, Element, <<>>)) =/= <<"none">>.

%% @doc Whether an element of any colours can be seen.
-spec is_visible(t()) -> boolean().
is_visible(#paint{visible = Visible, opaque = Opaque}) -> Visible andalso Opaque.

%% @doc The width of a line in user units.
-spec stroke_width(t()) -> float().
stroke_width(#paint{stroke_width = Width}) -> Width.

%% @doc Whether a line without length is seen as a dot.
-spec has_dots(t()) -> boolean().
has_dots(#paint{capped = Capped}) -> Capped.

%% @doc The visible parts of a shape. `IsServer' says whether a gradient or pattern exists.
-spec seen(t(), IsServer :: fun((Id :: binary()) -> boolean())) -> seen().
seen(#paint{visible = Visible, opaque = Opaque} = Paint, IsServer) when Visible, Opaque ->
    #paint{colour = Colour, fill = Fill, stroke = Stroke} = Paint,
    #{
        fill => tinted(Fill, Paint#paint.fill_opacity, Colour, IsServer),
        stroke => tinted(
            Stroke, min(Paint#paint.stroke_opacity, Paint#paint.stroke_width), Colour, IsServer
        )
    };
seen(_Paint, _IsServer) ->
    #{fill => none, stroke => none}.

%% @doc Whether a browser accepts the value of a property; it ignores a declaration otherwise.
-spec is_valid(Property :: binary(), Value :: binary()) -> boolean().
is_valid(Property, Value) ->
    case lists:member(lowercase(Value), ?WIDE) of
        true -> lists:member(Property, ?PAINT);
        false -> value(Property, Value) =/= error
    end.

%%% Internals

property({Name, Field}, Element, Paint) ->
    case starl_svg_xml:attribute(Name, Element) of
        undefined -> Paint;
        Text -> set(lowercase(Text), {Name, Text}, Field, Paint)
    end.

%% Keywords of every property come before its own values; what is wrong is ignored.
set(<<"initial">>, _Property, Field, Paint) ->
    setelement(Field, Paint, element(Field, #paint{}));
set(Wide, {Name, Text}, Field, Paint) ->
    case not lists:member(Wide, ?WIDE) andalso value(Name, Text) of
        {ok, Value} -> setelement(Field, Paint, Value);
        _ -> Paint
    end.

value(Name, Text) ->
    case kinds() of
        #{Name := Kind} -> of_kind(Kind, Text);
        #{} -> of_kind(length, Text)
    end.

kinds() ->
    #{
        <<"fill">> => paint,
        <<"stroke">> => paint,
        <<"color">> => colour,
        <<"visibility">> => visibility,
        <<"transform">> => transform,
        <<"stroke-width">> => width,
        <<"stroke-linecap">> => cap,
        <<"opacity">> => part,
        <<"fill-opacity">> => part,
        <<"stroke-opacity">> => part,
        <<"display">> => text,
        <<"fill-rule">> => text,
        <<"clip-path">> => text,
        <<"clip-rule">> => text,
        <<"mask">> => text,
        <<"overflow">> => text,
        <<"transform-origin">> => text,
        <<"marker-start">> => text,
        <<"marker-mid">> => text,
        <<"marker-end">> => text
    }.

of_kind(paint, Text) ->
    starl_svg_colour:paint(Text);
of_kind(colour, Text) ->
    case starl_svg_colour:paint(Text) of
        {ok, Colour} when Colour =/= none, Colour =/= current -> {ok, Colour};
        _ -> error
    end;
of_kind(visibility, Text) ->
    keyword(lowercase(Text), ?VISIBILITIES, [<<"visible">>]);
of_kind(cap, Text) ->
    keyword(lowercase(Text), [<<"butt">> | ?CAPS], ?CAPS);
of_kind(transform, Text) ->
    ok_or_error(starl_svg_transform:parse(Text));
of_kind(width, Text) ->
    not_negative(starl_svg_number:length(Text, 100.0));
of_kind(part, Text) ->
    ok_or_error(starl_svg_number:length(Text, 1.0));
of_kind(text, Text) ->
    {ok, Text};
of_kind(length, <<"auto">>) ->
    {ok, <<"auto">>};
of_kind(length, Text) ->
    ok_or_error(starl_svg_number:length(Text, 100.0)).

keyword(Word, Words, Those) ->
    case lists:member(Word, Words) of
        true -> {ok, lists:member(Word, Those)};
        false -> error
    end.

not_negative({ok, Number}) when Number >= 0.0 -> {ok, Number};
not_negative(_) -> error.

ok_or_error({ok, Value}) -> {ok, Value};
ok_or_error({error, _}) -> error.

opacity(Element) ->
    case value(<<"opacity">>, starl_svg_xml:attribute(<<"opacity">>, Element, <<"1">>)) of
        {ok, Opacity} -> Opacity;
        error -> 1.0
    end.

tinted(_Paint, Opacity, _Colour, _IsServer) when Opacity =< 0.0 -> none;
tinted(none, _Opacity, _Colour, _IsServer) ->
    none;
tinted(clear, _Opacity, _Colour, _IsServer) ->
    none;
tinted(current, Opacity, Colour, IsServer) ->
    tinted(Colour, Opacity, Colour, IsServer);
tinted({server, Id, Otherwise}, Opacity, Colour, IsServer) ->
    case IsServer(Id) of
        true -> {server, Id, none};
        false -> tinted(Otherwise, Opacity, Colour, IsServer)
    end;
tinted(Paint, _Opacity, _Colour, _IsServer) ->
    Paint.

lowercase(Text) -> string:lowercase(string:trim(Text)).
