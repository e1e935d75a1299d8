%% Applications that know no walls refuse a floor plan that has some inside, in one line; one without is as good
%% as no plan.
%%
%% Holds: Applications that know no walls refuse them
%% Red: 961f67c9: any verdict
-module(starl_unknown_walls_tests).
-include_lib("eunit/include/eunit.hrl").

-define(APPS, [formation, follow, swarm, crossing]).

walls_are_refused_test_() ->
    [
        {atom_to_list(App), fun() ->
            {error, {scene, [Line]}} = started(App, <<"Shed">>, [
                starl_floor:box(5000, 0, 5100, 900)
            ]),
            Text = unicode:characters_to_list(Line),
            Begins = io_lib:format(
                "the floor plan Shed has 1 wall inside, and ~p knows no walls: ", [
                    App
                ]
            ),
            ?assertEqual(lists:flatten(Begins), string:slice(Text, 0, string:length(Begins))),
            ?assertEqual(nomatch, string:find(Text, "\n"))
        end}
     || App <- ?APPS
    ].

a_plan_without_walls_is_taken_test_() ->
    [{atom_to_list(App), ?_assertMatch({ok, _}, started(App, <<"Lawn">>, []))} || App <- ?APPS].

%% Who says nothing of walls is not refused.
others_take_walls_test_() ->
    {timeout, 60,
        ?_assertMatch(
            {ok, _}, starl_scene:make(starl_search, context(starl_search, <<"Shed">>, walls()))
        )}.

walls() -> [starl_floor:box(5000, 0, 5100, 900)].

started(App, Name, Walls) ->
    Module = list_to_atom("starl_" ++ atom_to_list(App)),
    case starl_scene:make(Module, context(Module, Name, Walls)) of
        {ok, Scene} -> {ok, Scene};
        {error, Line} -> {error, {scene, [Line]}}
    end.

context(Module, Name, Walls) ->
    #{
        robots => [1, 2],
        world => {12000, 12000},
        floor => starl_floor:new(#{name => Name, size => {12000, 12000}, walls => Walls}),
        seed => 1,
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        sap => #{},
        range => none,
        options => (maps:from_list([{Key, V} || {Key, _, V, _} <- Module:options()]))#{
            ball => nowhere
        }
    }.
