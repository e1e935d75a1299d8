%% @doc A room for emulated Creates without an application: their bodies, which bump against each
%% other and the walls. In it a Create lives as in a {@link starl_world}, whose messages these are.
%%
%% Robots stand in rows, 500 mm apart, robot 1 first, and look along their row.
-module(starl_create_room).
-behaviour(gen_server).

-export([start_link/2, poses/2, pose/2, watch/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-record(robot, {
    body :: starl_world_vehicle:t(), create = none :: none | pid(), told_at :: integer()
}).

-record(room, {
    robots :: #{starl:robot_id() => #robot{}},
    %% who is told how a robot moves
    watchers = #{} :: #{starl:robot_id() => pid()},
    floor :: starl_world_floor:t()
}).

-define(APART_MM, 500).

%% @doc Starts a room for this number of Creates of a generation.
-spec start_link([{starl:robot_id(), starl:pose()}], {
    starl_create_packet:model(), starl_world_floor:arena()
}) -> gen_server:start_ret().
start_link(Poses, {Model, Arena}) -> gen_server:start_link(?MODULE, {Poses, Model, Arena}, []).

%% @doc Where this number of robots stand at first; `too_small' if the walls are too near.
-spec poses(pos_integer(), starl_world_floor:arena()) ->
    {ok, [{starl:robot_id(), starl:pose()}]} | too_small.
poses(N, none) ->
    {ok, row(N, N)};
poses(N, {Width, Height}) ->
    case {trunc(Width / ?APART_MM), trunc(Height / ?APART_MM)} of
        {Columns, Rows} when Columns * Rows < N -> too_small;
        {Columns, _Rows} -> {ok, row(N, Columns)}
    end.

row(N, Columns) ->
    [
        {Id, {place((Id - 1) rem Columns), place((Id - 1) div Columns), 0.0}}
     || Id <- lists:seq(1, N)
    ].

place(N) -> float(?APART_MM div 2 + N * ?APART_MM).

%% @doc Where a robot is now.
-spec pose(pid(), starl:robot_id()) -> starl:pose().
pose(Room, Id) -> gen_server:call(Room, {pose, Id}).

%% @doc Notifies the caller of each change of a robot's motion, `{moves, Room, Id, Piece}'; times
%% are of `erlang:system_time(microsecond)'.
-spec watch(pid(), starl:robot_id()) -> ok.
watch(Room, Id) -> gen_server:call(Room, {watch, Id}).

-spec init({[{starl:robot_id(), starl:pose()}], 1 | 2, starl_world_floor:arena()}) -> {ok, #room{}}.
init({Poses, Model, Arena}) ->
    World = #{profiles => profiles(Model), seed => 1, actuation => [], location => []},
    Now = now_us(),
    again(),
    {ok, #room{
        floor = starl_world_floor:new(#{arena => Arena}),
        robots = maps:from_list([{Id, robot(Id, Pose, Now, World)} || {Id, Pose} <- Poses])
    }}.

profiles(1) -> starl_chassis_choice:profiles(create_1, #{});
profiles(2) -> starl_chassis_choice:profiles(create, #{}).

robot(Id, Pose, Now, World) ->
    {_, Body} = starl_world_vehicle:new(Id, Pose, World),
    #robot{body = Body, told_at = Now}.

%% The time of the robots' words.
now_us() -> erlang:system_time(microsecond).

again() ->
    _ = erlang:send_after(starl_world_floor:period_us() div 1000, self(), feel),
    ok.

-spec handle_call(term(), gen_server:from(), #room{}) -> {reply, term(), #room{}}.
handle_call({inhabit, Id}, {Create, _}, #room{robots = Robots} = Room) ->
    #{Id := Robot} = Robots,
    {reply, ok, Room#room{robots = Robots#{Id := Robot#robot{create = Create}}}};
handle_call({watch, Id}, {Watcher, _}, #room{watchers = Watchers} = Room) ->
    {reply, ok, Room#room{watchers = Watchers#{Id => Watcher}}};
handle_call({pose, Id}, _From, #room{robots = Robots} = Room) ->
    #{Id := #robot{body = Body}} = Robots,
    {Id, Pose, _} = starl_world_vehicle:on_floor(Id, now_us(), Body),
    {reply, Pose, Room}.

-spec handle_cast(term(), #room{}) -> {noreply, #room{}}.
handle_cast(_Request, Room) -> {noreply, Room}.

-spec handle_info(term(), #room{}) -> {noreply, #room{}}.
handle_info({starl_body, Id, Create, {at, At, What}}, #room{robots = Robots} = Room) ->
    case Robots of
        #{Id := #robot{create = Create} = Robot} -> {noreply, hears(What, Id, At, Robot, Room)};
        #{} -> {noreply, Room}
    end;
handle_info(feel, #room{robots = Robots} = Room) ->
    again(),
    {noreply, feel(now_us(), maps:keys(Robots), Room)};
handle_info(_Message, Room) ->
    {noreply, Room}.

hears({drive, Script, _Until, Mark}, Id, Told, #robot{told_at = Before, body = Body}, Room) ->
    At = max(Before, Told),
    {_, _, Moved} = starl_world_vehicle:drive(Script, Mark, At, Body),
    #room{floor = Floor} = Next = moved(Id, At, Moved, Room),
    feel(At, [Id], Next#room{floor = starl_world_floor:commanded(Id, Floor)});
hears(_Other, _Id, _At, _Robot, Room) ->
    Room.

moved(Id, At, Body, #room{robots = Robots, watchers = Watchers} = Room) ->
    #{Id := Robot} = Robots,
    _ = [W ! {moves, self(), Id, starl_world_vehicle:piece(Body)} || #{Id := W} <- [Watchers]],
    Room#room{robots = Robots#{Id := Robot#robot{body = Body, told_at = At}}}.

feel(At, Ids, #room{robots = Robots, floor = Floor} = Room) ->
    Bodies = [
        starl_world_vehicle:on_floor(Id, At, Body)
     || {Id, #robot{body = Body}} <- lists:sort(maps:to_list(Robots))
    ],
    {Changes, Next} = starl_world_floor:look(Ids, Bodies, Floor),
    lists:foldl(fun(Change, R) -> touched(At, Change, R) end, Room#room{floor = Next}, Changes).

touched(At, {Id, {_Bits, IsBlocked} = Touch}, #room{robots = Robots} = Room) ->
    #{Id := #robot{create = Create, body = Body, told_at = Before}} = Robots,
    _ = is_pid(Create) andalso (Create ! {starl_body_touches, Touch}),
    Then = max(At, Before),
    case IsBlocked of
        true -> moved(Id, Then, element(3, starl_world_vehicle:stop(Then, Body)), Room);
        false -> Room
    end.
