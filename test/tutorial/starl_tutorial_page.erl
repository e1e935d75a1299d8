%% A page of documentation as a script: its files are written, its changes are made, its commands
%% run, in the order of the page and in one shell; what a command prints is what the page shows.
%%
%% ```
%%   `src/a.erl':  and a block of code: the file
%%   ```diff       a change, as `git apply' takes it
%%   ```console    commands after `$ ', each followed by its output
%%   ```sh         commands that are named only
%% '''
%% In an output `...' stands for any lines, or for a part of a line; blank lines do not count. A command ends with status 0, or with
%% that of `# exit status N' after it.
-module(starl_tutorial_page).
-include_lib("stdlib/include/assert.hrl").

-export([follow/3, links_lead_somewhere/1]).

-type command() :: {Line :: string(), Status :: string(), Shown :: [string()]}.

%% Does what a page says, in a directory, with additions to the environment and lines of sh after
%% commands that begin with these words. Gives the number of its commands.
-spec follow(file:filename(), file:filename(), #{env => [{string(), string()}], also => map()}) ->
    pos_integer().
follow(File, Dir, Options) ->
    Steps = steps(text(File)),
    Commands = [Command || {command, Command} <- Steps],
    Script = filename:join(Dir, "page.sh"),
    After = maps:get(also, Options, #{}),
    Lines = script(Steps, After, 1),
    starl_first_hour_ct:write(Script, unicode:characters_to_binary(Lines)),
    Path = starl_first_hour_ct:root() ++ ":" ++ starl_first_hour_ct:path(),
    Env = [{"PATH", Path}, {"REBAR_COLOR", "none"} | maps:get(env, Options, [])],
    {_, Printed} = starl_first_hour_ct:sh("sh page.sh 2>&1 </dev/null", Dir, Env),
    judged(Commands, 1, plain(Printed)),
    length(Commands).

%% Files that the page links to.
-spec links_lead_somewhere(file:filename()) -> ok.
links_lead_somewhere(File) ->
    {match, Links} = re:run(text(File), "\\]\\(([^)#]+)[^)]*\\)", [
        unicode, global, {capture, [1], list}
    ]),
    Dir = filename:dirname(filename:join(starl_first_hour_ct:root(), File)),
    [
        ?assert(filelib:is_file(filename:join(Dir, Link)), {File, Link})
     || [Link] <- Links, not lists:prefix("http", Link)
    ],
    ok.

text(File) ->
    {ok, Text} = file:read_file(filename:join(starl_first_hour_ct:root(), File)),
    unicode:characters_to_list(Text).

%% -- the page -------------------------------------------------------------------------------

steps(Text) ->
    {match, Blocks} = re:run(
        Text, "(?:^`([a-z_/.]+)`:\n\n)?^```([a-z]+)\n(.*?)^```$", [
            unicode, multiline, dotall, global, {capture, all_but_first, list}
        ]
    ),
    lists:append([step(Block) || Block <- Blocks]).

step([[_ | _] = File, _Language, Body]) -> [{file, File, Body}];
step([[], "diff", Body]) -> [{diff, Body}];
step([[], "console", Body]) -> [{command, C} || C <- commands(string:split(Body, "\n", all))];
step([[], _Language, _Body]) -> [].

-spec commands([string()]) -> [command()].
commands(["$ " ++ Line | Lines]) ->
    {Shown, Rest} = lists:splitwith(fun(L) -> not lists:prefix("$ ", L) end, Lines),
    {Command, Status} =
        case string:split(Line, "  # exit status ") of
            [Alone] -> {Alone, "0"};
            [With, Number] -> {With, Number}
        end,
    [{Command, Status, inked(Shown)} | commands(Rest)];
commands(_) ->
    [].

%% -- the script -----------------------------------------------------------------------------

script([], _After, _N) ->
    [];
script([{file, File, Body} | Steps], After, N) ->
    Dir = filename:dirname(File),
    ["mkdir -p ", Dir, "; cat >", File, here(Body) | script(Steps, After, N)];
script([{diff, Body} | Steps], After, N) ->
    ["git apply --quiet", here(Body) | script(Steps, After, N)];
script([{command, {Line, _, _}} | Steps], After, N) ->
    Added = [[Lines, "\n"] || {Words, Lines} <- maps:to_list(After), lists:prefix(Words, Line)],
    Mark = ["printf '\\n@@ %s %s\\n' ", integer_to_list(N), " $?\n"],
    [Line, "\n", Mark, Added | script(Steps, After, N + 1)].

here(Body) -> [" <<'END_OF_FILE'\n", Body, "END_OF_FILE\n"].

%% -- what was printed -----------------------------------------------------------------------

plain(Text) -> re:replace(Text, "\e\\[[0-9;]*m|\r", "", [unicode, global, {return, list}]).

judged([], _N, _Printed) ->
    ok;
judged([{Line, Status, Shown} | Commands], N, Printed) ->
    Mark = lists:flatten(io_lib:format("\n@@ ~b ", [N])),
    [Text, Rest] = [_, _] = string:split(Printed, Mark),
    [Ended | Others] = string:split(Rest, "\n"),
    ?assertEqual({Line, Status}, {Line, Ended}, Text),
    Lines = inked(string:split(Text, "\n", all)),
    matches(Shown, Lines) orelse error({Line, {page, Shown}, {prints, Lines}}),
    judged(Commands, N + 1, lists:append(Others)).

inked(Lines) -> [L || Line <- Lines, L <- [string:trim(Line, trailing)], L =/= ""].

%% A page that shows nothing hides nothing: the command's output does not matter there.
matches([], _Lines) -> true;
matches(Shown, Lines) -> same(Shown, Lines).

same([], []) -> true;
same(["..."], _Lines) -> true;
same(["..." | Shown], Lines) -> lists:any(fun(Rest) -> same(Shown, Rest) end, tails(Lines));
same([Line | Shown], [Other | Lines]) -> like(Line, Other) andalso same(Shown, Lines);
same(_, _) -> false.

tails([]) -> [[]];
tails([_ | Rest] = Lines) -> [Lines | tails(Rest)].

like(Line, Other) ->
    Parts = [["\\Q", Part, "\\E"] || Part <- string:split(Line, "...", all)],
    match =:= re:run(Other, ["^", lists:join(".*", Parts), "$"], [unicode, {capture, none}]).
