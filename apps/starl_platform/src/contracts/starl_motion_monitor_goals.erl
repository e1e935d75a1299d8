%% @doc Judges the drives of robots to their goals, for {@link starl_motion_monitor}: each robot
%% stays within r(v) of its line, and arrives.
%%
%% A drive begins with `goal', and has a line as soon as the robot knows where it stands. The robot
%% must keep to the line until it has another line or drives with a velocity, also when its program
%% has crashed. It need not if it is farther off the line at its beginning, nor once its position
%% may have been wrong. How long a drive may take follows from its length and its chassis
%% ({@link starl_chassis:arrives_us/3}), and from how long its controller may wait. This time begins
%% anew at the end of each fault of this robot during the drive.
-module(starl_motion_monitor_goals).

-export([new/1, broken/2, happened/4, pass/2, due/1, finish/2, counts/1, excused/1, leaves_us/3]).

-export_type([t/0]).

-type robot_id() :: starl_monitor:robot_id().

%% A robot's piece of motion, judged until then; its line, since when; its goal.
-record(drive, {
    piece = none :: starl_trajectory:piece() | none,
    judged_us = 0 :: integer(),
    line = none :: {starl_geometry:segment(), SinceUs :: integer()} | none,
    goal = none :: goal() | none,
    bumped_us = none :: integer() | none
}).

-type goal() :: #{
    to := starl_geometry:point(),
    since_us := integer(),
    within_us := pos_integer() | never,
    due_us := integer() | never
}.

-record(goals, {
    profiles :: starl_chassis:profiles(),
    %% the limit of each profile, mm: it is asked for at each piece of motion
    radii :: tuple(),
    assumption :: starl_assumption:t(),
    step_us :: non_neg_integer(),
    slack_us :: non_neg_integer(),
    drives = #{} :: #{robot_id() => #drive{}},
    due = never :: integer() | never,
    goals = 0 :: non_neg_integer(),
    arrived = 0 :: non_neg_integer(),
    misplaced = 0 :: non_neg_integer(),
    held_up = 0 :: non_neg_integer()
}).

-opaque t() :: #goals{}.

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

%% @doc `bodies': the windows of faults of robots ({@link starl_monitor:known()}); `slack_us': the time by
%% which this computer may prolong anything.
-spec new(#{
    profiles := starl_chassis:profiles(),
    bodies => [starl_assumption:window()],
    slack_us => non_neg_integer()
}) -> t().
new(#{profiles := Profiles} = Config) ->
    Slack = maps:get(slack_us, Config, 0),
    #goals{
        profiles = Profiles,
        radii = list_to_tuple([starl_chassis:tracking_radius(P) + ?CHORD_MM || P <- Profiles]),
        assumption = starl_assumption:new(maps:get(bodies, Config, []), ?DRIFT_PPM),
        %% a step that takes longer than these two patiences is begun again
        step_us = ?STEP_US + min(Slack, 2 * ?PATIENCE_US),
        slack_us = Slack
    }.

