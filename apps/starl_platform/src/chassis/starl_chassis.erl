%% @doc The behaviour of a chassis: one kind of driving hardware. A chassis defines its own profile
%% (limits, and bounds of its errors), its own commands, the planning of a course with them, and the
%% largest distance of a robot from the line that such a course follows. Everything else, motion
%% ({@link starl_motion}) and applications, is the same for every chassis.
%%
%% There are two kinds: {@link starl_chassis_differential} (two wheels; the iRobot Create) and
%% {@link starl_chassis_holonomic} (drives in any direction without a turn).
%%
%% A <em>script</em> is a list of commands that the platform carries out by itself, by the chassis'
%% own clock, one after the other; each has a duration, and the robot stands after the last. A
%% script names its chassis, so it is checked where a machine hands it over ({@link check/1}).
%%
%% A <em>course</em> is a sequence of steps. Each time the robot stands, motion checks its position
%% and asks for the next step in one of three modes ({@link mode()}). A step is a script, perhaps
%% with a memo for the step after the next look.
-module(starl_chassis).

-export([profile/2, of_robot/2, kind/1, simulation/1, radius_mm/1]).
-export([tracking_radius/1, ends_mm/1, widest/1, limited/2, rests_s/1, arrives_us/3, latency_us/1]).
-export([check/1]).

-export_type([profile/0, profiles/0, script/0, commands/0, movement/0, mode/0, step/0, memo/0]).
-export_type([velocity/0, pace/0]).

%% The profile of a robot's motion. `chassis' is the callback module, `speed' the highest speed
%% (mm/s). The bounds of the errors: `heading_error' in rad and `distance_error' as a fraction, per
%% leg, `position_error_mm' of the positioning system. `latency_ms' (5) bounds the delay with which
%% the chassis hears a command over its line ({@link starl_motion_clock_check} depends on it). `radius_mm'
%% (165, a Create) is that of the round body about the point between its wheels. `controller' is the module that
%% says how it drives between looks ({@link starl_controller}), if not the usual one. The other keys belong
%% to the chassis.
-type profile() :: #{
    chassis := module(),
    speed := float(),
    heading_error := float(),
    distance_error := float(),
    position_error_mm := float(),
    latency_ms => number(),
    radius_mm => float(),
    controller => module(),
    atom() => term()
}.

%% The profiles of a team: its robots take them in turn, robot 1 the first.
-type profiles() :: [profile(), ...].

%% The commands of a chassis. An empty list stops it.
-type script() :: {Chassis :: module(), commands()}.

-type commands() :: [tuple()].

%% Of a drive to a goal where nothing goes wrong: the least distance that a leg gains towards the goal unless it
%% ends there (0 if the bounds of the errors do not tell); the longest times of a leg, of a turn to any
%% direction, and of a turn or a drive to the exact place that has to be done once more.
-type pace() :: #{
    advance_mm := float(),
    leg_us := non_neg_integer(),
    turn_us := non_neg_integer(),
    again_us := non_neg_integer()
}.

%% A velocity along the axes of the floor (mm/s).
-type velocity() :: {VX :: float(), VY :: float()}.

%% A command without its duration; the event `stalled' returns it.
-type movement() :: term().

%% Along a line from the robot's starting place, to its end or nearly; along a given line to its
%% exact end; to the beginning of a given line, ready to follow it.
-type mode() :: to | along | face.

%% The next step: a script; or a script after which the chassis goes on with `memo()'.
-type step() :: {drive, commands()} | {{look, memo()}, commands()}.
-type memo() :: term().

