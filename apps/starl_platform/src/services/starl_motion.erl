%% @doc Motion: drives to a point along a straight line, in legs, with a look at the position
%% before each, and never without an end. How a leg is planned and commanded is the chassis' affair
%% ({@link starl_chassis}); this machine is the same for every chassis.
%% ```
%%   idle      go_to: halting
%%   halting   stands: locating, or idle without a goal;   no answer: halting again
%%   locating  a pose: driving, or idle at the goal;       no answer: locating again
%%   driving   stands: locating;   stalled: stalled;       no answer: halting
%%   stalled   half a second later: trying
%%   trying    stands: locating;   stalled: stalled;       no answer: halting
%% '''
%% It rests on nothing but the chassis while it drives. Every command says for how long, so a
%% robot whose program crashes, stands still, is late or has a wrong clock stops by itself where it
%% would have stopped, within its leg. What it does next follows from the chassis' word that it
%% stands, and a look at where; a command or its answer that is lost is found out by a time-out,
%% and only a robot that is told to stop, and has answered that it stands, looks where it is.
%%
%% A chassis that finds its drive not doing as it should stops, and says so. What it had begun is
%% then tried the other way round, slowly and for a moment: a drive that still does not obey brings
%% it back to where it was, and no try carries it any farther off; one that obeys again ends the
%% matter.
%%
%% Whoever drives by leave that ends at some time must not drive on after having stood still
%% unawares. So no leg of a drive along a given line begins but just after a word of the chassis,
%% and only while its clock and the robot's agree ({@link starl_motion_watch}).
%%
%% Calls: `{go_to, point()}' along the line from where it stands, `{go_along, segment()}' along this
%% line, near which it stands, to its very end, `{face, segment()}' to the beginning of this line, near
%% which it stands, ready to follow it (two wheels: looking along it) (answer `ok' when it is there,
%% `{error, stopped}' when another command comes first, `{error, out_of_time}' in all but the first
%% case when the clocks do not agree), `stop' (answer when it stands: `ok', or `{error,
%% out_of_time}' when they do not agree). Configuration: `profiles', of which it takes that of its
%% robot ({@link starl_chassis:profiles()}).
-module(starl_motion).
-behaviour(starl_machine).

-export([stop/0]).
-export([init/1, handle_event/5]).

-export_type([event/0]).

%% It traces nothing of its own.
-type event() :: none().

%% How long to wait for a position or for a word of the chassis before asking again.
-define(PATIENCE_US, 500000).
%% How long a drive that does not obey is left alone between two tries.
-define(REST_US, 500000).
%% A robot that stands and was seen so short a time ago is not looked for again.
-define(SEEN_US, 100000).

-type state() :: idle | halting | locating | driving | stalled | trying.

-record(drive, {
    self :: starl:robot_id(),
    chassis :: module(),
    profile :: starl_chassis:profile(),
    %% who wants to be at the goal, who only that it stands
    from = none :: starl_machine:from() | none,
    waiting = [] :: [starl_machine:from()],
    start = unknown :: starl_geometry:point() | unknown,
    goal = {0.0, 0.0} :: starl_geometry:point(),
    %% to the goal, or along a given line, or to the beginning of one
    way = to :: starl_chassis:way(),
    %% what the chassis goes on with after a look
    memo = none :: {some, starl_chassis:memo()} | none,
    %% numbers of the last command and of the last look
    command = 0 :: non_neg_integer(),
    asked = 0 :: non_neg_integer(),
    %% the robot's clock; when the last command was given, and how long it takes; how this clock and
    %% that of the chassis went: along given lines they have to agree
    now :: integer(),
    told = {0, {0, 0}} :: {ToldUs :: integer(), Takes :: {Least :: integer(), Most :: integer()}},
    watch :: starl_motion_watch:t(),
    %% the chassis has said that it stands, and nothing else was told it since; where it was then
    %% seen to stand, and when
    stands = false :: boolean(),
    seen = none :: {starl:pose(), AtUs :: integer()} | none,
    %% the last script
    script = [] :: starl_chassis:commands(),
    %% the drive did not obey, or nobody knows, and nothing has shown since that it does: the next try
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
        %% a robot that drives into the number of another life would believe its chassis too soon
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
    %% what was not heard may have been that the drive does not obey
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

%% One that stands looks where; one that drives stops first; one that waits for its drive goes on so.
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

%% The chassis stands, and heard the command at this time of its clock.
driven(HeardUs, State, #drive{now = Now, told = {Told, Takes}, watch = Before} = Drive) ->
    {Agree, Watch} = starl_motion_watch:agree({Told, Takes, Now}, HeardUs, Before),
    %% a drive that has obeyed in a try obeys, whatever the clock
    Doubt =
        case State of
            trying -> none;
            _ -> Drive#drive.doubt
        end,
    stands(Agree, Drive#drive{stands = true, watch = Watch, doubt = Doubt}).

%% A robot that has no goal rests; one whose clock is wrong has none any more.
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

%% A chassis that was told to stand, and says that it does not, is told so again.
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

%% Where it stands.
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
