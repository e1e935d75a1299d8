%% @doc Deploys a fleet: builds its release, and switches all robots from their present release to
%% the new one, or none of them. Nothing on a robot changes before the release is found good on all.
%% ```
%%     look  room  copy  keys  check   on all robots; a failure ends it here, nothing has changed
%%     commission                      if no robot of the team has a store: they have never run
%%     switch  health                  a failure takes all robots back to the release before
%% '''
-module(starl_fleet_deploy).

-export([release/2, plan/3, dry_run/2, run/3, rollback/1, ask/3]).

-export_type([options/0, made/0, report/0]).

%% `run': that of the team whose code is
%% reloaded; `scratch': a directory for the release on this computer; `say': gets a line on each stage.
-type options() :: #{
    kind := starl_fleet_release:kind(),
    mode := restart | reload,
    trial_s := pos_integer(),
    code := [starl_fleet_release:code()],
    run => non_neg_integer(),
    scratch := file:filename(),
    say := fun((unicode:chardata()) -> ok)
}.

%% A release that is not written yet.
-type made() :: #{
    fleet := starl_fleet_file:t(),
    manifest := starl_fleet_release:manifest(),
    version := string()
}.

-type report() :: {ok, [unicode:chardata()]} | {error, [unicode:chardata(), ...]}.

%% The longest time of a stage.
-define(STAGE_MS, 1_800_000).
-define(QUESTION_MS, 60_000).
%% After a roll-back.
-define(HEALTH, "health 60 1").

