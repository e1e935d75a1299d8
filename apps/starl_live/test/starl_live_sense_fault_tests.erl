%% Faults of senses of a live robot: what it is told, and that it stays a reading of that sense.
%%
%% Holds: A frozen sense says what it said last
%% Red: the new reading told
-module(starl_live_sense_fault_tests).
-include_lib("eunit/include/eunit.hrl").

-define(F, starl_live_sense_fault).

readings() ->
    Blob = #{colour => orange, bearing => 0.3, size => 0.1, mm => 1000.0},
    {ok, Profiles} = starl_sense:profiles(#{}),
    #{beams := _} = maps:get(range, Profiles),
    View = #{
        pose => {1000.0, 1000.0, 0.0},
        radius_mm => 165.0,
        now_us => 0,
        driven_mm => 0.0,
        walls => starl_walls:new(starl_floor:empty({3000, 3000})),
        bodies => [{2, {2000.0, 1200.0}, 165.0}],
        things => [],
        draw => fun(_) -> 0.5 end
    },
    #{
        camera => [Blob],
        bump => left,
        battery => 0.5,
        light => 1.0,
        range => starl_sense:read(range, View, Profiles),
        bearing => starl_sense:read(bearing, View, Profiles)
    }.

felt(Kind, Reading, Faults) -> element(1, ?F:felt(Kind, Reading, Faults)).

what_is_sound_is_told_as_it_is_test() ->
    Sound = ?F:new(1),
    [
        ?assertEqual({Kind, {ok, R}}, {Kind, felt(Kind, {ok, R}, Sound)})
     || {Kind, R} <- maps:to_list(readings())
    ],
    ?assertEqual(none, felt(camera, none, Sound)).

%% Of one sense, or of all; the fault of one has priority.
a_sense_that_is_gone_is_silent_test() ->
    Of = fun(Faults, Kind) -> felt(Kind, {ok, left}, ?F:set(Faults, ?F:new(1))) end,
    ?assertEqual(none, Of(#{bump => gone}, bump)),
    ?assertEqual({ok, left}, Of(#{bump => gone}, battery)),
    ?assertEqual(none, Of(#{all => gone}, bump)),
    ?assertEqual({ok, left}, Of(#{all => gone, bump => frozen}, bump)),
    ?assertEqual(unknown, felt(light, unknown, ?F:set(#{all => wrong}, ?F:new(1)))).

a_frozen_sense_says_what_it_said_last_test() ->
    {{ok, 0.9}, One} = ?F:felt(battery, {ok, 0.9}, ?F:new(1)),
    Frozen = ?F:set(#{battery => frozen}, One),
    {{ok, 0.9}, Two} = ?F:felt(battery, {ok, 0.5}, Frozen),
    {{ok, 0.9}, Three} = ?F:felt(battery, {ok, 0.4}, Two),
    ?assertEqual({ok, 0.3}, felt(battery, {ok, 0.3}, ?F:set(#{}, Three))),
    %% what has never said anything goes on with the first that it says
    {{ok, 0.7}, First} = ?F:felt(battery, {ok, 0.7}, ?F:set(#{all => frozen}, ?F:new(1))),
    ?assertEqual({ok, 0.7}, felt(battery, {ok, 0.6}, First)).

%% Whatever a noisy or wrong sense says, it could say; it differs from answer to answer.
noisy_and_wrong_senses_say_what_they_could_test_() ->
    {ok, Profiles} = starl_sense:profiles(#{}),
    [
        {lists:concat([Kind, $\s, Word]), fun() ->
            Said = said(100, Kind, Reading, ?F:set(#{Kind => Fault}, ?F:new(3))),
            [?assert(starl_sense:is_reading(Kind, S, Profiles)) || S <- Said],
            ?assertNotMatch([_], lists:usort(Said), {Kind, Fault})
        end}
     || {Kind, Reading} <- maps:to_list(readings()),
        {Word, Fault} <- ?F:known(),
        Word =:= "noisy" orelse Word =:= "wrong"
    ].

said(0, _Kind, _Reading, _Faults) ->
    [];
said(N, Kind, Reading, Faults) ->
    {{ok, Said}, Next} = ?F:felt(Kind, {ok, Reading}, Faults),
    [Said | said(N - 1, Kind, Reading, Next)].
