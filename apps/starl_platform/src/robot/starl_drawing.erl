%% @doc Describes what an application draws on the floor, for people who watch its run (the paper's
%% extensible visualiser). A robot draws by `starl:draw/2', which traces `{draw, Drawing}'; the
%% window, the film and recordings show it.
%% ```
%%   #{key => goal, points => [{1000, 1000}]}                     dots
%%   #{key => way, line => [{0, 0}, {1000, 500}], colour => red}  a line through points
%%   #{key => {section, 3}, area => starl_drawing:circle({3000, 3000}, 500), seconds => 10}
%%   #{key => name, text => "leader", at => {500, 500}}
%%   #{key => way, line => []}                                    nothing in its place any more
%% '''
%% A new drawing replaces the robot's earlier drawing under the same key. A robot's restart changes
%% nothing. Lengths are millimetres.
-module(starl_drawing).

-export([new/1, circle/2, colours/0, shown/2]).

-export_type([t/0, shape/0, place/0, key/0, kind/0, colour/0, seen/0]).

-type key() :: atom() | {atom(), integer()}.

-type kind() :: points | line | area | text.

%% `own': the colour of the robot.
-type colour() :: own | red | orange | yellow | green | blue | purple | grey | black.

%% In millimetres.
-type place() :: {X :: number(), Y :: number()}.

%% What an application gives: a key, one of the four kinds, and, if it likes, the seconds after which it
%% goes (otherwise it stays) and its colour (its own). A text has a place, `at'.
-type shape() :: #{
    key := key(),
    points => [place()],
    line => [place()],
    area => [place()],
    text => unicode:chardata(),
    at => place(),
    seconds => number(),
    colour => colour()
}.

%% A drawing as it is traced. The points of a text are its place; no points: nothing is drawn.
-type t() :: #{
    key := key(),
    kind := kind(),
    points := [starl_geometry:point()],
    text := binary(),
    life_us := pos_integer() | infinity,
    colour := colour()
}.

%% A drawing of a robot, and from when to when it is seen.
-type seen() :: {
    FromUs :: integer(), ToUs :: integer() | infinity, starl:robot_id(), t()
}.

-define(COLOURS, [
    {own, "#303030"},
    {red, "#d62728"},
    {orange, "#ff7f0e"},
    {yellow, "#e6c229"},
    {green, "#2ca02c"},
    {blue, "#1f77b4"},
    {purple, "#9467bd"},
    {grey, "#8c8c8c"},
    {black, "#202020"}
]).
-define(MOST_POINTS, 1000).
-define(LONGEST_TEXT, 200).
-define(FARTHEST, 1.0e9).
-define(LONGEST_S, 1.0e9).
-define(CORNERS, 32).

%% @doc The drawing of a shape, or what is expected in its place.
-spec new(shape()) -> {ok, t()} | {error, Expected :: string()}.
new(#{key := Key} = Shape) ->
    Kinds = maps:to_list(maps:with([points, line, area, text], Shape)),
    Allowed = [key, points, line, area, text, at, seconds, colour],
    case {is_key(Key), Kinds, maps:keys(maps:without(Allowed, Shape))} of
        {false, _, _} -> {error, "a key that is an atom, or {Atom, Integer}"};
        {true, [{Kind, Given}], []} -> kind(Kind, Given, Shape);
        {true, _, []} -> {error, "one of points, line, area and text"};
        {true, _, Unknown} -> {error, lists:flatten(io_lib:format("no key ~0tp", [hd(Unknown)]))}
    end;
new(_) ->
    {error, "a map with a key, as in #{key => way, line => [{0, 0}, {1000, 500}]}"}.

is_key({Name, N}) -> is_atom(Name) andalso is_integer(N) andalso abs(N) =< ?FARTHEST;
is_key(Name) -> is_atom(Name).

kind(text, Given, #{at := At} = Shape) ->
    case {text(Given), points([At])} of
        {{ok, Text}, {ok, Points}} -> style(text, Points, Text, Shape);
        {error, _} -> {error, "a text of at most 200 characters"};
        {_, error} -> {error, "at => a point {X, Y}: two numbers, mm, within 1.0e9"}
    end;
kind(text, _Given, _Shape) ->
    {error, "a place for the text, as in at => {500, 500}"};
kind(Kind, Given, Shape) ->
    case points(Given) of
        {ok, Points} -> style(Kind, Points, <<>>, Shape);
        error -> {error, "a list of at most 1,000 points {X, Y}: numbers, mm, within 1.0e9"}
    end.

style(Kind, Points, Text, #{key := Key} = Shape) ->
    Colour = maps:get(colour, Shape, own),
    case {life(maps:get(seconds, Shape, infinity)), lists:keymember(Colour, 1, ?COLOURS)} of
        {error, _} ->
            {error, "seconds => a number greater than 0"};
        {_, false} ->
            Names = lists:join(", ", [atom_to_list(Name) || {Name, _} <- ?COLOURS]),
            {error, "colour => one of " ++ lists:append(Names)};
        {LifeUs, true} ->
            {ok, #{
                key => Key,
                kind => Kind,
                points => Points,
                text => Text,
                life_us => LifeUs,
                colour => Colour
            }}
    end.

life(infinity) -> infinity;
life(S) when is_number(S), S > 0, S =< ?LONGEST_S -> max(1, round(S * 1.0e6));
life(_) -> error.

text(Given) ->
    try unicode:characters_to_binary(Given) of
        Text when is_binary(Text) -> short(Text);
        _ -> error
    catch
        error:badarg -> error
    end.

short(Text) ->
    case string:length(Text) =< ?LONGEST_TEXT of
        true -> {ok, Text};
        false -> error
    end.

points(Given) when is_list(Given) -> points(Given, 0, []);
points(_) -> error.

points([], _N, Points) ->
    {ok, lists:reverse(Points)};
points([{X, Y} | Given], N, Points) when N < ?MOST_POINTS ->
    case is_coordinate(X) andalso is_coordinate(Y) of
        true -> points(Given, N + 1, [{X, Y} | Points]);
        false -> error
    end;
points(_, _N, _Points) ->
    error.

is_coordinate(X) -> is_number(X) andalso X =< ?FARTHEST andalso X >= -?FARTHEST.

%% @doc The outline of a circle, for an area or a line.
-spec circle(Centre :: place(), RadiusMm :: number()) -> [starl_geometry:point()].
circle({X, Y}, Radius) ->
    Turns = [2 * math:pi() * N / ?CORNERS || N <- lists:seq(0, ?CORNERS)],
    [{X + Radius * math:cos(Turn), Y + Radius * math:sin(Turn)} || Turn <- Turns].

%% @doc The colours, as in SVG; that of `own' stands for robots without one.
-spec colours() -> [{colour(), string()}].
colours() -> ?COLOURS.