%% @doc Makes the release of a fleet, without writing it.
-spec release(starl_fleet_file:t(), options()) -> {ok, made()} | {error, [unicode:chardata(), ...]}.
release(Fleet, #{scratch := Scratch, kind := Kind, code := Code} = Options) ->
    What = (maps:with([run], Options))#{fleet => Fleet, kind => Kind, code => Code},
    case starl_fleet_release:manifest(What, filename:join(Scratch, "boot")) of
        {ok, Manifest} ->
            Version = starl_fleet_release:version(Manifest),
            {ok, #{fleet => Fleet, manifest => Manifest, version => Version}};
        {error, Why} ->
            {error, [Why]}
    end.

%% @doc The plan of a deployment of this release.
-spec plan(Version :: string(), starl_fleet_file:t(), options()) -> starl_fleet_steps:plan().
plan(Version, Fleet, #{scratch := Scratch, kind := Kind, mode := Mode, trial_s := Trial}) ->
    #{
        release => filename:join(Scratch, Version),
        keys => starl_fleet_keys:dir(Fleet),
        kind => Kind,
        mode => Mode,
        trial_s => Trial
    }.

%% @doc All commands, for a reader.
-spec dry_run(starl_fleet_file:t(), starl_fleet_steps:plan()) -> [unicode:chardata()].
dry_run(Fleet, Plan) ->
    lists:append([
        [["# ", title(Stage)] | [Command || {_, Command} <- Steps]]
     || {Stage, Steps} <- starl_fleet_steps:deploy(Fleet, Plan, [])
    ]).

title(look) -> "look: processor, disk, rsync, the release there, the clock";
title(room) -> "make the directories";
title(copy) -> "copy the release (by tar, where a robot has no rsync)";
title(keys) -> "copy the keys";
title(build) -> "compile there";
title(check) -> "check the release there: the VM starts, the fleet file is sound";
title(commission) -> "the robots have never run (only if none of them has a store)";
title(may_reload) -> "can the new code be loaded?";
title(switch) -> "switch to the release, and start; on a failure: bin/robot undo";
title(reload) -> "take the new code, on trial; on a failure: bin/robot reload back";
title(health) -> "wait until the robot is well and hears all others";
title(tidy) -> "remove older releases".

%% -- a deployment ---------------------------------------------------------------------------

%% @doc Deploys a release to all robots of a fleet.
-spec run(made(), starl_fleet_steps:plan(), options()) -> report().
run(#{fleet := Fleet, manifest := Manifest, version := Version}, Plan, Options) ->
    #{scratch := Scratch} = Options,
    case starl_fleet_keys:missing(Fleet) of
        [] ->
            case starl_fleet_release:write(Manifest, Version, Scratch) of
                {ok, _} -> stages(Fleet, Plan, Manifest, Options);
                {error, Why} -> {error, [Why]}
            end;
        [File | _] ->
            {error, [
                [File, ": no such file; the fleet's keys are made by: ./starl keys FLEET.term"]
            ]}
    end.

stages(Fleet, #{mode := Mode} = Plan, Manifest, Options) ->
    Stages = starl_fleet_steps:deploy(Fleet, Plan, []),
    {Before, After} = lists:splitwith(fun({Stage, _}) -> not is_turn(Stage) end, Stages),
    Ours = ours(Manifest, Plan),
    case
        each(Before, #{
            fleet => Fleet, plan => Plan, ours => Ours, options => Options, tar => [], stores => []
        })
    of
        {ok, State} -> turned(each(After, State), Mode, State);
        {error, _Failed, Lines} -> {error, Lines ++ ["no robot has changed its release"]}
    end.

is_turn(Stage) -> Stage =:= switch orelse Stage =:= reload.

ours(Manifest, #{kind := Kind}) ->
    #{
        kind => Kind,
        machine => string:trim(os:cmd("uname -m")),
        otp => erlang:system_info(otp_release),
        size_kb => starl_fleet_release:size_kb(Manifest)
    }.

turned({ok, #{plan := #{release := Release}, fleet := #{robots := Robots}}}, _Way, _State) ->
    Line = "release ~ts runs on ~b robot~ts",
    Plural = [$s || map_size(Robots) > 1],
    {ok, [io_lib:format(Line, [filename:basename(Release), map_size(Robots), Plural])]};
turned({error, Failed, Lines}, Mode, State) ->
    {error, Lines ++ back(back_command(Mode, Failed), State)}.

each([], State) ->
    {ok, State};
each([Stage | Stages], State) ->
    case stage(Stage, State) of
        {ok, Next} -> each(Stages, Next);
        {error, _, _} = Error -> Error
    end.

%% A team that has run begins nothing anew: a robot without a store has lost it.
stage({commission, _Steps}, #{stores := [_ | _]} = State) ->
    #{stores := Stores, fleet := #{robots := Robots}, options := #{say := Say}} = State,
    Without = maps:to_list(maps:without(Stores, Robots)),
    ok = lists:foreach(
        fun({N, Robot}) -> ok = Say(starl_fleet_failure:lost_store(N, Robot)) end,
        lists:sort(Without)
    ),
    {ok, State};
stage({Name, Steps}, #{options := #{say := Say}, tar := Tar} = State) ->
    ok = Say(title(Name)),
    Begun = os:system_time(second),
    Results = starl_fleet_shell:run(
        [with_tar(Name, Step, Tar, State) || Step <- Steps], ?STAGE_MS
    ),
    case failures(Name, Results, State) of
        [] ->
            looked(Name, Results, State#{looked_s => {Begun, os:system_time(second)}});
        Lines ->
            {error, hd([N || {N, {Status, _}} <- Results, Status =/= 0]), Lines}
    end.

%% Where there is no rsync.
with_tar(Name, {N, Command}, Tar, #{fleet := Fleet, plan := Plan}) ->
    case lists:member(N, Tar) andalso lists:member(Name, [copy, keys]) of
        true -> {N, starl_fleet_steps:copy_by_tar(Name, N, {Fleet, Plan})};
        false -> {N, Command}
    end.

failures(Name, Results, #{fleet := #{robots := Robots}}) ->
    [
        starl_fleet_failure:line(Name, N, maps:get(N, Robots), Result)
     || {N, {Status, _} = Result} <- Results, Status =/= 0
    ].

looked(look, Results, #{fleet := #{robots := Robots}, ours := Ours} = State) ->
    #{looked_s := Looked, options := #{say := Say}} = State,
    Facts = [{N, starl_fleet_failure:facts(Said)} || {N, {0, Said}} <- Results],
    Clock = fun(N, F) -> starl_fleet_failure:clock(N, maps:get(N, Robots), F, Looked) end,
    ok = lists:foreach(Say, [Line || {N, F} <- Facts, Line <- Clock(N, F)]),
    case [L || {N, F} <- Facts, L <- starl_fleet_failure:look(N, maps:get(N, Robots), F, Ours)] of
        [] ->
            {ok, State#{
                tar := [N || {N, #{rsync := false}} <- Facts],
                stores := [N || {N, #{store := true}} <- Facts]
            }};
        Lines ->
            {error, hd(lists:sort(maps:keys(Robots))), Lines}
    end;
looked(health, Results, #{fleet := #{robots := Robots}, options := #{say := Say}} = State) ->
    Notes = [{N, string:trim(Said)} || {N, {0, Said}} <- Results],
    ok = lists:foreach(Say, [
        starl_fleet_failure:named(N, maps:get(N, Robots), Note)
     || {N, Note} <- Notes, Note =/= "healthy"
    ]),
    {ok, State};
looked(_Name, _Results, State) ->
    {ok, State}.

%% -- back -----------------------------------------------------------------------------------

back(Words, #{fleet := Fleet, plan := Plan, options := #{say := Say}}) ->
    ok = Say("back to the release before"),
    {Failures, Summary} = went_back(starl_fleet_steps:back(Words, Fleet, Plan), Fleet),
    Failures ++ [Summary].

back_command(restart, _Failed) -> "undo";
back_command(reload, Failed) -> "reload back " ++ integer_to_list(Failed).

summary(Said) ->
    case lists:usort([string:trim(Text) || Text <- Said]) of
        [] -> "no robot went back";
        ["none"] -> "there was no release before: the robots are stopped";
        [Release] -> ["the robots run release ", Release, " again"];
        Releases -> ["the robots run releases ", lists:join(", ", Releases), " again"]
    end.

%% @doc Takes all robots back to the release before.
-spec rollback(starl_fleet_file:t()) -> report().
rollback(#{robots := Robots} = Fleet) ->
    case
        went_back(starl_fleet_steps:one("rollback", lists:sort(maps:keys(Robots)), Fleet), Fleet)
    of
        {[], Summary} -> {ok, [Summary]};
        {Failures, Summary} -> {error, Failures ++ [Summary]}
    end.

%% The robots must be well there, too.
went_back(Steps, Fleet) ->
    Results = starl_fleet_shell:run(Steps, ?STAGE_MS),
    Back = [N || {N, {0, Said}} <- Results, string:trim(Said) =/= "none"],
    Health = starl_fleet_shell:run(starl_fleet_steps:one(?HEALTH, Back, Fleet), ?STAGE_MS),
    Failures =
        failures(undo, Results, #{fleet => Fleet}) ++ failures(health, Health, #{fleet => Fleet}),
    {Failures, summary([Said || {_, {0, Said}} <- Results])}.

%% @doc Runs `bin/robot' with these arguments on each of these robots. Returns its output, or one
%% line.
-spec ask(Words :: string(), [starl:robot_id()], starl_fleet_file:t()) ->
    [{starl:robot_id(), {ok, string()} | {error, unicode:chardata()}}].
ask(Words, Numbers, #{robots := Robots} = Fleet) ->
    [
        {N, asked(N, maps:get(N, Robots), Result)}
     || {N, Result} <- starl_fleet_shell:run(
            starl_fleet_steps:one(Words, Numbers, Fleet), ?QUESTION_MS
        )
    ].

asked(_N, _Robot, {0, Said}) -> {ok, Said};
asked(N, Robot, Result) -> {error, starl_fleet_failure:line(robot, N, Robot, Result)}.
