%% @doc `./starl deploy': deploys a release to a fleet of real robots. It also manages the fleet:
%% status, logs, recordings, stop, rollback and reload.
-module(starl_fleet_deploy_command).
-behaviour(starl_cli_command).

-export([command/0]).

-type action() ::
    deploy
    | status
    | stop
    | rollback
    | {logs, all | starl:robot_id()}
    | {fetch, file:filename()}
    | reload.

-define(ACTIONS, ["status", "logs", "fetch", "stop", "rollback", "reload"]).
-define(LOG_LINES, 100).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "deploy",
        synopsis => "bring a fleet of real robots to a release",
        argument => {optional, "FLEET.term", {example, "fleet.term"}},
        subject => fun subject/2,
        about => [
            "Builds a release of the application in a fleet file, copies it by ssh to the robots' computers, "
            "starts it there, and waits until every robot is well. If one is not, all robots go back to the "
            "release before. Nothing on a robot changes before all have been found able to run it.",
            {list, "Afterwards", [
                {"deploy F status", "how each robot is; --watch 2 tells it again each 2 s"},
                {"deploy F logs [N]", "the latest lines of the robots' logs, or of robot N"},
                {"deploy F fetch DIR",
                    "the robots' recordings, into DIR/robot-1, DIR/robot-2, ..."},
                {"deploy F stop", "stops the robots until the next deploy"},
                {"deploy F rollback", "back to the release before; a second time, forward again"},
                {"deploy F reload APP", "new code of the application, while the robots run"}
            ]},
            "doc/deploy.md explains the fleet file; ./starl keys makes the keys."
        ],
        flags => [
            {"Flags", [
                {example, switch, false, "prints a fleet file with comments, to begin with"},
                {dry_run, switch, false, "prints every command, and runs none"},
                {erlang, {one_of, [ours, there]}, ours,
                    "ours: the release carries Erlang, for computers like this one; there: the robots have "
                    "their own"},
                {build_there, switch, false,
                    "the robots compile the sources with their own Erlang"},
                {trial, {integer, 1, 3600}, 5, "a robot must have been well for this long, s"},
                {watch, {optional, {integer, 1, 3600}}, none,
                    "status tells again each so many seconds, until Ctrl-C"}
            ]}
        ],
        statuses => [
            {0, "done"}, {1, "a robot is not well, or not reached; one that was stopped is well"}
        ],
        run => fun run/1
    }.

%% The words after the file say what is wanted of the fleet.
-spec subject(string(), [string()]) -> {ok, {file:filename(), Words :: [string()]}, [string()]}.
subject(File, Args) ->
    {Words, Flags} = lists:splitwith(fun(Arg) -> hd(Arg ++ "-") =/= $- end, Args),
    {ok, {File, Words}, Flags}.

%% To look at robots or to stop them, the application need not be sound.
fleet([Word | _], File) when Word =/= "reload" -> starl_fleet_target:robots(File);
fleet(_, File) -> starl_fleet_target:read(File).

-spec action([string()], starl_fleet_target:t()) -> action() | {error, unicode:chardata()}.
action([], _Fleet) ->
    deploy;
action(["status"], _Fleet) ->
    status;
action(["stop"], _Fleet) ->
    stop;
action(["rollback"], _Fleet) ->
    rollback;
action(["logs"], _Fleet) ->
    {logs, all};
action(["logs", Number], #{fleet := #{robots := Robots}}) ->
    logs(string:to_integer(Number), Robots);
action(["fetch", Dir], _Fleet) ->
    {fetch, Dir};
action(["fetch"], _Fleet) ->
    {error, "fetch the recordings to where? Name a directory, as in fetch recordings"};
action(["reload"], _Fleet) ->
    {error, "reload what? Name the application of the fleet file"};
action(["reload", App], #{file := File}) ->
    reloads(App, starl_fleet_file:read(File));
action([Word | _], _Fleet) ->
    {error, unknown(Word)}.

logs({N, ""}, Robots) when is_map_key(N, Robots) -> {logs, N};
logs(_, Robots) -> {error, io_lib:format("logs of which robot? 1 to ~b", [map_size(Robots)])}.

%% The word says what the user means to change; a fleet has one application.
reloads(Word, {ok, #{app := App}}) ->
    Names = [name_of(App), "starl_" ++ name_of(App)],
    case lists:member(filename:basename(Word, ".erl"), Names) of
        true -> reload;
        false -> {error, ["the fleet runs ", name_of(App), ", not ", Word]}
    end.

name_of(App) when is_atom(App) -> atom_to_list(App);
name_of(App) -> filename:basename(App, ".erl").

unknown(Word) ->
    All = ["; there are ", lists:join(", ", ?ACTIONS)],
    ["there is no ", Word, starl_similar:meant(starl_similar:words(Word, ?ACTIONS), All)].

%% -- running --------------------------------------------------------------------------------

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{example := true}}) ->
    {ok, Text} = file:read_file(filename:join(code:priv_dir(starl_fleet), "fleet.term")),
    starl_cli_terminal:out(Text),
    0;
run(#{subject := none}) ->
    {error, [
        "name a fleet file first, as in ./starl deploy fleet.term; ./starl deploy --example prints one"
    ]};
run(#{subject := {_, Words}, values := #{watch := Seconds}}) when
    Seconds =/= none, Words =/= ["status"]
->
    {error, [
        "--watch: only status is printed again and again, as in: deploy fleet.term status --watch 2"
    ]};
run(#{subject := {File, Words}, values := Values}) ->
    case fleet(Words, File) of
        {ok, Fleet} -> act(action(Words, Fleet), Fleet, Values);
        {error, _} = Error -> Error
    end.

act({error, Why}, _Fleet, _Values) ->
    {error, [Why]};
act(deploy, Fleet, Values) ->
    deploy(Fleet, options(restart, Fleet, Values), Values);
act(reload, Fleet, Values) ->
    reload(Fleet, options(reload, Fleet, Values), Values);
act(rollback, #{fleet := Fleet}, _Values) ->
    print(starl_fleet_deploy:rollback(Fleet));
act({fetch, Dir}, #{fleet := Fleet}, _Values) ->
    fetch(Dir, Fleet);
act(stop, #{fleet := Fleet}, _Values) ->
    each(starl_fleet_deploy:ask("stop", numbers(Fleet), Fleet), fun(N, _) ->
        io_lib:format("robot ~b: stopped\n", [N])
    end);
act(status, #{fleet := Fleet}, #{watch := none}) ->
    print_status(Fleet);
act(status, #{fleet := Fleet}, #{watch := Seconds}) ->
    watch(Fleet, Seconds);
act({logs, Which}, #{fleet := Fleet}, _Values) ->
    Numbers = [N || N <- numbers(Fleet), Which =:= all orelse Which =:= N],
    Words = "logs " ++ integer_to_list(?LOG_LINES),
    each(starl_fleet_deploy:ask(Words, Numbers, Fleet), fun(N, Said) ->
        [io_lib:format("robot ~b: ~ts\n", [N, Line]) || Line <- string:lexemes(Said, "\n")]
    end).

fetch(Dir, Fleet) ->
    case filelib:ensure_path(Dir) of
        ok -> fetched(starl_fleet_fetch:fetch(Dir, Fleet));
        {error, Why} -> {error, [[Dir, ": ", file:format_error(Why)]]}
    end.

print_status(#{robots := Robots} = Fleet) ->
    Answers = starl_fleet_deploy:ask("status", numbers(Fleet), Fleet),
    Status = each(Answers, fun(N, Said) ->
        starl_fleet_status:line(N, maps:get(N, Robots), Said)
    end),
    Said = [{N, Text} || {N, {ok, Text}} <- Answers],
    AreWell = lists:all(fun({_, Text}) -> starl_fleet_status:is_well(Text) end, Said),
    case starl_fleet_status:releases(Said) of
        none ->
            max(Status, status(AreWell));
        Line ->
            starl_cli_terminal:complain(["deploy: ", Line]),
            1
    end.

%% Until Ctrl-C, or until nobody reads it any more.
watch(Fleet, Seconds) ->
    Status = print_status(Fleet),
    starl_cli_terminal:out("\n"),
    case starl_cli_terminal:lost() of
        none ->
            receive
            after 1000 * Seconds -> watch(Fleet, Seconds)
            end;
        _ ->
            Status
    end.

%% What is passed over is said, too.
fetched(Answers) ->
    Note = fun(N, Text) -> starl_cli_terminal:warn(io_lib:format("robot ~b: ~ts", [N, Text])) end,
    lists:foreach(fun({N, Text}) -> ok = Note(N, Text) end, [
        {N, Text}
     || {N, {ok, _Files, Notes}} <- Answers, Text <- Notes
    ]),
    each([{N, files(Answer)} || {N, Answer} <- Answers], fun fetched/2).

files({ok, Files, _Notes}) -> {ok, Files};
files({error, _} = Error) -> Error.

fetched(N, []) ->
    io_lib:format("robot ~b: no recording\n", [N]);
fetched(N, [File | _] = Files) ->
    Bytes = lists:sum([filelib:file_size(F) || F <- Files]),
    Line = "robot ~b: ~b recording~ts, ~.1f MB, in ~ts\n",
    Plural = [$s || length(Files) > 1],
    io_lib:format(Line, [N, length(Files), Plural, Bytes / 1.0e6, filename:dirname(File)]).

numbers(#{robots := Robots}) -> lists:sort(maps:keys(Robots)).

%% Prints each answer, and complains of each failure.
each(Answers, Shown) ->
    Print = fun
        ({N, {ok, Said}}) -> starl_cli_terminal:out(Shown(N, Said));
        ({_, {error, Line}}) -> starl_cli_terminal:complain(["deploy: ", Line])
    end,
    lists:foreach(Print, Answers),
    status(lists:all(fun({_, {How, _}}) -> How =:= ok end, Answers)).

status(true) -> 0;
status(false) -> 1.

options(Mode, #{fleet := #{name := Name}, code := Code}, Values) ->
    #{
        kind => kind(Values),
        mode => Mode,
        trial_s => maps:get(trial, Values),
        code => Code,
        scratch => filename:join([starl_cli_target:root(), "_build", "fleet", Name]),
        say => fun starl_cli_terminal:warn/1
    }.

kind(#{build_there := true}) -> source;
kind(#{erlang := Erlang}) -> Erlang.

deploy(#{fleet := Fleet}, Options, #{dry_run := Dry}) ->
    case starl_fleet_deploy:release(Fleet, Options) of
        {ok, #{version := Version} = Made} ->
            Plan = starl_fleet_deploy:plan(Version, Fleet, Options),
            deployed(Dry, Made, Plan, Options);
        {error, Lines} ->
            {error, Lines}
    end.

deployed(true, #{fleet := Fleet}, Plan, _Options) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- starl_fleet_deploy:dry_run(Fleet, Plan)]),
    0;
deployed(false, Made, Plan, Options) ->
    print(starl_fleet_deploy:run(Made, Plan, Options)).

%% The team goes on with its run, so it must have one.
reload(#{fleet := Fleet} = File, Options, Values) ->
    Answers = starl_fleet_deploy:ask("status", numbers(Fleet), Fleet),
    case {[Line || {_, {error, Line}} <- Answers], runs(Answers)} of
        {[_ | _] = Lines, _} -> print({error, Lines});
        {[], [Run]} -> deploy(File, Options#{run => Run}, Values);
        {[], _} -> print({error, ["the robots run different releases; deploy first"]})
    end.

runs(Answers) ->
    lists:usort([
        Run
     || {_, {ok, Said}} <- Answers, {ok, #{run := Run}} <- [starl_fleet_term:read(Said)]
    ]).

print({ok, Lines}) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- Lines]),
    0;
print({error, Lines}) ->
    lists:foreach(fun(Line) -> starl_cli_terminal:complain(["deploy: ", Line]) end, Lines),
    1.
