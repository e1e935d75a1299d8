%% Several emulated Creates in one room, each behind a pty: they bump, and their drivers tell it.
-module(starl_create_room_SUITE).
-include_lib("stdlib/include/assert.hrl").
-compile([export_all, nowarn_export_all]).

-define(AFTER_MS, 30000).
-define(LONG_US, 20000000).

%% It waits for robots that always have something to say: a wait in vain must end with its line.
suite() -> [{timetrap, {minutes, 10}}].

all() -> [bumped, wall, held_in_a_room, held_in_a_world, seen_where_it_is, no_room].

init_per_suite(Config) ->
    case starl_create_program:path() of
        {ok, _} -> Config;
        {error, Reason} -> {skip, lists:flatten(starl_create_program:format_error(Reason))}
    end.

end_per_suite(_) -> ok.

%% 1 drives into 2: its driver tells it and stops, and 2 feels nothing. It can drive away.
bumped(_) ->
    {ok, Room, [One, Two]} = starl_create_on_ptys:start_link(options(2, none)),
    Chassis = ready(1, One),
    ok = elsewhere(2, Two),
    Bumped = bumps(Chassis),
    ?assertEqual({bump, both}, event(1)),
    {X1, _, _} = starl_create_room:pose(Room, 1),
    {X2, _, _} = starl_create_room:pose(Room, 2),
    ?assertEqual(750.0, X2),
    %% they touch, and do not lie above each other: as far as a late look allows
    ?assert(X2 - X1 =< 330.0),
    ?assert(X2 - X1 > 165.0),
    ?assertEqual({bump, none}, freed(Bumped)),
    receive
        {starl_create, 2, Event} -> error(Event)
    after 0 -> ok
    end.

wall(_) ->
    {ok, Room, [One]} = starl_create_on_ptys:start_link(options(1, {600, 600})),
    {{leg, {stalled, _}}, _} = until(answer, drives(200.0, leg, ready(1, One))),
    ?assertEqual({bump, both}, event(1)),
    {X, _, _} = starl_create_room:pose(Room, 1),
    ?assert(X >= 435.0).

%% One that stands against another and is told to drive on does not move at all; the other way it does.
held_in_a_room(_) ->
    {ok, Room} = starl_create_room:start_link(touching(), {2, none}),
    ok = starl_world:inhabit(Room, 1),
    held(Room),
    here(starl_create_room:pose(Room, 1)),
    drive(Room, -1.0e5),
    touches({3, false}).

held_in_a_world(_) ->
    World = world(touching()),
    ok = starl_world:inhabit(World, 1),
    held(World),
    #{robots := [{1, #{pose := Pose}}, _]} = starl_world:finish(World),
    here(Pose),
    drive(World, -1.0e5),
    touches({3, false}).

%% A look asks the hardware first: what it did before is heard late, and the picture is right all the same.
seen_where_it_is(_) ->
    World = world([{1, {0.0, 0.0, 0.0}}, {2, {9000.0, 0.0, 0.0}}]),
    ok = starl_world:inhabit(World, 1),
    Begin = erlang:system_time(microsecond) - 200000,
    drive(World, 500.0, Begin),
    World ! {starl_look, 2, self(), [1]},
    receive
        {starl_settle, World, N} ->
            drive(World, 0.0, Begin + 100000),
            World ! {starl_settled, 1, N}
    after ?AFTER_MS -> error(not_asked)
    end,
    receive
        {starl_seen, [{1, {X, _, _}, _}]} -> ?assert(abs(X - 50.0) < 5.0, X)
    after ?AFTER_MS -> error(not_seen)
    end.

