%% @doc Motion: drives to a point along a straight line, in legs, with a look at the position
%% before each, or with a velocity until told otherwise; always with an end. The chassis plans a leg
%% or a cruise, and its commands ({@link starl_chassis}); this machine is the same for every chassis.
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
%% Whether it waits before a leg, and how it drives with a velocity, is said by its controller ({@link starl_controller}).
%%
%% While it drives, it depends on the chassis alone. Every command has a duration, so a robot whose
%% program crashes, pauses, is late or has a wrong clock stops by itself at the planned place,
%% within its leg. The next step depends on the chassis' answer that it stands, and on a look at the
%% position. A time-out reveals a lost command or answer. A robot looks only after it was told to
%% stop and has answered that it stands.
%%
%% A chassis stops when it finds that its drive does not obey, and reports it. The machine then
%% tries the reverse of the failed command, slowly and for a moment: if the drive still does not
%% obey, the try takes the robot back to its place; if the drive obeys again, the doubt is over. A robot
%% that an obstacle holds up obeys on its way back, and not forwards again, so each try takes it a little
%% farther back. Where one more could take it out of the tracking radius, it looks, and tries the beginning
%% of its next step instead.
%%
%% A robot that drives under a lease must not resume after an unnoticed pause. So each leg of a
%% drive along a given line begins just after an answer of the chassis, and only while its clock and
%% the robot's agree ({@link starl_motion_clock_check}).
%%
%% A cruise is one script, too, whose end is the end of its dead-man's time. A robot that is given
%% another velocity looks at its position, while it still drives, and its new script replaces the
%% old one; a robot that gets no position stops.
%%
%% Calls: `{go_to, point()}' drives to this point, in a straight line from the robot's place;
%% `{go_along, segment()}' drives along this line, near which the robot stands, to its exact end;
%% `{face, segment()}' drives to the beginning of this line, near which the robot stands, ready to
%% follow it (two wheels: looking along it). Answers: `ok' on arrival; `{error, stopped}' when
%% another command comes first; `{error, blocked}', of a drive along a given line on a floor plan, when
%% the robot has run against something three times; `{error, out_of_time}', except for `go_to', when the clocks do not
%% agree. `{velocity, {VX, VY}, Us}' drives on with this velocity (mm/s, along the axes of the floor)
%% for that time, and is answered at once: `ok'; `{error, unknown}' without a position, `{error,
%% stalled}' while a drive does not obey, `{error, stopped}'. `stop' is answered when the robot stands: `ok', or `{error, out_of_time}' when the clocks
%% do not agree. Configuration: `profiles', from which the machine takes that of its robot ({@link
%% starl_chassis:profiles()}); `solid' (false): are there walls, and things in the way?
-module(starl_motion).
-behaviour(starl_machine).

-export([stop/0]).
-export([init/1, handle_event/5]).

-export_type([event/0]).

-type event() ::
    %% it drives on with this velocity, within its limits, until told otherwise, for at most this time
    {velocity, starl_geometry:point(), Us :: pos_integer()}
    %% because the time is up, or a command other than a velocity came, a new incarnation began, the
    %% drive does not obey, or the robot got no position or no answer of its chassis
    | {velocity_over, time | command | restarted | stalled | unknown | no_answer}
    %% it is to drive to this point
    | {goal, starl_chassis:way(), starl_geometry:point()}
    %% along this line, since now it knows where it stands
    | {line, starl_geometry:segment()}
    %% it has arrived, or another command came, or the clocks do not agree, or something is in the way
    | {goal_over, arrived | command | out_of_time | blocked}.

%% The time to wait for a position or for an answer of the chassis before asking again.
-define(PATIENCE_US, 500000).
%% The time between two tries of a drive that does not obey.
-define(REST_US, 500000).
%% A robot that stands and was seen within this time is not looked for again.
-define(SEEN_US, 100000).
%% Something is in the way of a robot that has come up against it so often, and back each time.
-define(STALLS, 3).

-type state() ::
    idle | halting | locating | driving | waiting | stalled | trying | steering | cruising.

