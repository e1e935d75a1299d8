%% @doc The drive of a robot's motion: what it was told to do and has seen, what its chassis was told, and the
%% steps from one state of {@link starl_motion} to the next. Pure; a part of it.
-module(starl_motion_drive).

-export([begun/1, at/2, command/1, asked/1, saw/2]).
-export([go/4, steer/5, stop/2, stand_still/1]).
-export([sight/1, cruise/2, blind/1, passes/1, cruise_over/3]).
-export([driven/3, stalled/2, undo/2, try_again/1, unheard/1]).
-export([locate/1, located/2, unseen/1]).

-export_type([t/0, state/0]).

%% The time to wait for a position or for an answer of the chassis before asking again.
-define(PATIENCE_US, 500000).
%% The time between two tries of a drive that does not obey.
-define(REST_US, 500000).
%% A robot that stands and was seen within this time is not looked for again.
-define(SEEN_US, 100000).

-type state() ::
    idle | halting | locating | driving | waiting | stalled | trying | steering | cruising.

-record(drive, {
    self :: starl:robot_id(),
    chassis :: module(),
    profile :: starl_chassis:profile(),
    solid :: boolean(),
    %% the caller of the drive, and the callers of `stop'
    from = none :: starl_machine:from() | none,
    waiting = [] :: [starl_machine:from()],
    goal = starl_motion_goal:none() :: starl_motion_goal:t(),
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

-opaque t() :: #drive{}.

-type next() :: {next_state, state(), t(), [starl_machine:action()]}.

%% @doc The drive of a motion that boots: it stops the robot.
-spec begun(starl_machine:config()) -> next().
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

%% @doc At this time of the robot's clock.
-spec at(NowUs :: integer(), t()) -> t().
at(Now, Drive) -> Drive#drive{now = Now}.

%% @doc The number of its last command.
-spec command(t()) -> non_neg_integer().
command(#drive{command = N}) -> N.

%% @doc The number of its last look.
-spec asked(t()) -> non_neg_integer().
asked(#drive{asked = N}) -> N.

%% @doc A look has shown these robots: its own pose.
-spec saw(#{starl:robot_id() => starl:pose()}, t()) -> {{ok, starl:pose()} | {error, unknown}, t()}.
saw(Poses, #drive{self = Self} = Drive) ->
    Own =
        case Poses of
            #{Self := Pose} -> {ok, Pose};
            #{} -> {error, unknown}
        end,
    {Own, Drive#drive{poses = Poses}}.

%% @doc It is to drive to this goal, for this caller. A robot that stands looks; one that drives stops first;
%% one that waits for its drive keeps waiting.
-spec go(starl_motion_goal:t(), starl_machine:from(), state(), t()) -> starl_machine:result().
go(Goal, From, State, #drive{stands = Stands} = Drive) ->
    Going = Drive#drive{from = From, bound = true, goal = Goal, memo = none},
    Actions = stopped(Drive) ++ [{trace, starl_motion_goal:said(Goal)}],
    case Stands andalso not starl_motion_goal:is_line(Goal) of
        _ when State =:= stalled -> {keep_state, Going, Actions};
        true -> look(Going, Actions);
        false -> stand_still(Going, Actions)
    end.

%% @doc It is to stop; these callers wait until it stands.
-spec stop([starl_machine:from()], t()) -> starl_machine:result().
stop(Waits, #drive{waiting = Waiting} = Drive) ->
    stand_still(Drive#drive{from = none, waiting = Waiting ++ Waits}, stopped(Drive)).

stopped(#drive{from = none}) ->
    [];
stopped(#drive{from = From} = Drive) ->
    goal_over(command, Drive) ++ [{reply, From, {error, stopped}}].

goal_over(Why, #drive{bound = Bound}) -> [{trace, {goal_over, Why}} || Bound].

over(Why) -> {trace, {velocity_over, Why}}.

%% -- a velocity -----------------------------------------------------------------------------

%% @doc It is given a velocity for this time, and looks, whether it stands or drives. Those who wait until it
%% stands are told that it does not. A drive of whose obedience it is not sure is tried first, if it stands; the
%% caller may ask again.
-spec steer(starl_geometry:point(), Us :: pos_integer(), starl_machine:from(), state(), t()) ->
    starl_machine:result().
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

%% @doc Looks for a velocity.
-spec sight(t()) -> starl_machine:result().
sight(#drive{asked = N} = Drive) ->
    {next_state, steering, Drive#drive{asked = N + 1}, ask(Drive)}.

ask(#drive{asked = N, self = Self, profile = Profile}) ->
    Question = starl_controller:look(Self, Profile),
    [{call, location, Question, N + 1}, {state_timeout, ?PATIENCE_US, ask}].

%% @doc Drives on with the velocity that it is given, from this pose. The time that the look took is gone.
-spec cruise(starl:pose(), t()) -> starl_machine:result().
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

%% @doc It is given a velocity, and gets no position: it stops.
-spec blind(t()) -> starl_machine:result().
blind(#drive{from = From} = Drive) ->
    Over = [over(unknown) || Drive#drive.cruises],
    Unknown = [{reply, From, {error, unknown}}],
    stand_still(Drive#drive{from = none, cruises = false}, Over ++ Unknown).

%% @doc It looks for a new velocity, and the time of the old one is up.
-spec passes(t()) -> starl_machine:result().
passes(#drive{cruises = Cruises} = Drive) ->
    {keep_state, Drive#drive{stands = true, cruises = false}, [over(time) || Cruises]}.

%% @doc A cruise ends, for this reason. It is handled as at the end of a leg.
-spec cruise_over(time | stalled | no_answer, Answer, t()) -> next() | unknown_event when
    Answer :: {driven | stalled, term()} | heard_nothing.
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

%% @doc It is to stand, for its own sake.
-spec stand_still(t()) -> starl_machine:result().
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

%% @doc It has no answer to a command: the lost one may have been that the drive does not obey.
-spec unheard(t()) -> starl_machine:result().
unheard(#drive{chassis = Chassis, script = Script} = Drive) ->
    stand_still(Drive#drive{doubt = Chassis:undo(Chassis:last(Script))}, []).

%% @doc The chassis stands; it heard the command at this time of its clock.
-spec driven(HeardUs :: integer(), state(), t()) -> starl_machine:result().
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
            driving -> starl_motion_goal:moves(Drive#drive.goal);
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
hindrance(Agree, #drive{solid = Solid, goal = Goal}) ->
    IsBlocked = Solid andalso starl_motion_goal:is_blocked(Goal),
    case starl_motion_goal:is_line(Goal) of
        true when not Agree -> out_of_time;
        _ when IsBlocked -> blocked;
        _ -> none
    end.

given_up(Why, #drive{from = From} = Drive) ->
    {goal_over(Why, Drive) ++ [{reply, From, {error, Why}}], Drive#drive{from = none}}.

rest(Agree, #drive{waiting = Waiting} = Drive, Actions) ->
    {next_state, idle, Drive#drive{waiting = []}, Actions ++ stood(Agree, Waiting)}.

stood(true, Waiting) -> [{reply, From, ok} || From <- Waiting];
stood(false, Waiting) -> [{reply, From, {error, out_of_time}} || From <- Waiting].

%% @doc Its drive may not obey: it tries it, or looks first.
-spec try_again(t()) -> starl_machine:result().
try_again(Drive) ->
    case may_back(Drive) of
        true -> try_now(Drive);
        false -> locate(Drive, [])
    end.

try_now(#drive{doubt = {ok, Script}} = Drive) -> command(trying, Script, Drive).

may_back(#drive{solid = Solid, from = From, place = Place, goal = Goal} = Drive) ->
    #drive{chassis = Chassis, profile = Profile} = Drive,
    not Solid orelse From =:= none orelse starl_motion_goal:keeps(Place, Chassis, Profile, Goal).

%% The step leads along the line, or back to it. Its first command that moves the robot is tried, slowly.
try_on({_, Commands} = Step, #drive{goal = Goal} = Drive) ->
    case {starl_motion_goal:is_blocked(Goal), first_try(Commands, Drive#drive.chassis)} of
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

%% @doc What takes back what the drive has not obeyed, as the chassis tells it.
-spec undo(Told :: term(), t()) -> {ok, starl_chassis:commands()} | none | unknown.
undo(Told, #drive{chassis = Chassis}) -> Chassis:undo(Told).

%% @doc The drive does not obey. A chassis that was told to stand, and reports that it does not, is told again.
-spec stalled(Told :: term(), t()) -> starl_machine:result().
stalled(Told, #drive{goal = Goal} = Drive) ->
    case undo(Told, Drive) of
        unknown ->
            unknown_event;
        none ->
            stand_still(Drive, []);
        {ok, _} = Doubt ->
            Counted = starl_motion_goal:stalled(Goal),
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

%% @doc Looks where it stands.
-spec locate(t()) -> starl_machine:result().
locate(Drive) -> locate(Drive, []).

%% @doc It gets no position. It has to stand for a leg along a line, whose beginning is timed.
-spec unseen(t()) -> starl_machine:result().
unseen(#drive{goal = Goal} = Drive) ->
    case starl_motion_goal:is_line(Goal) of
        true -> stand_still(Drive, []);
        false -> locate(Drive, [])
    end.

locate(#drive{asked = N} = Drive, Actions) ->
    {next_state, locating, Drive#drive{asked = N + 1}, Actions ++ ask(Drive)}.

%% @doc It stands here: its next step begins.
-spec located(starl:pose(), t()) -> starl_machine:result().
located(Pose, #drive{now = Now} = Drive) -> step(Pose, Drive#drive{seen = {Pose, Now}}).

step({X, Y, _} = Pose, #drive{goal = Goal} = Drive) ->
    {Lines, Begun} = starl_motion_goal:begins(Pose, Goal),
    Placed = Drive#drive{place = {X, Y}, goal = Begun},
    {next_state, State, Next, Actions} = follow(next(Pose, Placed), Placed),
    {next_state, State, Next, [{trace, Line} || Line <- Lines] ++ Actions}.

next(Pose, #drive{memo = none, chassis = Chassis, profile = Profile, goal = Goal}) ->
    starl_motion_goal:next(Pose, Chassis, Profile, Goal);
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
    Heads = starl_motion_goal:heads_to(Goal),
    case starl_controller:leg(Poses, Heads, {Self, starl_motion_goal:waited(Goal)}, Profile) of
        go -> leg(Step, Drive);
        {wait, Us} -> wait(Us, Drive#drive{goal = starl_motion_goal:waited(Us, Goal)})
    end.

wait(Us, Drive) -> {next_state, waiting, Drive#drive{memo = none}, [{state_timeout, Us, go_on}]}.

leg({{look, Memo}, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = {some, Memo}});
leg({drive, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = none}).
