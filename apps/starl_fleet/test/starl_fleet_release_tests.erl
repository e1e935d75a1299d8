%% The release of a fleet: what is in it, and its version.
-module(starl_fleet_release_tests).
-include_lib("eunit/include/eunit.hrl").

%% Holds: A robot's release has no command line
%% Red: without a look at optional applications, run: it carries the window's web server
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
    %% what a robot can do without stays away: the command line, and with it the lab and its window; pictures
    ?assertEqual([], [
        P
     || P <- Files,
        App <- ["cli", "lab", "cowboy", "picture", "xmerl"],
        string:find(P, App ++ "-") =/= nomatch
    ]),
    %% the log has what the robot's processes say, whose domain OTP's default handler does not know
    {_, {text, Text}} = lists:keyfind("sys.config", 1, Manifest),
    {ok, Tokens, _} = erl_scan:string(lists:flatten(Text)),
    {ok, [{kernel, [{logger, [Handler]}]}]} = erl_parse:parse_term(Tokens),
    ?assertMatch(
        {handler, default, logger_std_h, #{filter_default := log, filters := [_]}}, Handler
    ),
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

%% Only who reads pictures carries what reads them.
a_team_that_paints_reads_pictures_test() ->
    Files = fun(App) ->
        {ok, Fleet} = starl_fleet_file:check(
            "f.term", #{name => "lab", app => App, robots => #{1 => #{host => "a"}}}, App
        ),
        {ok, Manifest} = starl_fleet_release:manifest(#{fleet => Fleet, kind => there}, "/none"),
        [P || {P, _} <- Manifest, string:find(P, "starl_svg.beam") =/= nomatch]
    end,
    ?assertMatch([_], Files(starl_painting)),
    ?assertEqual([], Files(starl_follow)).

%% A robot that is a Create gets the driver, and its program, which can be run.
create_test() ->
    Create = {create, #{device => "/dev/ttyUSB0", model => 2}},
    Given = #{
        name => "lab", app => starl_exercise, robots => #{1 => #{host => "a", chassis => Create}}
    },
    {ok, Fleet} = starl_fleet_file:check("f.term", Given, starl_exercise),
    [
        begin
            {ok, Manifest} = starl_fleet_release:manifest(
                #{fleet => Fleet, kind => Kind}, "/none"
            ),
            Found = fun(Name) -> [C || {P, C} <- Manifest, filename:basename(P) =:= Name] end,
            ?assertMatch([_], Found("starl_create_chassis." ++ Code)),
            [?assertMatch([{run, _}], Found("starl_create_port")) || has_program()]
        end
     || {Kind, Code} <- [{there, "beam"}, {source, "erl"}]
    ],
    {ok, Other} = starl_fleet_release:manifest(what(there), "/none"),
    ?assertEqual([], [P || {P, _} <- Other, string:find(P, "starl_create") =/= nomatch]).

has_program() ->
    filelib:is_regular(filename:join(code:priv_dir(starl_create), "starl_create_port")).

%% A robot's unit lets its port program be on time, and open a serial line; it waits for a clock that is set.
unit_test() ->
    Base = filename:join(["/tmp", "starl-unit-" ++ os:getpid(), "lab", "robot-1"]),
    Bin = filename:join(Base, "releases/v/bin"),
    Fake = filename:join(Base, "fake"),
    [ok = filelib:ensure_path(Dir) || Dir <- [Bin, Fake]],
    {ok, Script} = file:read_file(filename:join(code:priv_dir(starl_fleet), "robot")),
    ok = file:write_file(filename:join(Base, "service"), "systemd"),
    Programs = [
        {filename:join(Bin, "robot"), Script},
        {filename:join(Fake, "cp"), "#!/bin/sh\n"},
        {filename:join(Fake, "systemctl"), "#!/bin/sh\n"},
        {filename:join(Fake, "sudo"), "#!/bin/sh\n"},
        {filename:join(Fake, "getent"), "#!/bin/sh\n[ \"$2\" = dialout ]\n"}
    ],
    [
        begin
            ok = file:write_file(File, Text),
            ok = file:change_mode(File, 8#755)
        end
     || {File, Text} <- Programs
    ],
    Start = filename:join(Bin, "robot") ++ " start",
    ?assertEqual("", os:cmd("PATH=" ++ Fake ++ ":$PATH " ++ Start)),
    {ok, Unit} = file:read_file(filename:join(Base, "state/unit")),
    Lines = binary:split(Unit, <<"\n">>, [global]),
    [
        ?assert(lists:member(Line, Lines))
     || Line <- [
            <<"LimitRTPRIO=1">>,
            <<"SupplementaryGroups=dialout">>,
            iolist_to_binary(["ExecStartPre=", Base, "/current/bin/robot clock"])
        ]
    ],
    ok = file:del_dir_r(filename:dirname(filename:dirname(Base))).

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
