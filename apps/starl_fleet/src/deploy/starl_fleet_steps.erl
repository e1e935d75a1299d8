%% @doc Builds the shell commands of a deployment. `--dry-run' prints exactly the lines that a
%% deployment runs. Each stage has one command for each robot; a stage begins when the stage before
%% has ended on all robots. A pure module.
-module(starl_fleet_steps).

-export([
    deploy/3,
    one/3,
    copy_by_tar/3,
    back/3,
    recorded/1,
    copied/4,
    recordings/1,
    target/1,
    base/2,
    quoted/1
]).

-export_type([plan/0, stage/0, step/0]).

%% `release': its directory on this computer, named by its version.
-type plan() :: #{
    release := file:filename(),
    keys := file:filename(),
    kind := starl_fleet_release:kind(),
    way := restart | reload,
    trial_s := pos_integer()
}.

-type stage() ::
    look
    | room
    | copy
    | keys
    | build
    | check
    | commission
    | may_reload
    | switch
    | reload
    | health
    | tidy.

-type step() :: {starl:robot_id(), Command :: string()}.

%% A node has this long to be healthy.
-define(HEALTH_S, 60).

%% @doc All stages of a deployment.
-spec deploy(starl_fleet_file:t(), plan(), [stage()]) -> [{stage(), [step()]}].
deploy(#{robots := Robots} = Fleet, Plan, Without) ->
    [
        {Stage, [
            {N, command(Stage, N, R, Fleet, Plan)}
         || {N, R} <- lists:sort(maps:to_list(Robots))
        ]}
     || Stage <- stages(Plan), not lists:member(Stage, Without)
    ].

stages(#{way := restart, kind := Kind}) ->
    [look, room, copy, keys] ++ [build || Kind =:= source] ++
        [check, commission, switch, health, tidy];
stages(#{way := reload, kind := Kind}) ->
    [look, room, copy] ++ [build || Kind =:= source] ++ [check, may_reload, reload, health, tidy].

command(look, N, Robot, Fleet, _Plan) ->
    ssh(Robot, look(base(N, Fleet)));
command(room, N, Robot, Fleet, _Plan) ->
    ssh(Robot, room(base(N, Fleet), Fleet));
command(copy, N, Robot, Fleet, #{release := Release}) ->
    Earlier = "--link-dest=../../current/",
    From = quoted(Release) ++ "/",
    To = target(Robot) ++ ":" ++ release(N, Fleet, Release) ++ "/",
    words(["rsync -a --delete", Earlier, "-e", quoted(shell(Robot)), From, To]);
command(keys, N, Robot, Fleet, #{keys := Keys}) ->
    Files = [quoted(filename:join(Keys, File)) || File <- key_files(N, Fleet)],
    To = target(Robot) ++ ":" ++ base(N, Fleet) ++ "/keys/",
    words(["rsync -a -e", quoted(shell(Robot))] ++ Files ++ [To]);
command(commission, N, Robot, Fleet, _Plan) ->
    ssh(Robot, "touch " ++ base(N, Fleet) ++ "/state/commissioned");
command(Stage, N, Robot, Fleet, Plan) ->
    robot(N, Robot, Fleet, Plan, action(Stage, Plan)).

%% What the release on a robot is told.
action(may_reload, _Plan) ->
    "reload check";
action(reload, #{trial_s := Trial}) ->
    "reload switch " ++ integer_to_list(1000 * Trial);
action(health, #{trial_s := Trial}) ->
    lists:flatten(io_lib:format("health ~b ~b", [?HEALTH_S, Trial]));
action(build, _Plan) ->
    "build";
action(check, _Plan) ->
    "check";
action(switch, _Plan) ->
    "switch";
action(tidy, _Plan) ->
    "tidy".

%% @doc One stage, for each of these robots: after a failure, or a wish of the user's.
-spec one(Words :: string(), [starl:robot_id()], starl_fleet_file:t()) -> [step()].
one(Words, Numbers, #{robots := Robots} = Fleet) ->
    [
        {N, ssh(maps:get(N, Robots), base(N, Fleet) ++ "/current/bin/robot " ++ Words)}
     || N <- Numbers
    ].

%% @doc Back to the release before, where this one is in use.
-spec back(Words :: string(), starl_fleet_file:t(), plan()) -> [step()].
back(Words, #{robots := Robots} = Fleet, Plan) ->
    [{N, robot(N, R, Fleet, Plan, Words)} || {N, R} <- lists:sort(maps:to_list(Robots))].

%% @doc Asks each robot for the sizes and the names of its recordings. Where there are none, nothing comes.
-spec recorded(starl_fleet_file:t()) -> [step()].
recorded(#{robots := Robots} = Fleet) ->
    [
        {N,
            ssh(
                R,
                "cd " ++ recordings_there(N, Fleet) ++
                    " 2>/dev/null && wc -c -- *.mcap 2>/dev/null || true"
            )}
     || {N, R} <- lists:sort(maps:to_list(Robots))
    ].

%% @doc Copies these recordings of a robot into a directory. Of each it copies at most the length
%% that the robot has announced.
-spec copied(starl:robot_id(), starl_fleet_file:t(), file:filename(), [
    {Name :: string(), Bytes :: non_neg_integer()}, ...
]) -> string().
copied(N, #{robots := Robots} = Fleet, To, Files) ->
    Robot = maps:get(N, Robots),
    lists:flatten(lists:join(" && ", [copied(N, Robot, Fleet, To, File) || File <- Files])).

copied(N, Robot, Fleet, To, {Name, Bytes}) ->
    Head = "head -c " ++ integer_to_list(Bytes),
    There = Head ++ " -- " ++ recordings_there(N, Fleet) ++ "/" ++ quoted(Name),
    words([ssh(Robot, There), "|", Head, ">" ++ quoted(filename:join(To, Name))]).

recordings_there(N, Fleet) -> base(N, Fleet) ++ "/state/recordings".

%% @doc The name of the directory of a robot's recordings, as `./starl merge' takes it.
-spec recordings(starl:robot_id()) -> string().
recordings(N) -> "robot-" ++ integer_to_list(N).

%% @doc Copies without rsync on the robot. By tar, not scp: any Linux has it, a small ssh server often has
%% no sftp, and modes survive.
-spec copy_by_tar(copy | keys, starl:robot_id(), {starl_fleet_file:t(), plan()}) -> string().
copy_by_tar(copy, N, {#{robots := Robots} = Fleet, #{release := Release}}) ->
    Dir = release(N, Fleet, Release),
    There = words(["mkdir -p", Dir, "&& tar -xf - -C", Dir]),
    words(["tar -C", quoted(Release), "-cf - . |", ssh_in(maps:get(N, Robots), There)]);
copy_by_tar(keys, N, {#{robots := Robots} = Fleet, #{keys := Keys}}) ->
    Files = [["-C ", quoted(D), " ", F] || {D, F} <- places(Keys, key_files(N, Fleet))],
    There = words(["tar -xf - -C", base(N, Fleet) ++ "/keys"]),
    words(["tar -cf -", lists:join(" ", Files), "|", ssh_in(maps:get(N, Robots), There)]).

places(Keys, Files) ->
    Whole = [filename:join(filename:absname(Keys), File) || File <- Files],
    [{filename:dirname(File), filename:basename(File)} || File <- Whole].

%% -- what is said on the robot's computer ---------------------------------------------------

%% Facts, one a line.
look(Base) ->
    "echo machine $(uname -m); "
    "echo rsync $(rsync --version >/dev/null 2>&1 && echo yes || echo no); "
    "echo otp $(command -v erl >/dev/null && erl -noinput -eval "
    "'io:put_chars(erlang:system_info(otp_release)), halt().' || echo none); "
    "echo free $(d=" ++ Base ++
        "; while [ ! -d $d ]; do d=$(dirname $d); done; "
        "df -Pk $d | tail -n 1 | { read a b c free e; echo $free; }); "
        "echo release $(basename $(readlink " ++ Base ++
        "/current || echo none)); "
        "echo store $(cd " ++ Base ++
        "/state 2>/dev/null && ls | grep -q '^starts-' && echo kept || echo none); "
        "echo time $(date +%s)".

room(Base, #{service := Service}) ->
    Dirs = lists:append([" " ++ Base ++ "/" ++ Dir || Dir <- ["releases", "keys", "state"]]),
    Only = " " ++ Base ++ "/keys " ++ Base ++ "/state",
    "mkdir -p" ++ Dirs ++ " && chmod 700" ++ Only ++ " && echo " ++ atom_to_list(Service) ++ " >" ++
        Base ++ "/service".

robot(N, Robot, Fleet, #{release := Release}, Words) ->
    ssh(Robot, release(N, Fleet, Release) ++ "/bin/robot " ++ Words).

key_files(N, #{transport := dist}) ->
    Own = "robot-" ++ integer_to_list(N),
    ["fleet.key", "ca.pem", "tls.config", Own ++ "/robot.key", Own ++ "/robot.pem"];
key_files(_N, #{}) ->
    ["fleet.key"].

release(N, Fleet, Release) -> base(N, Fleet) ++ "/releases/" ++ filename:basename(Release).

%% @doc The directory of a robot on its computer; relative to the user's home, if `home' is.
-spec base(starl:robot_id(), starl_fleet_file:t()) -> file:filename().
base(N, #{home := Home, name := Name}) ->
    Home ++ "/" ++ Name ++ "/robot-" ++ integer_to_list(N).

%% @doc A robot's computer, for ssh.
-spec target(starl_fleet_file:robot()) -> string().
target(#{user := none, host := Host}) -> Host;
target(#{user := User, host := Host}) -> User ++ "@" ++ Host.

%% The command that runs a line of sh on a robot's computer.
-spec ssh(starl_fleet_file:robot(), string()) -> string().
ssh(Robot, Line) -> words([shell(Robot), "-n", target(Robot), quoted(Line)]).

%% The same, with something to read.
ssh_in(Robot, Line) -> words([shell(Robot), target(Robot), quoted(Line)]).

%% Never a question: nobody may be there to answer it. Of two settings ssh takes the first, the user's.
shell(#{ssh := More}) ->
    words(["ssh"] ++ [quoted(Word) || Word <- More] ++ ["-o BatchMode=yes -o ConnectTimeout=10"]).

words(Words) -> lists:flatten(lists:join($\s, Words)).

%% @doc Quotes a word for `sh'.
-spec quoted(string()) -> string().
quoted(Word) when is_list(Word) ->
    case re:run(Word, "^[A-Za-z0-9_./:=@%+,-]+$", [{capture, none}, dollar_endonly]) of
        match -> Word;
        nomatch -> "'" ++ lists:flatten(string:replace(Word, "'", "'\\''", all)) ++ "'"
    end.
