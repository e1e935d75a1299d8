%% What every robot is made of, with processes and without.
-module(starl_robot_services_tests).
-include_lib("eunit/include/eunit.hrl").

%% The services come first and in their order; each is told what it needs.
tree_test() ->
    #{services := Services, blocks := Blocks, participants := Team} =
        starl_robot_services:tree(
            robot(#{
                sap => #{limit => 3}, waypoints => #{home => {1.0, 2.0}}, blocks => [block()]
            })
        ),
    ?assertEqual(
        [
            {sap, starl_sap, #{limit => 3}},
            {location, starl_location, #{waypoints => #{home => {1.0, 2.0}}, exact => false}},
            {motion, starl_motion, #{profiles => [profile(1.0)]}}
        ],
        Services
    ),
    ?assertEqual({[block()], starl_team:new([1, 2, 5])}, {Blocks, Team}).

%% A positioning system without noise may repeat itself.
exact_test() ->
    #{services := [_, {location, _, Config} | _]} =
        starl_robot_services:tree((robot(#{}))#{profiles => [profile(0.0)]}),
    ?assertMatch(#{exact := true}, Config).

%% Inline, a machine's application has no process, a sequential one is all that is left of the tree.
inline_test() ->
    Tree = starl_robot_services:tree(robot(#{blocks => [block()]})),
    {Left, Inline} = starl_robot_services:inline(Tree),
    ?assertMatch(#{services := [], blocks := [], app := {sequential, a, x}}, Left),
    ?assertEqual([block, location, motion, sap], lists:sort(maps:keys(Inline))),
    {none, All} = starl_robot_services:inline(Tree#{app := {machine, a, #{k => v}}}),
    ?assertEqual({a, #{k => v}}, maps:get(app, All)).

block() -> {block, some_block, #{}}.

robot(More) ->
    maps:merge(#{robots => [1, 2, 5], profiles => [profile(1.0)], app => {sequential, a, x}}, More).

profile(Error) ->
    starl_chassis:profile(starl_chassis_differential, #{position_error_mm => Error}).
