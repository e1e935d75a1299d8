%% The keys of a fleet: made once, never over another; certificates that openssl finds sound.
-module(starl_fleet_keys_tests).
-include_lib("eunit/include/eunit.hrl").
-include_lib("kernel/include/file.hrl").

keys_test_() ->
    case os:find_executable("openssl") of
        false -> [];
        _ -> {timeout, 60, fun keys/0}
    end.

keys() ->
    Dir = filename:join("/tmp", "starl-keys-" ++ os:getpid()),
    Fleet = fleet(Dir, #{1 => #{host => "10.0.0.1"}}),
    ?assertMatch([_ | _], starl_fleet_keys:missing(Fleet)),
    {ok, Made} = starl_fleet_keys:make(Fleet),
    ?assertEqual([], starl_fleet_keys:missing(Fleet)),
    ?assertEqual(6, length([L || L <- flat(Made), lists:suffix(": made", L)])),
    Keys = filename:join(Dir, "keys"),
    {ok, First} = file:read_file(filename:join(Keys, "fleet.key")),
    %% a further robot: the others keep theirs
    More = fleet(Dir, #{1 => #{host => "10.0.0.1"}, 2 => #{host => "r2.lab"}}),
    {ok, Again} = starl_fleet_keys:make(More),
    ?assertEqual(2, length([L || L <- flat(Again), lists:suffix(": made", L)])),
    ?assertEqual({ok, First}, file:read_file(filename:join(Keys, "fleet.key"))),
    [sound(N, Host, Keys) || {N, Host} <- [{"1", "10.0.0.1"}, {"2", "r2.lab"}]],
    [private(filename:join(Keys, F)) || F <- ["fleet.key", "ca.key", "robot-1/robot.key"]],
    ok = file:del_dir_r(Dir).

sound(N, Host, Keys) ->
    Pem = filename:join([Keys, "robot-" ++ N, "robot.pem"]),
    Line =
        "openssl verify -CAfile " ++ filename:join(Keys, "ca.pem") ++ " -verify_hostname " ++ Host,
    ?assertEqual(Pem ++ ": OK\n", os:cmd(Line ++ " " ++ Pem)).

private(File) ->
    {ok, #file_info{mode = Mode}} = file:read_file_info(File),
    ?assertEqual(8#600, Mode band 8#777).

fleet(Dir, Robots) ->
    Given = #{name => "lab", app => starl_exercise, robots => Robots, transport => dist},
    {ok, Fleet} = starl_fleet_file:check(filename:join(Dir, "f.term"), Given, starl_exercise),
    Fleet.

flat(Lines) -> [unicode:characters_to_list(Line) || Line <- Lines].
