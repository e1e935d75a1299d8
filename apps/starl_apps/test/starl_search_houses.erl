%% Houses for the search, drawn from a seed: rooms in rows and columns, doors, furniture that stands free or in
%% corners, compartments that are open at one side, that nobody fits into, or that are closed. They have walls
%% only: no names, no doors. And searches of them, with the ball anywhere.
-module(starl_search_houses).

-export([house/3, search/3, table/1]).

-define(WALL, 100).

%% So many rooms across and up, each 3 m wide inside.
house(Columns, Rows, Seed) ->
    {Parts, _} = lists:mapfoldl(fun room/2, rand:seed_s(exsss, Seed), rooms(Columns, Rows)),
    {Tree, Random} = doors(Columns, Rows, rand:seed_s(exsss, Seed + 1)),
    {Between, _} = lists:mapfoldl(
        fun(Edge, R) -> between(Edge, Tree, R) end, Random, edges(Columns, Rows)
    ),
    starl_floor:new(#{
        name => <<"House">>,
        size => {Columns * pitch() + ?WALL, Rows * pitch() + ?WALL},
        walls => border(Columns, Rows) ++ lists:append(Between) ++ lists:append(Parts)
    }).

pitch() -> 3100.

rooms(Columns, Rows) -> [{I, J} || J <- lists:seq(0, Rows - 1), I <- lists:seq(0, Columns - 1)].

border(Columns, Rows) ->
    {W, H} = {Columns * pitch() + ?WALL, Rows * pitch() + ?WALL},
    [
        starl_floor:box(0, 0, W, ?WALL),
        starl_floor:box(0, H - ?WALL, W, H),
        starl_floor:box(0, 0, ?WALL, H),
        starl_floor:box(W - ?WALL, 0, W, H)
    ].

edges(Columns, Rows) ->
    [{{I, J}, {I + 1, J}} || {I, J} <- rooms(Columns, Rows), I + 1 < Columns] ++
        [{{I, J}, {I, J + 1}} || {I, J} <- rooms(Columns, Rows), J + 1 < Rows].