%% @doc A fault in this window, of which no event has been judged yet.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #goals{assumption = Before, drives = Drives} = Goals) ->
    Assumption = starl_assumption:broken(Window, Before),
    Later = fun
        (Robot, #drive{goal = #{} = Goal} = Drive) ->
            Drive#drive{goal = Goal#{due_us := due_us(Robot, Goal, Assumption)}};
        (_Robot, Drive) ->
            Drive
    end,
    earliest(Goals#goals{assumption = Assumption, drives = maps:map(Later, Drives)}).

%% @doc No robot may be too late up to this time. An atom is greater than every number.
-spec due(t()) -> integer() | never.
due(#goals{due = Due}) -> Due.

%% @doc The goals that were given, and those that were reached.
-spec counts(t()) -> #{goals := non_neg_integer(), arrived := non_neg_integer()}.
counts(#goals{goals = Goals, arrived = Arrived}) -> #{goals => Goals, arrived => Arrived}.

%% @doc How often a robot was excused: its position may have been wrong; a fault has held it up beyond the time
%% that it would have had.
-spec excused(t()) -> #{misplaced := non_neg_integer(), held_up := non_neg_integer()}.
excused(#goals{misplaced = Misplaced, held_up = Held}) ->
    #{misplaced => Misplaced, held_up => Held}.

%% @doc Time has passed: who should have arrived until then, when, and where?
-spec pass(TimeUs :: integer(), t()) -> {[{DueUs, robot_id(), What, Details}], t()} when
    DueUs :: integer(), What :: atom(), Details :: map().
pass(T, #goals{due = Due} = Goals) when T =< Due ->
    {[], Goals};
pass(T, #goals{drives = Drives, assumption = Assumption} = Goals) ->
    Late = lists:sort([
        {Due, Robot, not_arrived, maps:with([to, since_us], Goal)}
     || {Robot, #drive{goal = #{due_us := Due} = Goal}} <- maps:to_list(Drives), Due < T
    ]),
    Left = lists:foldl(fun({_, Robot, _, _}, D) -> ended(Robot, D) end, Drives, Late),
    Found = [
        One
     || {Due, Robot, _, #{since_us := Since}} = One <- Late,
        not starl_assumption:is_misplaced(Robot, Since, Due, Assumption)
    ],
    Misplaced = Goals#goals.misplaced + length(Late) - length(Found),
    {Found, earliest(Goals#goals{drives = Left, misplaced = Misplaced})}.

%% @doc An event of a robot; the place where it was too far off its line before it, if it was.
-spec happened(TimeUs :: integer(), robot_id(), Event, t()) ->
    {[{robot_id(), off_line, map()}], t()}
when
    Event :: {Machine :: atom(), term()}.
happened(T, Robot, {motion, Event}, Goals) ->
    drives(T, Robot, Event, Goals);
happened(T, Robot, {chassis, {motion, Piece}}, Goals) ->
    {Found, Drive, Next} = follow(T, Robot, Goals),
    Since = max(T, starl_trajectory:start_us(Piece)),
    {Found, put_drive(Robot, Drive#drive{piece = Piece, judged_us = Since}, Next)};
happened(T, Robot, {chassis, {sensed, {bump, _Side}}}, Goals) ->
    %% something is in its way: it need not arrive; and while its wheels turned on it was set apart
    {Found, Drive, Next} = follow(T, Robot, Goals),
    {Found, over(Robot, put_drive(Robot, Drive#drive{line = none, bumped_us = T}, Next))};
happened(_T, Robot, {robot, down}, Goals) ->
    {[], over(Robot, Goals)};
happened(T, Robot, {robot, {died, _Reason}}, Goals) ->
    {Found, _Drive, #goals{drives = Drives} = Next} = follow(T, Robot, Goals),
    {Found, Next#goals{drives = maps:remove(Robot, Drives)}};
happened(_T, _Robot, _Event, Goals) ->
    {[], Goals}.

%% What its motion tells.
drives(T, Robot, {goal, _Way, To}, Goals) ->
    {[], sets_out(T, Robot, To, Goals)};
drives(T, Robot, {line, Line}, Goals) ->
    {Found, Drive, Next} = follow(T, Robot, Goals),
    Held = [
        {Line, T}
     || Place <- place(T, Drive),
        is_apart(T, Drive),
        starl_geometry:point_segment(Place, Line) =< radius_mm(Robot, Goals)
    ],
    {Found, put_drive(Robot, Drive#drive{line = hd(Held ++ [none])}, Next)};
drives(T, Robot, {velocity, _, _}, Goals) ->
    {Found, Drive, Next} = follow(T, Robot, Goals),
    {Found, put_drive(Robot, Drive#drive{line = none}, Next)};
drives(T, Robot, {goal_over, arrived}, #goals{arrived = N} = Goals) ->
    Held = Goals#goals.held_up + length([x || is_late(T, drive(Robot, Goals))]),
    {[], over(Robot, Goals#goals{arrived = N + 1, held_up = Held})};
drives(_T, Robot, {goal_over, _Why}, Goals) ->
    {[], over(Robot, Goals)};
drives(_T, Robot, Event, Goals) when Event =:= crashed; Event =:= {velocity_over, restarted} ->
    {[], over(Robot, Goals)};
drives(_T, _Robot, _Event, Goals) ->
    {[], Goals}.

sets_out(T, Robot, To, #goals{goals = N} = Goals) ->
    Drive = drive(Robot, Goals),
    Goal = goal(T, Robot, To, Drive, Goals),
    #goals{due = Due} =
        Given = put_drive(Robot, Drive#drive{goal = Goal}, Goals#goals{goals = N + 1}),
    Given#goals{due = min(Due, maps:get(due_us, Goal))}.

%% @doc The latest time at which a command of a step at this time leaves the robot's computer.
-spec leaves_us(robot_id(), TimeUs :: integer(), t()) -> integer().
leaves_us(Robot, T, #goals{assumption = Assumption}) ->
    starl_assumption:leaves_us(Robot, T, Assumption).

%% @doc The run has ended: who has been too far off its line since its last event?
-spec finish(EndUs :: integer(), t()) -> [{robot_id(), off_line, map()}].
finish(EndUs, #goals{drives = Drives} = Goals) ->
    [
        Off
     || Robot <- lists:sort(maps:keys(Drives)), Off <- element(1, follow(EndUs, Robot, Goals))
    ].

is_late(T, #drive{goal = #{since_us := Since, within_us := Within}}) -> T > add(Since, Within);
is_late(_T, _Drive) -> false.

add(_Since, never) -> never;
add(Since, Within) -> Since + Within.

%% Has it touched nothing for a while?
is_apart(_T, #drive{bumped_us = none}) -> true;
is_apart(T, #drive{bumped_us = Bumped}) -> T - Bumped >= ?PATIENCE_US.

drive(Robot, #goals{drives = Drives}) -> maps:get(Robot, Drives, #drive{}).

put_drive(Robot, Drive, #goals{drives = Drives} = Goals) ->
    Goals#goals{drives = Drives#{Robot => Drive}}.

over(Robot, #goals{drives = Drives} = Goals) ->
    Goals#goals{drives = ended(Robot, Drives)}.

ended(Robot, Drives) ->
    case Drives of
        #{Robot := Drive} -> Drives#{Robot := Drive#drive{goal = none}};
        #{} -> Drives
    end.

earliest(#goals{drives = Drives} = Goals) ->
    Dues = [Due || #drive{goal = #{due_us := Due}} <- maps:values(Drives)],
    Goals#goals{due = lists:min([never | Dues])}.

place(_T, #drive{piece = none}) -> [];
place(T, #drive{piece = Piece}) -> [starl_trajectory:position(T, Piece)].

%% -- arrives --------------------------------------------------------------------------------

%% A robot that drives stops before it sets out: a leg of no length.
goal(T, Robot, To, Drive, #goals{profiles = Profiles, step_us = Step, slack_us = Slack} = Goals) ->
    Profile = starl_chassis:of_robot(Robot, Profiles),
    Latency = starl_chassis:latency_us(Profile),
    Way = [starl_geometry:distance(Place, To) || Place <- place(T, Drive)],
    Within =
        case Way =/= [] andalso starl_chassis:arrives_us(hd(Way), Step + 2 * Latency, Profile) of
            Us when is_integer(Us) ->
                Us + 3 * ?PATIENCE_US + Slack + starl_controller:waits_us(Profile);
            _Unknown ->
                never
        end,
    Goal = #{to => To, since_us => T, within_us => Within, due_us => never},
    Goal#{due_us := due_us(Robot, Goal, Goals#goals.assumption)}.

due_us(_Robot, #{within_us := never}, _Assumption) ->
    never;
due_us(Robot, #{since_us := Since, within_us := Within}, Assumption) ->
    starl_assumption:calm_us(Robot, Since, Within, Assumption).

%% -- stays near its line ----------------------------------------------------------------------

%% The robot's drive, judged until then.
follow(T, Robot, #goals{assumption = Assumption} = Goals) ->
    case drive(Robot, Goals) of
        #drive{line = {Line, Since}, piece = Piece, judged_us = From} = Drive when From < T ->
            Judged = Drive#drive{judged_us = T},
            case strays(Line, Piece, From, T, radius_mm(Robot, Goals)) of
                none ->
                    {[], Judged, Goals};
                {At, Mm} ->
                    %% where it begins the robot has seen before, within its patience
                    Seen = Since - ?PATIENCE_US,
                    Misplaced = starl_assumption:is_misplaced(Robot, Seen, T, Assumption),
                    Off = #{at => At, distance_mm => Mm, limit_mm => radius_mm(Robot, Goals)},
                    Found = [{Robot, off_line, Off#{line => Line}} || not Misplaced],
                    Count = Goals#goals.misplaced + length([x || Misplaced]),
                    {Found, Judged#drive{line = none}, Goals#goals{misplaced = Count}}
            end;
        Drive ->
            {[], Drive#drive{judged_us = max(T, Drive#drive.judged_us)}, Goals}
    end.

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

radius_mm(Robot, #goals{radii = Radii}) ->
    %% as starl_chassis:of_robot/2
    element(1 + (Robot - 1) rem tuple_size(Radii), Radii).
