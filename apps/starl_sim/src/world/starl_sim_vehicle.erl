%% @doc The vehicle of a simulated robot. It holds the present script of its chassis, its motion
%% segment ({@link starl_sim_chassis}), its other actuators, and its view of the positioning system
%% ({@link starl_sim_positioning}). Faults of actuation, of the serial line and of location act on
%% it.
%%
%% The chassis carries out a script by itself, by its own clock. Every 15 ms, the period in which a
%% Create streams its sensors, it checks whether its drive obeys. Its later steps and answers are
%% {@link plan()}s; the plans of a replaced script are void.
%%
%% All draws are stateless: a hash of the seed, the robot, a count and a purpose. A robot sees the
%% others as they were at the beginning of the present window (`sight' in the world).
-module(starl_sim_vehicle).

-export([new/3, in_world/2, piece/1, drive/4, actuate/4, turn_wheels/2, beat/3, says/2, stop/2]).
-export([bump/2, beat_in_us/1, sense/3, feel/3]).

-export_type([t/0, world/0, change/0, plan/0, beat/0]).

%% The part of a simulation's world that a vehicle looks at.
-type world() :: #{
    seed := integer(),
    profiles := starl_chassis:profiles(),
    location := [starl_run_fault:compiled()],
    actuation := [starl_run_fault:compiled()],
    latency_us => {Min :: non_neg_integer(), Max :: non_neg_integer()},
    atom() => term()
}.

-record(vehicle, {
    id :: starl:robot_id(),
    world :: world(),
    profile :: starl_chassis:profile(),
    %% the module that simulates its chassis
    kind :: module(),
    piece :: starl_trajectory:piece(),
    %% the present command, and its errors; the rest of the script
    command :: starl_sim_chassis:command(),
    errors = {0.0, 1.0} :: starl_sim_chassis:errors(),
    script = [] :: starl_chassis:commands(),
    %% the number of the script; its owner and mark; the answer still due when the robot stands, if
    %% that time was not known beforehand
    run = 0 :: non_neg_integer(),
    owner = none :: owner() | none,
    word = none :: {driven, Mark :: term(), HeardUs :: starl_sim_queue:time()} | none,
    %% the time since which the drive has not obeyed
    off = no :: starl_sim_queue:time() | no,
    %% the line of commands: the number of stops so far, which void the commands under way, and the
    %% time at which the last command arrives: a line keeps their order
    line = {0, 0} :: {Stops :: non_neg_integer(), starl_sim_queue:time()},
    draws = 0 :: non_neg_integer(),
    %% the values of its other actuators, as far as they were ever set
    devices = #{} :: #{atom() => term()},
    %% the last seen poses of robots, if sight may freeze
    seen = #{} :: #{starl:robot_id() => starl:pose()},
    %% on a floor plan: how far it has driven up to this piece of motion (mm), and what its senses
    %% said last, if they may freeze
    driven = 0.0 :: float(),
    felt = #{} :: #{starl_sense:kind() => term()}
}).

-opaque t() :: #vehicle{}.

-type owner() :: {starl_machine:name(), Mark :: term()}.

%% A step of the chassis: go on with the script of this number; handle a drive that has not
%% obeyed since then; hear a script that was under way.
-type beat() ::
    {go_on, Run :: integer()}
    | {watch, Run :: integer(), Since :: integer()}
    | {hears, Stops :: integer(), starl_chassis:commands(), owner()}.

%% A plan, with its delay: a step; an answer to a machine, valid only for the present script; an
%% answer that is always valid.
-type plan() ::
    {Us :: non_neg_integer(), beat()}
    | {Us :: non_neg_integer(), {says, Run :: integer(), starl_machine:name(), Content :: term()}}
    | {Us :: non_neg_integer(), {starl_machine:name(), info, Content :: term()}}.

%% Whether the piece of motion has changed, and the plans.
-type change() :: {moved | same, [plan()], t()}.

%% The period in which the chassis checks its drive (Open Interface, streaming of sensors).
-define(WATCH_US, 15000).

%% @doc A vehicle at rest at a pose.
-spec new(starl:robot_id(), starl:pose(), world()) -> t().
new(Id, {X, Y, Heading}, #{profiles := Profiles} = World) ->
    Profile = starl_chassis:of_robot(Id, Profiles),
    Kind = starl_chassis:simulation(Profile),
    #vehicle{
        id = Id,
        world = World,
        profile = Profile,
        kind = Kind,
        command = Kind:standing(),
        piece = starl_trajectory:standing(0, {X, Y}, Heading)
    }.

%% @doc The same vehicle in a world with other values.
-spec in_world(world(), t()) -> t().
in_world(World, Vehicle) -> Vehicle#vehicle{world = World}.

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#vehicle{piece = Piece}) -> Piece.

%% -- driving --------------------------------------------------------------------------------

%% @doc Gives the chassis a script on behalf of a machine. `lost': the chassis has not heard it;
%% `not_understood': the script is for another chassis.
-spec drive(starl_chassis:script(), owner(), starl_sim_queue:time(), t()) ->
    change() | {lost, t()} | not_understood.
drive({Chassis, Script}, Owner, Now, #vehicle{profile = #{chassis := Chassis}} = Vehicle) ->
    case Vehicle#vehicle.world of
        #{latency_us := Between} -> under_way(Between, Script, Owner, Now, Vehicle);
        #{} -> hear(Script, Owner, Now, Vehicle)
    end;
drive(_Script, _Owner, _Now, _Vehicle) ->
    not_understood.

%% The line takes its time.
under_way({Least, Most}, Script, Owner, Now, #vehicle{id = Id, draws = N, line = Line} = Vehicle) ->
    #vehicle{world = #{seed := Seed}} = Vehicle,
    {Stops, Before} = Line,
    Us = Least + round((Most - Least) * starl_run_draw:uniform({Seed, Id, N, latency})),
    Arrives = max(Before, Now + Us),
    Sent = Vehicle#vehicle{draws = N + 1, line = {Stops, Arrives}},
    {same, [{Arrives - Now, {hears, Stops, Script, Owner}}], Sent}.

hear(Script, Owner, Now, #vehicle{id = Id, draws = N, world = #{seed := Seed}} = Vehicle) ->
    Faults = held(Now, Vehicle),
    case deaf(drive, Faults, {Seed, Id, N}) of
        false -> run(Script, Owner, Faults, Now, Vehicle#vehicle{draws = N + length(Faults)});
        true -> {lost, Vehicle#vehicle{draws = N + 1}}
    end.

%% Is a command to the drive or to another device lost on the line, or an answer of the chassis?
deaf(Whom, Faults, Key) -> lists:any(fun(Fault) -> swallows(Whom, Fault, Key) end, Faults).

swallows(Whom, {Id, _, _, Kind, _, #{part := Part}}, Key) when
    Kind =:= serial_garbage;
    Kind =:= command_lost, Whom =:= drive;
    Kind =:= actuator_lost, Whom =:= device
->
    starl_run_draw:uniform({Key, Id}) < Part;
swallows(_Whom, {_, _, _, serial_gone, _, _}, _Key) ->
    true;
swallows(_Whom, _, _Key) ->
    false.

run(Script, {Name, Mark} = Owner, Faults, Now, #vehicle{run = Run, kind = Kind} = Vehicle) ->
    Next = Vehicle#vehicle{run = Run + 1, owner = Owner, script = Script, word = none},
    Word = {driven, Mark, Now},
    case Kind:lasts_us(Script) of
        unknown ->
            go_on(Faults, Now, Next#vehicle{word = Word});
        Us ->
            {Change, Plans, Running} = go_on(Faults, Now, Next),
            {Change, word(Us, Name, Word, Now, Running) ++ Plans, Running}
    end.

%% Plans an answer of the chassis, if its line carries it at that time, with the line's delay.
word(Us, Name, Word, Now, #vehicle{id = Id, run = Run, draws = N, world = World} = Vehicle) ->
    Key = {maps:get(seed, World), Id, N, word},
    case held(Now + Us, Vehicle) of
        [] ->
            [{Us, {says, Run, Name, Word}}];
        Faults ->
            [{Us + lag(Faults, Key), {says, Run, Name, Word}} || not deaf(nobody, Faults, Key)]
    end.

lag(Faults, Key) when is_list(Faults) -> lists:sum([lag(Fault, Key) || Fault <- Faults]);
lag({Id, _, _, serial_split, _, #{lag_ms := Ms}}, Key) ->
    round(1000 * Ms * starl_run_draw:uniform({Key, Id}));
lag(_, _Key) ->
    0.

go_on(Faults, Now, #vehicle{script = [], kind = Kind} = Vehicle) ->
    stands(Now, move(goes_on, Faults, Now, Vehicle#vehicle{command = Kind:standing()}));
go_on(Faults, Now, #vehicle{script = [First | Script], draws = N, kind = Kind} = Vehicle) ->
    #vehicle{id = Id, run = Run, profile = Profile, world = #{seed := Seed}} = Vehicle,
    {Command, Us} = Kind:command(First, Profile),
    Errors = Kind:errors(Command, {Seed, Id, N}, Profile),
    Told = Vehicle#vehicle{command = Command, script = Script, draws = N + 1, errors = Errors},
    {Change, Plans, Moving} = move(begins, Faults, Now, Told),
    {Change, [{Us, {go_on, Run}} | Plans], Moving}.

%% Now the time at which it will stand is known.
stands(_Now, {_, _, #vehicle{word = none}} = Stopping) ->
    Stopping;
stands(Now, {Change, Plans, #vehicle{word = Word, owner = {Name, _}} = Vehicle}) ->
    Said = word(stops_us(Now, Vehicle), Name, Word, Now, Vehicle),
    {Change, Said ++ Plans, Vehicle#vehicle{word = none}}.

stops_us(Now, #vehicle{kind = Kind, piece = Piece}) -> Kind:stops_us(Now, Piece).

%% @doc The chassis does its planned step.
-spec beat(beat(), starl_sim_queue:time(), t()) -> change().
beat({go_on, Run}, Now, #vehicle{run = Run} = Vehicle) ->
    go_on(held(Now, Vehicle), Now, Vehicle);
beat({watch, Run, Since}, Now, #vehicle{run = Run, off = Since} = Vehicle) ->
    #vehicle{owner = {Name, Mark}, command = Command} = Vehicle,
    {Change, [], Stopped} = stop(Now, Vehicle),
    Us = stops_us(Now, Stopped),
    {Change, word(Us, Name, {stalled, Mark, Command}, Now, Stopped), Stopped};
beat({hears, Stops, Script, Owner}, Now, #vehicle{line = {Stops, _}} = Vehicle) ->
    case hear(Script, Owner, Now, Vehicle) of
        {lost, Deaf} -> {same, [], Deaf};
        Change -> Change
    end;
beat(_, _Now, Vehicle) ->
    {same, [], Vehicle}.

%% @doc Is the planned answer to the script of this number still valid?
-spec says(Run :: integer(), t()) -> boolean().
says(Run, #vehicle{run = Now}) -> Run =:= Now.

%% @doc Adapts the motion when a fault of the drive begins or ends.
-spec turn_wheels(starl_sim_queue:time(), t()) -> change().
turn_wheels(Now, Vehicle) -> move(goes_on, held(Now, Vehicle), Now, Vehicle).

%% @doc Stops the chassis, under all faults; no machine gets an answer.
-spec stop(starl_sim_queue:time(), t()) -> change().
stop(Now, #vehicle{run = Run, kind = Kind, line = {Stops, _}} = Vehicle) ->
    move(goes_on, [], Now, Vehicle#vehicle{
        command = Kind:standing(), script = [], run = Run + 1, word = none, line = {Stops + 1, Now}
    }).

%% @doc The body is held up by what it touches: it stands, and the chassis says that its drive does not
%% obey, as a Create does of a bump.
-spec bump(starl_sim_queue:time(), t()) -> change().
bump(Now, #vehicle{piece = Piece, owner = Owner, command = Command} = Vehicle) ->
    {X, Y, Heading} = starl_trajectory:pose(Now, Piece),
    Standing = starl_trajectory:standing(Now, {X, Y}, Heading),
    {_, [], Stopped} = stop(Now, (driven(Now, Vehicle))#vehicle{piece = Standing}),
    Said =
        case Owner of
            {Name, Mark} -> word(?WATCH_US, Name, {stalled, Mark, Command}, Now, Stopped);
            none -> []
        end,
    {moved, Said, Stopped}.

%% @doc The time until the chassis streams its sensors next. What its body feels is known then: an application that
%% reacts at once does so once a period.
-spec beat_in_us(starl_sim_queue:time()) -> pos_integer().
beat_in_us(Now) -> ?WATCH_US - Now rem ?WATCH_US.

held(_Now, #vehicle{world = #{actuation := []}}) ->
    [];
held(Now, #vehicle{id = Id, world = #{actuation := All}}) ->
    [F || F <- starl_run_fault:holding(Now, All), starl_run_fault:hits(Id, F)].

move(When, Faults, Now, #vehicle{kind = Kind, command = Command, piece = Old} = Vehicle) ->
    #vehicle{errors = Errors, profile = Profile} = Vehicle,
    {IsOff, Motion} = Kind:move({Command, Errors, When}, Faults, Now, Old, Profile),
    {Plans, Watched} = watch(IsOff, Now, Vehicle),
    case Motion of
        same -> {same, Plans, Watched};
        Piece -> {moved, Plans, (driven(Now, Watched))#vehicle{piece = Piece}}
    end.

%% Only a battery asks for it, and only on a floor plan there is one.
driven(Now, #vehicle{world = #{senses := _}, piece = Piece, driven = Mm} = Vehicle) ->
    Since = starl_trajectory:start_us(Piece),
    Vehicle#vehicle{driven = Mm + starl_trajectory:moved(min(Since, Now), Now, Piece)};
driven(_Now, Vehicle) ->
    Vehicle.

watch(false, _Now, #vehicle{off = no} = Vehicle) ->
    {[], Vehicle};
watch(false, _Now, Vehicle) ->
    {[], Vehicle#vehicle{off = no}};
watch(true, Now, #vehicle{off = no} = Vehicle) ->
    watch(true, Now, Vehicle#vehicle{off = Now});
watch(true, Now, #vehicle{off = Since, run = Run} = Vehicle) ->
    {[{max(0, Since + ?WATCH_US - Now), {watch, Run, Since}}], Vehicle}.

%% -- other actuators ------------------------------------------------------------------------

%% @doc Sets another actuator, on behalf of a machine that wants an answer, or of
%% none. Tells whether the value has been set, and plans the answer.
-spec actuate({Device :: atom(), Value :: term()}, owner() | none, starl_sim_queue:time(), t()) ->
    {set | same, [plan()], t()}.
actuate({Device, Value}, Owner, Now, #vehicle{id = Id, draws = N, devices = Old} = Vehicle) ->
    #vehicle{world = #{seed := Seed}} = Vehicle,
    Faults = held(Now, Vehicle),
    Drawn = Vehicle#vehicle{draws = N + length(Faults)},
    case {deaf(device, Faults, {Seed, Id, N, Device}), is_stuck(Faults)} of
        {true, _} ->
            {same, [], Drawn};
        {false, true} ->
            {same, state(Device, maps:get(Device, Old, unknown), Owner, Faults, Vehicle), Drawn};
        {false, false} ->
            Devices = Old#{Device => Value},
            {set, state(Device, Value, Owner, Faults, Vehicle), Drawn#vehicle{devices = Devices}}
    end.

is_stuck(Faults) -> lists:any(fun({_, _, _, Kind, _, _}) -> Kind =:= actuator_stuck end, Faults).

state(_Device, _Value, none, _Faults, _Vehicle) ->
    [];
state(Device, Value, {Name, Mark}, Faults, #vehicle{id = Id, draws = N, world = World}) ->
    Key = {maps:get(seed, World), Id, N, Device, word},
    Word = {Name, info, {actuated, Mark, Device, Value}},
    [{lag(Faults, Key), Word} || not deaf(nobody, Faults, Key)].

%% -- positioning ----------------------------------------------------------------------------

%% @doc The poses of these robots, if they are seen: its own as of now, the others' as of the
%% beginning of the window. `{near, Mm}': its own, and at least those of all robots that it sees at most so
%% far away.
-spec sense([starl:robot_id()] | {near, Mm :: number()}, {Now, WindowFrom}, t()) ->
    {[{starl:robot_id(), starl:pose()}], t()}
when
    Now :: starl_sim_queue:time(), WindowFrom :: starl_sim_queue:time().
sense({near, Mm}, {Now, From} = When, #vehicle{world = #{location := []}} = Vehicle) ->
    #vehicle{id = Id, piece = Piece, profile = Profile, world = #{sight := Sight}} = Vehicle,
    #{position_error_mm := Error} = Profile,
    Far = Mm + 2 * Error + 1.0,
    Near = starl_sim_sight:near(starl_trajectory:position(Now, Piece), Far, From, Sight),
    sense(lists:umerge([Id], Near), When, Vehicle);
sense({near, _Mm}, When, #vehicle{world = #{team := Team}} = Vehicle) ->
    %% a fault may show a robot anywhere
    sense(starl_team:members(Team), When, Vehicle);
sense(Robots, When, #vehicle{draws = N, world = #{location := []}} = Vehicle) ->
    Poses = [{Robot, Pose} || Robot <- Robots, Pose <- see(Robot, When, Vehicle)],
    {Poses, Vehicle#vehicle{draws = N + 1}};
sense(Robots, {Now, _} = When, #vehicle{id = Id, draws = N, world = World} = Vehicle) ->
    {Poses, Seen} = starl_sim_positioning:poses(Robots, #{
        robot => Id,
        faults => starl_run_fault:holding(Now, maps:get(location, World)),
        key => {maps:get(seed, World), Id, N},
        see => fun(Robot) -> see(Robot, When, Vehicle) end,
        seen => Vehicle#vehicle.seen
    }),
    {Poses, Vehicle#vehicle{draws = N + 1, seen = Seen}}.

%% @doc What a sense says: the robot's own place counts as of now, the others' as of the beginning
%% of the window.
-spec feel(starl_sense:kind(), {Now, WindowFrom}, t()) -> {starl_sim_senses:felt(), t()} when
    Now :: starl_sim_queue:time(), WindowFrom :: starl_sim_queue:time().
feel(Kind, {Now, From}, #vehicle{world = #{senses := Senses} = World} = Vehicle) ->
    #vehicle{id = Id, draws = N, profile = Profile, piece = Piece, felt = Before} = Vehicle,
    #vehicle{driven = Driven} = driven(Now, Vehicle),
    {Felt, After} = starl_sim_senses:feel(Kind, Senses, World, #{
        robot => Id,
        pose => starl_trajectory:pose(Now, Piece),
        radius_mm => starl_chassis:radius_mm(Profile),
        driven_mm => Driven,
        now_us => Now,
        window_us => From,
        key => {maps:get(seed, World), Id, N, sense, Kind},
        felt => Before
    }),
    {Felt, Vehicle#vehicle{draws = N + 1, felt = After}};
feel(_Kind, _When, Vehicle) ->
    {unknown, Vehicle}.

see(Id, {Now, _From}, #vehicle{id = Id, piece = Piece} = Vehicle) ->
    [blur(Id, starl_trajectory:pose(Now, Piece), Vehicle)];
see(Other, {_Now, From}, #vehicle{world = #{sight := Sight}} = Vehicle) ->
    case starl_sim_sight:piece(Other, Sight) of
        {ok, Piece} -> [blur(Other, starl_trajectory:pose(From, Piece), Vehicle)];
        unknown -> []
    end.

blur(Robot, Pose, #vehicle{id = Id, draws = N, profile = Profile, world = #{seed := Seed}}) ->
    starl_sim_positioning:blur(Pose, {Seed, Id, Robot, N}, Profile).