world(Poses) ->
    Sim = #{
        profiles => starl_chassis_choice:profiles(create, #{}),
        seed => 1,
        actuation => [],
        location => []
    },
    Plan = #{robots => Poses, world => Sim, monitors => [], limit_us => 1 bsl 40},
    %% the run began a second ago
    Clock = starl_live_clock:new(erlang:system_time(microsecond) - 1000000, 1),
    {ok, World} = starl_world:start_link(#{plan => Plan, clock => Clock}),
    World.

%% Only its heading is a little off, as that of every robot.
here({X, Y, _Heading}) -> ?assertEqual({0.0, 0.0}, {X, Y}).

touching() -> [{1, {0.0, 0.0, 0.0}}, {2, {329.0, 0.0, 0.0}}].

%% It touches before it drives; so fast that the shortest time would show.
held(World) ->
    touches({3, false}),
    drive(World, 1.0e5),
    touches({3, true}).

drive(World, V) -> drive(World, V, erlang:system_time(microsecond)).

drive(World, V, At) ->
    Drive = {drive, {starl_chassis_differential, [{V, V, ?LONG_US}]}, 1 bsl 60, wheels},
    World ! {starl_body, 1, self(), {at, At, Drive}}.

touches(Wanted) ->
    receive
        {starl_body_touches, Touch} -> ?assertEqual(Wanted, Touch)
    after ?AFTER_MS -> error({late, Wanted})
    end.

no_room(_) ->
    ?assertEqual({error, too_small}, starl_create_on_ptys:start_link(options(3, {600, 900}))),
    ?assertEqual(
        {error, no_number}, starl_create_on_ptys:start_link((options(2, none))#{link := "/tmp/x"})
    ).

%% -- robots ---------------------------------------------------------------------------------

options(N, Arena) -> #{model => 2, robots => N, arena => Arena, link => none, quirks => #{}}.

ready(Id, {_Create, _OnPty, Device}) ->
    {ok, Chassis} = starl_create_chassis:open(#{
        robot => Id,
        clock => starl_live_clock:new(erlang:system_time(microsecond), 1),
        port => {starl_create_port, #{}},
        create => #{model => 2, device => Device},
        events => self()
    }),
    {ready, Ready} = until({event, Id}, Chassis),
    Ready.

%% Another robot, in a process of its own since the words of all ports look the same. It tells us its
%% events.
elsewhere(Id, Robot) ->
    Self = self(),
    _ = spawn_link(fun() ->
        Ready = ready(Id, Robot),
        Self ! {ready, Id},
        events(Id, Self, Ready)
    end),
    receive
        {ready, Id} -> ok
    after ?AFTER_MS -> error(late)
    end.

events(Id, Self, Chassis) ->
    {Event, Next} = until({event, Id}, Chassis),
    Self ! {starl_create, Id, Event},
    events(Id, Self, Next).

drives(V, Mark, Chassis) ->
    Script = {starl_chassis_differential, [{V, V, ?LONG_US}]},
    {[], Driving} = starl_create_chassis:drive(Script, infinity, Mark, Chassis),
    Driving.

%% The chassis hears, until it has answered, or told an event.
until({event, Id} = What, Chassis) ->
    receive
        {starl_create, Id, Event} -> {Event, Chassis};
        Message -> hears(What, Message, Chassis)
    after ?AFTER_MS -> error(late)
    end;
until(answer = What, Chassis) ->
    receive
        Message when element(1, Message) =/= starl_create -> hears(What, Message, Chassis)
    after ?AFTER_MS -> error(late)
    end.

hears(What, Message, Chassis) ->
    case starl_create_chassis:hear(Message, Chassis) of
        {Said, Next} ->
            answered(What, [Answer || {Mark, _} = Answer <- Said, Mark =/= sensed], Next);
        unknown ->
            until(What, Chassis)
    end.

answered(answer, [Answer], Chassis) -> {Answer, Chassis};
answered(What, _Answers, Chassis) -> until(What, Chassis).

%% Robot 1 drives on, until it bumps. On a machine that is busy for long, the port cuts a script short, and the
%% answer is another: it is driven again, as a robot would.
bumps(Chassis) ->
    case until(answer, drives(200.0, bump, Chassis)) of
        {{bump, {driven, _}}, Next} -> bumps(Next);
        {{bump, {stalled, _}}, Next} -> Next
    end.

%% It drives back, until it touches nothing: again, too, whatever it is answered before that.
freed(Chassis) -> back(drives(-200.0, back, Chassis)).

back(Chassis) ->
    receive
        {starl_create, 1, Event} ->
            Event;
        Message ->
            case starl_create_chassis:hear(Message, Chassis) of
                {[{back, _}], Next} -> freed(Next);
                {_Sensed, Next} -> back(Next);
                unknown -> back(Chassis)
            end
    after ?AFTER_MS -> error(late)
    end.

event(Id) ->
    receive
        {starl_create, Id, Event} -> Event
    after ?AFTER_MS -> error(late)
    end.
