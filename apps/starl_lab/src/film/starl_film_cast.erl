%% @doc Collects the content of a run's film from its messages ({@link starl_trace_message}). It
%% keeps the floor, the lines to paint, the robots' paths and ink, when robots were down, cut links,
%% and what applications draw and measure. A pure module.
%% ```
%%   {ok, Cast, _} = starl_trace_reader:fold(fun starl_film_cast:message/2, starl_film_cast:new(), File),
%%   {ok, Scene} = starl_film_cast:scene(Cast)
%% '''
-module(starl_film_cast).

-export([new/0, message/2, until/2, scene/1]).

-export_type([t/0, scene/0, actor/0, span/0]).

-record(cast, {
    facts = none :: starl_trace_message:scenario() | none,
    %% the pieces of motion of each robot, the latest first
    pieces = #{} :: #{starl:robot_id() => [starl_trajectory:piece(), ...]},
    %% positions of robots without pieces, the latest first
    poses = #{} :: #{starl:robot_id() => [starl_film_series:point(), ...]},
    pens = #{} :: #{starl:robot_id() => [{integer(), up | down}]},
    states = #{} :: #{starl:robot_id() => [{integer(), up | down}]},
    %% by their names, as they were told last
    faults = #{} :: #{Name :: term() => tuple()},
    %% what applications draw, the latest first
    drawings = [] :: [{integer(), starl:robot_id(), starl_drawing:t()}],
    curves = starl_film_curves:new() :: starl_film_curves:t(),
    until = 0 :: integer()
}).

-opaque t() :: #cast{}.

%% Lengths in mm, times in us. Times are counted from the beginning of what was told; `end_us': its
%% end.
-type scene() :: #{
    app := module(),
    floor := {number(), number()},
    lines := [{starl_geometry:point(), starl_geometry:point()}],
    actors := [actor()],
    cuts := [starl_film_partitions:cut()],
    plan := starl_floor:t() | none,
    %% the sides of what stands in the way for a time
    obstacles := [{[starl_geometry:segment()], span()}],
    drawings := [starl_drawing:seen()],
    curves := [starl_film_curves:curve()],
    end_us := integer()
}.

%% A robot: its way, with `[X, Y, Heading]', its ink, with `[X, Y]', and when it was down.
-type actor() :: #{
    id := starl:robot_id(),
    way := [starl_film_series:point(), ...],
    ink := [[starl_film_series:point(), ...]],
    down := [span()]
}.

-type span() :: {FromUs :: integer(), ToUs :: integer()}.

-define(TOLERANCE_MM, 1.0).
%% While its speed changes, a robot is looked at this often.
-define(STEP_US, 50000).

%% @doc Nothing is known of the run.
-spec new() -> t().
new() -> #cast{}.

