%% @doc A convoy: a column of robots drives through the doors of a building, each of which lets one robot through at a
%% time. The way is the shortest of the floor plan's roadmap ({@link starl_convoy_route}). A token of mutual exclusion guards each
%% section of it: a robot acquires the next one, drives there, and releases the one behind it ({@link
%% starl_sections}). So nobody overtakes, and one is in a door.
%%
%% Measures: `gap_mm', the distance from the robot ahead, and `wait_s', the wait for a section. Trace: {@link
%% event()} (see {@link starl_convoy_monitor}).
-module(starl_convoy).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([options/0, scene/1, guarantees/0, measures/0, report/2]).

-export_type([event/0]).

%% The robot has come to this section; it is the one behind this door.
-type event() :: {at, Section :: pos_integer(), Door :: pos_integer() | none}.

%% `ahead': the robots before it in the column. `since': when it began to wait for the next section, by its own clock (ms).
-type state() :: #{
    lane := starl_convoy_route:t(),
    ahead := [starl:robot_id()],
    at := non_neg_integer(),
    held := boolean(),
    since := integer()
}.

-spec options() -> [starl_options:option()].
options() ->
    [
        {section, {integer, 550, 5000}, 600,
            "the distance of two robots that wait in the column, mm"}
    ].

-spec measures() -> [{atom(), string()}].
measures() ->
    [
        {gap_mm, "distance from the robot ahead, mm"},
        {wait_s, "waiting for a section of the way, s"}
    ].

%% @doc What those who wait behind a door may rely on.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {order, safety, "nobody overtakes, and no two robots come nearer to each other than 400 mm",
            [
                {mutex, exclusion}, {motion, line}, delivery, alive, no_restart, positions
            ]},
        {moves, progress, "somebody moves on at least every two minutes, until all are there", [
            alive, {mutex, granted}, {motion, arrives}
        ]}
    ].

%% @doc The column before the first door, robot 1 ahead.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(#{robots := Ids, profiles := Profiles, options := #{section := Length}} = Context) ->
    {ok, Floor} = building(Context),
    case starl_convoy_route:new(Floor, #{profiles => Profiles, section_mm => Length}) of
        {ok, Lane} -> column(starl_convoy_route:starts(Ids, Lane), Lane, Floor);
        {error, _} = Error -> Error
    end.

building(#{floor := #{doors := []}}) -> starl_floor_file:read("doors", 1000);
building(#{floor := Floor}) -> {ok, Floor}.

column({ok, Poses}, Lane, Floor) ->
    {ok, #{
        app => {sequential, starl_convoy, Lane},
        blocks => [starl_mutex],
        floor => Floor,
        poses => Poses,
        monitors => [{starl_convoy_monitor, #{robots => lists:sort(maps:keys(Poses))}}],
        never_crashes => true
    }};
column({error, _} = Error, _Lane, _Floor) ->
    Error.

-spec init(starl:robot(), starl_convoy_route:t()) -> state().
init(Robot, Lane) ->
    {Ahead, _} = lists:splitwith(fun(R) -> R =/= starl:id(Robot) end, starl:participants(Robot)),
    _ = Ahead =:= [] andalso starl:draw(Robot, starl_convoy_route:drawing(Lane)),
    located(Robot, #{lane => Lane, ahead => Ahead}).

%% At the beginning, after a restart, and when it does not come where it wants to.
located(Robot, #{lane := Lane} = State) ->
    at(starl_convoy_route:locate(starl_sections:position(Robot), Lane), Robot, State).

at(At, Robot, State) ->
    Held = starl_sections:take(Robot, {section, At}),
    State#{at => At, held => Held, since => starl:now(Robot)}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, arrived}.
step(Robot, #{lane := Lane, at := At} = State) when At + 1 >= length(Lane) -> arrived(Robot, State);
step(Robot, #{lane := Lane, at := At} = State) ->
    #{way := Way} = Section = starl_convoy_route:section(At + 1, Lane),
    case starl_sections:enter(Robot, Section, fun() -> begins(Robot, Way, State) end) of
        occupied ->
            Here = elsewhere(starl_sections:position(Robot), Robot, State),
            behind_all(starl:positions(Robot), Robot, Here);
        stuck ->
            {continue, beside(starl:floor(Robot), starl_sections:position(Robot), Robot, State)};
        ok ->
            {_, Door} = lists:nth(At + 2, Lane),
            ok = starl:trace(Robot, {at, At + 1, Door}),
            ok = behind(Robot, State),
            {continue, State#{at := At + 1, held := true, since := starl:now(Robot)}}
    end.

arrived(Robot, State) ->
    ok = behind(Robot, State),
    {done, arrived}.

%% Its way ends behind those that have come to stay, in whatever order: wrong positions may have mixed up the column.
behind_all({ok, Poses}, Robot, #{lane := Lane, at := At} = State) ->
    Others = [{X, Y} || {X, Y, _} <- maps:values(maps:remove(starl:id(Robot), Poses))],
    case starl_convoy_route:is_full(At + 1, Others, Lane) of
        true -> arrived(Robot, State);
        false -> {continue, State}
    end;
behind_all({error, _}, _Robot, State) ->
    {continue, State}.

%% Is it where it takes itself to be? A fault may have misled it.
elsewhere(Place, Robot, #{lane := Lane, at := At} = State) ->
    case starl_convoy_route:locate(Place, Lane) of
        At ->
            State;
        Other ->
            moved(Other, Robot, State)
    end.

%% It may stand where a wall is between it and the lane: it begins anew with a section that it can reach.
beside({ok, Floor}, Place, Robot, #{lane := Lane, at := At} = State) ->
    case starl_convoy_route:reach(Place, Floor, Lane) of
        At -> State;
        Other -> moved(Other, Robot, State)
    end;
beside({error, _}, Place, Robot, State) ->
    elsewhere(Place, Robot, State).

moved(At, Robot, State) ->
    ok = behind(Robot, State),
    at(At, Robot, State).

behind(Robot, #{at := At, held := true}) -> starl_sections:leave(Robot, {section, At});
behind(_Robot, #{held := false}) -> ok.

begins(Robot, Way, #{since := Since, ahead := Ahead}) ->
    ok = starl:measure(Robot, wait_s, (starl:now(Robot) - Since) / 1000),
    Place = starl_sections:position(Robot),
    _ = [
        starl:measure(Robot, gap_mm, starl_geometry:distance(Place, {X, Y}))
     || Other <- lists:nthtail(max(0, length(Ahead) - 1), Ahead),
        {ok, {X, Y, _}} <- [starl:position(Robot, Other)]
    ],
    starl:draw(Robot, #{key => section, area => starl_drawing:circle(lists:last(Way), 165)}).

%% @doc How many came through all doors, and when; and how near robots came to each other.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{monitors := #{starl_convoy_monitor := Results}, robots := Robots}) ->
    #{passes := Passes, last_us := LastUs, least_mm := Least} = Results,
    There = length([Id || {Id, #{result := {done, arrived}}} <- Robots]),
    #{
        figures => [
            {there, There}, {passes, Passes}, {seconds, LastUs / 1.0e6}, {least_mm, Least}
        ],
        formats => #{
            seconds => #{
                decimals => 1, label => "time until the last has come, s", plotted => true
            },
            least_mm => #{decimals => 1, rounded => down}
        },
        complete => There =:= length(Robots),
        done => io_lib:format("~b robots through the doors, ~b passes in order", [There, Passes])
    }.
