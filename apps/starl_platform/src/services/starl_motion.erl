%% @doc Drives the robot. It drives to a point along a straight line, in legs, with a check of the
%% position before each. Or it drives with a velocity until another command comes. Each drive has an
%% end. The chassis plans a leg or a cruise, and its commands ({@link starl_chassis}); this machine
%% is the same for every chassis.
%% ```
%%   idle      go_to: halting
%%   halting   stands: locating, or idle without a goal;   no answer: halting again
%%   locating  a pose: driving, or idle at the goal;       no answer: locating again
%%   driving   stands: locating;   stalled: stalled;       no answer: halting
%%   stalled   half a second later: trying
%%   trying    stands: locating;   stalled: stalled;       no answer: halting
%%
%%   locating  the controller waits: waiting
%%   waiting   the wait is over: halting
%%
%%   any but stalled, trying   velocity: steering
%%   steering  a pose: cruising; go_to, stop: halting;     no answer: halting
%%   cruising  stands, as its time is up: idle; velocity: steering; stalled: stalled;
%%             go_to, stop: halting;                       no answer: halting
%% '''
%% Its controller decides whether it waits before a leg, and how it drives with a velocity
%% ({@link starl_controller}).
%%
%% While the robot drives, it depends on the chassis alone. Every command has a duration. So a robot
%% whose program crashes, pauses, is late or has a wrong clock stops by itself at the planned place,
%% within its leg. The next step depends on the chassis' answer that the robot stands, and on a
%% check of the position. A time-out reveals a lost command or answer. A robot checks its position
%% only after it was commanded to stop and has answered that it stands.
%%
%% A chassis stops when it finds that its drive does not obey, and reports it. The machine then
%% tries the reverse of the failed command, slowly and for a moment. If the drive still does not
%% obey, the try takes the robot back to its place; if the drive obeys again, the doubt is over. A
%% robot in front of an obstacle obeys on its way back, and not forwards again, so each try takes it
%% a little farther back. If one more try could take it out of the tracking radius, it checks its
%% position, and tries the beginning of its next step instead.
%%
%% A robot that drives under a lease must not resume after an unnoticed pause. So each leg of a
%% drive along a given line begins just after an answer of the chassis, and only while its clock and
%% the robot's agree ({@link starl_motion_clock_check}).
%%
%% A cruise is one script, too, whose end is the end of its dead-man's time. A robot that gets
%% another velocity checks its position while it still drives, and its new script replaces the old
%% one. A robot that gets no position stops.
%%
%% Calls. `{go_to, point()}' drives to this point, in a straight line from the robot's place.
%% `{go_along, segment()}' drives along this line, near which the robot stands, to its exact end.
%% `{face, segment()}' drives to the beginning of this line, near which the robot stands, ready to
%% follow it (two wheels: facing along it). The answer is `ok' on arrival. It is `{error, stopped}'
%% when another command comes first, and, except for `go_to', `{error, out_of_time}' when the clocks
%% do not agree. It is `{error, blocked}' when the robot has run against something three times on a
%% floor plan. A `go_to' never gives up, but `{go_to, point(), until_blocked}' does.
%%
%% `{velocity, {VX, VY}, Us}' drives on with this velocity (mm/s, along the axes of the floor) for
%% that time. It is answered at once: `ok'; `{error, unknown}' without a position; `{error,
%% stalled}' while a drive does not obey; `{error, stopped}'. `stop' is answered when the robot
%% stands: `ok', or `{error, out_of_time}' when the clocks do not agree. `wall_mm' is answered by
%% `{ok, Mm}': so far from walls a path keeps the body clear of them; `{ok, none}' without walls.
%%
%% Configuration: `profiles', from which the machine takes that of its robot
%% ({@link starl_chassis:profiles()}); `solid' (false): are there walls, and obstacles?
-module(starl_motion).
-behaviour(starl_machine).

-export([stop/0]).
-export([init/1, handle_event/5]).

-export_type([event/0]).