%% Doors by which each room can be reached.
doors(Columns, Rows, Random) -> tree([{0, 0}], #{{0, 0} => true}, [], {Columns, Rows}, Random).

tree([], _Seen, Tree, _Size, Random) ->
    {Tree, Random};
tree([{I, J} = At | Back], Seen, Tree, {Columns, Rows} = Size, Random0) ->
    New = [
        To
     || {X, Y} = To <- [{I + 1, J}, {I - 1, J}, {I, J + 1}, {I, J - 1}],
        X >= 0,
        Y >= 0,
        X < Columns,
        Y < Rows,
        not is_map_key(To, Seen)
    ],
    case New of
        [] ->
            tree(Back, Seen, Tree, Size, Random0);
        _ ->
            {K, Random} = rand:uniform_s(length(New), Random0),
            To = lists:nth(K, New),
            tree(
                [To, At | Back],
                Seen#{To => true},
                [{min(At, To), max(At, To)} | Tree],
                Size,
                Random
            )
    end.

%% The wall between two rooms, with a door or without.
between({{I, J}, {K, _}} = Edge, Tree, Random0) ->
    {Part, Random1} = rand:uniform_s(Random0),
    {Off, Random} = rand:uniform_s(1700, Random1),
    IsDoor = lists:member(Edge, Tree) orelse Part < 0.2,
    {X, Y} = {I * pitch(), J * pitch()},
    Along = [{From, To} || {From, To} <- ends(IsDoor, Off)],
    Walls =
        case K > I of
            true ->
                [
                    starl_floor:box(X + pitch(), Y + A, X + pitch() + ?WALL, Y + B)
                 || {A, B} <- Along
                ];
            false ->
                [starl_floor:box(X + A, Y + pitch(), X + B, Y + pitch() + ?WALL) || {A, B} <- Along]
        end,
    {Walls, Random}.

ends(false, _Off) -> [{0, pitch() + ?WALL}];
ends(true, Off) -> [{0, 250 + Off}, {1150 + Off, pitch() + ?WALL}].

%% What stands in a room. Doors stay free: it stands 700 mm from walls, or in a corner.
room({I, J}, Random0) ->
    {Kind, Random1} = rand:uniform_s(6, Random0),
    {A, Random2} = rand:uniform_s(600, Random1),
    {B, Random} = rand:uniform_s(600, Random2),
    {X, Y} = {I * pitch() + ?WALL, J * pitch() + ?WALL},
    {furniture(Kind, X, Y, A, B), Random}.

%% a table; a pillar; a corner cupboard; a box that is open at one side; one with a slit; a closed one
furniture(1, X, Y, A, B) ->
    [starl_floor:box(X + 800 + A, Y + 800 + B, X + 1400 + A, Y + 1400 + B)];
furniture(2, X, Y, A, B) ->
    [starl_floor:box(X + 1000 + A, Y + 1000 + B, X + 1150 + A, Y + 1150 + B)];
furniture(3, X, Y, A, B) ->
    [starl_floor:box(X, Y, X + 200 + A div 8, Y + 200 + B div 8)];
furniture(4, X, Y, A, B) ->
    compartment(X + 800 + A, Y + 800 + B, 700);
furniture(5, X, Y, A, B) ->
    compartment(X + 800 + A, Y + 800 + B, 250);
furniture(6, X, Y, A, B) ->
    compartment(X + 800 + A, Y + 800 + B, 0).

%% 900 mm wide outside, its right side open over this height.
compartment(X, Y, Open) ->
    Side = (800 - Open) div 2,
    [
        starl_floor:box(X, Y, X + 50, Y + 900),
        starl_floor:box(X, Y, X + 900, Y + 50),
        starl_floor:box(X, Y + 850, X + 900, Y + 900),
        starl_floor:box(X + 850, Y, X + 900, Y + 50 + Side),
        starl_floor:box(X + 850, Y + 850 - Side, X + 900, Y + 900)
    ].

%% The search of a house: the outcome with its report and the place of the ball.
search(Floor, Seed, More) ->
    File = filename:join("/tmp", "starl_house_" ++ os:getpid() ++ ".floor"),
    ok = file:write_file(File, text(Floor)),
    Scenario = maps:merge(
        #{
            app => starl_search,
            floor => File,
            robots => 4,
            ball => random,
            seed => Seed,
            time => 7200
        },
        More
    ),
    {ok, Sim} = starl_sim:start(Scenario),
    ok = file:delete(File),
    _ = starl_sim:run(Sim),
    {Outcome, Report} = starl_sim:finish(Sim),
    Outcome#{report => Report, ball => ball(Seed, Floor)}.

ball(Seed, Floor) ->
    {ok, At} = starl_search_cells:draw({Seed, ball}, 100.0, Floor),
    At.

text(#{size := {W, H}, walls := Walls}) ->
    [
        io_lib:format("size ~b ~b~n", [round(W), round(H)])
        | [
            ["outline", [io_lib:format(" ~b ~b", [round(X), round(Y)]) || {X, Y} <- Wall], $\n]
         || Wall <- Walls
        ]
    ].

%% Searches with these seeds of a house of 64 rooms each: found, or the floor not seen has the ball.
table(Seeds) ->
    [
        begin
            Floor = house(8, 8, Seed),
            {Us, Outcome} = timer:tc(fun() -> search(Floor, Seed, #{loss => 0.1}) end),
            #{violations := Violations, report := Report, ball := Ball, monitors := Monitors} =
                Outcome,
            #{starl_search_monitor := #{found_us := Found, left := Left, unseen_m2 := M2}} =
                Monitors,
            Near = [P || P <- Left, starl_geometry:distance(P, Ball) < 150],
            How =
                case Found of
                    none when Near =/= [] -> not_seen;
                    none -> 'LOST';
                    _ -> found
                end,
            io:format(
                "~b ~p violations ~p complete ~p found ~p s, not seen ~.1f m2, ~.1f s of computer~n",
                [
                    Seed,
                    How,
                    [W || #{what := W} <- Violations],
                    maps:get(complete, Report),
                    [Found div 1000000 || Found =/= none],
                    M2,
                    Us / 1.0e6
                ]
            ),
            How
        end
     || Seed <- Seeds
    ].
