%% @doc The contract of motion: a robot with a goal stays near its line and arrives; a robot with a
%% velocity stands in time.
%%
%% Goals. A drive begins with `goal', and has a line as soon as the robot knows where it stands. The
%% robot stays within r(v) of its line until it has another line or drives with a velocity, also when
%% its program has crashed. It need not if it is farther off the line at its beginning, nor once its
%% position may have been wrong. It arrives: how long a drive may take follows from its length and its
%% chassis ({@link starl_chassis:arrives_us/3}), and from how long its controller may wait. This time
%% begins anew at the end of each fault of this robot during the drive.
%%
%% Velocities. A robot that drives with a velocity ({@link starl:velocity/3})
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
%% Events: of machine `motion', {@link starl_motion:event()}, `crashed'; of machine `chassis', `motion',
%% `sensed'; of machine `robot', `down' and `died'.
-module(starl_motion_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, sometimes/0]).

-type piece() :: starl_trajectory:piece().

%% A robot that drives with a velocity: until when at the latest, and its piece of motion; the time
%% of its last command, and until when the robot drives if the chassis has heard it.
-type cruise() :: {
    UntilUs :: integer(), piece() | unknown, {CommandUs :: integer(), UntilUs :: integer()}
}.

-type goal() :: #{
    to := starl_geometry:point(), since_us := integer(), within_us := pos_integer() | never
}.

%% A robot's piece of motion, judged until then; its line, since when; its goal.
-record(drive, {
    piece = none :: piece() | none,
    judged_us = 0 :: integer(),
    line = none :: {starl_geometry:segment(), SinceUs :: integer()} | none,
    goal = none :: goal() | none,
    bumped_us = none :: integer() | none
}).

-record(state, {
    profiles :: starl_chassis:profiles(),
    %% the limit of each profile, mm: it is asked for at each piece of motion
    radii :: tuple(),
    assumption :: starl_assumption:t(),
    step_us :: non_neg_integer(),
    slack_us :: non_neg_integer(),
    cruises = #{} :: #{starl:robot_id() => cruise()},
    %% none of them ends before this
    first_end = infinity :: integer() | infinity,
    drives = #{} :: #{starl:robot_id() => #drive{}},
    arrivals = starl_obligations:new(anew) :: starl_obligations:t(starl:robot_id()),
    velocities = 0 :: non_neg_integer(),
    goals = 0 :: non_neg_integer(),
    arrived = 0 :: non_neg_integer(),
    misplaced = 0 :: non_neg_integer(),
    held_up = 0 :: non_neg_integer()
}).

%% A command is heard so long after its step, or is not begun.
-define(HEARD_US, 500000).
%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% Rounding, and the chords of an arc (mm).
-define(CHORD_MM, 0.01).
%% What a step takes beside the driving and the line's latency: the chassis says each 15 ms that it stands,
%% and a picture of the positions is 20 ms old at most, or is asked for again.
-define(STEP_US, 55000).
%% Motion waits for an answer of its chassis, or for a position, no longer than this, nor between two
%% tries.
-define(PATIENCE_US, 500000).

%% @doc `profiles': those of the team's robots; `bodies': the windows of faults of robots
%% ({@link starl_monitor:known()}); `slack_us': the time by which this computer may prolong anything.
-spec init(#{
    profiles := starl_chassis:profiles(),
    bodies => [starl_assumption:window()],
    slack_us => non_neg_integer()
}) -> #state{}.
init(#{profiles := Profiles} = Config) ->
    Slack = maps:get(slack_us, Config, 0),
    #state{
        profiles = Profiles,
        radii = list_to_tuple([starl_chassis:tracking_radius(P) + ?CHORD_MM || P <- Profiles]),
        assumption = starl_assumption:new(maps:get(bodies, Config, []), ?DRIFT_PPM),
        %% a step that takes longer than these two patiences is begun again
        step_us = ?STEP_US + min(Slack, 2 * ?PATIENCE_US),
        slack_us = Slack
    }.

%% @doc The configuration with the windows of the faults that robots have, and the time by which this
%% computer may prolong anything.
-spec context(starl_monitor:known(), map()) -> map().
context(Known, Config) -> maps:merge(maps:with([bodies, slack_us], Known), Config).

