%% @doc The senses of a simulated robot ({@link starl_sense}): computes readings from its
%% surroundings, and applies faults of senses. Other robots are where they were at the beginning of
%% the window, so a reading is the same however robots are spread over shards. All draws are
%% stateless.
-module(starl_sim_senses).

-export([new/1, feel/4]).

-export_type([t/0, felt/0, self/0]).

%% The things on the floor, and the measures and errors of the senses.
-type t() :: #{things := [starl_sense:thing()], profiles := starl_sense:profiles()}.

%% The answer of a sense; `none': it is silent; `unknown': there is no such sense.
-type felt() :: {ok, Reading :: term()} | none | unknown.

%% The robot that feels; `felt': what its senses said last.
-type self() :: #{
    robot := starl:robot_id(),
    pose := starl:pose(),
    radius_mm := float(),
    driven_mm := float(),
    now_us := starl_sim_queue:time(),
    window_us := starl_sim_queue:time(),
    key := term(),
    felt := #{starl_sense:kind() => term()}
}.

%% @doc The senses on a scene's floor.
-spec new(starl_scene:t()) -> t().
new(Scene) ->
    {ok, Profiles} = starl_sense:profiles(maps:get(senses, Scene, #{})),
    #{things => [placed(Thing) || Thing <- maps:get(things, Scene, [])], profiles => Profiles}.

placed(#{at := {X, Y}} = Thing) -> Thing#{at := {float(X), float(Y)}}.

%% @doc What a sense says, and all that the senses said last.
-spec feel(starl_sense:kind(), t(), World :: map(), self()) -> {felt(), Last} when
    Last :: #{starl_sense:kind() => term()}.
feel(Kind, Senses, World, #{robot := Id, now_us := Now, felt := Before} = Self) ->
    All = maps:get(sense, World, []),
    Faults = [
        F
     || F <- starl_run_fault:holding(Now, All), starl_run_fault:hits(Id, F), is_of(Kind, F)
    ],
    Kinds = [What || {_, _, _, What, _, _} <- Faults],
    case {lists:member(sense_gone, Kinds), lists:member(sense_frozen, Kinds), Before} of
        {true, _, _} ->
            {none, Before};
        {false, true, #{Kind := Last}} ->
            {{ok, Last}, Before};
        _ ->
            Reading = reading(Kind, lists:member(sense_wrong, Kinds), Faults, Senses, World, Self),
            {{ok, Reading}, kept(All, Kind, Reading, Before)}
    end.

is_of(Kind, {_, _, _, _, _, #{sense := Sense}}) -> Sense =:= Kind orelse Sense =:= all.

%% Without faults nobody asks for the last reading.
kept([], _Kind, _Reading, Before) -> Before;
kept(_All, Kind, Reading, Before) -> Before#{Kind => Reading}.

reading(Kind, true, _Faults, #{profiles := Profiles}, _World, #{key := Key}) ->
    starl_sense:guess(Kind, draw(Key), Profiles);
reading(Kind, false, Faults, #{profiles := Profiles, things := Things}, World, Self) ->
    #{key := Key, now_us := Now} = Self,
    Times = [Times || {_, _, _, sense_noisy, _, #{times := Times}} <- Faults],
    Noisy = lists:foldl(fun(N, P) -> starl_sense:noisy(Kind, N, P) end, Profiles, Times),
    View = (maps:with([pose, radius_mm, driven_mm, now_us], Self))#{
        walls => starl_sim_bodies:walls(Now, World),
        bodies => bodies(World, Self),
        things => Things,
        draw => draw(Key)
    },
    starl_sense:read(Kind, View, Noisy).

draw(Key) -> fun(Purpose) -> starl_run_draw:uniform({Key, Purpose}) end.

bodies(#{sight := Sight, profiles := Profiles}, #{robot := Self, window_us := From}) ->
    [
        {Id, starl_trajectory:position(From, Piece), radius(Id, Profiles)}
     || {Id, Piece} <- lists:sort(starl_sim_sight:pieces(Sight)), Id =/= Self
    ];
bodies(_World, _Self) ->
    [].

radius(Id, Profiles) -> starl_chassis:radius_mm(starl_chassis:of_robot(Id, Profiles)).
