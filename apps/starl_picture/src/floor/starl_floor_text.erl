%% @doc Reads a floor plan of StarL's own form: lines of words, and a drawing in characters.
%% ```
%%   name Two rooms            % what follows a per cent sign is a remark
%%   scale 250                 % a character is 250 mm wide and high
%%   room kitchen = k
%%   place dock = d
%%   drawing
%%   ##########
%%   #   #    #
%%   # k + d  #
%%   #   #    #
%%   ##########
%% '''
%% In the drawing `#' is a wall, `+' a door, a blank or a dot free floor. A letter marks a place, or
%% the room around it, up to walls and doors; one without a line of its own is a place of that name.
%% The first line of the drawing is the top of the floor; the lower left corner is the origin.
%% Measures in millimetres may be given instead of a drawing, or beside it:
%% ```
%%   size 12330 8550           % only without a drawing
%%   wall 0 0 7910 120         % a block, from corner to corner
%%   line 0 500 900 500        % a wall without thickness
%%   outline 0 0 900 0 0 900   % a wall of any shape, counter-clockwise
%%   room A 120 120 3600 120 3600 3230
%%   door 2400 3350 3210 3350
%%   place A 2800 3230
%% '''
-module(starl_floor_text).

-export([parse/1, name/1]).

-export_type([problem/0]).

%% What is wrong, on which line.
-type problem() :: {Line :: pos_integer() | none, unicode:chardata()}.

-record(plan, {
    name = <<>> :: binary(),
    size = none :: {number(), number()} | none,
    scale = none :: number() | none,
    walls = [] :: [starl_floor:polygon()],
    rooms = #{} :: #{atom() => starl_floor:polygon()},
    doors = [] :: [starl_geometry:segment()],
    places = #{} :: #{atom() => starl_geometry:point()},
    %% what letters of the drawing stand for
    letters = #{} :: #{char() => {room | place, atom()}}
}).

%% A drawing has at most so many characters in a line, and lines; a plan so many names, since each
%% becomes an atom.
-define(MOST_CELLS, 4000).
-define(MOST_NAMES, 1000).
-define(FARTHEST_MM, 10000000).

%% @doc The floor plan of a text.
-spec parse(binary()) -> {ok, starl_floor:t()} | {error, problem()}.
parse(Bytes) ->
    case unicode:characters_to_list(Bytes) of
        Text when is_list(Text) ->
            Lines = string:split(string:replace(Text, "\r\n", "\n", all), "\n", all),
            try
                {ok, starl_floor:new(plan(lists:enumerate(1, [lists:flatten(L) || L <- Lines])))}
            catch
                throw:{?MODULE, Problem} -> {error, Problem}
            end;
        _ ->
            {error, {none, "this is no text in UTF-8"}}
    end.

-spec fail(pos_integer() | none, io:format(), [term()]) -> no_return().
fail(Line, Format, Args) -> throw({?MODULE, {Line, io_lib:format(Format, Args)}}).

plan(Lines) -> lines(Lines, #plan{}).

lines([], #plan{size = none}) ->
    fail(none, "there is neither a size nor a drawing", []);
lines([], Plan) ->
    whole(Plan);
lines([{N, Line} | Lines], Plan) ->
    case string:lexemes(hd(string:split(Line, "%")), " \t") of
        [] -> lines(Lines, Plan);
        ["drawing"] -> drawing(N, Lines, Plan);
        ["name" | Words] -> lines(Lines, Plan#plan{name = title(Words)});
        [Word | Words] -> lines(Lines, statement(Word, Words, N, Plan))
    end.

title(Words) -> unicode:characters_to_binary(lists:join(" ", Words)).

whole(#plan{size = Size} = Plan) ->
    #{
        name => Plan#plan.name,
        size => Size,
        walls => lists:reverse(Plan#plan.walls),
        rooms => Plan#plan.rooms,
        doors => lists:reverse(Plan#plan.doors),
        places => Plan#plan.places
    }.

statement("scale", Words, N, Plan) ->
    [Scale] = numbers(1, "scale", Words, N),
    Plan#plan{scale = positive(Scale, N)};
statement("size", Words, N, Plan) ->
    [W, H] = numbers(2, "size", Words, N),
    Plan#plan{size = {positive(W, N), positive(H, N)}};
statement("wall", Words, N, #plan{walls = Walls} = Plan) ->
    [X0, Y0, X1, Y1] = numbers(4, "wall", Words, N),
    X0 =/= X1 andalso Y0 =/= Y1 orelse
        fail(N, "a wall has two different corners; line is thin", []),
    Box = starl_floor:box(min(X0, X1), min(Y0, Y1), max(X0, X1), max(Y0, Y1)),
    Plan#plan{walls = [Box | Walls]};
statement("line", Words, N, #plan{walls = Walls} = Plan) ->
    Plan#plan{walls = [points(numbers(4, "line", Words, N)) | Walls]};
statement("outline", Words, N, #plan{walls = Walls} = Plan) ->
    Plan#plan{walls = [polygon("outline", Words, N) | Walls]};
statement("door", Words, N, #plan{doors = Doors} = Plan) ->
    [A, B] = points(numbers(4, "door", Words, N)),
    Plan#plan{doors = [{A, B} | Doors]};
statement(Kind, Words, N, Plan) when (Kind =:= "room" orelse Kind =:= "place"), Words =/= [] ->
    name_given(Kind, Words, N, Plan);
statement(Word, _Words, N, _Plan) ->
    Known = "name, scale, size, wall, line, outline, door, room, place, drawing",
    fail(N, "a line begins with one of ~ts, not with ~ts", [Known, Word]).

name_given(Kind, [Name, "=", [Letter]], N, #plan{letters = Letters} = Plan) ->
    lists:member(Letter, "#+. ") andalso
        fail(N, "the character ~tc cannot stand for a name", [Letter]),
    is_map_key(Letter, Letters) andalso fail(N, "the letter ~tc has a name already", [Letter]),
    named(Plan#plan{letters = Letters#{Letter => {list_to_existing_atom(Kind), name(Name, N)}}}, N);
name_given("room", [Name | Words], N, #plan{rooms = Rooms} = Plan) ->
    named(Plan#plan{rooms = Rooms#{name(Name, N) => polygon("room", Words, N)}}, N);
name_given("place", [Name | Words], N, #plan{places = Places} = Plan) ->
    [Place] = points(numbers(2, "place", Words, N)),
    named(Plan#plan{places = Places#{name(Name, N) => Place}}, N).

named(#plan{rooms = Rooms, places = Places, letters = Letters} = Plan, N) ->
    map_size(Rooms) + map_size(Places) + map_size(Letters) =< ?MOST_NAMES orelse
        fail(N, "a plan has at most ~b names", [?MOST_NAMES]),
    Plan.

name(Text, N) ->
    case name(Text) of
        {ok, Name} -> Name;
        {error, What} -> fail(N, "~ts", [What])
    end.

%% @doc The name of a room or place, of bounded length; who asks bounds their number.
-spec name(string()) -> {ok, atom()} | {error, unicode:chardata()}.
name(Text) ->
    case re:run(Text, "^[\\pL\\d][\\pL\\d_-]{0,39}$", [unicode, {capture, none}, dollar_endonly]) of
        match -> {ok, list_to_atom(Text)};
        nomatch -> {error, ["a name has letters, digits, _ or -, at most 40; not ", Text]}
    end.

numbers(Count, What, Words, N) when length(Words) =:= Count ->
    [number(Word, What, N) || Word <- Words];
numbers(Count, What, Words, N) ->
    fail(N, "~ts needs ~b numbers, mm; there are ~b", [What, Count, length(Words)]).

number(Word, What, N) ->
    case {string:to_float(Word), string:to_integer(Word)} of
        {{Mm, []}, _} when abs(Mm) =< ?FARTHEST_MM -> Mm;
        {_, {Mm, []}} when is_integer(Mm), abs(Mm) =< ?FARTHEST_MM -> Mm;
        _ -> fail(N, "~ts needs numbers of at most ~b mm, not ~ts", [What, ?FARTHEST_MM, Word])
    end.

positive(Mm, _N) when Mm > 0 -> Mm;
positive(Mm, N) -> fail(N, "more than 0 mm expected, not ~p", [Mm]).

polygon(What, Words, N) when length(Words) >= 6, length(Words) rem 2 =:= 0 ->
    Points = points(numbers(length(Words), What, Words, N)),
    case starl_floor:area(Points) of
        Area when Area < 0 -> lists:reverse(Points);
        _ -> Points
    end;
polygon(What, Words, N) ->
    fail(N, "~ts needs at least three points, X Y each; there are ~b numbers", [What, length(Words)]).

points([]) -> [];
points([X, Y | Rest]) -> [{X, Y} | points(Rest)].

%% -- the drawing ----------------------------------------------------------------------------

drawing(N, _Lines, #plan{scale = none}) ->
    fail(N, "a drawing needs its scale before it, as in: scale 250", []);
drawing(N, _Lines, #plan{size = {_, _}}) ->
    fail(N, "a plan has a size or a drawing, not both", []);
drawing(N, Lines, Plan) ->
    Rows = [{M, string:trim(Row, trailing)} || {M, Row} <- Lines],
    Drawn = lists:reverse(blank(lists:reverse(blank(Rows)))),
    Width = lists:max([0 | [length(Row) || {_, Row} <- Drawn]]),
    Width > 0 orelse fail(N, "the drawing is empty", []),
    max(Width, length(Drawn)) =< ?MOST_CELLS orelse
        fail(N, "a drawing has at most ~b lines and columns", [?MOST_CELLS]),
    drawn(cells(Drawn), {Width, length(Drawn)}, Plan).

blank([{_, ""} | Rows]) -> blank(Rows);
blank(Rows) -> Rows.

cells(Rows) ->
    Top = length(Rows) - 1,
    [
        {{Column, Top - I}, Char, N}
     || {I, {N, Row}} <- lists:enumerate(0, Rows),
        {Column, Char} <- lists:enumerate(0, Row),
        Char =/= $.,
        Char =/= $\s
    ].

drawn(Cells, {W, H}, #plan{scale = Scale, doors = Doors, walls = Walls} = Plan) ->
    Solid = maps:from_list([{Cell, true} || {Cell, $#, _} <- Cells]),
    Gaps = maps:from_list([{Cell, true} || {Cell, $+, _} <- Cells]),
    IsWall = fun(Cell) -> is_map_key(Cell, Solid) end,
    IsFree = fun({X, Y} = Cell) ->
        X >= 0 andalso Y >= 0 andalso X < W andalso Y < H andalso
            not is_map_key(Cell, Solid) andalso not is_map_key(Cell, Gaps)
    end,
    Closed = [
        starl_floor_cells:door(Run, IsWall, Scale)
     || Run <- runs(lists:sort(maps:keys(Gaps)))
    ],
    Marks = [Mark || {_, Char, _} = Mark <- Cells, Char =/= $#, Char =/= $+],
    Marked = lists:foldl(
        fun(Mark, P) -> mark(Mark, IsFree, P) end,
        Plan#plan{
            size = {W * Scale, H * Scale},
            walls = lists:reverse(starl_floor_cells:walls(Solid, Scale)) ++ Walls,
            doors = lists:reverse(Closed) ++ Doors
        },
        Marks
    ),
    missing(maps:to_list(Plan#plan.letters), [Char || {_, Char, _} <- Marks]),
    whole(Marked).

missing(Letters, Chars) ->
    case [Letter || {Letter, _} <- lists:sort(Letters), not lists:member(Letter, Chars)] of
        [] -> ok;
        [Letter | _] -> fail(none, "the letter ~tc is not in the drawing", [Letter])
    end.

mark({Cell, Char, N}, IsFree, #plan{scale = Scale, letters = Letters} = Plan) ->
    #plan{rooms = Rooms} = Plan,
    case maps:get(Char, Letters, none) of
        {room, Name} when is_map_key(Name, Rooms) ->
            Plan;
        {room, Name} ->
            Plan#plan{rooms = Rooms#{Name => starl_floor_cells:room(Cell, IsFree, Scale)}};
        {place, Name} ->
            place(Name, Cell, N, Plan);
        none ->
            place(name([Char], N), Cell, N, Plan)
    end.

place(Name, _Cell, N, #plan{places = Places}) when is_map_key(Name, Places) ->
    fail(N, "the place ~ts is there twice", [Name]);
place(Name, Cell, _N, #plan{scale = Scale, places = Places} = Plan) ->
    Plan#plan{places = Places#{Name => starl_floor_cells:centre(Cell, Scale)}}.

%% Doors: cells that follow each other in a row or a column. Sorted by column, then row.
runs([]) ->
    [];
runs([{X, Y} | Rest]) ->
    Up = run({X, Y}, {0, 1}, Rest),
    Right = run({X, Y}, {1, 0}, Rest),
    Longer =
        case length(Up) >= length(Right) of
            true -> Up;
            false -> Right
        end,
    [Longer | runs(Rest -- Longer)].

run({X, Y} = Cell, {DX, DY}, Cells) ->
    Next = {X + DX, Y + DY},
    case lists:member(Next, Cells) of
        true -> [Cell | run(Next, {DX, DY}, Cells)];
        false -> [Cell]
    end.
