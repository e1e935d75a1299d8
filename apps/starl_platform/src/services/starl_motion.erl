%% @doc Motion: drives to a point along a straight line, in legs, with a look at the position
%% before each, and always with an end. The chassis plans a leg and its commands
%% ({@link starl_chassis}); this machine is the same for every chassis.
%% ```
%%   idle      go_to: halting
%%   halting   stands: locating, or idle without a goal;   no answer: halting again
%%   locating  a pose: driving, or idle at the goal;       no answer: locating again
%%   driving   stands: locating;   stalled: stalled;       no answer: halting
%%   stalled   half a second later: trying
%%   trying    stands: locating;   stalled: stalled;       no answer: halting
%% '''
%% While it drives, it depends on the chassis alone. Every command has a duration, so a robot whose
%% program crashes, pauses, is late or has a wrong clock stops by itself at the planned place,
%% within its leg. The next step depends on the chassis' answer that it stands, and on a look at the
%% position. A time-out reveals a lost command or answer. A robot looks only after it was told to
%% stop and has answered that it stands.
%%
%% A chassis stops when it finds that its drive does not obey, and reports it. The machine then
%% tries the reverse of the failed command, slowly and for a moment: if the drive still does not
%% obey, the try takes the robot back to its place, and no try takes it farther off; if the drive
%% obeys again, the doubt is over.
%%
%% A robot that drives under a lease must not resume after an unnoticed pause. So each leg of a
%% drive along a given line begins just after an answer of the chassis, and only while its clock and
%% the robot's agree ({@link starl_motion_watch}).
%%
%% Calls: `{go_to, point()}' drives to this point, in a straight line from the robot's place;
%% `{go_along, segment()}' drives along this line, near which the robot stands, to its exact end;
%% `{face, segment()}' drives to the beginning of this line, near which the robot stands, ready to
%% follow it (two wheels: looking along it). Answers: `ok' on arrival; `{error, stopped}' when
%% another command comes first; `{error, out_of_time}', except for `go_to', when the clocks do not
%% agree. `stop' is answered when the robot stands: `ok', or `{error, out_of_time}' when the clocks
%% do not agree. Configuration: `profiles', from which the machine takes that of its robot ({@link
%% starl_chassis:profiles()}).
-module(starl_motion).
-behaviour(starl_machine).

-export([stop/0]).
-export([init/1, handle_event/5]).

-export_type([event/0]).

%% It traces nothing of its own.
-type event() :: none().

%% The time to wait for a position or for an answer of the chassis before asking again.
-define(PATIENCE_US, 500000).
%% The time between two tries of a drive that does not obey.
-define(REST_US, 500000).
%% A robot that stands and was seen within this time is not looked for again.
-define(SEEN_US, 100000).

-type state() :: idle | halting | locating | driving | stalled | trying.

-record(drive, {
    self :: starl:robot_id(),
    chassis :: module(),
    profile :: starl_chassis:profile(),
    %% the caller of the drive, and the callers of `stop'
    from = none :: starl_machine:from() | none,
    waiting = [] :: [starl_machine:from()],
    start = unknown :: starl_geometry:point() | unknown,
    goal = {0.0, 0.0} :: starl_geometry:point(),
    %% to the goal, or along a given line, or to the beginning of one
    way = to :: starl_chassis:way(),
    %% the chassis' memo for the step after a look
    memo = none :: {some, starl_chassis:memo()} | none,
    %% numbers of the last command and of the last look
    command = 0 :: non_neg_integer(),
    asked = 0 :: non_neg_integer(),
    %% the robot's clock; the time and the duration of the last command; the comparison of this
    %% clock with that of the chassis, which must agree along given lines
    now :: integer(),
    told = {0, {0, 0}} :: {ToldUs :: integer(), Takes :: {Least :: integer(), Most :: integer()}},
    watch :: starl_motion_watch:t(),
    %% the chassis has answered that it stands, and has had no other command since; the pose then
    %% seen, and its time
    stands = false :: boolean(),
    seen = none :: {starl:pose(), AtUs :: integer()} | none,
    %% the last script
    script = [] :: starl_chassis:commands(),
    %% the next try, if the drive did not obey, or may not have, and has not obeyed since
    doubt = none :: {ok, starl_chassis:commands()} | none
}).

%% @doc The action that stops the robot.
-spec stop() -> starl_machine:action().
stop() -> {cast, motion, stop}.

