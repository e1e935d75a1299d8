%% An application that drives around walls to one place after the other, and gives the answers.
-module(starl_errand).
-behaviour(starl_app).
-export([options/0, scene/1, init/2, step/2, floor/1]).
-compile({no_auto_import, [floor/1]}).

options() ->
    [
        {errands, {term, "a list of goals", fun is_list/1}, [east, closet], ""},
        {door_mm, {integer, 0, 1000}, 800, "how wide the door is"},
        {walls, boolean, true, "is there a floor plan?"}
    ].

%% Two rooms with a door, and a closet without one.
floor(DoorMm) ->
    starl_floor:new(#{
        size => {6000, 3000},
        walls => [
            starl_floor:box(2950, 0, 3050, 1900),
            starl_floor:box(2950, 1900 + DoorMm, 3050, 3000),
            starl_floor:box(5000, 0, 5100, 3000)
        ],
        doors => [{{3000, 1900}, {3000, 1900 + DoorMm}}],
        places => #{start => {600, 500}, east => {4300, 500}, closet => {5500, 1500}}
    }).

scene(#{options := #{errands := Errands} = Options}) ->
    Scene = #{app => {sequential, ?MODULE, Errands}, poses => #{1 => {600.0, 500.0, 0.0}}},
    {ok, maps:merge(Scene, planned(Options))}.

planned(#{walls := true, door_mm := Mm}) -> #{floor => floor(Mm), never_bumps => true};
planned(#{walls := false}) -> #{}.

init(_Robot, Errands) -> {Errands, []}.

step(_Robot, {[], Answers}) ->
    {done, lists:reverse(Answers)};
step(Robot, {[Goal | Goals], Answers}) ->
    {continue, {Goals, [starl:go_around(Robot, Goal) | Answers]}}.
