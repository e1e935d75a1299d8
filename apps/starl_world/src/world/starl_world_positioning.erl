%% @doc The positioning system of the simulated world: the pictures that it shows robots, with the
%% errors of their sensors, rounded to whole millimetres if wished, and with the faults of a scenario
%% (class `location'). A pure module.
%%
%% A robot for which the system is frozen gets the last picture again and again, as a new one.
-module(starl_world_positioning).

-export([new/2, rate_hz/1, fault/2, seen/3, shown/4]).

-export_type([t/0, options/0]).

%% `rate_hz': the pictures a second (`none': one whenever a robot asks).
-type options() :: #{rate_hz => number() | none, whole_mm => boolean(), atom() => term()}.

-record(positioning, {
    profiles :: starl_chassis:profiles(),
    seed :: integer(),
    rate_hz :: number() | none,
    whole_mm :: boolean(),
    draws = 0 :: non_neg_integer(),
    %% what each robot was shown last, and the faults that last
    shown = #{} :: #{starl:robot_id() => #{starl:robot_id() => starl:pose()}},
    faults = [] :: [starl_world_faults:fault()]
}).

-opaque t() :: #positioning{}.

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

%% @doc One of its faults begins or ends.
-spec fault(starl_world_faults:told(), t()) -> t().
fault({began, Fault}, #positioning{faults = Faults} = Positioning) ->
    Positioning#positioning{faults = Faults ++ [Fault]};
fault({ended, Fault}, #positioning{faults = Faults} = Positioning) ->
    Positioning#positioning{faults = lists:keydelete(element(1, Fault), 1, Faults)}.

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