%% @doc Takes a message into account.
-spec message(starl_trace_message:t(), t()) -> t().
message({scenario, _, #{scenario := Scenario} = Facts}, Cast) ->
    lists:foldl(fun fault/2, Cast#cast{facts = Facts}, maps:get(faults, Scenario, []));
message({faults, _, {_BeganOrEnded, Fault}}, Cast) ->
    fault(Fault, Cast);
message({trace, At, {Robot, Machine, Event}}, #cast{until = Until} = Cast) ->
    event(Machine, Event, At, Robot, Cast#cast{until = max(At, Until)});
message({poses, At, #{robots := Robots}}, #cast{until = Until} = Cast) ->
    lists:foldl(fun(Pose, C) -> pose(At, Pose, C) end, Cast#cast{until = max(At, Until)}, Robots);
message({verdicts, _, {ended, #{end_us := End}}}, #cast{until = Until} = Cast) ->
    Cast#cast{until = max(End, Until)};
message(_, Cast) ->
    Cast.

%% @doc Advances the run to this time. Robots go on as commanded until then.
-spec until(AtUs :: integer(), t()) -> t().
until(At, #cast{until = Until} = Cast) -> Cast#cast{until = max(At, Until)}.

fault(Fault, #cast{faults = Faults} = Cast) ->
    Cast#cast{faults = Faults#{element(1, Fault) => Fault}}.

event(chassis, {motion, Piece}, _At, Robot, #cast{pieces = Pieces} = Cast) ->
    T0 = starl_trajectory:start_us(Piece),
    Known = maps:get(Robot, Pieces, []),
    %% a piece that had not begun yet is replaced
    Before = lists:dropwhile(fun(P) -> starl_trajectory:start_us(P) >= T0 end, Known),
    Cast#cast{pieces = Pieces#{Robot => [Piece | Before]}};
event(chassis, {actuated, pen, Pen}, At, Robot, #cast{pens = Pens} = Cast) when
    Pen =:= up; Pen =:= down
->
    Cast#cast{pens = added(Robot, {At, Pen}, Pens)};
event(robot, {died, _}, At, Robot, #cast{states = States} = Cast) ->
    Cast#cast{states = added(Robot, {At, down}, States)};
event(robot, State, At, Robot, #cast{states = States} = Cast) when State =:= up; State =:= down ->
    Cast#cast{states = added(Robot, {At, State}, States)};
event(app, {draw, #{kind := _} = Drawing}, At, Robot, #cast{drawings = Drawings} = Cast) ->
    Cast#cast{drawings = [{At, Robot, Drawing} | Drawings]};
event(app, {measure, Key, Value}, At, Robot, #cast{curves = Curves} = Cast) when
    is_atom(Key), is_number(Value)
->
    Cast#cast{curves = starl_film_curves:add(At, Robot, Key, Value, Curves)};
event(_Machine, _Event, _At, _Robot, Cast) ->
    Cast.

added(Robot, Entry, Map) -> Map#{Robot => [Entry | maps:get(Robot, Map, [])]}.

pose(At, {Robot, {X, Y, Heading}, Pen, _}, #cast{pieces = Pieces, poses = Poses} = Cast) when
    not is_map_key(Robot, Pieces)
->
    Inked = pen(At, Robot, Pen, Cast),
    Inked#cast{poses = added(Robot, {At, [X, Y, Heading]}, Poses)};
pose(_At, _Pose, Cast) ->
    Cast.

pen(_At, _Robot, none, Cast) ->
    Cast;
pen(At, Robot, Pen, #cast{pens = Pens} = Cast) ->
    case Pens of
        #{Robot := [{_, Pen} | _]} -> Cast;
        #{} -> Cast#cast{pens = added(Robot, {At, Pen}, Pens)}
    end.

%% @doc What the film shows; a recording that was cut off before anything moved shows nothing.
-spec scene(t()) -> {ok, scene()} | {error, empty}.
scene(#cast{facts = none}) ->
    {error, empty};
scene(#cast{pieces = Pieces, poses = Poses}) when map_size(Pieces) + map_size(Poses) =:= 0 ->
    {error, empty};
scene(#cast{facts = Facts, until = Until} = Cast) ->
    #{app := App, scenario := Scenario, monitors := Monitors} = Facts,
    Begun = maps:get(begun_us, Facts, 0),
    Ways = ways(Cast),
    Faults = maps:values(Cast#cast.faults),
    Plan = plan(Facts),
    {ok, #{
        app => App,
        floor => floor_of(Scenario),
        plan => Plan,
        obstacles => since_begun(Begun, obstacles(Plan, Faults, Until)),
        lines => lines(Monitors),
        actors => [
            since(Begun, actor(Id, Way, Cast))
         || {Id, Way} <- lists:sort(maps:to_list(Ways))
        ],
        cuts => since_begun(Begun, starl_film_partitions:cuts(Faults, maps:keys(Ways), Until)),
        drawings => drawings(Begun, Cast),
        curves => starl_film_curves:curves(Begun, Cast#cast.curves),
        end_us => Until - Begun
    }}.

ways(#cast{poses = Poses, pieces = Pieces, until = Until}) ->
    maps:merge(
        maps:map(fun(_, Known) -> lists:reverse(Known) end, Poses),
        maps:map(fun(_, Known) -> way(lists:reverse(Known), Until) end, Pieces)
    ).

since_begun(Begun, Shown) -> [{What, span(Begun, Span)} || {What, Span} <- Shown].

drawings(Begun, #cast{drawings = Drawings, until = Until}) ->
    [
        {max(0, From - Begun), To - Begun, Robot, Drawing}
     || {From, To, Robot, Drawing} <- starl_drawing:shown(lists:reverse(Drawings), Until)
    ].

%% A film begins with the recording. That of a robot on its own counts from 1970.
since(Begun, #{way := Way, ink := Ink, down := Down} = Actor) ->
    Moved = fun(Points) -> [{T - Begun, Place} || {T, Place} <- Points] end,
    Actor#{
        way := Moved(Way),
        ink := [Moved(Line) || Line <- Ink],
        down := [span(Begun, Span) || Span <- Down]
    }.

span(Begun, {From, To}) -> {max(0, From - Begun), max(0, To - Begun)}.

%% What a recording says is of any shape.
plan(#{floor := Plan}) ->
    case starl_floor:is_floor(Plan) of
        true -> Plan;
        false -> none
    end;
plan(_Facts) ->
    none.

obstacles(none, _Faults, _Until) ->
    [];
obstacles(Plan, Faults, Until) ->
    [
        {Sides, {1000 * From, min(1000 * To, Until)}}
     || {_, From, To, Kind, _, Params} <- Faults,
        is_integer(To),
        1000 * From < min(1000 * To, Until),
        Sides <- [starl_obstacles:of_fault(Kind, Params, Plan)],
        Sides =/= []
    ].

floor_of(#{world := {Width, Height}}) when is_number(Width), is_number(Height) -> {Width, Height};
floor_of(_) -> {12000, 12000}.

lines(Monitors) ->
    [
        {{X1, Y1}, {X2, Y2}}
     || {_, #{lines := Lines}} <- Monitors,
        is_list(Lines),
        {{X1, Y1}, {X2, Y2}} <- Lines,
        is_number(X1)
    ].

actor(Id, Way, #cast{pens = Pens, states = States, until = Until}) ->
    #{
        id => Id,
        way => Way,
        ink => [
            [{T, [X, Y]} || {T, [X, Y, _]} <- Slice]
         || Slice <- starl_film_series:slices(
                spans(lists:reverse(maps:get(Id, Pens, [])), Until), Way
            )
        ],
        down => spans(lists:reverse(maps:get(Id, States, [])), Until)
    }.

%% The spans of time that begin with `down' and end with `up'.
spans([{From, down} | Later], Until) ->
    case lists:dropwhile(fun({_, State}) -> State =:= down end, Later) of
        [{To, up} | Rest] -> [{From, To} | spans(Rest, Until)];
        [] -> [{From, max(From, Until)}]
    end;
spans([_ | Later], Until) ->
    spans(Later, Until);
spans([], _Until) ->
    [].

%% -- ways -----------------------------------------------------------------------------------

way([Piece], Until) ->
    From = starl_trajectory:start_us(Piece),
    points(From, max(From, Until), Piece);
way([Piece, Next | Pieces], Until) ->
    {From, To} = {starl_trajectory:start_us(Piece), starl_trajectory:start_us(Next)},
    points(From, To, Piece) ++ way([Next | Pieces], Until).

%% The last of these points and the first of the next piece may differ: a robot can be put elsewhere.
points(From, To, Piece) ->
    [
        {T, [X, Y, Heading]}
     || T <- lists:usort(times(From, To, Piece)),
        {X, Y, Heading} <- [starl_trajectory:pose(T, Piece)]
    ].

times(From, To, {ramp, T0, _, _, _, _, _, Us}) when Us > 0, T0 + Us > From ->
    Even = min(To, T0 + Us),
    lists:seq(From, Even, ?STEP_US) ++ [Even, To];
times(From, To, Piece) ->
    Points = starl_trajectory:polyline(Piece, From, To, ?TOLERANCE_MM),
    N = max(1, length(Points) - 1),
    [From + I * (To - From) div N || I <- lists:seq(0, N)].
