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

-type state() :: starl_motion_drive:state().

%% @doc The action that stops the robot.
-spec stop() -> starl_machine:action().
stop() -> {cast, motion, stop}.

-spec init(starl_machine:config()) ->
    {state(), starl_motion_drive:t(), [starl_machine:action()]}.
init(#{incarnation := Incarnation} = Config) ->
    Over = [{trace, {velocity_over, restarted}} || Incarnation > 1],
    {next_state, State, Drive, Actions} = starl_motion_drive:begun(Config),
    {State, Drive, Over ++ Actions}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), starl_motion_drive:t(), starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, State, Drive, #{now := Now}) ->
    event(Type, Content, State, starl_motion_drive:at(Now, Drive)).

event(info, {Word, N, What}, State, Drive) when Word =:= driven; Word =:= stalled ->
    case starl_motion_drive:command(Drive) of
        N -> ended({Word, What}, State, Drive);
        _ -> late({Word, What}, Drive)
    end;
event(info, {restarted, Machine}, State, Drive) ->
    restarted(Machine, State, Drive);
event(state_timeout, Word, State, Drive) ->
    timed_out(Word, State, Drive);
event({reply, N}, Answer, State, Drive) ->
    case starl_motion_drive:asked(Drive) of
        N -> looked(Answer, State, Drive);
        _ -> keep_state_and_data
    end;
event({call, From}, Call, State, Drive) ->
    called(Call, From, State, Drive);
event(cast, stop, _State, Drive) ->
    starl_motion_drive:stop([], Drive);
event(_, _, _, _) ->
    unknown_event.

%% The answer to its last look.
looked({ok, #{} = Poses}, State, Drive) ->
    {Own, Saw} = starl_motion_drive:saw(Poses, Drive),
    looked(Own, State, Saw);
looked({ok, Pose}, locating, Drive) ->
    starl_motion_drive:located(Pose, Drive);
looked({ok, Pose}, steering, Drive) ->
    starl_motion_drive:cruise(Pose, Drive);
looked({error, _}, steering, Drive) ->
    starl_motion_drive:blind(Drive);
looked(_, _State, _Drive) ->
    keep_state_and_data.

called({go_to, Goal}, From, State, Drive) ->
    starl_motion_drive:go(starl_motion_goal:new(to, {unknown, Goal}), From, State, Drive);
called({go_along, {_, _} = Line}, From, State, Drive) ->
    starl_motion_drive:go(starl_motion_goal:new(along, Line), From, State, Drive);
called({face, {_, _} = Line}, From, State, Drive) ->
    starl_motion_drive:go(starl_motion_goal:new(face, Line), From, State, Drive);
called({velocity, _, _}, From, State, Drive) when State =:= stalled; State =:= trying ->
    {keep_state, Drive, [{reply, From, {error, stalled}}]};
called({velocity, Velocity, Us}, From, State, Drive) ->
    starl_motion_drive:steer(Velocity, Us, From, State, Drive);
called(stop, From, _State, Drive) ->
    starl_motion_drive:stop([From], Drive);
called(_Call, _From, _State, _Drive) ->
    unknown_event.

%% The chassis' answer to the last command.
ended({driven, _}, steering, Drive) ->
    starl_motion_drive:passes(Drive);
ended({driven, _} = Driven, cruising, Drive) ->
    starl_motion_drive:cruise_over(time, Driven, Drive);
ended({stalled, _} = Stalled, State, Drive) when State =:= cruising; State =:= steering ->
    starl_motion_drive:cruise_over(stalled, Stalled, Drive);
ended({driven, HeardUs}, State, Drive) when is_integer(HeardUs) ->
    starl_motion_drive:driven(HeardUs, State, Drive);
ended({stalled, Told}, State, Drive) when State =:= driving; State =:= trying ->
    starl_motion_drive:stalled(Told, Drive);
ended(Answer, _State, Drive) ->
    late(Answer, Drive).

%% An answer to an earlier command, or one that comes too late.
late({driven, Us}, _Drive) when is_integer(Us) ->
    keep_state_and_data;
late({stalled, Told}, Drive) ->
    case starl_motion_drive:undo(Told, Drive) of
        unknown -> unknown_event;
        _ -> keep_state_and_data
    end;
late(_Answer, _Drive) ->
    unknown_event.

restarted(location, locating, Drive) -> starl_motion_drive:locate(Drive);
restarted(location, steering, Drive) -> starl_motion_drive:sight(Drive);
restarted(_, _State, _Drive) -> keep_state_and_data.

timed_out(heard_nothing, cruising, Drive) ->
    starl_motion_drive:cruise_over(no_answer, heard_nothing, Drive);
timed_out(ask, steering, Drive) ->
    starl_motion_drive:blind(Drive);
timed_out(try_again, stalled, Drive) ->
    starl_motion_drive:try_again(Drive);
timed_out(heard_nothing, halting, Drive) ->
    starl_motion_drive:stand_still(Drive);
timed_out(heard_nothing, _State, Drive) ->
    starl_motion_drive:unheard(Drive);
timed_out(ask, locating, Drive) ->
    starl_motion_drive:unseen(Drive);
timed_out(go_on, waiting, Drive) ->
    starl_motion_drive:stand_still(Drive);
timed_out(_, _, _) ->
    unknown_event.
