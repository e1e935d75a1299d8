%% @doc Reads the values of `fill', `stroke' and `color' (SVG 2, section 13.2; CSS Color 4). A part
%% of the SVG reader, {@link starl_svg}.
%%
%% Only two properties of a colour matter: whether it can be seen, and whether it is the colour of
%% the page. So notations that need no table or arithmetic keep their text.
-module(starl_svg_colour).

-export([paint/1]).
-export_type([paint/0, colour/0]).

%% Components from 0 to 255; `clear' is transparent.
-type colour() :: clear | {rgb, integer(), integer(), integer()} | {text, binary()}.
%% `server': a gradient or pattern and the paint that stands in for it if it does not exist.
-type paint() :: none | current | colour() | {server, Id :: binary(), none | current | colour()}.

-define(FUNCTIONS, [
    <<"rgb">>,
    <<"rgba">>,
    <<"hsl">>,
    <<"hsla">>,
    <<"hwb">>,
    <<"lab">>,
    <<"lch">>,
    <<"oklab">>,
    <<"oklch">>,
    <<"color">>,
    <<"icc-color">>
]).

%% @doc The paint that a text means; `error' for what a browser ignores.
-spec paint(binary()) -> {ok, paint()} | error.
paint(Text) ->
    case string:lowercase(string:trim(Text)) of
        <<"none">> -> {ok, none};
        <<"context-", _/binary>> -> {ok, none};
        <<"currentcolor">> -> {ok, current};
        <<"url(", _/binary>> -> server(string:trim(Text));
        Lower -> colour(Lower)
    end.

%%% Internals

server(Text) ->
    Pattern = <<"^url\\(\\s*[\"']?\\s*#([^\"')\\s]*)\\s*[\"']?\\s*\\)\\s*(.*)$">>,
    case re:run(Text, Pattern, [caseless, {capture, [1, 2], binary}]) of
        {match, [Id, <<>>]} -> {ok, {server, Id, none}};
        {match, [Id, Fallback]} -> fallback(Id, paint(Fallback));
        nomatch -> {ok, none}
    end.

fallback(Id, {ok, Paint}) when not is_tuple(Paint); element(1, Paint) =/= server ->
    {ok, {server, Id, Paint}};
fallback(_Id, _) ->
    error.

colour(<<"#", Digits/binary>>) ->
    hex(Digits);
colour(<<"transparent">>) ->
    {ok, clear};
colour(<<"white">>) ->
    {ok, {rgb, 255, 255, 255}};
colour(<<"black">>) ->
    {ok, {rgb, 0, 0, 0}};
colour(Text) ->
    case
        re:run(Text, <<"^([a-z-]+)(?:\\(([^()]*)\\))?( icc-color\\(.*)?$">>, [
            {capture, [1, 2], binary}
        ])
    of
        {match, [_Name, <<>>]} ->
            {ok, {text, Text}};
        {match, [Name, Arguments]} ->
            function(lists:member(Name, ?FUNCTIONS), Name, Arguments, Text);
        nomatch ->
            icc(binary:split(Text, <<" icc-color(">>), Text)
    end.

%% A colour for the screen may be followed by one for printing.
icc([Screen, _], _Text) -> colour(Screen);
icc([_], _Text) -> error.

hex(<<R, G, B>>) -> hex(<<R, R, G, G, B, B>>);
hex(<<R, G, B, A>>) -> hex(<<R, R, G, G, B, B, A, A>>);
hex(<<Rgb:6/binary>>) -> hex(Rgb, 255);
hex(<<Rgb:6/binary, A:2/binary>>) -> hex(Rgb, hexadecimal(A));
hex(_) -> error.

hex(Rgb, Alpha) ->
    case hexadecimal(Rgb) of
        N when is_integer(N), Alpha =:= 0 -> {ok, clear};
        N when is_integer(N), is_integer(Alpha) ->
            {ok, {rgb, N bsr 16, (N bsr 8) band 255, N band 255}};
        _ ->
            error
    end.

hexadecimal(Text) ->
    case re:run(Text, <<"^[0-9a-f]+$">>) of
        {match, _} -> binary_to_integer(Text, 16);
        nomatch -> error
    end.

function(false, _Name, _Arguments, _Text) ->
    error;
function(true, Name, Arguments, Text) ->
    Numbers = re:split(string:trim(Arguments), <<"[\\s,/]+">>),
    case {alpha(Numbers), Name, [component(N) || N <- Numbers]} of
        {Alpha, _, _} when Alpha =< 0.0 -> {ok, clear};
        {_, <<"rgb", _/binary>>, [R, G, B | _]} when is_integer(R), is_integer(G), is_integer(B) ->
            {ok, {rgb, R, G, B}};
        {_, <<"rgb", _/binary>>, _} ->
            error;
        {_, _, _} ->
            {ok, {text, Text}}
    end.

%% The fourth number; without one a colour is opaque.
alpha([_, _, _, Alpha]) ->
    case starl_svg_number:length(Alpha, 1.0) of
        {ok, Number} -> Number;
        {error, _} -> 1.0
    end;
alpha(_) ->
    1.0.

component(Text) ->
    case starl_svg_number:length(Text, 255.0) of
        {ok, Number} -> max(0, min(255, round(Number)));
        {error, _} -> error
    end.
