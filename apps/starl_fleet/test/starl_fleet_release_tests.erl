%% The release of a fleet: what is in it, and its version.
-module(starl_fleet_release_tests).
-include_lib("eunit/include/eunit.hrl").

release_test_() ->
    {timeout, 60, fun release/0}.

release() ->
    Dir = filename:join("/tmp", "starl-release-" ++ os:getpid()),
    {ok, Manifest} = starl_fleet_release:manifest(what(ours), filename:join(Dir, "boot")),
    Version = starl_fleet_release:version(Manifest),
    Files = [Path || {Path, _} <- Manifest],
    [
        ?assert(lists:member(Path, Files))
     || Path <- [
            "fleet.term", "bin/robot", "start.boot", "start_clean.boot", "sys.config", "vm.args"
        ]
    ],
    ?assertMatch([_ | _], [P || P <- Files, lists:suffix("/bin/beam.smp", P)]),
    ?assertMatch([_ | _], [P || P <- Files, lists:prefix("lib/starl_blocks-", P)]),
    %% crypto's library comes along, the C library of the robot stays its own
    Native = [filename:basename(P) || P <- Files, lists:prefix("native/", P)],
    ?assertMatch([_ | _], [P || P <- Native, lists:prefix("libcrypto", P)]),
    ?assertEqual([], [P || P <- Native, lists:prefix("libc.", P)]),
    %% the installed Erlang is only read
    Ets = code:which(ets),
    {ok, Before} = file:read_file(Ets),
    Few = [{P, C} || {P, C} <- Manifest, lists:suffix("ets.beam", P) orelse P =:= "bin/robot"],
    {ok, Release} = starl_fleet_release:write(Few, Version, Dir),
    ?assertEqual({ok, Before}, file:read_file(Ets)),
    [Stripped] = filelib:wildcard(filename:join(Release, "lib/*/ebin/ets.beam")),
    {ok, {ets, Chunks}} = beam_lib:chunks(Stripped, ["Line", "Dbgi"], [allow_missing_chunks]),
    ?assertMatch([{"Line", <<_/binary>>}, {"Dbgi", missing_chunk}], Chunks),
    ok = file:del_dir_r(Dir).

%% The version is that of the content: the same twice, another for another option.
version_test() ->
    Version = fun(What) ->
        {ok, Manifest} = starl_fleet_release:manifest(What, "/none"),
        starl_fleet_release:version(Manifest)
    end,
    #{fleet := Fleet} = What = what(there),
    Other = What#{fleet := Fleet#{options := #{speed => 100}}},
    ?assertEqual(Version(What), Version(What)),
    ?assertNotEqual(Version(What), Version(Other)),
    ?assertNotEqual(Version(What), Version(What#{run => 1})).

%% The user's own modules come as an application; as sources, where they are compiled there.
code_test() ->
    Code = [{my_app, "/src/my_app.erl", <<"beam">>}],
    #{fleet := Fleet} = What = what(there),
    Mine = What#{fleet := Fleet#{app := my_app}, code => Code},
    {ok, Manifest} = starl_fleet_release:manifest(Mine, "/none"),
    ?assertEqual(
        {text, <<"beam">>}, proplists:get_value("lib/fleet_code-1/ebin/my_app.beam", Manifest)
    ),
    {ok, Sources} = starl_fleet_release:manifest(Mine#{kind => source}, "/none"),
    ?assertEqual(
        {file, "/src/my_app.erl"}, proplists:get_value("lib/fleet_code-1/src/my_app.erl", Sources)
    ),
    ?assertEqual([], [P || {P, _} <- Sources, filename:extension(P) =:= ".beam"]).

what(Kind) ->
    Given = #{name => "lab", app => starl_exercise, robots => #{1 => #{host => "a"}}},
    {ok, Fleet} = starl_fleet_file:check("f.term", Given, starl_exercise),
    #{fleet => Fleet, kind => Kind}.
