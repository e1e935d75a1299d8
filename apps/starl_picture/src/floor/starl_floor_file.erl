%% @doc Reads a floor plan from a file, or by its name if it ships with StarL. The ending says of
%% what form it is: `.map' of the MovingAI benchmarks ({@link starl_floor_map}), `.yaml' of an
%% occupancy grid of ROS ({@link starl_floor_ros}), `.svg' a drawing with a layer of walls
%% ({@link starl_floor_svg}); any other is StarL's own ({@link starl_floor_text}).
-module(starl_floor_file).

-export([read/1, read/2, shipped/0]).

-define(MOST_BYTES, 50000000).
%% The width of a cell of a MovingAI map, and of a unit of a drawing, unless it is given.
-define(CELL_MM, 1000).
-define(UNIT_MM, 1).

%% @doc Reads a plan.
-spec read(file:filename()) -> {ok, starl_floor:t()} | {error, unicode:chardata()}.
read(Name) -> read(Name, none).

%% @doc Reads a plan; `ScaleMm' is the width of a cell of a MovingAI map (usually 1000), or of a unit
%% of an SVG drawing (usually 1). An error is one line.
-spec read(file:filename(), ScaleMm :: number() | none) ->
    {ok, starl_floor:t()} | {error, unicode:chardata()}.
read(Name, Scale) ->
    File = file(Name),
    case bytes(File) of
        {ok, Bytes} -> named(File, parsed(filename:extension(File), Bytes, File, Scale));
        {error, Why} -> {error, [Name, ": ", Why, remedy(Name)]}
    end.

parsed(".map", Bytes, _File, none) ->
    starl_floor_map:parse(Bytes, ?CELL_MM);
parsed(".map", Bytes, _File, Scale) ->
    starl_floor_map:parse(Bytes, Scale);
parsed(".svg", Bytes, _File, none) ->
    starl_floor_svg:parse(Bytes, ?UNIT_MM);
parsed(".svg", Bytes, _File, Scale) ->
    starl_floor_svg:parse(Bytes, Scale);
parsed(".yaml", Bytes, File, _Scale) ->
    starl_floor_ros:parse(Bytes, filename:dirname(File));
parsed(Ending, Bytes, _File, _Scale) when Ending =:= ".pgm"; Ending =:= ".png" ->
    {error, {none, no_plan(Bytes)}};
parsed(_Own, Bytes, _File, _Scale) ->
    starl_floor_text:parse(Bytes).

no_plan(_Bytes) -> "this is only the image of a map: give its YAML file".

named(File, {ok, #{name := <<>>} = Floor}) ->
    {ok, Floor#{name := unicode:characters_to_binary(filename:basename(File))}};
named(_File, {ok, Floor}) ->
    {ok, Floor};
named(File, {error, {none, What}}) ->
    {error, [File, ": ", What]};
named(File, {error, {Line, What}}) ->
    {error, [File, io_lib:format(":~b: ", [Line]), What]}.

bytes(File) ->
    case filelib:is_dir(File) of
        true -> {error, "this is a directory"};
        false -> content(starl_small_file:read(File, ?MOST_BYTES))
    end.

content({ok, Bytes}) ->
    {ok, Bytes};
content({error, efbig}) ->
    {error, "this is too big for a floor plan"};
content({error, Posix}) ->
    {error, file:format_error(Posix)}.

%% A file of that name has priority over a plan that ships.
file(Name) ->
    Shipped = filename:join(dir(), Name ++ ".floor"),
    case is_word(Name) andalso filelib:is_regular(Shipped) andalso not filelib:is_regular(Name) of
        true -> Shipped;
        false -> Name
    end.

is_word(Name) -> filename:extension(Name) =:= "" andalso filename:basename(Name) =:= Name.

remedy(Name) ->
    Near = [Word || is_word(Name), Word <- starl_similar:words(Name, shipped())],
    starl_similar:meant(Near, ["; give a file, or one of ", lists:join(", ", shipped())]).

%% @doc The names of the plans that ship.
-spec shipped() -> [string()].
shipped() ->
    [
        filename:basename(F, ".floor")
     || F <- lists:sort(filelib:wildcard(filename:join(dir(), "*.floor")))
    ].

dir() -> filename:join(code:priv_dir(starl_picture), "floors").