%% The time to wait for a position or for an answer of the chassis before asking again.
-define(PATIENCE_US, 500000).
%% The time between two tries of a drive that does not obey.
-define(REST_US, 500000).
%% A robot that stands and was seen within this time is not looked for again.
-define(SEEN_US, 100000).
%% Something blocks a robot that has run against it so often, and has come back each time.
-define(STALLS, 3).
%% The room that a path leaves beside a body (mm).
-define(MARGIN_MM, 10.0).

-type event() ::
    %% it drives on with this velocity, within its limits, until told otherwise, for at most this time
    {velocity, starl_geometry:point(), Us :: pos_integer()}
    %% because the time is up, or a command other than a velocity came, a new incarnation began, the
    %% drive does not obey, or the robot got no position or no answer of its chassis
    | {velocity_over, time | command | restarted | stalled | unknown | no_answer}
    %% it is to drive to this point
    | {goal, starl_chassis:mode(), starl_geometry:point()}
    %% along this line, since now it knows where it stands
    | {line, starl_geometry:segment()}
    %% it has arrived, or another command came, or the clocks do not agree, or something is in the way
    | {goal_over, arrived | command | out_of_time | blocked}.

-type state() ::
    idle | halting | locating | driving | waiting | stalled | trying | steering | cruising.

%% A drive goes to a point, along a given line, or to the beginning of one.
-record(goal, {
    mode = to :: starl_chassis:mode(),
    %% does it give up if something blocks it?
    gives_up = true :: boolean(),
    start = unknown :: starl_geometry:point() | unknown,
    point = {0.0, 0.0} :: starl_geometry:point(),
    %% is the line to it known?
    known = false :: boolean(),
    %% how often in a row the drive has not obeyed
    stalls = 0 :: non_neg_integer(),
    %% how long the robot has waited, us
    waited = 0 :: non_neg_integer()
}).

