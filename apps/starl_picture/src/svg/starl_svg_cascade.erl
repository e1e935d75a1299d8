%% @doc Resolves the styles of a document (CSS Cascading 4, section 6; SVG 2, section 6). Styles
%% come from the rules of its style sheets, and from the `style' attributes and presentation
%% attributes of its elements. A part of the SVG reader, {@link starl_svg}.
%%
%% The winning value of each property becomes the attribute of the property's name, so all later
%% steps read attributes only. Of two declarations the important one wins. Then the `style'
%% attribute wins, then the more specific selector, then the later declaration. A presentation
%% attribute loses against all. An element that a `use' repeats keeps the rules of its place in the
%% document.
-module(starl_svg_cascade).

-export([resolve/1]).

-type element_() :: starl_svg_xml:element_().
-type rank() :: {IsInline :: boolean(), tuple(), Order :: non_neg_integer()}.
-type filed() :: {
    starl_svg_selector:t(), [starl_svg_css:declaration()], Order :: non_neg_integer()
}.
-type index() :: #{starl_svg_selector:key() => [filed()]}.

%% The properties that matter here, as far as style sheets may set them.
-define(PROPERTIES, [
    <<"fill">>,
    <<"stroke">>,
    <<"color">>,
    <<"opacity">>,
    <<"fill-opacity">>,
    <<"fill-rule">>,
    <<"stroke-opacity">>,
    <<"stroke-width">>,
    <<"stroke-linecap">>,
    <<"display">>,
    <<"visibility">>,
    <<"transform">>,
    <<"transform-origin">>,
    <<"clip-path">>,
    <<"clip-rule">>,
    <<"mask">>,
    <<"overflow">>,
    <<"marker-start">>,
    <<"marker-mid">>,
    <<"marker-end">>,
    <<"x">>,
    <<"y">>,
    <<"width">>,
    <<"height">>,
    <<"cx">>,
    <<"cy">>,
    <<"r">>,
    <<"rx">>,
    <<"ry">>
]).

%% @doc The document with the values that its styles give.
-spec resolve(element_()) -> element_().
resolve(Root) ->
    Rules = lists:append([starl_svg_css:sheet(Sheet) || Sheet <- sheets(Root)]),
    resolve(Root, [], index(Rules)).

%%% Internals

sheets(Element) ->
    Own =
        case starl_svg_xml:name(Element) of
            <<"style">> -> [sheet(Element) || is_for_screens(Element)];
            _ -> []
        end,
    Own ++ lists:append([sheets(Child) || Child <- starl_svg_xml:children(Element)]).

sheet(Element) -> unicode:characters_to_binary(starl_svg_xml:text(Element)).

is_for_screens(Element) ->
    Type = starl_svg_xml:attribute(<<"type">>, Element, <<>>),
    (Type =:= <<>> orelse string:lowercase(Type) =:= <<"text/css">>) andalso
        starl_svg_css:applies_to_screens(starl_svg_xml:attribute(<<"media">>, Element, <<>>)).

-spec index([starl_svg_css:rule()]) -> index().
index(Rules) ->
    Numbered = lists:zip(lists:seq(1, length(Rules)), Rules),
    lists:foldl(
        fun({Key, Filed}, Index) ->
            maps:update_with(Key, fun(Others) -> [Filed | Others] end, [Filed], Index)
        end,
        #{},
        [
            {starl_svg_selector:key(Selector), {Selector, Declarations, Order}}
         || {Order, {Selectors, Declarations}} <- Numbered, Selector <- Selectors
        ]
    ).

resolve(Element, Ancestors, Index) ->
    {_, Id, Classes} = Node = node_of(Element),
    Path = [Node | Ancestors],
    Keys = [any, {type, element(1, Node)}, {id, Id} | [{class, Class} || Class <- Classes]],
    Matching = [
        {{false, starl_svg_selector:specificity(Selector), Order}, Declarations}
     || Key <- lists:usort(Keys),
        {Selector, Declarations, Order} <- maps:get(Key, Index, []),
        starl_svg_selector:matches(Selector, Path)
    ],
    Style = starl_svg_xml:attribute(<<"style">>, Element, <<>>),
    Inline = [{{true, {}, 0}, starl_svg_css:declarations(Style)} || Style =/= <<>>],
    Children = [resolve(Child, Path, Index) || Child <- starl_svg_xml:children(Element)],
    starl_svg_xml:update(winners(Matching ++ Inline), Children, Element).

node_of(Element) ->
    Classes = starl_svg_xml:attribute(<<"class">>, Element, <<>>),
    {
        starl_svg_xml:name(Element),
        starl_svg_xml:attribute(<<"id">>, Element, none),
        [Class || Class <- re:split(Classes, <<"\\s+">>), Class =/= <<>>]
    }.

-spec winners([{rank(), [starl_svg_css:declaration()]}]) -> #{binary() => binary()}.
winners(Ranked) ->
    All = [
        Declaration
     || {_, Declarations} <- lists:keysort(1, Ranked),
        {Name, Value, _} = Declaration <- Declarations,
        lists:member(Name, ?PROPERTIES),
        starl_svg_paint:is_valid(Name, Value)
    ],
    {Important, Normal} = lists:partition(fun({_, _, Important}) -> Important end, All),
    maps:from_list([{Name, Value} || {Name, Value, _} <- Normal ++ Important]).