-spec init(starl_machine:config()) -> {state(), #drive{}, [starl_machine:action()]}.
init(#{robot := Self, profiles := Profiles, incarnation := Incarnation, now := Now}) ->
    Profile = starl_chassis:of_robot(Self, Profiles),
    Drive = #drive{
        self = Self,
        chassis = starl_chassis:kind(Profile),
        profile = Profile,
        watch = starl_motion_watch:new(Profile),
        now = Now,
        %% a robot that still drives must not accept an answer to an earlier incarnation's command
        command = Incarnation bsl 32
    },
    {next_state, halting, Halting, Actions} = stand_still(Drive, []),
    {halting, Halting, Actions}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), #drive{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, State, Drive, #{now := Now}) ->
    event(Type, Content, State, Drive#drive{now = Now}).

event(info, {driven, N, HeardUs}, State, #drive{command = N} = Drive) when is_integer(HeardUs) ->
    driven(HeardUs, State, Drive);
event(info, {stalled, N, Told}, State, #drive{command = N, chassis = Chassis} = Drive) when
    State =:= driving; State =:= trying
->
    stalled(Chassis:undo(Told), Drive);
event(info, {restarted, location}, locating, Drive) ->
    locate(Drive, []);
event(info, {restarted, _}, _State, _Drive) ->
    keep_state_and_data;
event(info, {driven, _, Us}, _State, _Drive) when is_integer(Us) ->
    keep_state_and_data;
event(info, {stalled, _, Told}, _State, #drive{chassis = Chassis}) ->
    known(Chassis:undo(Told));
event(state_timeout, try_again, stalled, Drive) ->
    try_again(Drive);
event(state_timeout, heard_nothing, halting, Drive) ->
    stand_still(Drive, []);
event(state_timeout, heard_nothing, _State, #drive{chassis = Chassis, script = Script} = Drive) ->
    %% the lost answer may have been that the drive does not obey
    stand_still(Drive#drive{doubt = Chassis:undo(Chassis:last(Script))}, []);
event(state_timeout, ask, locating, #drive{way = to} = Drive) ->
    locate(Drive, []);
event(state_timeout, ask, locating, Drive) ->
    stand_still(Drive, []);
event({reply, N}, {ok, Pose}, locating, #drive{asked = N, now = Now} = Drive) ->
    located(Pose, Drive#drive{seen = {Pose, Now}});
event({reply, _}, _, _State, _Drive) ->
    keep_state_and_data;
event({call, From}, {go_to, Goal}, State, Drive) ->
    go(State, to(From, {unknown, Goal}, to, Drive), stopped(Drive));
event({call, From}, {go_along, Line}, State, Drive) ->
    go(State, to(From, Line, along, Drive), stopped(Drive));
event({call, From}, {face, Line}, State, Drive) ->
    go(State, to(From, Line, face, Drive), stopped(Drive));
event({call, From}, stop, _State, #drive{waiting = Waiting} = Drive) ->
    stand_still(Drive#drive{from = none, waiting = Waiting ++ [From]}, stopped(Drive));
event(cast, stop, _State, Drive) ->
    stand_still(Drive#drive{from = none}, stopped(Drive));
event(_, _, _, _) ->
    unknown_event.

to(From, {Start, Goal}, Way, Drive) ->
    Drive#drive{from = From, goal = Goal, start = Start, way = Way, memo = none}.

%% A robot that stands looks; one that drives stops first; one that waits for its drive keeps
%% waiting.
go(stalled, Drive, Actions) -> {keep_state, Drive, Actions};
go(_State, #drive{stands = true, way = to} = Drive, Actions) -> look(Drive, Actions);
go(_State, Drive, Actions) -> stand_still(Drive, Actions).

stopped(#drive{from = none}) -> [];
stopped(#drive{from = From}) -> [{reply, From, {error, stopped}}].

%% -- the chassis ----------------------------------------------------------------------------

stand_still(Drive, Actions) ->
    {next_state, State, Halting, Commands} = command(halting, [], Drive#drive{memo = none}),
    {next_state, State, Halting, Actions ++ Commands}.

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
    {Agree, Watch} = starl_motion_watch:agree({Told, Takes, Now}, HeardUs, Before),
    %% a drive that has obeyed in a try obeys, even if the clocks do not agree
    Doubt =
        case State of
            trying -> none;
            _ -> Drive#drive.doubt
        end,
    stands(Agree, Drive#drive{stands = true, watch = Watch, doubt = Doubt}).

%% A robot without a goal rests; a wrong clock takes a robot's goal away.
stands(false, #drive{from = From, way = Way} = Drive) when From =/= none, Way =/= to ->
    rest(false, Drive#drive{from = none}, [{reply, From, {error, out_of_time}}]);
stands(Agree, #drive{from = none} = Drive) ->
    rest(Agree, Drive, []);
stands(Agree, #drive{waiting = Waiting} = Drive) ->
    look(Drive#drive{waiting = []}, stood(Agree, Waiting)).

rest(Agree, #drive{waiting = Waiting} = Drive, Actions) ->
    {next_state, idle, Drive#drive{waiting = []}, Actions ++ stood(Agree, Waiting)}.

stood(true, Waiting) -> [{reply, From, ok} || From <- Waiting];
stood(false, Waiting) -> [{reply, From, {error, out_of_time}} || From <- Waiting].

try_again(#drive{doubt = {ok, Script}} = Drive) -> command(trying, Script, Drive).

%% A chassis that was told to stand, and reports that it does not, is told again.
stalled(unknown, _Drive) ->
    unknown_event;
stalled(none, Drive) ->
    stand_still(Drive, []);
stalled({ok, _} = Doubt, Drive) ->
    Doubtful = Drive#drive{stands = true, memo = none, doubt = Doubt},
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

locate(#drive{asked = N, self = Self} = Drive, Actions) ->
    Ask = [starl_location:pose(Self, N + 1), {state_timeout, ?PATIENCE_US, ask}],
    {next_state, locating, Drive#drive{asked = N + 1}, Actions ++ Ask}.

located({X, Y, _} = Pose, #drive{start = unknown} = Drive) ->
    located(Pose, Drive#drive{start = {X, Y}});
located(Pose, #drive{memo = none, chassis = Chassis, way = Way, profile = Profile} = Drive) ->
    #drive{start = Start, goal = Goal} = Drive,
    follow(Chassis:next(Way, Pose, {Start, Goal}, Profile), Drive);
located(Pose, #drive{memo = {some, Memo}, chassis = Chassis, profile = Profile} = Drive) ->
    follow(Chassis:resume(Pose, Memo, Profile), Drive).

follow(arrived, #drive{from = From} = Drive) ->
    {next_state, idle, Drive#drive{from = none}, [{reply, From, ok}]};
follow({_, _}, #drive{doubt = Doubt} = Drive) when Doubt =/= none ->
    try_again(Drive#drive{memo = none});
follow({{look, Memo}, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = {some, Memo}});
follow({drive, Script}, Drive) ->
    command(driving, Script, Drive#drive{memo = none}).
