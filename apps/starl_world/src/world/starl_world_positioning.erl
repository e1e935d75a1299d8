%% @doc The positioning system of the simulated world, at both ends. In the world it is pure: it makes
%% pictures for the robots with the errors of their sensors and the faults of class `location'. If
%% wished, it rounds them to whole millimetres. In a robot it is a source of positions
%% ({@link starl_live_positioning}).
%%
%% A robot for which the system is frozen gets the last picture again and again, as a new one.
%%
%% <em>Looks that wait for hardware.</em> On a busy computer, reports of hardware arrive late. A
%% picture taken at once would show a body at an old place, as of now. So the hardware must first
%% report everything up to the moment of the look, and the picture shows that moment:
%% ```
%%     robot -- look --> world -- {starl_settle, World, N} --> hardware
%%     robot <- picture - world <-- {starl_settled, Robot, N} -- hardware     after all its reports
%% '''
%% Hardware that has ended does not answer, and a look without an answer is dropped.
-module(starl_world_positioning).
-behaviour(starl_live_positioning).

-export([open/1, ask/2, hear/2, figures/1, close/1]).
-export([new/2, rate_hz/1, fault/2, begun/4, settled/3, picture/5, seen/3, shown/4]).

-export_type([t/0, options/0, look/0]).

%% `rate_hz': the pictures a second (`none': one whenever a robot asks).
-type options() :: #{rate_hz => number() | none, whole_mm => boolean(), atom() => term()}.

%% Who looks (`sight': the process that gets the picture), and at whom.
-type look() :: {By :: {starl:robot_id(), Sight :: pid()} | all, [starl:robot_id()]}.

-record(positioning, {
    profiles :: starl_chassis:profiles(),
    seed :: integer(),
    rate_hz :: number() | none,
    whole_mm :: boolean(),
    draws = 0 :: non_neg_integer(),
    %% the last picture of each robot, and the faults that last
    shown = #{} :: #{starl:robot_id() => #{starl:robot_id() => starl:pose()}},
    faults = [] :: [starl_world_faults:fault()],
    %% the number of the next look that waits, and those that wait
    next = 1 :: pos_integer(),
    waiting = #{} :: #{pos_integer() => {look(), AtUs :: integer(), [starl:robot_id(), ...]}}
}).

-opaque t() :: #positioning{}.

%% A robot's end.
-record(sight, {world :: pid(), robot :: starl:robot_id(), pictures = 0 :: non_neg_integer()}).

%% A picture that is older is of no use to a robot.
-define(FORGOTTEN_US, 1000000).

%% @doc The positioning system of a simulation's world.
-spec new(starl_sim_world:t(), options()) -> t().
new(#{profiles := Profiles, seed := Seed}, Options) ->
    #positioning{
        profiles = Profiles,
        seed = Seed,
        rate_hz = maps:get(rate_hz, Options, none),
        whole_mm = maps:get(whole_mm, Options, false)
    }.

%% @doc The pictures a second.
-spec rate_hz(t()) -> number() | none.
rate_hz(#positioning{rate_hz = Rate}) -> Rate.

%% @doc A fault begins or ends, which may be one of its.
-spec fault(starl_world_faults:report(), t()) -> t().
fault({Is, Fault}, #positioning{faults = Faults} = Positioning) ->
    case {starl_run_fault:class(Fault), Is} of
        {location, began} ->
            Positioning#positioning{faults = Faults ++ [Fault]};
        {location, ended} ->
            Positioning#positioning{faults = lists:keydelete(element(1, Fault), 1, Faults)};
        _ ->
            Positioning
    end.

%% @doc Begins a look now, at bodies with this hardware among others. Returns whether the picture is
%% taken at once (`taken'), or which messages must be sent to the hardware first.
-spec begun(look(), NowUs :: integer(), [{starl:robot_id(), Hardware :: pid()}], t()) ->
    taken | {[{pid(), N :: pos_integer()}, ...], t()}.
begun(_Look, _Now, [], _Positioning) ->
    taken;
begun(Look, Now, Hardware, #positioning{next = N, waiting = Waiting} = Positioning) ->
    Young = maps:filter(fun(_, {_, At, _}) -> Now - At =< ?FORGOTTEN_US end, Waiting),
    {[{Pid, N} || {_, Pid} <- Hardware], Positioning#positioning{
        next = N + 1, waiting = Young#{N => {Look, Now, [Id || {Id, _} <- Hardware]}}
    }}.

%% @doc Handles that the hardware of a robot has reported everything up to the N-th look. Returns
%% the look and its time, if it waited for nothing else.
-spec settled(starl:robot_id(), N :: pos_integer(), t()) ->
    {taken, look(), AtUs :: integer(), t()} | {waits, t()}.
settled(Id, N, #positioning{waiting = Waiting} = Positioning) ->
    case Waiting of
        #{N := {Look, At, [Id]}} ->
            {taken, Look, At, Positioning#positioning{waiting = maps:remove(N, Waiting)}};
        #{N := {Look, At, Ids}} ->
            {waits, Positioning#positioning{
                waiting = Waiting#{N := {Look, At, lists:delete(Id, Ids)}}
            }};
        #{} ->
            {waits, Positioning}
    end.

%% @doc The picture of a look as of a time: what each sight that looks is shown.
-spec picture(look(), AtUs :: integer(), NowUs :: integer(), starl_world_team:t(), t()) ->
    {[{Sight :: pid(), [starl_live_positioning:sighting()]}], t()}.
picture({By, Ids}, At, Now, Robots, Positioning) ->
    {Id, Watching} =
        case By of
            all -> {0, starl_world_team:watching(Robots)};
            {Robot, _Sight} -> {Robot, [By]}
        end,
    {Seen, Taken} = seen(Id, starl_world_team:poses(Ids, At, Now, Robots), Positioning),
    lists:mapfoldl(
        fun({R, Sight}, Before) ->
            {Picture, Next} = shown(R, Seen, Now, Before),
            {{Sight, Picture}, Next}
        end,
        Taken,
        Watching
    ).

%% @doc A picture of robots at these true poses, each at its time; `By': the robot that looks, 0 if the
%% system does by itself.
-spec seen(By, [{starl:robot_id(), starl:pose(), Us :: integer()}], t()) ->
    {[starl_live_positioning:sighting()], t()}
when
    By :: starl:robot_id() | 0.
seen(By, Poses, #positioning{seed = Seed, draws = N} = Positioning) ->
    Seen = [{Id, sensed(Pose, {Seed, By, Id, N}, Id, Positioning), Us} || {Id, Pose, Us} <- Poses],
    {Seen, Positioning#positioning{draws = N + 1}}.

sensed(Pose, Key, Id, #positioning{profiles = Profiles, whole_mm = Whole}) ->
    rounded(Whole, starl_sim_positioning:blur(Pose, Key, starl_chassis:of_robot(Id, Profiles))).

rounded(false, Pose) -> Pose;
rounded(true, {X, Y, Heading}) -> {float(round(X)), float(round(Y)), Heading}.

%% @doc What a robot is shown of a picture.
-spec shown(starl:robot_id(), [starl_live_positioning:sighting()], NowUs :: integer(), t()) ->
    {[starl_live_positioning:sighting()], t()}.
shown(Id, Seen, _Now, #positioning{shown = Shown, faults = []} = Positioning) ->
    Last = maps:get(Id, Shown, #{}),
    Latest = maps:merge(Last, maps:from_list([{R, Pose} || {R, Pose, _} <- Seen])),
    {Seen, Positioning#positioning{shown = Shown#{Id => Latest}}};
shown(Id, Seen, Now, Positioning) ->
    #positioning{shown = Shown, faults = Faults, seed = Seed, draws = N} = Positioning,
    Look = #{
        robot => Id,
        faults => Faults,
        key => {Seed, Id, N},
        see => fun(Robot) -> [Pose || {R, Pose, _} <- Seen, R =:= Robot] end,
        seen => maps:get(Id, Shown, #{})
    },
    {Poses, Latest} = starl_sim_positioning:poses([R || {R, _, _} <- Seen], Look),
    Times = maps:from_list([{R, time(Id, Us, Now, Faults)} || {R, _, Us} <- Seen]),
    {
        [{R, Pose, maps:get(R, Times)} || {R, Pose} <- Poses],
        Positioning#positioning{shown = Shown#{Id => Latest}}
    }.

time(Id, Us, Now, Faults) ->
    Frozen = [F || {_, _, _, location_frozen, _, _} = F <- Faults, starl_run_fault:hits(Id, F)],
    case Frozen of
        [] -> Us;
        [_ | _] -> Now
    end.

%% -- a robot's end --------------------------------------------------------------------------

-spec open(#{world := pid(), robot := starl:robot_id(), atom() => term()}) -> {ok, #sight{}}.
open(#{world := World, robot := Robot}) ->
    World ! {starl_watches, Robot, self()},
    {ok, #sight{world = World, robot = Robot}}.

-spec ask([starl:robot_id()], #sight{}) -> #sight{}.
ask(Robots, #sight{world = World, robot = Robot} = Sight) ->
    World ! {starl_look, Robot, self(), lists:usort([Robot | Robots])},
    Sight.

-spec hear(term(), #sight{}) -> {[starl_live_positioning:sighting()], #sight{}} | unknown.
hear({starl_seen, Seen}, #sight{pictures = N} = Sight) -> {Seen, Sight#sight{pictures = N + 1}};
hear(_Message, _Sight) -> unknown.

-spec figures(#sight{}) -> starl_live_positioning:figures().
figures(#sight{pictures = N}) -> #{pictures => N}.

-spec close(#sight{}) -> ok.
close(_Sight) -> ok.
