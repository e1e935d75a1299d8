%% @doc Finds the picture that the options of painting name: a file, or one of those that ship.
-module(starl_painting_picture).

-export([read/2, shipped/0, names/0]).

%% @doc Reads the picture, to fill the area, with the tolerance and the limit of the options.
-spec read(Area, #{atom() => term()}) -> {ok, starl_picture:t()} | {error, unicode:chardata()} when
    Area :: {number(), number(), number(), number()}.
read(Area, #{picture := Name, tolerance := Tolerance, segments := Max}) ->
    Options = #{area => Area, tolerance_mm => float(Tolerance), max_segments => Max},
    case starl_picture:read(file(Name), Options) of
        {ok, _} = Ok -> Ok;
        {error, Reason} -> {error, [starl_picture:format_error(Reason), remedy(Reason, Name)]}
    end.

%% @doc The pictures that ship: name and title.
-spec shipped() -> [{Name :: string(), Title :: string()}].
shipped() ->
    Files = filelib:wildcard(filename:join(dir(), "*.svg")),
    [{filename:basename(File, ".svg"), title(File)} || File <- lists:sort(Files)].

%% @doc The names of the pictures that ship, each with its title unless that is the name.
-spec names() -> string().
names() -> lists:append(lists:join(", ", [described(Each) || Each <- shipped()])).

%%% Internals

%% A shipped picture is named without its folder and ending. A file of that name has priority; a
%% directory of that name, such as the results of an earlier run, does not hide the picture.
file(Name) ->
    Shipped = filename:join(dir(), Name ++ ".svg"),
    IsShipped =
        is_word(Name) andalso filelib:is_regular(Shipped) andalso not filelib:is_regular(Name),
    case IsShipped of
        true -> Shipped;
        false -> Name
    end.

is_word(Name) -> filename:extension(Name) =:= "" andalso filename:basename(Name) =:= Name.

dir() -> filename:join(code:priv_dir(starl_apps), "pictures").

title(File) ->
    {ok, Bytes} = file:read_file(File),
    {match, [Title]} = re:run(Bytes, "<title>([^<]*)</title>", [{capture, [1], list}]),
    Title.

described({Name, Title}) ->
    case string:lowercase(Title) of
        Name -> Name;
        _ -> Name ++ " (" ++ Title ++ ")"
    end.

%% A word without a file may be meant for a picture that ships.
remedy({cannot_read, _, missing}, Name) ->
    Shipped = [Each || {Each, _} <- shipped()],
    case is_word(Name) andalso starl_options:similar(Name, Shipped) of
        [Near | _] -> [" (did you mean ", Near, "?)"];
        _ -> ["; give an SVG file, or one of ", lists:join(", ", Shipped)]
    end;
remedy(_Reason, _Name) ->
    [].
