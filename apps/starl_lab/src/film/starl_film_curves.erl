%% @doc Draws the measures of applications as curves below a film. Each of the first measures gets a
%% strip with a line for each robot, above one time axis with the bar of the film. A pure module.
-module(starl_film_curves).

-export([new/0, add/5, curves/2, strips/3, mark/1]).

-export_type([t/0, curve/0]).

%% By robot, the latest value first.
-type values() :: #{starl:robot_id() => [starl_film_series:point(), ...]}.
-opaque t() :: #{Key :: atom() => values()}.

%% The values of each robot by time.
-type curve() :: {Key :: atom(), [{starl:robot_id(), [starl_film_series:point(), ...]}, ...]}.

%% The most strips; the height of the words above one, and of what is free beside its lines, in dots.
-define(MOST, 3).
-define(HEAD, 20).
-define(FREE, 4).
-define(TEXT, 13).

%% @doc Nothing has been measured.
-spec new() -> t().
new() -> #{}.

%% @doc One value more.
-spec add(AtUs :: integer(), starl:robot_id(), Key :: atom(), number(), t()) -> t().
add(At, Robot, Key, Value, Curves) ->
    Values = maps:get(Key, Curves, #{}),
    Curves#{Key => Values#{Robot => [{At, [float(Value)]} | maps:get(Robot, Values, [])]}}.

%% @doc The curves of the first measures by name, with times since the beginning.
-spec curves(BegunUs :: integer(), t()) -> [curve()].
curves(Begun, Curves) ->
    [
        {Key, [
            {Robot, since(Begun, Points)}
         || {Robot, Points} <- lists:sort(maps:to_list(Values))
        ]}
     || {Key, Values} <- lists:sublist(lists:sort(maps:to_list(Curves)), ?MOST)
    ].

since(Begun, Points) -> [{T - Begun, Value} || {T, Value} <- lists:reverse(Points)].

%% @doc The strips of a film that ends then.
-spec strips([curve()], EndUs :: integer(), starl_film_draw:page()) -> iolist().
strips(Curves, End, Page) ->
    [
        strip(N, Curve, max(1, End), Page)
     || {N, Curve} <- lists:enumerate(0, Curves)
    ].

strip(N, {Key, Lines}, End, #{width := Width, dot := Dot, strip := Strip} = Page) ->
    Top = top(N, Page),
    Range = range([V || {_, Points} <- Lines, {_, [V]} <- Points]),
    {Low, High} = Range,
    Text = io_lib:format("~ts: ~ts to ~ts", [Key, short(Low), short(High)]),
    [
        io_lib:format("<text x=\"~b\" y=\"~b\" font-size=\"~b\">~ts</text>\n", [
            round(12 * Dot), round(Top - 5 * Dot), round(?TEXT * Dot), Text
        ]),
        io_lib:format(
            "<rect class=\"e\" y=\"~b\" width=\"~b\" height=\"~b\" fill=\"#f6f6f6\"/>\n", [
                round(Top), Width, round(Strip - (?HEAD + ?FREE) * Dot)
            ]
        ),
        [line(Line, Top, Range, End, Page) || Line <- Lines]
    ].

%% The strips begin beneath the foot without them.
top(N, #{height := Height, foot := Foot, strips := Strips, strip := Strip, dot := Dot}) ->
    Height + Foot - (Strips - N) * Strip + ?HEAD * Dot.

range(Values) ->
    case {lists:min(Values), lists:max(Values)} of
        {Same, Same} -> {Same - 1, Same + 1};
        Range -> Range
    end.

short(Value) when trunc(Value) == Value -> integer_to_list(trunc(Value));
short(Value) when abs(Value) < 0.05 -> io_lib:format("~.2e", [Value]);
short(Value) -> starl_film_draw:number(Value).

line({Robot, Points}, Top, {Low, High}, End, #{width := Width, dot := Dot, strip := Strip}) ->
    Room = Strip - (?HEAD + 3 * ?FREE) * Dot,
    Place = fun({T, [V]}) ->
        {
            round(Width * max(0, min(T, End)) / End),
            round(Top + ?FREE * Dot + Room * (High - V) / (High - Low))
        }
    end,
    Seen = starl_film_series:thin((High - Low) * Dot / Room, Points),
    [
        [
            "<path class=\"i\" style=\"stroke-width:",
            starl_film_draw:number(1.5 * Dot),
            "\" stroke=\""
        ],
        [starl_film_draw:colour(Robot), "\" d=\""],
        [starl_film_draw:path([Place(Point) || Point <- Seen]), "\"/>\n"]
    ].

%% @doc The line that marks a moment, at the beginning of time.
-spec mark(starl_film_draw:page()) -> iolist().
mark(#{height := Height, foot := Foot, dot := Dot} = Page) ->
    io_lib:format("<path stroke=\"#888\" stroke-width=\"~b\" d=\"M0,~bV~b\"", [
        max(1, round(Dot)), round(top(0, Page)), round(Height + Foot)
    ]).
