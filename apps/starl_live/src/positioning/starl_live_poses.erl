%% @doc Keeps what a robot's positioning has seen: the latest pose of each robot, and the questions
%% that wait for a picture. Pure; the process around it is {@link starl_live_positioning}.
%%
%% <em>Questions.</em> A question is answered with the first picture that shows the robot itself at
%% the time of the question, or later. For other robots the answer has the last pose seen, with its
%% age.
%%
%% <em>Old pictures.</em> A pose that is no newer than the one before it changes nothing. Neither
%% does a pose that is bit for bit equal to the one before it, unless the source is `exact' (it
%% rounds): no live system measures the same value twice.
%%
%% <em>The first picture.</em> A source may have been stuck before the robot looked for the first time. So the
%% first pose of the robot itself counts only when a different one that fits it has followed (unless the
%% source is `exact').
%%
%% <em>Jumps.</em> A robot cannot be where it could not have driven to. A pose is refused if it is
%% farther from the last pose than `speed' allows for the time between them (plus `jump_mm'), or
%% turned by more than `turn' allows (plus `jump_rad'). If the poses that follow agree with it for
%% `believe_us', it is believed: somebody has carried the robot, or the earlier pose was wrong.
%%
%% <em>Placing.</em> People put robots down. With a rule for that (`placing',
%% {@link starl_floor_placement:stands/3}), questions are answered only after a picture has shown
%% that the robot stands well among all others. Until then it drives nowhere. Each problem is
%% reported once.
-module(starl_live_poses).

-export([new/2, options/1, ask/4, wanted/2, show/3, silence/2, figures/1]).

-export_type([t/0, picture/0, event/0]).

%% Robots, with the age of each pose.
-type picture() :: [{starl:robot_id(), starl:pose(), AgeUs :: non_neg_integer()}].

%% What is said in the log, once each time.
-type event() ::
    #{
        what := position_jumped,
        of_robot := starl:robot_id(),
        from := starl:pose(),
        to := starl:pose(),
        refused_us := non_neg_integer()
    }
    | #{what := position_silent | position_back, for_us := non_neg_integer()}
    | #{what := badly_placed, why := binary()}
    | #{what := well_placed}.

%% The questions that may be open; beyond that the oldest is forgotten.
-define(OPEN, 1000).
%% The robot has not been seen for so long that it is said.
-define(SILENT_US, 2000000).

-record(seen, {
    self :: starl:robot_id(),
    participants :: starl_team:t(),
    exact :: boolean(),
    limits :: limits(),
    robots = #{} :: #{starl:robot_id() => robot()},
    %% open questions, newest first
    asked = [] :: [{Tag :: term(), [starl:robot_id()], AtUs :: integer()}],
    %% since when the robot itself has not been seen; has that been said?
    since_us :: integer(),
    silent = false :: boolean(),
    %% how the robot is to be put down, until it has been seen to stand so; what was said of that last
    placing :: starl_floor_placement:rule() | none,
    misplaced = none :: starl_floor_placement:problem() | none,
    figures = #{} :: #{atom() => pos_integer()}
}).

%% Speed (mm/s), turn (rad/s), what a pose may be off besides (mm, rad), and the time after which a
%% jump is believed.
-type limits() :: {
    Speed :: number() | infinity,
    Turn :: number() | infinity,
    JumpMm :: number(),
    JumpRad :: number(),
    BelieveUs :: non_neg_integer()
}.

%% The last pose that was believed; since when others have been refused, and the last of these. The robot
%% itself is not known yet while no other pose has followed its first one.
-type robot() :: {at(), doubt()} | {first, at(), doubt()}.
-type doubt() :: none | {SinceUs :: integer(), at()}.
-type at() :: {starl:pose(), TakenUs :: integer()}.

-opaque t() :: #seen{}.

%% @doc Nothing has been seen yet. The configuration is that of {@link starl_live_positioning}.
-spec new(starl_live_positioning:config(), NowUs :: integer()) -> t().
new(#{robot := Self, participants := Participants} = Config, Now) ->
    #seen{
        self = Self,
        participants = Participants,
        exact = maps:get(exact, Config, false),
        limits = {
            maps:get(speed, Config, infinity),
            maps:get(turn, Config, infinity),
            maps:get(jump_mm, Config, 50),
            maps:get(jump_rad, Config, 0.5),
            maps:get(believe_us, Config, 1000000)
        },
        placing = maps:get(placing, Config, none),
        since_us = Now
    }.