%% @doc The drawings that are seen, with their times, from all that were traced in the order of time.
-spec shown([{AtUs :: integer(), starl:robot_id(), t()}], UntilUs :: integer()) -> [seen()].
shown(Traced, Until) ->
    {Latest, Earlier} = lists:foldl(fun replace/2, {#{}, []}, Traced),
    All = lists:reverse(Earlier) ++ [last(One) || One <- maps:values(Latest)],
    Seen = [
        {From, min(To, Until), Robot, Drawing}
     || {From, To, Robot, #{points := [_ | _]} = Drawing} <- All, From < To, From =< Until
    ],
    lists:sort(Seen).

replace({At, Robot, #{key := Key} = Drawing}, {Latest, Earlier}) ->
    Next = Latest#{{Robot, Key} => {At, Robot, Drawing}},
    case Latest of
        #{{Robot, Key} := Before} -> {Next, [until(At, last(Before)) | Earlier]};
        #{} -> {Next, Earlier}
    end.

last({At, Robot, #{life_us := infinity} = Drawing}) -> {At, infinity, Robot, Drawing};
last({At, Robot, #{life_us := Us} = Drawing}) -> {At, At + Us, Robot, Drawing}.

%% An atom is greater than every number.
until(At, {From, To, Robot, Drawing}) -> {From, min(At, To), Robot, Drawing}.
