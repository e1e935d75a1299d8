%% @doc A convoy: a column of robots drives through the doors of a building. Only one robot at a
%% time passes a door. The path is the shortest of the floor plan's roadmap
%% ({@link starl_convoy_route}). A token of mutual exclusion guards each section of it: a robot
%% acquires the next section, drives there, and releases the section behind it
%% ({@link starl_sections}). So no robot overtakes another, and at most one is in a door. A robot
%% that cannot advance checks where it stands ({@link starl_convoy_place}).
%%
%% Measures: `gap_mm', the distance from the robot ahead, and `wait_s', the wait for a section.
%% Trace: {@link event()} (see {@link starl_convoy_monitor}).
-module(starl_convoy).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([options/0, scene/1, guarantees/0, measures/0, report/2]).

-export_type([event/0]).

%% The robot has come to this section; it is the one behind this door.
-type event() :: {at, Section :: pos_integer(), Door :: pos_integer() | none}.

%% `ahead': the robot before it, if any. `held': the token of its section, if it has it. `since': when it began to wait (own clock, ms).
-type state() :: #{
    lane := starl_convoy_route:t(),
    floor := starl_floor:t(),
    ahead := [starl:robot_id()],
    at := non_neg_integer(),
    held := [term()],
    since := integer()
}.

-spec options() -> [starl_options:option()].
options() -> [{section, {integer, 550, 5000}, 600, "distance of two robots that wait, mm"}].

-spec measures() -> [{atom(), string()}].
measures() ->
    [
        {gap_mm, "distance from the robot ahead, mm"},
        {wait_s, "waiting for a section of the way, s"}
    ].

%% @doc The guarantees for the robots that wait behind a door.
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
    Config = #{profiles => Profiles, section_mm => Length},
    case starl_convoy_route:column(Ids, Floor, Config) of
        {ok, Lane, Poses} ->
            {ok, #{
                app => {sequential, starl_convoy, #{lane => Lane, floor => Floor}},
                blocks => [starl_mutex],
                floor => Floor,
                poses => Poses,
                %% as its contract says
                apart_mm => 400,
                monitors => [{starl_convoy_monitor, #{robots => lists:sort(Ids), lane => Lane}}],
                never_crashes => true
            }};
        {error, _} = Error ->
            Error
    end.

building(#{floor := #{doors := []}}) -> starl_floor_file:read("doors", 1000);
building(#{floor := Floor}) -> {ok, Floor}.

-spec init(starl:robot(), #{lane := starl_convoy_route:t(), floor := starl_floor:t()}) -> state().
init(Robot, #{lane := Lane} = Known) ->
    Ahead = lists:takewhile(fun(R) -> R =/= starl:id(Robot) end, starl:participants(Robot)),
    _ = Ahead =:= [] andalso starl:draw(Robot, starl_convoy_route:drawing(Lane)),
    At = starl_convoy_place:locate(starl_sections:position(Robot), Lane),
    at(At, Robot, Known#{ahead => lists:nthtail(max(0, length(Ahead) - 1), Ahead)}).

at(At, Robot, State) ->
    Held = starl_sections:take(Robot, {section, At}),
    State#{at => At, held => Held, since => starl:now(Robot)}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, arrived}.
step(Robot, #{lane := Lane, at := At} = State) when At + 1 >= length(Lane) -> arrived(Robot, State);
step(Robot, #{lane := Lane, at := At, held := Held} = State) ->
    #{way := Way, token := Token} = Section = starl_convoy_route:section(At + 1, Lane),
    case starl_sections:enter(Robot, Section, fun() -> begins(Robot, Way, State) end) of
        ok ->
            {_, Door} = lists:nth(At + 2, Lane),
            ok = starl:trace(Robot, {at, At + 1, Door}),
            ok = starl_sections:leave(Robot, Held),
            {continue, State#{at := At + 1, held := [Token], since := starl:now(Robot)}};
        Refused ->
            refused(starl_convoy_place:next(Refused, seen(Robot, State)), Robot, State)
    end.

seen(Robot, #{since := Since} = State) ->
    (maps:with([lane, floor, at], State))#{
        here => starl_sections:position(Robot),
        others => starl_sections:others(Robot),
        waited_ms => starl:now(Robot) - Since
    }.

refused(stay, _Robot, State) ->
    {continue, State};
refused(arrived, Robot, State) ->
    arrived(Robot, State);
refused(Else, Robot, #{held := Held} = State) ->
    ok = starl_sections:leave(Robot, Held),
    {continue, elsewhere(Else, Robot, State#{held := [], since := starl:now(Robot)})}.

elsewhere({at, At}, Robot, State) ->
    at(At, Robot, State);
elsewhere({back, #{token := Token} = Section}, Robot, State) ->
    Entered = starl_sections:enter(Robot, Section, fun() -> ok end),
    State#{held := [Token || Entered =:= ok]};
elsewhere(leave, _Robot, State) ->
    State.

arrived(Robot, #{held := Held}) ->
    ok = starl_sections:leave(Robot, Held),
    {done, arrived}.

begins(Robot, Way, #{since := Since, ahead := Ahead}) ->
    ok = starl:measure(Robot, wait_s, (starl:now(Robot) - Since) / 1000),
    Gaps = [starl_sections:distance(Robot, Other) || Other <- Ahead],
    _ = [starl:measure(Robot, gap_mm, Mm) || {ok, Mm} <- Gaps],
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
            seconds => #{decimals => 1, label => "until the last has come, s", plotted => true},
            least_mm => #{decimals => 1, rounded => down}
        },
        complete => There =:= length(Robots),
        done => io_lib:format("~b robots through the doors, ~b passes in order", [There, Passes])
    }.
