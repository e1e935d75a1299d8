%% Which code runs: the same in every directory, and another one after each change.
%%
%% Holds: Two commits of one version are told apart: each change to a block, the simulator or the
%% program is another code, the directory and what debuggers need are not
%% Red: literals left out of what is hashed
-module(starl_build_tests).
-include_lib("eunit/include/eunit.hrl").

compiled(Body, Options) ->
    Forms = [
        {attribute, 1, file, {proplists:get_value(source, Options, "a.erl"), 1}},
        {attribute, 1, module, starl_build_sample},
        {attribute, 1, export, [{f, 0}]},
        {function, 1, f, 0, [{clause, 1, [], [], [Body]}]}
    ],
    {ok, _, Beam} = compile:forms(Forms, Options),
    Beam.

code(Body, Options) -> starl_build:code([compiled(Body, Options)]).

the_same_in_every_directory_test() ->
    One = code({integer, 1, 7}, [{source, "/one/a.erl"}]),
    ?assertEqual(One, code({integer, 1, 7}, [{source, "/two/b.erl"}, debug_info])),
    ?assertEqual(
        One, starl_build:code([compiled({integer, 1, 7}, []), compiled({integer, 1, 7}, [])])
    ).

each_change_is_other_code_test() ->
    Bodies = [
        {integer, 1, 7},
        {integer, 1, 8},
        {atom, 1, a},
        {string, 1, "a"},
        {string, 1, "b"},
        {call, 1, {atom, 1, node}, []}
    ],
    Codes = [starl_build:code([]) | [code(Body, []) || Body <- Bodies]],
    ?assertEqual(lists:sort(Codes), lists:usort(Codes)).

%% A change to a block or to the simulator is another code of StarL.
code_of_starl_is_its_applications_test() ->
    Beams = [
        Beam
     || App <- [starl_platform, starl_blocks, starl_run, starl_sim, starl_apps],
        File <- filelib:wildcard(filename:join(code:lib_dir(App, ebin), "*.beam")),
        {ok, Beam} <- [file:read_file(File)]
    ],
    ?assert(length(Beams) > 200),
    ?assertEqual(starl_build:code([]), starl_build:code(Beams)),
    ?assertMatch({match, _}, re:run(starl_build:code([]), "^[0-9a-f]{12}$")).
