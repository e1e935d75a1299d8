%% @doc The behaviour of a chassis: a kind of body that drives. A chassis knows its own profile
%% (limits, and bounds of its errors), its own commands, how a course is planned with them, and how
%% far from a line a robot may be that follows such a course. Everything else, motion
%% ({@link starl_motion}) and applications, is the same for every chassis.
%%
%% Two kinds are here: {@link starl_chassis_differential} (two wheels; the iRobot Create) and
%% {@link starl_chassis_holonomic} (drives in any direction without a turn).
%%
%% A <em>script</em> is what the platform carries out by itself, by the chassis' own clock: a list of
%% commands, one after the other, each of which says for how long, after which the robot stands. It
%% names its chassis, so that it can be checked where it is given ({@link check/1}).
%%
%% A <em>course</em> is what motion asks for each time the robot stands: it looks where the robot is,
%% and asks for the next step on one of three {@link way()}s. A step is a script, and perhaps what to
%% go on with once the robot has looked again.
-module(starl_chassis).

-export([profile/2, of_robot/2, kind/1]).
-export([tracking_radius/1, ends_mm/1, widest/1]).
-export([check/1]).

-export_type([profile/0, profiles/0, script/0, commands/0, told/0, way/0, step/0, memo/0]).

%% How a robot drives. `chassis' is the callback module, `speed' the highest speed (mm/s). The
%% bounds of the errors: `heading_error' in rad and `distance_error' as a fraction, per leg,
%% `position_error_mm' of the positioning system. `latency_ms' (5) bounds how late the chassis hears a
%% command, over its line ({@link starl_motion_watch}: what rests on it). The other keys are the
%% chassis' own.
-type profile() :: #{
    chassis := module(),
    speed := float(),
    heading_error := float(),
    distance_error := float(),
    position_error_mm := float(),
    latency_ms => number(),
    atom() => term()
}.

%% The profiles of a team: its robots take them in turn, robot 1 the first.
-type profiles() :: [profile(), ...].

%% What a chassis is to do: commands of its own. Without any it stops.
-type script() :: {Chassis :: module(), commands()}.

-type commands() :: [tuple()].

%% What one command demands, but for its duration; comes back with the event `stalled'.
-type told() :: term().

%% Along a line from where the robot set out, to its end or nearly; along a given line to its very
%% end; to the beginning of a given line, ready to follow it.
-type way() :: to | along | face.

%% What to do next: drive and look where that has led; or drive, look, and go on with `memo()'.
-type step() :: {drive, commands()} | {{look, memo()}, commands()}.
-type memo() :: term().

%% A whole profile: the chassis' defaults, overridden by the given keys.
-callback profile(map()) -> map().
%% Are these commands of this chassis? Else what they have to be.
-callback check(Commands :: term()) -> ok | {error, Expected :: string()}.
%% How long a script takes (us), at least and at most, until the robot stands. The robot may be on
%% its way when it is told to stop, else it stands before.
-callback duration_us(commands(), profile()) -> {Least, Most} when
    Least :: non_neg_integer(), Most :: non_neg_integer().
%% What a robot does next that stands at a pose.
-callback next(way(), starl:pose(), starl_geometry:segment(), profile()) -> arrived | step().
%% What it does next after a step with a memo; only of a chassis that makes such steps.
-callback resume(starl:pose(), memo(), profile()) -> step().
%% What the last command of a script demands.
-callback last(commands()) -> told().
%% What to try when the chassis was told so and did not do it: what was begun, the other way round,
%% slowly and for a moment. `none': it was to stand. `unknown': that is nothing it can be told.
-callback undo(told()) -> {ok, commands()} | none | unknown.
%% r(v): how far from the straight line a robot may be while it drives (mm), under every fault.
-callback tracking_radius(profile()) -> float().
%% How far along a line its beginning and its end may be from where a robot began and ended it (mm).
-callback ends_mm(profile()) -> float().
-optional_callbacks([resume/3]).

%% @doc A whole profile of a chassis.
-spec profile(Chassis :: module(), map()) -> profile().
profile(Chassis, Overrides) -> (Chassis:profile(Overrides))#{chassis => Chassis}.

%% @doc The profile of a robot of a team.
-spec of_robot(starl:robot_id(), profiles()) -> profile().
of_robot(Robot, Profiles) -> lists:nth(1 + (Robot - 1) rem length(Profiles), Profiles).

%% @doc The chassis that a profile belongs to.
-spec kind(profile()) -> module().
kind(#{chassis := Chassis}) -> Chassis.

%% @doc r(v) of a robot with this profile.
-spec tracking_radius(profile()) -> float().
tracking_radius(#{chassis := Chassis} = Profile) -> Chassis:tracking_radius(Profile).

%% @doc How exactly it begins and ends a line.
-spec ends_mm(profile()) -> float().
ends_mm(#{chassis := Chassis} = Profile) -> Chassis:ends_mm(Profile).

%% @doc The largest r(v) of a team.
-spec widest(profiles()) -> float().
widest(Profiles) -> lists:max([tracking_radius(Profile) || Profile <- Profiles]).

%% @doc Is this a script? Else what it has to be.
-spec check(term()) -> ok | {error, Expected :: string()}.
check({Chassis, Commands}) when is_atom(Chassis) ->
    case is_chassis(Chassis) of
        true -> Chassis:check(Commands);
        false -> {error, expected()}
    end;
check(_) ->
    {error, expected()}.

is_chassis(Chassis) ->
    erlang:function_exported(Chassis, check, 1) orelse
        (code:ensure_loaded(Chassis) =:= {module, Chassis} andalso
            erlang:function_exported(Chassis, check, 1)).

expected() -> "{Chassis, Commands}: a module of the behaviour starl_chassis, and its commands".