%% The module of a simulator that turns its commands into motion (`starl_sim_chassis'). It is only named
%% here: a robot does without a simulator.
-callback simulation() -> module().
%% A whole profile: the chassis' defaults, overridden by the given keys.
-callback profile(map()) -> map().
%% Are these commands of this chassis? If not, the expected form.
-callback check(Commands :: term()) -> ok | {error, Expected :: string()}.
%% The least and the greatest duration of a script (us), until the robot stands. A robot may still
%% be driving when it is told to stop; otherwise it stands before.
-callback duration_us(commands(), profile()) -> {Least, Most} when
    Least :: non_neg_integer(), Most :: non_neg_integer().
%% The next step of a robot that stands at a pose.
-callback next(mode(), starl:pose(), starl_geometry:segment(), profile()) -> arrived | step().
%% The next step after a step with a memo; only of a chassis with such steps.
-callback resume(starl:pose(), memo(), profile()) -> step().
%% The script of a robot at a pose that is to drive on with a velocity, within its limits (mm/s, along
%% the axes of the floor), for this time, from its present motion.
-callback cruise(velocity(), starl:pose(), Us :: pos_integer(), profile()) -> commands().
%% The longest time that it drives on after the end of a script (s): it brakes.
-callback rests_s(profile()) -> float().
%% The last command of a script.
-callback last(commands()) -> movement().
%% The try after a command that the drive did not obey: its reverse, slowly and for a
%% moment. `none': the command was to stand. `unknown': the chassis has no such command.
-callback undo(movement()) -> {ok, commands()} | none | unknown.
%% How far such a try takes the robot at most, in whatever direction (mm).
-callback try_mm(profile()) -> float().
%% r(v): the largest distance of a robot from its straight line while it drives (mm), under any
%% fault.
-callback tracking_radius(profile()) -> float().
%% The largest distance along a line between its ends and the places where a robot began and ended
%% it (mm).
-callback ends_mm(profile()) -> float().
%% Its pace on a drive to a goal.
-callback pace(profile()) -> pace().
-optional_callbacks([resume/3]).

%% The legs of a drive beside those that a pace counts, each after a turn: one back to the line, one at a
%% change of speed, one near the end of a line, and the last one.
-define(SHORT_LEGS, 4).
%% Turns and corrections that have to be done again, at most once in two for each leg: more than twice
%% the legs and these are needed at most once in 10^9 drives (Hoeffding's inequality).
-define(AGAIN, 60).
%% The usual bound on the delay of a command, ms.
-define(LATENCY_MS, 5).
%% The radius of a Create (mm).
-define(RADIUS_MM, 165.0).

%% @doc A whole profile of a chassis.
-spec profile(Chassis :: module(), map()) -> profile().
profile(Chassis, Overrides) -> (Chassis:profile(Overrides))#{chassis => Chassis}.

%% @doc The profile of a robot of a team.
-spec of_robot(starl:robot_id(), profiles()) -> profile().
of_robot(Robot, Profiles) -> lists:nth(1 + (Robot - 1) rem length(Profiles), Profiles).

%% @doc The chassis of a profile.
-spec kind(profile()) -> module().
kind(#{chassis := Chassis}) -> Chassis.

%% @doc The module that simulates the chassis of a profile.
-spec simulation(profile()) -> module().
simulation(#{chassis := Chassis}) -> Chassis:simulation().

%% @doc The radius of its round body.
-spec radius_mm(profile()) -> float().
radius_mm(Profile) -> float(maps:get(radius_mm, Profile, ?RADIUS_MM)).

%% @doc r(v) of a robot with this profile.
-spec tracking_radius(profile()) -> float().
tracking_radius(#{chassis := Chassis} = Profile) -> Chassis:tracking_radius(Profile).

%% @doc The largest error at the ends of a line.
-spec ends_mm(profile()) -> float().
ends_mm(#{chassis := Chassis} = Profile) -> Chassis:ends_mm(Profile).

%% @doc A velocity in the same direction, no faster than a robot with this profile drives.
-spec limited({number(), number()}, profile()) -> velocity().
limited({VX, VY}, #{speed := Most}) ->
    case math:sqrt(VX * VX + VY * VY) of
        Speed when Speed > Most -> {VX * Most / Speed, VY * Most / Speed};
        _ -> {float(VX), float(VY)}
    end.

%% @doc The longest time that a robot with this profile drives on after the end of a script (s).
-spec rests_s(profile()) -> float().
rests_s(#{chassis := Chassis} = Profile) -> Chassis:rests_s(Profile).

%% @doc The longest time that a command takes to the chassis.
-spec latency_us(profile()) -> non_neg_integer().
latency_us(Profile) -> ceil(1000 * maps:get(latency_ms, Profile, ?LATENCY_MS)).

%% @doc The longest time of a drive from rest to a goal at this distance, if nothing goes wrong.
%% Each step takes `StepUs' besides the driving, for its command, its answer, and a look. Turns and
%% corrections must suffice at least every second time.
-spec arrives_us(Mm :: float(), StepUs :: non_neg_integer(), profile()) -> pos_integer() | never.
arrives_us(Mm, StepUs, #{chassis := Chassis} = Profile) ->
    case Chassis:pace(Profile) of
        #{advance_mm := Advance} when Advance =< 0 ->
            never;
        #{advance_mm := Advance, leg_us := Leg, turn_us := Turn, again_us := Again} ->
            Legs = ceil(Mm / Advance) + ?SHORT_LEGS,
            %% a leg is a turn, and a drive
            Driven = Legs * (Leg + 2 * StepUs) + ?SHORT_LEGS * Turn,
            case Driven + (2 * Legs + ?AGAIN) * (Again + StepUs) of
                Us when is_integer(Us) -> Us
            end
    end.

%% @doc The largest r(v) of a team.
-spec widest(profiles()) -> float().
widest(Profiles) -> lists:max([tracking_radius(Profile) || Profile <- Profiles]).

%% @doc Is this a script? If not, the expected form.
-spec check(term()) -> ok | {error, Expected :: string()}.
check({Chassis, Commands}) when is_atom(Chassis) ->
    case starl_callback:exported(Chassis, check, 1) of
        true -> Chassis:check(Commands);
        false -> {error, expected()}
    end;
check(_) ->
    {error, expected()}.

expected() -> "{Chassis, Commands}: a module of the behaviour starl_chassis, and its commands".