%% @doc Checks the options: one line on the first that is wrong.
-spec options(map()) -> ok | {error, iolist()}.
options(Config) ->
    Wrong = [
        io_lib:format("~s must be ~s, not ~0p", [Key, Expected, maps:get(Key, Config)])
     || {Key, Expected, Is} <- checks(), is_map_key(Key, Config), not Is(maps:get(Key, Config))
    ],
    case Wrong of
        [] -> ok;
        [First | _] -> {error, First}
    end.

checks() ->
    Bound = fun(N) -> N =:= infinity orelse is_number(N) andalso N > 0 end,
    Size = fun(N) -> is_number(N) andalso N >= 0 end,
    [
        {exact, "true or false", fun is_boolean/1},
        {speed, "a speed in mm/s, or infinity", Bound},
        {turn, "a speed in rad/s, or infinity", Bound},
        {jump_mm, "a distance in mm", Size},
        {jump_rad, "an angle in rad", Size},
        {believe_us, "a time in microseconds", Size}
    ].

%% -- questions ------------------------------------------------------------------------------

%% @doc A question. One that is asked again counts from the first time.
-spec ask(Tag :: term(), [starl:robot_id()], NowUs :: integer(), t()) -> t().
ask(Tag, Robots, Now, #seen{asked = Asked} = Seen) ->
    case lists:keymember(Tag, 1, Asked) of
        true -> Seen;
        false -> Seen#seen{asked = lists:sublist([{Tag, Robots, Now} | Asked], ?OPEN)}
    end.

%% @doc The robots that the source is asked for. A robot that has just been put down asks for all.
-spec wanted([starl:robot_id()], t()) -> [starl:robot_id()].
wanted(Robots, #seen{placing = none}) -> Robots;
wanted(_Robots, #seen{participants = Participants}) -> starl_team:members(Participants).

%% @doc The robot has asked: is there something to say about a source that does not show it? Nobody
%% misses a picture while no question is open; some sources show nothing unless they are asked.
-spec silence(NowUs :: integer(), t()) -> {[event()], t()}.
silence(Now, #seen{since_us = Since, asked = [_ | _] = Asked, silent = false} = Seen) ->
    {_, _, Oldest} = lists:last(Asked),
    case Now - max(Since, Oldest) of
        Us when Us >= ?SILENT_US ->
            {[#{what => position_silent, for_us => Us}], Seen#seen{silent = true}};
        _ ->
            {[], Seen}
    end;
silence(_Now, Seen) ->
    {[], Seen}.

%% @doc The counters.
-spec figures(t()) -> starl_live_positioning:figures().
figures(#seen{figures = Figures, asked = Asked}) -> Figures#{open => length(Asked)}.

%% @doc Robots that the source shows: the questions that this answers, oldest first.
-spec show([starl_live_positioning:sighting()], NowUs :: integer(), t()) ->
    {[{Tag :: term(), picture()}], [event()], t()}.
show(Sightings, Now, Seen) ->
    {Jumps, Latest} = lists:foldl(
        fun(Sighting, Before) -> see(Sighting, Now, Before) end, {[], Seen}, Sightings
    ),
    {Back, Known} = back(Now, Seen, Latest),
    {Placed, Stands} = placed(Now, Known),
    {Answers, Answered} = answer(Now, Stands),
    {Answers, lists:reverse(Jumps) ++ Back ++ Placed, Answered}.

%% The robot itself is seen again.
back(Now, Before, #seen{self = Self, since_us = Since, silent = Silent} = Seen) ->
    case {taken(Self, Before), taken(Self, Seen)} of
        {Same, Same} -> {[], Seen};
        _ when Silent -> {[#{what => position_back, for_us => Now - Since}], here(Now, Seen)};
        _ -> {[], here(Now, Seen)}
    end.

%% Does the robot stand well among those that have been seen lately?
placed(_Now, #seen{placing = none} = Seen) ->
    {[], Seen};
placed(Now, #seen{self = Self, robots = Robots, placing = Rule, misplaced = Before} = Seen) ->
    Poses = maps:from_list([
        {Id, Pose}
     || {Id, {{Pose, Taken}, _}} <- maps:to_list(Robots), Now - Taken < ?SILENT_US
    ]),
    case is_map_key(Self, Poses) andalso starl_floor_placement:stands(Self, Poses, Rule) of
        false ->
            {[], Seen};
        ok ->
            {[#{what => well_placed} || Before =/= none], Seen#seen{placing = none}};
        {error, Before, _} ->
            {[], Seen};
        {error, Problem, Line} ->
            Event = #{what => badly_placed, why => unicode:characters_to_binary(Line)},
            {[Event], Seen#seen{misplaced = Problem}}
    end.

here(Now, Seen) -> Seen#seen{since_us = Now, silent = false}.

%% An atom is greater than any number: `none' is no time.
taken(Robot, #seen{robots = Robots}) ->
    case Robots of
        #{Robot := {{_, Taken}, _}} -> Taken;
        %% not seen, or only for the first time
        #{} -> none
    end.

answer(_Now, #seen{placing = #{}} = Seen) ->
    {[], Seen};
answer(Now, #seen{self = Self, asked = Asked} = Seen) ->
    case taken(Self, Seen) of
        none ->
            {[], Seen};
        Taken ->
            {Open, Ready} = lists:partition(fun({_, _, At}) -> At > Taken end, Asked),
            Answers = [
                {Tag, picture(Robots, Now, Seen)}
             || {Tag, Robots, _} <- lists:reverse(Ready)
            ],
            {Answers, Seen#seen{asked = Open}}
    end.

picture(Wanted, Now, #seen{robots = Robots}) ->
    [
        {Robot, Pose, max(0, Now - Taken)}
     || Robot <- Wanted, #{Robot := {{Pose, Taken}, _}} <- [Robots]
    ].

%% -- what is believed -----------------------------------------------------------------------

%% Nothing is taken later than now: a source whose clock is ahead must not make all that follows old.
see({Robot, Pose, Taken}, Now, {Events, #seen{robots = Robots} = Seen}) ->
    This = {Pose, min(Taken, Now)},
    case starl_team:has(Robot, Seen#seen.participants) of
        true ->
            {Figure, Said, Known} = judge(Robot, This, maps:get(Robot, Robots, none), Seen),
            {Said ++ Events, count(Figure, Seen#seen{robots = Robots#{Robot => Known}})};
        false ->
            {Events, count(strangers, Seen)}
    end.

count(Figure, #seen{figures = Figures} = Seen) ->
    Seen#seen{figures = maps:update_with(Figure, fun(N) -> N + 1 end, 1, Figures)}.

judge(Self, This, none, #seen{self = Self, exact = false}) ->
    {first, [], {first, This, none}};
judge(_Robot, This, none, _Seen) ->
    {shown, [], {This, none}};
judge(Robot, This, {first, Last, Doubt}, Seen) ->
    case judge(Robot, This, {Last, Doubt}, Seen) of
        {Figure, Said, {This, none}} -> {Figure, Said, {This, none}};
        {Figure, Said, {Last, Other}} -> {Figure, Said, {first, Last, Other}}
    end;
judge(_Robot, {_, Taken}, {{_, Last}, _} = Known, _Seen) when Taken =< Last ->
    {late, [], Known};
judge(_Robot, {Pose, _}, {{Pose, _}, _} = Known, #seen{exact = false}) ->
    {repeated, [], Known};
judge(Robot, This, {Last, Doubt}, #seen{limits = Limits}) ->
    case within(This, Last, Limits) of
        true -> {shown, [], {This, none}};
        false -> jumped(Robot, This, Last, doubt(This, Doubt, Limits), Limits)
    end.

%% Since when poses have been refused that agree with this one.
doubt({_, Taken} = This, {Since, Refused}, Limits) ->
    case within(This, Refused, Limits) of
        true -> Since;
        false -> Taken
    end;
doubt({_, Taken}, none, _Limits) ->
    Taken.

jumped(Robot, {Pose, Taken} = This, {From, _}, Since, {_, _, _, _, Believe}) when
    Taken - Since >= Believe
->
    Event = #{
        what => position_jumped,
        of_robot => Robot,
        from => From,
        to => Pose,
        refused_us => Taken - Since
    },
    {jumps_believed, [Event], {This, none}};
jumped(_Robot, This, Last, Since, _Limits) ->
    {jumps_refused, [], {Last, {Since, This}}}.

within({{X, Y, A}, Taken}, {{U, V, B}, Before}, {Speed, Turn, Mm, Rad, _}) ->
    Us = abs(Taken - Before),
    reaches(starl_geometry:distance({X, Y}, {U, V}), Mm, Speed, Us) andalso
        reaches(abs(starl_geometry:angle_diff(A, B)), Rad, Turn, Us).

reaches(_Way, _More, infinity, _Us) -> true;
reaches(Mm, More, Speed, Us) -> Mm =< More + Speed * Us / 1.0e6.