%% @doc A fault in this window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{assumption = Assumption} = State) ->
    State#state{assumption = starl_assumption:broken(Window, Assumption)}.

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
step({T, _, _, _} = Event, State) ->
    {Overdue, Passed} = pass(T, State),
    starl_violation:first(Overdue, judge(Event, Passed)).

%% @doc Judges the time until the end. Results: the numbers of velocities and of goals that were given, and
%% of goals that were reached; how often a robot was excused.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, #state{arrived = Arrived, drives = Drives} = State) ->
    {Overdue, _} = pass(EndUs, State),
    Off = [
        Found
     || Robot <- lists:sort(maps:keys(Drives)), Found <- element(1, follow(EndUs, Robot, State))
    ],
    starl_violation:finish(Overdue ++ Off, #{
        velocities => State#state.velocities,
        goals => State#state.goals,
        arrived => Arrived,
        sometimes => #{
            arrived => Arrived,
            misplaced => State#state.misplaced,
            held_up => State#state.held_up
        }
    }).

%% Who should stand, or have arrived, before `T'?
pass(T, State) ->
    {Driving, Stopped} = Timed = beyond_its_time(T, State),
    case starl_obligations:overdue(T, State#state.assumption, State#state.arrivals) of
        none ->
            Timed;
        {Late, Left} ->
            {NotArrived, Next} = not_arrived(Late, Stopped#state{arrivals = Left}),
            {Driving ++ NotArrived, Next}
    end.

judge({T, Robot, Machine, Event}, State) ->
    {Off, Next} = drive({Machine, Event}, T, Robot, State),
    starl_violation:first(Off, cruise({Machine, Event}, T, Robot, Next)).

violation(What, T, Robot, Details) -> starl_violation:new(motion, What, T, [Robot], Details).

%% -- velocities -----------------------------------------------------------------------------

cruise({chassis, {motion, Piece}}, T, Robot, #state{cruises = Cruises} = State) ->
    case Cruises of
        #{Robot := {_, _, {T, Until} = Command}} ->
            {ok, ends(Until, State#state{cruises = Cruises#{Robot := {Until, Piece, Command}}})};
        #{Robot := {Until, _, Command}} ->
            {ok, State#state{cruises = Cruises#{Robot := {Until, Piece, Command}}}};
        #{} ->
            {ok, State}
    end;
cruise({motion, {velocity, _, Us}}, T, Robot, #state{cruises = Cruises} = State) ->
    Until = T + Us + spare_us(Robot, State) + late_us(T, Robot, State),
    {Before, Piece, _} = maps:get(Robot, Cruises, {Until, unknown, none}),
    Latest = max(Before, Until),
    {ok,
        ends(Latest, State#state{
            cruises = Cruises#{Robot => {Latest, Piece, {T, Until}}},
            velocities = State#state.velocities + 1
        })};
cruise({motion, {velocity_over, Why}}, T, Robot, #state{cruises = Cruises} = State) ->
    Drives =
        case Cruises of
            #{Robot := {_, Piece, _}} when Why =:= time -> not is_at_rest(T, Piece);
            #{} -> false
        end,
    starl_violation:step(
        [violation(drives_when_time_is_over, T, Robot, #{}) || Drives],
        State#state{cruises = maps:remove(Robot, Cruises)}
    );
cruise(_Event, _T, _Robot, State) ->
    {ok, State}.

spare_us(Robot, #state{profiles = Profiles}) ->
    Profile = starl_chassis:of_robot(Robot, Profiles),
    starl_chassis:latency_us(Profile) + ceil(1.0e6 * starl_chassis:rests_s(Profile)).

%% A stalled robot's command leaves when it goes on.
late_us(T, Robot, #state{assumption = Assumption}) ->
    min(?HEARD_US, starl_assumption:leaves_us(Robot, T, Assumption) - T).

%% Mostly not much earlier than the earliest time: to look at all robots at each event would cost the whole
%% team.
ends(Until, #state{first_end = First} = State) -> State#state{first_end = min(Until, First)}.

%% Robots whose time has passed are judged by the piece that they were in then.
beyond_its_time(T, #state{first_end = First} = State) when T =< First ->
    %% integers sort before the atom infinity
    {[], State};
beyond_its_time(T, #state{cruises = Cruises} = State) ->
    All = [{Until, Robot, Piece} || {Robot, {Until, Piece, _}} <- maps:to_list(Cruises)],
    {Late, Left} = lists:partition(fun({Until, _, _}) -> Until < T end, lists:sort(All)),
    Found = [
        violation(drives_beyond_its_time, Until, Robot, #{})
     || {Until, Robot, Piece} <- Late, not is_at_rest(Until, Piece)
    ],
    {Found, State#state{
        cruises = maps:without([Robot || {_, Robot, _} <- Late], Cruises),
        first_end = lists:min([infinity | [Until || {Until, _, _} <- Left]])
    }}.

%% A robot whose chassis has not heard a command has no piece: it stands as it stood.
is_at_rest(_T, unknown) -> true;
is_at_rest(_T, {piece, _, _, _, _, V, W}) -> V == 0 andalso W == 0;
is_at_rest(T, Ramp) -> starl_trajectory:rests_from(Ramp) =< T.

%% -- goals and lines ------------------------------------------------------------------------

%% Where the robot was too far off its line before this event, if it was.
drive({motion, Event}, T, Robot, State) ->
    moves(Event, T, Robot, State);
drive({chassis, {motion, Piece}}, T, Robot, State) ->
    {Found, Drive, Next} = follow(T, Robot, State),
    Since = max(T, starl_trajectory:start_us(Piece)),
    {Found, put_drive(Robot, Drive#drive{piece = Piece, judged_us = Since}, Next)};
drive({chassis, {sensed, {bump, _Side}}}, T, Robot, State) ->
    %% something is in its way: it need not arrive; and while its wheels turned on it was set apart
    {Found, Drive, Next} = follow(T, Robot, State),
    {Found, over(Robot, put_drive(Robot, Drive#drive{line = none, bumped_us = T}, Next))};
drive({robot, down}, _T, Robot, State) ->
    {[], over(Robot, State)};
drive({robot, {died, _Reason}}, T, Robot, State) ->
    {Found, _Drive, Next} = follow(T, Robot, State),
    Over = over(Robot, Next),
    {Found, Over#state{drives = maps:remove(Robot, Over#state.drives)}};
drive(_Event, _T, _Robot, State) ->
    {[], State}.

moves({goal, _Way, To}, T, Robot, State) ->
    {[], sets_out(T, Robot, To, State)};
moves({line, Line}, T, Robot, State) ->
    {Found, Drive, Next} = follow(T, Robot, State),
    Held = [
        {Line, T}
     || Place <- place(T, Drive),
        is_apart(T, Drive),
        starl_geometry:point_segment(Place, Line) =< radius_mm(Robot, State)
    ],
    {Found, put_drive(Robot, Drive#drive{line = hd(Held ++ [none])}, Next)};
moves({velocity, _, _}, T, Robot, State) ->
    {Found, Drive, Next} = follow(T, Robot, State),
    {Found, put_drive(Robot, Drive#drive{line = none}, Next)};
moves({goal_over, arrived}, T, Robot, #state{arrived = N, held_up = Held} = State) ->
    Late = length([x || is_late(T, drive_of(Robot, State))]),
    {[], over(Robot, State#state{arrived = N + 1, held_up = Held + Late})};
moves(Event, _T, Robot, State) when
    element(1, Event) =:= goal_over; Event =:= crashed; Event =:= {velocity_over, restarted}
->
    {[], over(Robot, State)};
moves(_Event, _T, _Robot, State) ->
    {[], State}.

drive_of(Robot, #state{drives = Drives}) -> maps:get(Robot, Drives, #drive{}).

put_drive(Robot, Drive, #state{drives = Drives} = State) ->
    State#state{drives = Drives#{Robot => Drive}}.

%% It need not arrive any more.
over(Robot, #state{drives = Drives, arrivals = Arrivals} = State) ->
    case Drives of
        #{Robot := Drive} ->
            State#state{
                drives = Drives#{Robot := Drive#drive{goal = none}},
                arrivals = starl_obligations:paid(Robot, Arrivals)
            };
        #{} ->
            State
    end.

place(_T, #drive{piece = none}) -> [];
place(T, #drive{piece = Piece}) -> [starl_trajectory:position(T, Piece)].

%% Has it touched nothing for a while?
is_apart(_T, #drive{bumped_us = none}) -> true;
is_apart(T, #drive{bumped_us = Bumped}) -> T - Bumped >= ?PATIENCE_US.

sets_out(T, Robot, To, #state{goals = N, arrivals = Arrivals} = State) ->
    Drive = drive_of(Robot, State),
    Within = within_us(T, Robot, To, Drive, State),
    Goal = #{to => To, since_us => T, within_us => Within},
    Owed =
        case Within of
            never -> starl_obligations:paid(Robot, Arrivals);
            Us -> starl_obligations:owe(Robot, Robot, T, Us, Arrivals)
        end,
    put_drive(Robot, Drive#drive{goal = Goal}, State#state{goals = N + 1, arrivals = Owed}).

%% A robot that drives stops before it sets out: a leg of no length.
within_us(T, Robot, To, Drive, #state{step_us = Step, slack_us = Slack, profiles = Profiles}) ->
    Profile = starl_chassis:of_robot(Robot, Profiles),
    Latency = starl_chassis:latency_us(Profile),
    Lengths = [starl_geometry:distance(Place, To) || Place <- place(T, Drive)],
    case
        Lengths =/= [] andalso starl_chassis:arrives_us(hd(Lengths), Step + 2 * Latency, Profile)
    of
        Us when is_integer(Us) ->
            Us + 3 * ?PATIENCE_US + Slack + starl_controller:waits_us(Profile);
        _Unknown ->
            never
    end.

not_arrived(Late, #state{drives = Drives, assumption = Assumption} = State) ->
    Found = [
        violation(not_arrived, Due, Robot, maps:with([to, since_us], Goal))
     || {Due, Robot} <- Late,
        #{Robot := #drive{goal = #{since_us := Since} = Goal}} <- [Drives],
        not starl_assumption:is_misplaced(Robot, Since, Due, Assumption)
    ],
    Ended = lists:foldl(fun({_, Robot}, S) -> over(Robot, S) end, State, Late),
    {Found, Ended#state{misplaced = State#state.misplaced + length(Late) - length(Found)}}.

is_late(_T, #drive{goal = #{within_us := never}}) -> false;
is_late(T, #drive{goal = #{since_us := Since, within_us := Within}}) -> T > Since + Within;
is_late(_T, _Drive) -> false.

%% The robot's drive, judged until then.
follow(T, Robot, #state{assumption = Assumption, misplaced = N} = State) ->
    case drive_of(Robot, State) of
        #drive{line = {Line, Since}, piece = Piece, judged_us = From} = Drive when From < T ->
            Judged = Drive#drive{judged_us = T},
            case strays(Line, Piece, From, T, radius_mm(Robot, State)) of
                none ->
                    {[], Judged, State};
                {At, Mm} ->
                    %% where it begins the robot has seen before, within its patience
                    Seen = Since - ?PATIENCE_US,
                    Lost = Judged#drive{line = none},
                    case starl_assumption:is_misplaced(Robot, Seen, T, Assumption) of
                        true -> {[], Lost, State#state{misplaced = N + 1}};
                        false -> {[off_line(T, Robot, At, Mm, Line, State)], Lost, State}
                    end
            end;
        Drive ->
            {[], Drive#drive{judged_us = max(T, Drive#drive.judged_us)}, State}
    end.

off_line(T, Robot, At, Mm, Line, State) ->
    Limit = radius_mm(Robot, State),
    Details = #{at => At, distance_mm => Mm, limit_mm => Limit, line => Line},
    violation(off_line, T, Robot, Details).

%% The farthest place on this piece from the line, if it is too far off.
strays(Line, Piece, From, To, Limit) ->
    Off = [
        {starl_geometry:point_segment(Point, Line), Point}
     || not starl_trajectory:is_still(Piece),
        Point <- starl_trajectory:polyline(Piece, From, To, ?CHORD_MM)
    ],
    case lists:max([{0.0, none} | Off]) of
        {Mm, Point} when Mm > Limit -> {Point, Mm};
        _ -> none
    end.

radius_mm(Robot, #state{radii = Radii}) ->
    %% as starl_chassis:of_robot/2
    element(1 + (Robot - 1) rem tuple_size(Radii), Radii).
