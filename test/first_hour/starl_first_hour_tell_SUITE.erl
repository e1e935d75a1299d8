%% What a run tells about an application that does what nobody meant, and leaves behind; applications
%% in directories and on the code path; random numbers that are not the robot's.
-module(starl_first_hour_tell_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([messages_that_nobody_gets_are_told/1, distances_and_ways_are_told/1]).
-export([a_directory_is_an_application/1, modules_on_the_code_path_are_found/1]).
-export([hidden_randomness_is_found/1]).

-import(starl_first_hour_ct, [sh/2, sh/3, contains/2, write/2, root/0]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        messages_that_nobody_gets_are_told,
        distances_and_ways_are_told,
        a_directory_is_an_application,
        modules_on_the_code_path_are_found,
        hidden_randomness_is_found
    ].

%% One run for the first two cases.
init_per_suite(Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "tell"),
    write(filename:join(Dir, "lost.erl"), lost()),
    write(filename:join(Dir, "flip/flip.erl"), flip()),
    write(filename:join(Dir, "flip/flip_help.erl"), help()),
    write(filename:join(Dir, "flip/extra.erl"), rename("extra", lost())),
    Ran = sh("$starl run lost.erl --robots 3 --out out/lost", Dir),
    [{dir, Dir}, {ran, Ran} | Config].

end_per_suite(_Config) -> ok.

lost() ->
    "-module(lost).\n"
    "-behaviour(starl_app).\n"
    "-export([init/2, step/2]).\n"
    "init(Robot, _) -> starl:listen(Robot, heard), sends.\n"
    "step(Robot, sends) ->\n"
    "    starl:post(Robot, 9, hello, 1),\n"
    "    starl:broadcast(Robot, word, 1),\n"
    "    starl:broadcast(Robot, heard, 1),\n"
    "    starl:broadcast(Robot, late, 1),\n"
    "    starl:listen(Robot, late),\n"
    "    _ = [starl:velocity(Robot, {-500, 0}, 4000) || starl:id(Robot) =:= 1],\n"
    "    starl:sleep(Robot, 4500),\n"
    "    starl:go_to(Robot, {3000, 3000}),\n"
    "    {done, #{robot => starl:id(Robot)}}.\n".

%% In the words of the summary, once for all robots, and in the report with the time of the first.
messages_that_nobody_gets_are_told(Config) ->
    {0, Text} = proplists:get_value(ran, Config),
    contains(
        "\n  there is no robot 9: 3 messages of type hello, first by robot 1 at 0.000 s\n", Text
    ),
    contains("\n  robots 1, 2, 3 do not listen to word: 6 messages, first by robot ", Text),
    nomatch = string:find(Text, "heard"),
    nomatch = string:find(Text, "late"),
    [?assert(string:length(Line) =< 80, Line) || "  " ++ _ = Line <- noted(Text)],
    Report = read("out/lost/report.json", Config),
    contains("{\"from\":2,\"to\":9,\"type\":\"hello\",\"at_s\":0.0,\"count\":1}", Report),
    contains("\"messages_unheard\": [{\"robot\":1,", Report),
    contains("\nnote: there is no robot 9: ", read("out/lost/report.txt", Config)).

noted(Text) ->
    [Line || Line <- string:split(Text, "\n", all), string:find(Line, "digest") =:= nomatch].

%% Robot 1 leaves the floor; all of them meet at one spot.
distances_and_ways_are_told(Config) ->
    {0, Text} = proplists:get_value(ran, Config),
    {match, _} = re:run(
        Text,
        "\n  robots [123] and [123] came within [0-9]+\\.[0-9] mm "
        "\\(centres; Creates touch at 330\\), at [0-9.]+ s\n"
    ),
    {match, _} = re:run(
        Text, "\n  robot 1 left the floor at [0-9.]+ s; robot 1 by 4[0-9][0-9]\\.[0-9] mm\n"
    ),
    {match, _} = re:run(
        read("out/lost/report.json", Config),
        "\"off_floor\": \\[\\{\"robot\":1,\"at_s\":[0-9.]+,\"mm\":4[0-9.]+\\}\\]"
    ),
    ?assertEqual(
        {ok, [{Id, {done, #{robot => Id}}} || Id <- [1, 2, 3]]},
        file:consult(path("out/lost/results.term", Config))
    ),
    [Header, First | _] = string:split(read("out/lost/trajectories.csv", Config), "\n", all),
    ?assertEqual("time_s,robot,x_mm,y_mm,heading_rad", Header),
    ?assertMatch("0.000000,1,1000.0,1000.0," ++ _, First),
    contains("<polyline", read("out/lost/ways.svg", Config)).

flip() ->
    "-module(flip).\n"
    "-behaviour(starl_app).\n"
    "-export([init/2, step/2]).\n"
    "init(_Robot, _) -> none.\n"
    "step(Robot, none) ->\n"
    "    starl:sleep(Robot, 5),\n"
    "    {done, flip_help:number()}.\n".

help() ->
    "-module(flip_help).\n"
    "-export([number/0]).\n"
    "number() ->\n"
    "    rand:uniform().\n".

%% With or without the slash; the module named as the directory is, and the files beside it. The
%% run's directory repeats the run.
a_directory_is_an_application(Config) ->
    Dir = proplists:get_value(dir, Config),
    {0, _} = sh("$starl run flip/ --robots 2 --quiet --out out/flip", Dir),
    %% its random numbers are not the robots': equal events, other results
    {3, Text} = sh("$starl replay out/flip", Dir),
    contains("NOT THE SAME: the events are, with digest ", Text),
    contains("; other results have robot", Text),
    write(filename:join(Dir, "two/one.erl"), rename("one", lost())),
    write(filename:join(Dir, "two/other.erl"), rename("other", lost())),
    {2, Told} = sh("$starl run two", Dir),
    ?assertEqual("starl: run: two: which one is to run? one.erl, other.erl; name the file\n", Told),
    write(filename:join(Dir, "none/help.erl"), rename("help", help())),
    {2, None} = sh("$starl run none", Dir),
    contains("starl: run: none: no module here is an application", None).

rename(Name, Text) -> re:replace(Text, "-module\\([a-z_]+\\)", "-module(" ++ Name ++ ")").

%% As those of a project of one's own, whose ebin is on the path.
modules_on_the_code_path_are_found(Config) ->
    Dir = proplists:get_value(dir, Config),
    Ebin = filename:join(Dir, "lib/mine/ebin"),
    ok = filelib:ensure_path(Ebin),
    {ok, _} = compile:file(path("lost.erl", Config), [{outdir, Ebin}]),
    Env = [{"ERL_AFLAGS", "-pa \"" ++ Ebin ++ "\""}],
    {0, _} = sh("$starl run lost --robots 2 --quiet --out out/path", Dir, Env),
    {2, Text} = sh("$starl run lists", Dir),
    contains("starl: run: lists: this is no application", Text).

%% The events of the runs are equal, their results are not; the line that calls it is named.
hidden_randomness_is_found(Config) ->
    Dir = proplists:get_value(dir, Config),
    {3, Text} = sh("$starl diverge flip --robots 2 --ways process:1,process:2", Dir),
    contains("DIFFERENT TRACES OR RESULTS of one seed", Text),
    Line =
        "flip/flip_help.erl:4: rand:uniform/0 is not the robot's random number; "
        "use starl:random(Robot)\n",
    contains("warning: " ++ Line, Text),
    contains("likely cause: " ++ Line, Text).

path(Name, Config) -> filename:join(proplists:get_value(dir, Config), Name).

read(Name, Config) ->
    {ok, Text} = file:read_file(path(Name, Config)),
    unicode:characters_to_list(Text).