-record(drive, {
    self :: starl:robot_id(),
    chassis :: module(),
    profile :: starl_chassis:profile(),
    solid :: boolean(),
    %% how often in a row its drive has not obeyed on the way to the present goal
    stalls = 0 :: non_neg_integer(),
    %% the caller of the drive, and the callers of `stop'
    from = none :: starl_machine:from() | none,
    waiting = [] :: [starl_machine:from()],
    start = unknown :: starl_geometry:point() | unknown,
    goal = {0.0, 0.0} :: starl_geometry:point(),
    %% to the goal, or along a given line, or to the beginning of one
    way = to :: starl_chassis:way(),
    %% is its caller that of a goal, and is the line to it known?
    bound = false :: boolean(),
    known = false :: boolean(),
    %% the velocity that it is given, and until when; does an earlier one still hold?
    wish = {{0.0, 0.0}, 0} :: {starl_geometry:point(), UntilUs :: integer()},
    cruises = false :: boolean(),
    %% the chassis' memo for the step after a look
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
    %% the robots that it saw with its pose, if its controller looks for them; how long it has waited on the
    %% way to the present goal
    poses = #{} :: #{starl:robot_id() => starl:pose()},
    waited = 0 :: non_neg_integer(),
    %% the last script
    script = [] :: starl_chassis:commands(),
    %% the next try, if the drive did not obey, or may not have, and has not obeyed since
    doubt = none :: {ok, starl_chassis:commands()} | none
}).

%% @doc The action that stops the robot.
-spec stop() -> starl_machine:action().
stop() -> {cast, motion, stop}.

-spec init(starl_machine:config()) -> {state(), #drive{}, [starl_machine:action()]}.
init(#{robot := Self, profiles := Profiles, incarnation := Incarnation, now := Now} = Config) ->
    Profile = starl_chassis:of_robot(Self, Profiles),
    Drive = #drive{
        self = Self,
        chassis = starl_chassis:kind(Profile),
        profile = Profile,
        solid = maps:get(solid, Config, false),
        watch = starl_motion_clock_check:new(Profile),
        now = Now,
        %% a robot that still drives must not accept an answer to an earlier incarnation's command
        command = Incarnation bsl 32
    },
    Over = [over(restarted) || Incarnation > 1],
    {next_state, halting, Halting, Actions} = stand_still(Drive, Over),
    {halting, Halting, Actions}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), #drive{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, State, Drive, #{now := Now}) ->
    event(Type, Content, State, Drive#drive{now = Now}).

event(info, Word, State, Drive) ->
    informed(Word, State, Drive);
event(state_timeout, Word, State, Drive) ->
    timed_out(Word, State, Drive);
event({reply, N}, {ok, #{} = Poses}, State, #drive{asked = N, self = Self} = Drive) ->
    Own =
        case Poses of
            #{Self := Pose} -> {ok, Pose};
            #{} -> {error, unknown}
        end,
    event({reply, N}, Own, State, Drive#drive{poses = Poses});
event({reply, N}, {ok, Pose}, locating, #drive{asked = N, now = Now} = Drive) ->
    located(Pose, Drive#drive{seen = {Pose, Now}});
event({reply, N}, {ok, Pose}, steering, #drive{asked = N} = Drive) ->
    cruise(Pose, Drive);
event({reply, N}, {error, _}, steering, #drive{asked = N} = Drive) ->
    blind(Drive);
event({reply, _}, _, _State, _Drive) ->
    keep_state_and_data;
event({call, From}, {go_to, Goal}, State, Drive) ->
    go(State, to(From, {unknown, Goal}, to, Drive), stopped(Drive) ++ [goal(to, Goal)]);
event({call, From}, {go_along, {_, Goal} = Line}, State, Drive) ->
    go(State, to(From, Line, along, Drive), stopped(Drive) ++ [goal(along, Goal)]);
event({call, From}, {face, {Start, _} = Line}, State, Drive) ->
    go(State, to(From, Line, face, Drive), stopped(Drive) ++ [goal(face, Start)]);
event({call, From}, {velocity, _, _}, State, Drive) when State =:= stalled; State =:= trying ->
    {keep_state, Drive, [{reply, From, {error, stalled}}]};
event({call, From}, {velocity, _, _}, State, #drive{doubt = Doubt} = Drive) when Doubt =/= none ->
    doubtful(State, Drive#drive{from = none}, stopped(Drive) ++ [{reply, From, {error, stalled}}]);
event({call, From}, {velocity, Velocity, Us}, _State, #drive{now = Now} = Drive) ->
    Wished = Drive#drive{from = From, bound = false, wish = {Velocity, Now + Us}, memo = none},
    steer(Wished, stopped(Drive));
event({call, From}, stop, _State, #drive{waiting = Waiting} = Drive) ->
    stand_still(Drive#drive{from = none, waiting = Waiting ++ [From]}, stopped(Drive));
event(cast, stop, _State, Drive) ->
    stand_still(Drive#drive{from = none}, stopped(Drive));
event(_, _, _, _) ->
    unknown_event.

%% Words of the chassis, and of machines that have restarted.
informed({driven, N, _}, steering, #drive{command = N, cruises = Cruises} = Drive) ->
    {keep_state, Drive#drive{stands = true, cruises = false}, [over(time) || Cruises]};
informed({driven, N, _} = Driven, cruising, #drive{command = N} = Drive) ->
    ended(time, Driven, Drive);
informed({stalled, N, _} = Stalled, State, #drive{command = N} = Drive) when
    State =:= cruising; State =:= steering
->
    ended(stalled, Stalled, Drive);
informed({driven, N, HeardUs}, State, #drive{command = N} = Drive) when is_integer(HeardUs) ->
    driven(HeardUs, State, Drive);
informed({stalled, N, Told}, State, #drive{command = N, chassis = Chassis} = Drive) when
    State =:= driving; State =:= trying
->
    stalled(Chassis:undo(Told), Drive);
informed({restarted, location}, locating, Drive) ->
    locate(Drive, []);
informed({restarted, location}, steering, Drive) ->
    sight(Drive);
informed({restarted, _}, _State, _Drive) ->
    keep_state_and_data;
informed({driven, _, Us}, _State, _Drive) when is_integer(Us) ->
    keep_state_and_data;
informed({stalled, _, Told}, _State, #drive{chassis = Chassis}) ->
    known(Chassis:undo(Told));
informed(_, _, _) ->
    unknown_event.

timed_out(heard_nothing, cruising, Drive) ->
    ended(no_answer, heard_nothing, Drive);
timed_out(ask, steering, Drive) ->
    blind(Drive);
timed_out(try_again, stalled, Drive) ->
    case may_back(Drive) of
        true -> try_again(Drive);
        false -> locate(Drive, [])
    end;
timed_out(heard_nothing, halting, Drive) ->
    stand_still(Drive, []);
timed_out(heard_nothing, _State, #drive{chassis = Chassis, script = Script} = Drive) ->
    %% the lost answer may have been that the drive does not obey
    stand_still(Drive#drive{doubt = Chassis:undo(Chassis:last(Script))}, []);
timed_out(ask, locating, #drive{way = to} = Drive) ->
    locate(Drive, []);
timed_out(ask, locating, Drive) ->
    stand_still(Drive, []);
timed_out(go_on, waiting, Drive) ->
    stand_still(Drive, []);
timed_out(_, _, _) ->
    unknown_event.

to(From, {Start, Goal}, Way, Drive) ->
    Drive#drive{
        from = From,
        bound = true,
        known = false,
        goal = Goal,
        start = Start,
        way = Way,
        stalls = 0,
        waited = 0,
        memo = none
    }.

goal(Way, Point) -> {trace, {goal, Way, Point}}.

%% A robot that stands looks; one that drives stops first; one that waits for its drive keeps
%% waiting.
go(stalled, Drive, Actions) -> {keep_state, Drive, Actions};
go(_State, #drive{stands = true, way = to} = Drive, Actions) -> look(Drive, Actions);
go(_State, Drive, Actions) -> stand_still(Drive, Actions).

stopped(#drive{from = none}) ->
    [];
stopped(#drive{from = From} = Drive) ->
    goal_over(command, Drive) ++ [{reply, From, {error, stopped}}].

goal_over(Why, #drive{bound = Bound}) -> [{trace, {goal_over, Why}} || Bound].

over(Why) -> {trace, {velocity_over, Why}}.

%% -- a velocity -----------------------------------------------------------------------------

%% Looks, whether it stands or drives. Those who wait until it stands are told that it does not.
steer(#drive{waiting = Waiting} = Drive, Actions) ->
    Interrupted = [{reply, From, {error, stopped}} || From <- Waiting],
    {next_state, State, Steering, Looks} = sight(Drive#drive{waiting = []}),
    {next_state, State, Steering, Actions ++ Interrupted ++ Looks}.

sight(#drive{asked = N} = Drive) ->
    {next_state, steering, Drive#drive{asked = N + 1}, ask(Drive)}.

ask(#drive{asked = N, self = Self, profile = Profile}) ->
    Question = starl_controller:look(Self, Profile),
    [{call, location, Question, N + 1}, {state_timeout, ?PATIENCE_US, ask}].

%% The time that the look took is gone.
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

blind(#drive{from = From} = Drive) ->
    Over = [over(unknown) || Drive#drive.cruises],
    Unknown = [{reply, From, {error, unknown}}],
    stand_still(Drive#drive{from = none, cruises = false}, Over ++ Unknown).

%% A robot that stands tries its drive now; the caller may ask again.
doubtful(idle, Drive, Actions) ->
    {next_state, State, Trying, Commands} = try_again(Drive),
    {next_state, State, Trying, Actions ++ Commands};
doubtful(_State, Drive, Actions) ->
    stand_still(Drive, Actions).

%% What ends a cruise is handled as at the end of a leg.
ended(Why, Event, #drive{cruises = Cruises, from = From} = Drive) ->
    Waits = [{reply, From, {error, stalled}} || From =/= none],
    case end_of_leg(Event, Drive#drive{cruises = false, from = none}) of
        {next_state, State, Next, Actions} ->
            {next_state, State, Next, [over(Why) || Cruises] ++ Waits ++ Actions};
        unknown_event ->
            unknown_event
    end.

end_of_leg({driven, _, HeardUs}, Drive) ->
    driven(HeardUs, cruising, Drive);
end_of_leg({stalled, _, Told}, #drive{chassis = Chassis} = Drive) ->
    stalled(Chassis:undo(Told), Drive);
end_of_leg(heard_nothing, #drive{chassis = Chassis, script = Script} = Drive) ->
    stand_still(Drive#drive{doubt = Chassis:undo(Chassis:last(Script))}, []).

%% -- the chassis ----------------------------------------------------------------------------

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

%% The chassis stands; it heard the command at this time of its clock.
driven(HeardUs, State, #drive{now = Now, told = {Told, Takes}, watch = Before} = Drive) ->
    {Agree, Watch} = starl_motion_clock_check:agree({Told, Takes, Now}, HeardUs, Before),
    %% a drive that has obeyed in a try obeys, even if the clocks do not agree
    Doubt =
        case State of
            trying -> none;
            _ -> Drive#drive.doubt
        end,
    Stalls =
        case State of
            driving -> 0;
            _ -> Drive#drive.stalls
        end,
    stands(Agree, Drive#drive{stands = true, watch = Watch, doubt = Doubt, stalls = Stalls}).

%% A robot without a goal rests; a wrong clock takes a robot's goal away.
stands(false, #drive{from = From, way = Way} = Drive) when From =/= none, Way =/= to ->
    Over = goal_over(out_of_time, Drive) ++ [{reply, From, {error, out_of_time}}],
    rest(false, Drive#drive{from = none}, Over);
stands(Agree, #drive{from = From, way = Way, solid = true, stalls = Stalls} = Drive) when
    From =/= none, Way =/= to, Stalls >= ?STALLS
->
    Over = goal_over(blocked, Drive) ++ [{reply, From, {error, blocked}}],
    rest(Agree, Drive#drive{from = none, stalls = 0}, Over);
stands(Agree, #drive{from = none} = Drive) ->
    rest(Agree, Drive, []);
stands(Agree, #drive{waiting = Waiting} = Drive) ->
    look(Drive#drive{waiting = []}, stood(Agree, Waiting)).

rest(Agree, #drive{waiting = Waiting} = Drive, Actions) ->
    {next_state, idle, Drive#drive{waiting = []}, Actions ++ stood(Agree, Waiting)}.

stood(true, Waiting) -> [{reply, From, ok} || From <- Waiting];
stood(false, Waiting) -> [{reply, From, {error, out_of_time}} || From <- Waiting].

try_again(#drive{doubt = {ok, Script}} = Drive) -> command(trying, Script, Drive).

%% Is it sure to stay on its line in a try in any direction? Its place was seen with an error.
may_back(#drive{solid = false}) ->
    true;
may_back(#drive{from = none}) ->
    true;
may_back(#drive{start = unknown}) ->
    true;
may_back(#drive{place = unknown}) ->
    false;
may_back(#drive{place = Place, start = Start, goal = Goal, profile = Profile, chassis = Chassis}) ->
    #{position_error_mm := Error} = Profile,
    Off = starl_geometry:point_segment(Place, {Start, Goal}),
    Off + Error + Chassis:try_mm(Profile) =< Chassis:tracking_radius(Profile).

%% The step leads along the line, or back to it. Its first command that moves the robot is tried, slowly.
try_on(_Step, #drive{from = From, way = Way, stalls = Stalls} = Drive) when
    Way =/= to, Stalls >= ?STALLS
->
    Over = goal_over(blocked, Drive) ++ [{reply, From, {error, blocked}}],
    {next_state, idle, Drive#drive{from = none, stalls = 0}, Over};
try_on({_, Commands} = Step, #drive{chassis = Chassis} = Drive) ->
    Tries = [
        Try
     || Command <- Commands,
        {ok, Back} <- [Chassis:undo(Chassis:last([Command]))],
        {ok, Try} <- [Chassis:undo(Chassis:last(Back))]
    ],
    case Tries of
        [Try | _] -> command(trying, Try, Drive);
        %% it is to stand: its next step will tell
        [] -> leg(Step, Drive)
    end.

%% A chassis that was told to stand, and reports that it does not, is told again.
stalled(unknown, _Drive) ->
    unknown_event;
stalled(none, Drive) ->
    stand_still(Drive, []);
stalled({ok, _} = Doubt, #drive{stalls = N} = Drive) ->
    Doubtful = Drive#drive{stands = true, memo = none, doubt = Doubt, stalls = N + 1},
    {next_state, stalled, Doubtful, [{state_timeout, ?REST_US, try_again}]}.

known(unknown) -> unknown_event;
known(_Late) -> keep_state_and_data.

%% -- the course -----------------------------------------------------------------------------

%% Uses the pose of a recent look, or looks.
look(#drive{seen = {Pose, At}, now = Now} = Drive, Actions) when
    At =< Now, Now - At < ?SEEN_US
->
    {next_state, State, Next, Course} = located(Pose, Drive),
    {next_state, State, Next, Actions ++ Course};
look(Drive, Actions) ->
    locate(Drive, Actions).

locate(#drive{asked = N} = Drive, Actions) ->
    {next_state, locating, Drive#drive{asked = N + 1}, Actions ++ ask(Drive)}.

located({X, Y, _} = Pose, Drive) ->
    step(Pose, Drive#drive{place = {X, Y}}).

step({X, Y, _} = Pose, #drive{start = unknown} = Drive) ->
    step(Pose, Drive#drive{start = {X, Y}});
step(Pose, #drive{known = false, start = Start, goal = Goal} = Drive) ->
    {next_state, State, Next, Actions} = step(Pose, Drive#drive{known = true}),
    {next_state, State, Next, [{trace, {line, {Start, Goal}}} | Actions]};
step(Pose, #drive{memo = none, chassis = Chassis, way = Way, profile = Profile} = Drive) ->
    #drive{start = Start, goal = Goal} = Drive,
    follow(Chassis:next(Way, Pose, {Start, Goal}, Profile), Drive);
step(Pose, #drive{memo = {some, Memo}, chassis = Chassis, profile = Profile} = Drive) ->
    follow(Chassis:resume(Pose, Memo, Profile), Drive).

follow(arrived, #drive{from = From} = Drive) ->
    Over = goal_over(arrived, Drive) ++ [{reply, From, ok}],
    {next_state, idle, Drive#drive{from = none}, Over};
follow({_, _} = Step, #drive{doubt = Doubt} = Drive) when Doubt =/= none ->
    case may_back(Drive) of
        true -> try_again(Drive#drive{memo = none});
        false -> try_on(Step, Drive#drive{memo = none})
    end;
follow(Step, Drive) ->
    #drive{poses = Poses, self = Self, waited = Waited, profile = Profile} = Drive,
    case starl_controller:leg(Poses, heads_to(Drive), {Self, Waited}, Profile) of
        go -> leg(Step, Drive);
        {wait, Us} -> wait(Us, Drive#drive{waited = Waited + Us})
    end.

heads_to(#drive{way = face, start = Start}) -> Start;
heads_to(#drive{goal = Goal}) -> Goal.

wait(Us, Drive) -> {next_state, waiting, Drive#drive{memo = none}, [{state_timeout, Us, go_on}]}.

leg({{look, Memo}, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = {some, Memo}});
leg({drive, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = none}).
