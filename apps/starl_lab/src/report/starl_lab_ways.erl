%% @doc Shows the paths of a run's robots as a table and as a picture. It also finds the least
%% distance of two robots and the robots that left the floor. Only the picture is impure.
-module(starl_lab_ways).

-export([watch/0, new/2, on/2, with/2, least/1, off_floor/1, is_whole/1, until_us/1, csv/1, draw/3]).

-export_type([t/0, least/0, off/0]).

-record(ways, {
    world :: {number(), number()},
    plan = none :: starl_floor:t() | none,
    pieces :: [{starl:robot_id(), starl_trajectory:piece()}],
    paths :: [{starl:robot_id(), [stretch()]}],
    until :: integer(),
    whole :: boolean(),
    drawings = [] :: [{starl:robot_id(), starl_drawing:t()}]
}).

-opaque t() :: #ways{}.

%% A piece of motion and the time in which it was driven.
-type stretch() :: {FromUs :: integer(), ToUs :: integer(), starl_trajectory:piece()}.

%% The least distance of two robots (mm), when, and which; `none' of a single robot.
-type least() :: {Mm :: float(), AtUs :: integer(), {starl:robot_id(), starl:robot_id()}} | none.

%% A robot that left the floor: when first, and by how much at most.
-type off() :: {starl:robot_id(), AtUs :: integer(), Mm :: float()}.

%% The number of pieces that are recorded.
-define(MOST, 500000).
%% A way is drawn and written with this error; it is looked at in steps of this length, mm.
-define(TOLERANCE_MM, 2.0).
-define(STEP_MM, 20.0).

%% @doc The monitor that records the ways.
-spec watch() -> {module(), map()}.
watch() -> {starl_run_paths_monitor, #{most => ?MOST}}.

%% @doc The ways on a floor.
-spec new(starl_run_paths_monitor:paths(), World :: {number(), number()}) -> t().
new(#{pieces := Pieces, until_us := Until, is_whole := IsWhole}, World) ->
    Own = maps:groups_from_list(fun({Id, _}) -> Id end, fun({_, Piece}) -> Piece end, Pieces),
    Paths = [{Id, stretches(Path, Until)} || {Id, Path} <- lists:sort(maps:to_list(Own))],
    #ways{world = World, pieces = Pieces, paths = Paths, until = Until, whole = IsWhole}.

%% @doc The ways on a floor plan, which is drawn with them.
-spec on(starl_floor:t() | none, t()) -> t().
on(Plan, Ways) -> Ways#ways{plan = Plan}.

%% @doc The ways with what the application has drawn.
-spec with([{starl:robot_id(), starl_drawing:t()}], t()) -> t().
with(Drawings, Ways) -> Ways#ways{drawings = Drawings}.

%% A piece that was replaced at the moment when it began was never driven.
stretches([Last], Until) ->
    [{starl_trajectory:start_us(Last), max(Until, starl_trajectory:start_us(Last)), Last}];
stretches([Piece, Next | Pieces], Until) ->
    {From, To} = {starl_trajectory:start_us(Piece), starl_trajectory:start_us(Next)},
    [{From, To, Piece} || From < To] ++ stretches([Next | Pieces], Until).

%% @doc Are these the whole ways?
-spec is_whole(t()) -> boolean().
is_whole(#ways{whole = IsWhole}) -> IsWhole.

%% @doc The time until which the ways are known.
-spec until_us(t()) -> integer().
until_us(#ways{until = Until}) -> Until.

%% @doc The least distance of two robots at any moment.
-spec least(t()) -> least().
least(#ways{pieces = Pieces, until = Until}) ->
    Driven = lists:foldl(fun drive/2, starl_separation:new(0.0), Pieces),
    {_Met, Least} = starl_separation:finish(Until, Driven),
    Least.

drive({Robot, Piece}, Separation) ->
    {_Met, Advanced} = starl_separation:advance(starl_trajectory:start_us(Piece), Separation),
    starl_separation:motion(Robot, Piece, Advanced).

%% -- the floor ------------------------------------------------------------------------------

%% @doc The robots whose centres left the floor, the first to leave it first.
-spec off_floor(t()) -> [off()].
off_floor(#ways{paths = Paths, world = World}) ->
    All = [{Id, [Off || Stretch <- Path, Off <- off(Stretch, World)]} || {Id, Path} <- Paths],
    lists:keysort(2, [
        {Id, At, lists:max([Mm || {_, Mm} <- Offs])}
     || {Id, [{At, _} | _] = Offs} <- All
    ]).

%% The first moment off the floor in this stretch, and the greatest distance from it.
off({From, To, Piece}, World) ->
    {{X, Y}, Radius} = starl_trajectory:enclosing(From, To, Piece),
    case outside({X - Radius, Y - Radius}, World) + outside({X + Radius, Y + Radius}, World) of
        Zero when Zero == 0 -> [];
        _ -> looked(steps(From, To, Piece), Piece, World)
    end.

looked(Times, Piece, World) ->
    Outside = fun(T) -> outside(starl_trajectory:position(T, Piece), World) end,
    case lists:splitwith(fun(T) -> Outside(T) == 0 end, Times) of
        {_, []} ->
            [];
        {[], [First | _]} ->
            [{First, lists:max([Outside(T) || T <- Times])}];
        {Inside, [First | _]} ->
            At = crossing(lists:last(Inside), First, Outside),
            [{At, lists:max([Outside(T) || T <- Times])}]
    end.

crossing(In, Out, _Outside) when Out - In =< 1 -> Out;
crossing(In, Out, Outside) ->
    Middle = (In + Out) div 2,
    case Outside(Middle) == 0 of
        true -> crossing(Middle, Out, Outside);
        false -> crossing(In, Middle, Outside)
    end.

steps(From, To, Piece) ->
    evenly(From, To, max(1, ceil(starl_trajectory:moved(From, To, Piece) / ?STEP_MM))) ++ [To].

evenly(From, To, N) -> lists:usort([From + I * (To - From) div N || I <- lists:seq(0, N - 1)]).

%% The distance from the floor.
outside({X, Y}, {Width, Height}) ->
    Over = [0.0, -X, X - Width],
    Beside = [0.0, -Y, Y - Height],
    {DX, DY} = {lists:max(Over), lists:max(Beside)},
    math:sqrt(DX * DX + DY * DY).

%% -- the table ------------------------------------------------------------------------------

%% @doc The ways as CSV, ordered by time and robot. Between two rows a robot moves evenly, to within
%% 2 mm.
-spec csv(t()) -> unicode:chardata().
csv(#ways{paths = Paths}) ->
    Rows = [row(T, Id, Piece) || {Id, Path} <- Paths, {T, Piece} <- moments(Path)],
    Lines = [
        io_lib:format("~.6f,~b,~.1f,~.1f,~.4f\n", [T / 1.0e6, Id, X, Y, Heading])
     || {T, Id, {X, Y, Heading}} <- lists:sort(Rows)
    ],
    ["time_s,robot,x_mm,y_mm,heading_rad\n" | Lines].

row(T, Id, Piece) -> {T, Id, starl_trajectory:pose(T, Piece)}.

%% The times at which a path is written down, each with its piece.
moments([{From, To, Piece}]) ->
    [{T, Piece} || T <- lists:usort(times(From, To, Piece) ++ [To])];
moments([{From, To, Piece} | Path]) ->
    [{T, Piece} || T <- times(From, To, Piece)] ++ moments(Path).

times(From, To, {ramp, T0, _, _, _, _, _, Us} = Piece) when T0 + Us > From, T0 + Us < To ->
    chords(From, T0 + Us, Piece) ++ [T0 + Us];
times(From, To, Piece) ->
    chords(From, To, Piece).

chords(From, To, Piece) ->
    Points = starl_trajectory:polyline(Piece, From, To, ?TOLERANCE_MM),
    evenly(From, To, max(1, length(Points) - 1)).

%% -- the picture ----------------------------------------------------------------------------

%% @doc Draws the ways into `ways.svg', and into `ways.png' where the program for it is at hand.
-spec draw(file:filename(), Title :: unicode:chardata(), t()) -> starl_scene:written().
draw(Dir, Title, #ways{world = World, paths = Paths, until = Until, plan = Plan} = Ways) ->
    On = maps:from_list([{plan, Plan} || Plan =/= none]),
    Drawing = On#{
        floor => World,
        target => [],
        ink => maps:from_list([{Id, [line(Path)]} || {Id, Path} <- Paths]),
        robots => [robot(Id, lists:last(Path), Until) || {Id, Path} <- Paths],
        drawings => Ways#ways.drawings,
        title => Title
    },
    case starl_picture_draw:write(Dir, "ways", Drawing) of
        {ok, Files} -> {ok, Files};
        {partly, Files, Reason} -> {partly, Files, starl_picture_draw:format_error(Reason)};
        {error, Reason} -> {error, starl_picture_draw:format_error(Reason)}
    end.

line(Path) -> [starl_trajectory:position(T, Piece) || {T, Piece} <- moments(Path)].

robot(Id, {_, _, Piece}, Until) ->
    {X, Y, Heading} = starl_trajectory:pose(Until, Piece),
    {Id, {X, Y}, Heading}.
