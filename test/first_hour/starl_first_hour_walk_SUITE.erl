%% The walk from the README to a flock of one's own: the files and the commands of the page
%% doc/own_application.md, as they stand there, in an empty directory.
-module(starl_first_hour_walk_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([readme_leads_to_the_page/1, examples_are_those_of_the_page/1, links_lead_somewhere/1]).
-export([commands_do_as_the_page_says/1, results_are_those_of_the_page/1]).

-import(starl_first_hour_ct, [sh/2, contains/2, write/2, root/0]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        readme_leads_to_the_page,
        examples_are_those_of_the_page,
        links_lead_somewhere,
        commands_do_as_the_page_says,
        results_are_those_of_the_page
    ].

init_per_suite(Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "walk"),
    _ = [write(filename:join(Dir, Name), Text) || {Name, Text} <- files()],
    [{dir, Dir} | Config].

end_per_suite(_Config) -> ok.

readme_leads_to_the_page(_Config) -> contains("](doc/own_application.md)", text("README.md")).

examples_are_those_of_the_page(_Config) ->
    ?assertEqual(["flock/flock.erl", "flock/flock_monitor.erl"], [Name || {Name, _} <- files()]),
    [
        ?assertEqual(text(filename:join("examples/flocking", filename:basename(Name))), Text)
     || {Name, Text} <- files()
    ].

%% Files, and headings within them.
links_lead_somewhere(_Config) ->
    {match, Links} = re:run(page(), "\\]\\(([^)]+)\\)", [unicode, global, {capture, [1], list}]),
    ?assert(length(Links) > 4),
    [
        begin
            [File | Heading] = string:split(Link, "#"),
            Page = text(filename:join("doc", File)),
            [?assert(lists:member(H, headings(Page)), Link) || H <- Heading]
        end
     || [Link] <- Links
    ].

headings(Page) ->
    {match, Found} = re:run(Page, "^#+ (.*)$", [unicode, multiline, global, {capture, [1], list}]),
    [
        re:replace(string:lowercase(Words), "[^a-z0-9]+", "-", [unicode, global, {return, list}])
     || [Words] <- Found
    ].

%% Each ends with the exit status that stands beside it, or with 0; what the page shows after a
%% command, it prints.
commands_do_as_the_page_says(Config) ->
    Dir = proplists:get_value(dir, Config),
    Commands = commands(),
    ?assert(length(Commands) >= 7),
    Help = [ran(Command, Dir) || Command <- Commands],
    contains("--spacing", hd(Help)),
    contains("--flight", hd(Help)).

ran({Line, Status, Shown}, Dir) ->
    {Ended, Text} = sh(Line, Dir),
    ?assertEqual({Line, Status}, {Line, Ended}, Text),
    [contains(Part, Text) || Part <- Shown],
    nomatch = string:find(Text, "warning"),
    Text.

%% The results of the commands before.
results_are_those_of_the_page(Config) ->
    Dir = proplists:get_value(dir, Config),
    In = fun(Name) -> filename:join(Dir, Name) end,
    Report = read(In("first/report.json")),
    [contains(Key, Report) || Key <- ["\"polarisation\":", "\"nearest_mm\":"]],
    contains("<svg", read(In("first/ways.svg"))),
    contains("time_s,robot,x_mm,y_mm,heading_rad\n", read(In("first/trajectories.csv"))),
    {ok, Results} = file:consult(In("first/results.term")),
    ?assertMatch([{1, {done, {_, _}}} | _], Results),
    ?assertEqual(8, length(Results)),
    [Header | Rows] = string:lexemes(read(In("sweep/runs.csv")), "\n"),
    ?assertEqual(
        "app,robots,spacing,flight,seed,status,virtual_s,polarisation,nearest_mm,messages,"
        "packets,events,digest,violations,ending",
        Header
    ),
    ?assertEqual(8, length(Rows)),
    [contains("polarisation_median", read(In("sweep/summary.csv")))].

%% -- the page -------------------------------------------------------------------------------

page() -> text("doc/own_application.md").

text(File) -> read(filename:join(root(), File)).

read(File) ->
    {ok, Text} = file:read_file(File),
    unicode:characters_to_list(Text).

%% A block of code, with the name of its file before it.
files() ->
    {match, Blocks} = re:run(page(), "^`([a-z_/]+\\.erl)`:\n\n```erlang\n(.*?)```", [
        unicode, multiline, dotall, global, {capture, [1, 2], list}
    ]),
    [{Name, Text} || [Name, Text] <- Blocks].

%% The indented lines: commands, each with the lines that it prints. The directory is there already.
commands() ->
    [Prose | _] = [re:replace(page(), "```.*?```", "", [unicode, dotall, global, {return, list}])],
    Lines = [Line || "    " ++ Line <- string:split(Prose, "\n", all)],
    grouped([Line || Line <- Lines, Line =/= "mkdir flock"]).

grouped([]) ->
    [];
grouped(["./starl" ++ Words | Lines]) ->
    {Shown, Others} = lists:splitwith(fun(Line) -> not lists:prefix("./starl", Line) end, Lines),
    {Command, Status} =
        case string:split(Words, "  # exit status ") of
            [Alone] -> {Alone, 0};
            [With, Number] -> {With, list_to_integer(Number)}
        end,
    [{"\"$starl\"" ++ Command, Status, Shown} | grouped(Others)].
