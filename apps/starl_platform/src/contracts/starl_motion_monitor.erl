%% @doc The contract of motion. A robot that drives to a goal stays within r(v) of its line, and arrives
%% ({@link starl_motion_monitor_goals}).
%%
%% A robot that drives with a velocity ({@link starl:velocity/3})
%% stands at the end of its dead-man's time at the latest, whatever becomes of its program, unless
%% another command came before. It stands, too, when motion says that the time is over. A chassis that
%% does not hear a velocity keeps to the one before, and to its time; it has heard one if it moves
%% otherwise from that moment on.
%%
%% A command takes at most `latency_ms' to the chassis, and a chassis that brakes comes to rest a
%% little later ({@link starl_chassis:rests_s/1}); the bound is later by these two. The chassis
%% carries out the script, with its end, by itself. But a robot whose computer stalls when it gives
%% the command may go on before the command leaves. A command that leaves more than `HEARD_US' after
%% its step is not begun.
%%
%% Events: of machine `motion', {@link starl_motion:event()}, `crashed'; of machine `chassis', `motion';
%% of machine `robot', `down' and `died'.
-module(starl_motion_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, sometimes/0]).

-record(state, {
    profiles :: starl_chassis:profiles(),
    goals :: starl_motion_monitor_goals:t(),
    driving = #{} :: #{starl:robot_id() => driving()},
    %% the earliest of these times
    due = infinity :: integer() | infinity,
    commands = 0 :: non_neg_integer()
}).

%% A robot that drives with a velocity: until when at the latest, and its piece of motion; the time
%% of its last command, and until when the robot drives if the chassis has heard it.
-type driving() :: {UntilUs :: integer(), piece(), {ToldUs :: integer(), UntilUs :: integer()}}.

-type piece() :: starl_trajectory:piece() | unknown.

%% A command is heard so long after its step, or is not begun.
-define(HEARD_US, 500000).

%% @doc `profiles': those of the team's robots; for the rest see {@link
%% starl_motion_monitor_goals:new/1}.
-spec init(#{
    profiles := starl_chassis:profiles(),
    bodies => [starl_assumption:window()],
    slack_us => non_neg_integer()
}) -> #state{}.
init(#{profiles := Profiles} = Config) ->
    #state{profiles = Profiles, goals = starl_motion_monitor_goals:new(Config)}.

%% @doc The configuration with the windows of the faults that robots have, and the time by which this
%% computer may prolong anything.
-spec context(starl_monitor:known(), map()) -> map().
context(Known, Config) -> maps:merge(maps:with([bodies, slack_us], Known), Config).

%% @doc A fault in this window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{goals = Goals} = State) ->
    due(State#state{goals = starl_motion_monitor_goals:broken(Window, Goals)}).

%% @doc The events of motion, the motion of the chassis, and the end of robots.
-spec interests() -> [atom()].
interests() -> [motion, chassis, robot].

%% @doc {@link starl_motion:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() ->
    #{motion => [{velocity, 2}, {velocity_over, 1}, {goal, 2}, {line, 1}, {goal_over, 1}]}.

%% @doc Goals that were reached, and what was excused: a robot that was not near its line any more, or
%% late, because its position may have been wrong; a robot that a fault held up.
-spec sometimes() -> [{atom(), owed | seldom}].
sometimes() -> [{arrived, owed}, {misplaced, owed}, {held_up, seldom}].

%% @doc Judges one event, and the time until it.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, #state{due = Due} = State) when T =< Due ->
    %% integers sort before the atom infinity
    judge(Event, State);
step({T, _, _, _} = Event, State) ->
    case pass(T, State) of
        {[], Passed} -> judge(Event, Passed);
        {[First | _], Passed} -> first(First, judge(Event, Passed))
    end.

first(Violation, {ok, State}) -> {violation, Violation, State};
first(Violation, {violation, _Second, State}) -> {violation, Violation, State}.

judge({T, Robot, Machine, Event}, #state{goals = Goals0} = State0) ->
    {Off, Goals} = starl_motion_monitor_goals:happened(T, Robot, {Machine, Event}, Goals0),
    Before = State0#state{goals = Goals},
    State = sooner(starl_motion_monitor_goals:due(Goals), Before),
    Judged = cruised({T, Robot, Machine, Event}, State),
    lists:foldl(
        fun({_, What, Details}, J) -> first(violation(What, T, Robot, Details), J) end, Judged, Off
    ).

cruised({T, Robot, chassis, {motion, Piece}}, #state{driving = Driving} = State) ->
    case Driving of
        #{Robot := {_, _, {T, Until} = Told}} ->
            {ok, sooner(Until, State#state{driving = Driving#{Robot := {Until, Piece, Told}}})};
        #{Robot := {Until, _, Told}} ->
            {ok, State#state{driving = Driving#{Robot := {Until, Piece, Told}}}};
        #{} ->
            {ok, State}
    end;
cruised({T, Robot, motion, {velocity, _, Us}}, #state{driving = Driving, commands = N} = State) ->
    Until =
        T + Us + spare_us(starl_chassis:of_robot(Robot, State#state.profiles)) +
            late_us(T, Robot, State),
    {Before, Piece, _} = maps:get(Robot, Driving, {Until, unknown, none}),
    Drives = {max(Before, Until), Piece, {T, Until}},
    Driven = State#state{driving = Driving#{Robot => Drives}, commands = N + 1},
    {ok, sooner(element(1, Drives), Driven)};
cruised({T, Robot, motion, {velocity_over, Why}}, #state{driving = Driving} = State) ->
    Ended = State#state{driving = maps:remove(Robot, Driving)},
    case Driving of
        #{Robot := {_, Piece, _}} when Why =:= time -> stands(T, Robot, Piece, Ended);
        #{} -> {ok, Ended}
    end;
cruised(_, State) ->
    {ok, State}.

stands(T, Robot, Piece, State) ->
    case is_at_rest(T, Piece) of
        true -> {ok, State};
        false -> {violation, violation(drives_when_time_is_over, T, Robot), State}
    end.

late_us(T, Robot, #state{goals = Goals}) ->
    min(?HEARD_US, starl_motion_monitor_goals:leaves_us(Robot, T, Goals) - T).

spare_us(Profile) ->
    starl_chassis:latency_us(Profile) + ceil(1.0e6 * starl_chassis:rests_s(Profile)).

%% Never later than the earliest time, and mostly not much earlier: to look at all robots at each event
%% would cost the whole team.
sooner(Due, #state{due = Before} = State) -> State#state{due = min(Due, Before)}.

due(#state{driving = Driving, goals = Goals} = State) ->
    Ends = [Until || {Until, _, _} <- maps:values(Driving)],
    State#state{
        due = lists:min([infinity, starl_motion_monitor_goals:due(Goals) | Ends])
    }.

%% Robots whose time has passed are judged by the piece that they were in then.
pass(T, #state{driving = Driving, goals = Goals} = State) ->
    {Lost, Left} = starl_motion_monitor_goals:pass(T, Goals),
    All = [{Until, Robot, Piece} || {Robot, {Until, Piece, _}} <- maps:to_list(Driving)],
    Late = lists:sort([One || {Until, _, _} = One <- All, Until < T]),
    Found = [
        violation(drives_beyond_its_time, Until, Robot)
     || {Until, Robot, Piece} <- Late, not is_at_rest(Until, Piece)
    ],
    NotArrived = [violation(What, Due, Robot, Details) || {Due, Robot, What, Details} <- Lost],
    Driven = maps:without([R || {_, R, _} <- Late], Driving),
    {Found ++ NotArrived, due(State#state{driving = Driven, goals = Left})}.

%% A robot whose chassis has not heard a command has no piece: it stands as it stood.
is_at_rest(_T, unknown) -> true;
is_at_rest(_T, {piece, _, _, _, _, V, W}) -> V == 0 andalso W == 0;
is_at_rest(T, Ramp) -> starl_trajectory:rests_from(Ramp) =< T.

violation(What, T, Robot) -> violation(What, T, Robot, #{}).

violation(What, T, Robot, Details) ->
    #{contract => motion, what => What, at_us => T, robots => [Robot], details => Details}.

%% @doc Judges the time until the end. Results: the numbers of velocities and of goals that were given, and
%% of goals that were reached.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, #state{goals = Goals} = State) ->
    Counts = starl_motion_monitor_goals:counts(Goals),
    Results = Counts#{velocities => State#state.commands, sometimes => sometimes(Goals)},
    {Late, _} = pass(EndUs, State),
    Off = [
        violation(What, EndUs, Robot, Details)
     || {Robot, What, Details} <- starl_motion_monitor_goals:finish(EndUs, Goals)
    ],
    starl_violation:finish(Late ++ Off, Results).

sometimes(Goals) ->
    #{arrived := Arrived} = starl_motion_monitor_goals:counts(Goals),
    (starl_motion_monitor_goals:excused(Goals))#{arrived => Arrived}.