-record(drive, {
    self :: starl:robot_id(),
    chassis :: module(),
    profile :: starl_chassis:profile(),
    solid :: boolean(),
    %% the caller of the drive, and the callers of `stop'
    from = none :: starl_machine:from() | none,
    waiting = [] :: [starl_machine:from()],
    goal = #goal{} :: #goal{},
    %% is its caller that of a goal?
    bound = false :: boolean(),
    %% the velocity that it is given, and until when; does an earlier one still hold?
    wish = {{0.0, 0.0}, 0} :: {starl_geometry:point(), UntilUs :: integer()},
    cruises = false :: boolean(),
    %% the chassis' memo for the step after a look; none while its drive is in doubt
    memo = none :: {some, starl_chassis:memo()} | none,
    %% numbers of the last command and of the last look
    command = 0 :: non_neg_integer(),
    asked = 0 :: non_neg_integer(),
    %% the robot's clock; the time and the duration of the last command; the comparison of this
    %% clock with that of the chassis, which must agree along given lines
    now :: integer(),
    told = {0, {0, 0}} :: {ToldUs :: integer(), Takes :: {Least :: integer(), Most :: integer()}},
    watch :: starl_motion_clock_check:t(),
    %% the chassis has answered that it stands, and has had no other command since; the pose then
    %% seen, and its time
    stands = false :: boolean(),
    seen = none :: {starl:pose(), AtUs :: integer()} | none,
    %% where its last step was planned: every leg and every try begins with a look that is no older
    place = unknown :: starl_geometry:point() | unknown,
    %% the robots that it saw with its pose, if its controller looks for them
    poses = #{} :: #{starl:robot_id() => starl:pose()},
    %% the last script
    script = [] :: starl_chassis:commands(),
    %% the next try, if the drive did not obey, or may not have, and has not obeyed since
    doubt = none :: {ok, starl_chassis:commands()} | none
}).

%% @doc The action that stops the robot.
-spec stop() -> starl_machine:action().
stop() -> {cast, motion, stop}.

-spec init(starl_machine:config()) ->
    {state(), #drive{}, [starl_machine:action()]}.
init(#{incarnation := Incarnation} = Config) ->
    Over = [{trace, {velocity_over, restarted}} || Incarnation > 1],
    {next_state, State, Drive, Actions} = begun(Config),
    {State, Drive, Over ++ Actions}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), #drive{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, State, Drive, #{now := Now}) ->
    event(Type, Content, State, Drive#drive{now = Now}).

event(info, {Word, N, What}, State, Drive) when Word =:= driven; Word =:= stalled ->
    case Drive of
        #drive{command = N} -> ended({Word, What}, State, Drive);
        #drive{} -> late({Word, What}, Drive)
    end;
event(info, {restarted, Machine}, State, Drive) ->
    restarted(Machine, State, Drive);
event(state_timeout, Word, State, Drive) ->
    timed_out(Word, State, Drive);
event({reply, N}, Answer, State, Drive) ->
    case Drive of
        #drive{asked = N} -> looked(Answer, State, Drive);
        #drive{} -> keep_state_and_data
    end;
event({call, From}, Call, State, Drive) ->
    called(Call, From, State, Drive);
event(cast, stop, _State, Drive) ->
    stop([], Drive);
event(_, _, _, _) ->
    unknown_event.

%% The answer to its last look.
looked({ok, #{} = Poses}, State, #drive{self = Self} = Drive) ->
    Own =
        case Poses of
            #{Self := Pose} -> {ok, Pose};
            #{} -> {error, unknown}
        end,
    looked(Own, State, Drive#drive{poses = Poses});
looked({ok, Pose}, locating, Drive) ->
    located(Pose, Drive);
looked({ok, Pose}, steering, Drive) ->
    cruise(Pose, Drive);
looked({error, _}, steering, Drive) ->
    blind(Drive);
looked(_, _State, _Drive) ->
    keep_state_and_data.

called({go_to, Goal}, From, State, Drive) ->
    go(#goal{mode = to, point = Goal, gives_up = false}, From, State, Drive);
called({go_to, Goal, until_blocked}, From, State, Drive) ->
    go(#goal{mode = to, point = Goal}, From, State, Drive);
called({go_along, {Start, End}}, From, State, Drive) ->
    go(#goal{mode = along, start = Start, point = End}, From, State, Drive);
called({face, {Start, End}}, From, State, Drive) ->
    go(#goal{mode = face, start = Start, point = End}, From, State, Drive);
called({velocity, _, _}, From, State, Drive) when State =:= stalled; State =:= trying ->
    {keep_state, Drive, [{reply, From, {error, stalled}}]};
called({velocity, Velocity, Us}, From, State, Drive) ->
    steer(Velocity, Us, From, State, Drive);
called(stop, From, _State, Drive) ->
    stop([From], Drive);
called(wall_mm, From, _State, Drive) ->
    {keep_state_and_data, [{reply, From, {ok, wall_mm(Drive)}}]};
called(_Call, _From, _State, _Drive) ->
    unknown_event.

%% The body, and how far it may be from its line.
wall_mm(#drive{solid = false}) ->
    none;
wall_mm(#drive{chassis = Chassis, profile = Profile}) ->
    starl_chassis:radius_mm(Profile) + Chassis:tracking_radius(Profile) + ?MARGIN_MM.

%% The chassis' answer to the last command.
ended({driven, _}, steering, Drive) ->
    passes(Drive);
ended({driven, _} = Driven, cruising, Drive) ->
    cruise_over(time, Driven, Drive);
ended({stalled, _} = Stalled, State, Drive) when State =:= cruising; State =:= steering ->
    cruise_over(stalled, Stalled, Drive);
ended({driven, HeardUs}, State, Drive) when is_integer(HeardUs) ->
    driven(HeardUs, State, Drive);
ended({stalled, Told}, State, Drive) when State =:= driving; State =:= trying ->
    stalled(Told, Drive);
ended(Answer, _State, Drive) ->
    late(Answer, Drive).

%% An answer to an earlier command, or one that comes too late.
late({driven, Us}, _Drive) when is_integer(Us) ->
    keep_state_and_data;
late({stalled, Told}, Drive) ->
    case undo(Told, Drive) of
        unknown -> unknown_event;
        _ -> keep_state_and_data
    end;
late(_Answer, _Drive) ->
    unknown_event.

restarted(location, locating, Drive) -> locate(Drive);
restarted(location, steering, Drive) -> sight(Drive);
restarted(_, _State, _Drive) -> keep_state_and_data.

timed_out(heard_nothing, cruising, Drive) ->
    cruise_over(no_answer, heard_nothing, Drive);
timed_out(ask, steering, Drive) ->
    blind(Drive);
timed_out(try_again, stalled, Drive) ->
    try_again(Drive);
timed_out(heard_nothing, halting, Drive) ->
    stand_still(Drive);
timed_out(heard_nothing, _State, Drive) ->
    unheard(Drive);
timed_out(ask, locating, Drive) ->
    unseen(Drive);
timed_out(go_on, waiting, Drive) ->
    stand_still(Drive);
timed_out(_, _, _) ->
    unknown_event.

%% -- goals ----------------------------------------------------------------------------------

%% The drive of a motion that boots: it stops the robot.
begun(#{robot := Self, profiles := Profiles, incarnation := Incarnation, now := Now} = Config) ->
    Profile = starl_chassis:of_robot(Self, Profiles),
    stand_still(#drive{
        self = Self,
        chassis = starl_chassis:kind(Profile),
        profile = Profile,
        solid = maps:get(solid, Config, false),
        watch = starl_motion_clock_check:new(Profile),
        now = Now,
        %% a robot that still drives must not accept an answer to an earlier incarnation's command
        command = Incarnation bsl 32
    }).

%% It is to drive to this goal, for this caller. A robot that stands looks; one that drives stops first;
%% one that waits for its drive keeps waiting.
go(Goal, From, State, #drive{stands = Stands} = Drive) ->
    Going = Drive#drive{from = From, bound = true, goal = Goal, memo = none},
    Actions = stopped(Drive) ++ [{trace, {goal, Goal#goal.mode, heads_to(Goal)}}],
    case Stands andalso Goal#goal.mode =:= to of
        _ when State =:= stalled -> {keep_state, Going, Actions};
        true -> look(Going, Actions);
        false -> stand_still(Going, Actions)
    end.

heads_to(#goal{mode = face, start = Start}) -> Start;
heads_to(#goal{point = Point}) -> Point.

%% It is to stop; these callers wait until it stands.
stop(Waits, #drive{waiting = Waiting} = Drive) ->
    stand_still(Drive#drive{from = none, waiting = Waiting ++ Waits}, stopped(Drive)).

stopped(#drive{from = none}) ->
    [];
stopped(#drive{from = From} = Drive) ->
    goal_over(command, Drive) ++ [{reply, From, {error, stopped}}].

goal_over(Why, #drive{bound = Bound}) -> [{trace, {goal_over, Why}} || Bound].

over(Why) -> {trace, {velocity_over, Why}}.

%% -- a velocity -----------------------------------------------------------------------------

%% It gets a velocity for this time, and checks its position, whether it stands or drives. Callers
%% that wait until it stands are notified that it does not. A drive of whose obedience it is not
%% sure is tried first, if it stands; the caller may ask again.
steer(Velocity, Us, From, _State, #drive{doubt = none, waiting = Waiting, now = Now} = Drive) ->
    Interrupted = [{reply, Waits, {error, stopped}} || Waits <- Waiting],
    {next_state, State, Steering, Looks} = sight(Drive#drive{
        from = From, bound = false, wish = {Velocity, Now + Us}, memo = none, waiting = []
    }),
    {next_state, State, Steering, stopped(Drive) ++ Interrupted ++ Looks};
steer(_Velocity, _Us, From, idle, Drive) ->
    {next_state, State, Trying, Commands} = try_now(Drive#drive{from = none}),
    {next_state, State, Trying, stopped(Drive) ++ [{reply, From, {error, stalled}} | Commands]};
steer(_Velocity, _Us, From, _State, Drive) ->
    Stopped = stopped(Drive) ++ [{reply, From, {error, stalled}}],
    stand_still(Drive#drive{from = none}, Stopped).

%% Looks for a velocity.
sight(#drive{asked = N} = Drive) ->
    {next_state, steering, Drive#drive{asked = N + 1}, ask(Drive)}.

ask(#drive{asked = N, self = Self, profile = Profile}) ->
    Question = starl_controller:look(Self, Profile),
    [{call, location, Question, N + 1}, {state_timeout, ?PATIENCE_US, ask}].

%% Drives on with the velocity that it is given, from this pose. The time that the look took is gone.
cruise(Pose, #drive{now = Now, wish = {Wish, Until}, chassis = Chassis} = Drive) ->
    #drive{profile = Profile, from = From, self = Self, poses = Poses} = Drive,
    Us = max(1, Until - Now),
    Velocity = starl_controller:velocity(Wish, Us, {Self, Poses}, Profile),
    Script = Chassis:cruise(Velocity, Pose, Us, Profile),
    {next_state, State, Told, Actions} = command(cruising, Script, Drive#drive{
        from = none, cruises = true
    }),
    Trace = {trace, {velocity, Velocity, Us}},
    {next_state, State, Told, [Trace, {reply, From, ok} | Actions]}.

%% It is given a velocity, and gets no position: it stops.
blind(#drive{from = From} = Drive) ->
    Over = [over(unknown) || Drive#drive.cruises],
    Unknown = [{reply, From, {error, unknown}}],
    stand_still(Drive#drive{from = none, cruises = false}, Over ++ Unknown).

%% It looks for a new velocity, and the time of the old one is up.
passes(#drive{cruises = Cruises} = Drive) ->
    {keep_state, Drive#drive{stands = true, cruises = false}, [over(time) || Cruises]}.

%% A cruise ends, for this reason. It is handled as at the end of a leg.
cruise_over(Why, Answer, #drive{cruises = Cruises, from = From} = Drive) ->
    Waits = [{reply, From, {error, stalled}} || From =/= none],
    case end_of_leg(Answer, Drive#drive{cruises = false, from = none}) of
        {next_state, State, Next, Actions} ->
            {next_state, State, Next, [over(Why) || Cruises] ++ Waits ++ Actions};
        unknown_event ->
            unknown_event
    end.

end_of_leg({driven, HeardUs}, Drive) -> driven(HeardUs, cruising, Drive);
end_of_leg({stalled, Told}, Drive) -> stalled(Told, Drive);
end_of_leg(heard_nothing, Drive) -> unheard(Drive).

%% -- the chassis ----------------------------------------------------------------------------

%% It is to stand, for its own sake.
stand_still(Drive) -> stand_still(Drive, []).

stand_still(#drive{cruises = Cruises} = Drive, Actions) ->
    Still = Drive#drive{memo = none, cruises = false},
    {next_state, State, Halting, Commands} = command(halting, [], Still),
    {next_state, State, Halting, [over(command) || Cruises] ++ Actions ++ Commands}.

command(State, Script, #drive{command = N, now = Now, chassis = Chassis} = Drive) ->
    {_, Most} = Takes = Chassis:duration_us(Script, Drive#drive.profile),
    Told = Drive#drive{
        command = N + 1,
        told = {Now, Takes},
        stands = false,
        seen = still(Script, Drive),
        script = Script
    },
    {next_state, State, Told, [
        {drive, {Chassis, Script}, N + 1}, {state_timeout, Most + ?PATIENCE_US, heard_nothing}
    ]}.

still([], #drive{stands = true, seen = Seen}) -> Seen;
still(_Script, _Drive) -> none.

%% It has no answer to a command: the lost one may have been that the drive does not obey.
unheard(#drive{chassis = Chassis, script = Script} = Drive) ->
    stand_still(Drive#drive{doubt = Chassis:undo(Chassis:last(Script))}, []).

%% The chassis stands; it heard the command at this time of its clock.
driven(HeardUs, State, #drive{now = Now, told = {Told, Takes}, watch = Before} = Drive) ->
    {Agree, Watch} = starl_motion_clock_check:agree({Told, Takes, Now}, HeardUs, Before),
    %% a drive that has obeyed in a try obeys, even if the clocks do not agree
    Doubt =
        case State of
            trying -> none;
            _ -> Drive#drive.doubt
        end,
    Counted =
        case State of
            driving -> Drive#drive.goal#goal{stalls = 0};
            _ -> Drive#drive.goal
        end,
    stands(Agree, Drive#drive{stands = true, watch = Watch, doubt = Doubt, goal = Counted}).

%% A robot without a goal rests; a wrong clock takes a robot's goal away.
stands(Agree, #drive{from = none} = Drive) ->
    rest(Agree, Drive, []);
stands(Agree, #drive{waiting = Waiting} = Drive) ->
    case hindrance(Agree, Drive) of
        none ->
            look(Drive#drive{waiting = []}, stood(Agree, Waiting));
        Why ->
            {Over, Left} = given_up(Why, Drive),
            rest(Agree, Left, Over)
    end.

%% What ends the drive to its goal before it has arrived.
hindrance(false, #drive{goal = #goal{mode = Mode}}) when Mode =/= to ->
    out_of_time;
hindrance(_Agree, #drive{solid = Solid, goal = Goal}) ->
    case Solid andalso is_blocked(Goal) of
        true -> blocked;
        false -> none
    end.

%% Does an obstacle block its line?
is_blocked(#goal{gives_up = GivesUp, stalls = Stalls}) -> GivesUp andalso Stalls >= ?STALLS.

given_up(Why, #drive{from = From} = Drive) ->
    {goal_over(Why, Drive) ++ [{reply, From, {error, Why}}], Drive#drive{from = none}}.

rest(Agree, #drive{waiting = Waiting} = Drive, Actions) ->
    {next_state, idle, Drive#drive{waiting = []}, Actions ++ stood(Agree, Waiting)}.

stood(true, Waiting) -> [{reply, From, ok} || From <- Waiting];
stood(false, Waiting) -> [{reply, From, {error, out_of_time}} || From <- Waiting].

%% Its drive may not obey: it tries it, or looks first.
try_again(Drive) ->
    case may_back(Drive) of
        true -> try_now(Drive);
        false -> locate(Drive, [])
    end.

try_now(#drive{doubt = {ok, Script}} = Drive) -> command(trying, Script, Drive).

%% May it try in any direction? It must be sure to stay on its line then. Its place was seen with an
%% error.
may_back(#drive{solid = false}) ->
    true;
may_back(#drive{from = none}) ->
    true;
may_back(#drive{goal = #goal{start = unknown}}) ->
    true;
may_back(#drive{place = unknown}) ->
    false;
may_back(#drive{place = Place, goal = #goal{start = Start, point = Point}} = Drive) ->
    #drive{chassis = Chassis, profile = #{position_error_mm := Error} = Profile} = Drive,
    Off = starl_geometry:point_segment(Place, {Start, Point}),
    Off + Error + Chassis:try_mm(Profile) =< Chassis:tracking_radius(Profile).

%% The step leads along the line, or back to it. Its first command that moves the robot is tried, slowly.
try_on({_, Commands} = Step, #drive{goal = Goal} = Drive) ->
    case {is_blocked(Goal), first_try(Commands, Drive#drive.chassis)} of
        {true, _} ->
            {Over, Left} = given_up(blocked, Drive),
            {next_state, idle, Left, Over};
        {false, {ok, Try}} ->
            command(trying, Try, Drive);
        %% it is to stand: its next step will tell
        {false, none} ->
            leg(Step, Drive)
    end.

first_try(Commands, Chassis) ->
    Tries = [
        Try
     || Command <- Commands,
        {ok, Back} <- [Chassis:undo(Chassis:last([Command]))],
        {ok, Try} <- [Chassis:undo(Chassis:last(Back))]
    ],
    case Tries of
        [Try | _] -> {ok, Try};
        [] -> none
    end.

%% What takes back what the drive has not obeyed, as the chassis tells it.
undo(Told, #drive{chassis = Chassis}) -> Chassis:undo(Told).

%% The drive does not obey. A chassis that was commanded to stop, and reports that it has not, gets
%% the command again.
stalled(Told, #drive{goal = Goal} = Drive) ->
    case undo(Told, Drive) of
        unknown ->
            unknown_event;
        none ->
            stand_still(Drive, []);
        {ok, _} = Doubt ->
            Counted = Goal#goal{stalls = Goal#goal.stalls + 1},
            Doubtful = Drive#drive{stands = true, memo = none, doubt = Doubt, goal = Counted},
            {next_state, stalled, Doubtful, [{state_timeout, ?REST_US, try_again}]}
    end.

%% -- the course -----------------------------------------------------------------------------

%% Uses the pose of a recent look, or looks.
look(#drive{seen = {Pose, At}, now = Now} = Drive, Actions) when
    At =< Now, Now - At < ?SEEN_US
->
    {next_state, State, Next, Course} = step(Pose, Drive),
    {next_state, State, Next, Actions ++ Course};
look(Drive, Actions) ->
    locate(Drive, Actions).

%% Looks where it stands.
locate(Drive) -> locate(Drive, []).

%% It gets no position. It has to stand for a leg along a line, whose beginning is timed.
unseen(#drive{goal = #goal{mode = to}} = Drive) -> locate(Drive, []);
unseen(Drive) -> stand_still(Drive, []).

locate(#drive{asked = N} = Drive, Actions) ->
    {next_state, locating, Drive#drive{asked = N + 1}, Actions ++ ask(Drive)}.

%% It stands here: its next step begins.
located(Pose, #drive{now = Now} = Drive) -> step(Pose, Drive#drive{seen = {Pose, Now}}).

step({X, Y, _} = Pose, #drive{goal = Goal} = Drive) ->
    {Lines, Begun} = with_line({X, Y}, Goal),
    Placed = Drive#drive{place = {X, Y}, goal = Begun},
    {next_state, State, Next, Actions} = follow(next(Pose, Placed), Placed),
    {next_state, State, Next, [{trace, Line} || Line <- Lines] ++ Actions}.

%% The robot knows where it stands, and so its line, which is traced once.
with_line(_Place, #goal{known = true} = Goal) ->
    {[], Goal};
with_line(Place, #goal{start = unknown} = Goal) ->
    with_line(Place, Goal#goal{start = Place});
with_line(_Place, #goal{start = Start, point = Point} = Goal) ->
    {[{line, {Start, Point}}], Goal#goal{known = true}}.

next(Pose, #drive{memo = none, chassis = Chassis, profile = Profile, goal = Goal}) ->
    #goal{mode = Mode, start = Start, point = Point} = Goal,
    Chassis:next(Mode, Pose, {Start, Point}, Profile);
next(Pose, #drive{memo = {some, Memo}, chassis = Chassis, profile = Profile}) ->
    Chassis:resume(Pose, Memo, Profile).

follow(arrived, #drive{from = From} = Drive) ->
    Over = goal_over(arrived, Drive) ++ [{reply, From, ok}],
    {next_state, idle, Drive#drive{from = none}, Over};
follow({_, _} = Step, #drive{doubt = Doubt} = Drive) when Doubt =/= none ->
    case may_back(Drive) of
        true -> try_now(Drive);
        false -> try_on(Step, Drive)
    end;
follow(Step, Drive) ->
    #drive{poses = Poses, self = Self, goal = Goal, profile = Profile} = Drive,
    #goal{waited = Waited} = Goal,
    case starl_controller:leg(Poses, heads_to(Goal), {Self, Waited}, Profile) of
        go -> leg(Step, Drive);
        {wait, Us} -> wait(Us, Drive#drive{goal = Goal#goal{waited = Waited + Us}})
    end.

wait(Us, Drive) -> {next_state, waiting, Drive#drive{memo = none}, [{state_timeout, Us, go_on}]}.

leg({{look, Memo}, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = {some, Memo}});
leg({drive, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = none}).
