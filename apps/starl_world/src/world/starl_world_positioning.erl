%% @doc The positioning system of the simulated world: the pictures that it shows robots, with the
%% errors of their sensors, rounded to whole millimetres if wished. A pure module.
%%
%% A robot for which the system is frozen gets the last picture again and again, as a new one.
-module(starl_world_positioning).

-export([new/2, rate_hz/1, freeze/2, frozen/1, seen/3, shown/4]).

-export_type([t/0, options/0]).

%% `rate_hz': the pictures a second (`none': one whenever a robot asks).
-type options() :: #{rate_hz => number() | none, whole_mm => boolean(), atom() => term()}.

-record(positioning, {
    profiles :: starl_chassis:profiles(),
    seed :: integer(),
    rate_hz :: number() | none,
    whole_mm :: boolean(),
    draws = 0 :: non_neg_integer(),
    %% what each robot was shown last, and the robots that get nothing newer
    shown = #{} :: #{starl:robot_id() => #{starl:robot_id() => starl:pose()}},
    frozen = [] :: [starl:robot_id()]
}).

-opaque t() :: #positioning{}.

%% @doc The positioning system of a simulation's world.
-spec new(starl_sim_platform:world(), options()) -> t().
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

%% @doc From now on these robots, and no others, are shown what they were shown last.
-spec freeze([starl:robot_id()], t()) -> t().
freeze(Ids, Positioning) -> Positioning#positioning{frozen = Ids}.

%% @doc The robots that get nothing newer.
-spec frozen(t()) -> [starl:robot_id()].
frozen(#positioning{frozen = Frozen}) -> Frozen.

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
shown(Id, Seen, Now, #positioning{shown = Shown, frozen = Frozen} = Positioning) ->
    Last = maps:get(Id, Shown, #{}),
    case lists:member(Id, Frozen) of
        true ->
            {[{R, Pose, Now} || {R, _, _} <- Seen, #{R := Pose} <- [Last]], Positioning};
        false ->
            Latest = maps:merge(Last, maps:from_list([{R, Pose} || {R, Pose, _} <- Seen])),
            {Seen, Positioning#positioning{shown = Shown#{Id => Latest}}}
    end.
