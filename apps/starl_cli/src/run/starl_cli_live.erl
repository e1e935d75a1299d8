%% @doc Runs the robots of a command line in real time, in this VM or on a node each: shows the
%% progress, obeys Ctrl-C, and leaves the same files as a simulation.
-module(starl_cli_live).

-export([flags/0, run/3]).

-export_type([live/0]).

%% Where the robots run; how packets travel between nodes, and what happens to these.
-type live() ::
    here | {nodes, dist | udp, Chaos :: [{AtUs :: integer(), starl_cluster_chaos:act()}]}.

%% A run: what can be asked of it, wherever its robots are.
-type handle() :: #{
    await := fun(() -> starl_world:ending()),
    status := fun(() -> #{now_us := integer(), running := non_neg_integer(), atom() => term()}),
    stop := fun(() -> ok),
    finish := fun(() -> {starl_sim_outcome:t(), starl_scene:report()}),
    scenario := starl_sim_scenario:t(),
    %% what can be done to it ({@link starl_view_live})
    atom() => function()
}.

-define(SHOW_MS, 100).
%% What a window can do.
-define(HANDS, [status, stop, kill, pause, lose_store, set_back, cut, freeze, heal]).
%% The beginning of the name of the directory of the stores; the number of the OS process follows.
-define(STATE_DIR, "starl-live-").

%% @doc The flags of every live run, beside those of its scenario.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {pace, {number, 0.01, 100}, 1, "live, view: how many times as fast as real time"},
        {position_rate, {optional, {number, 0.1, 1000}}, none,
            "live: pictures of the positioning system a second; none: whenever a robot asks"},
        {whole_mm, switch, false, "live: the positioning system rounds to whole millimetres"},
        {walls, switch, false,
            "live: walls around the floor, which an emulated Create bumps against"}
    ].

%% @doc Runs a checked command line in real time. Gives the exit status.
-spec run(live(), starl_cli_setup:t(), Values :: #{atom() => term()}) ->
    starl_cli_command:answer().
run(Live, #{scenario := Scenario} = Setup, Values) ->
    case refused(Scenario) ++ too_fast(Scenario, Values) ++ no_cable(Scenario, Values) of
        [] -> run_with(own(Scenario), Live, Setup, Values);
        Problems -> {error, Problems}
    end.

own(#{chassis := Choice} = Scenario) ->
    starl_world_drivers:resolve(
        Choice, starl_sim_plan:profiles(Scenario), fun starl_cli_source:driver/1
    ).

run_with({error, _} = Error, _Live, _Setup, _Values) ->
    Error;
run_with({ok, Own}, Live, Checked, Values) ->
    Setup = Checked#{own => Own},
    Recorded =
        case starl_cli_recording:wanted(live, Values) of
            true -> live;
            false -> none
        end,
    starl_cli_recording:recorded(Recorded, Values, Setup, fun(With) ->
        starl_cli_window:live(Values, fun(Options, Attach) ->
            prepared(Live, With, Values, {Options, Attach})
        end)
    end).

%% What only the simulator can do.
refused(#{faults := Faults, random_faults := Random, reloads := Reloads}) ->
    [
        "faults: a schedule of faults needs the simulator; live, --loss and --delay disturb the "
        "radio, and ./starl cluster kill and cut the robots"
     || Faults =/= [] orelse Random =/= []
    ] ++
        [
            "reloads: a reload at a time of the run needs the simulator; live, ./starl cluster "
            "reload"
         || Reloads =/= []
        ].

%% An emulated Create knows real time only, and so do programs.
too_fast(#{chassis := Choice}, #{pace := Pace}) ->
    Own = [
        Name
     || Name <- starl_chassis_choice:in_turn(Choice), starl_chassis_choice:own(Name) =/= none
    ],
    [
        "chassis: an emulated Create, or a chassis of your own, runs in real time only: leave --pace "
        "and --speed of the cluster at 1"
     || Pace /= 1, Own =/= [] orelse starl_world_emulator:all(Choice, here) =/= undefined
    ].

no_cable(#{chassis := Choice}, #{unplug := Times}) ->
    [
        "unplug: only a Create has a cable: add --chassis create or create_1"
     || Times > 0, starl_world_emulator:all(Choice, here) =:= undefined
    ];
no_cable(_Scenario, _Values) ->
    [].

prepared(Live, Setup, Values, {Viewed, Attach}) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    Dir = state_dir(),
    try
        Own = options(Dir, Live, Setup, Values),
        Options = Viewed(starl_cli_recording:options(Setup, recorded(Live, Setup, Own))),
        started(start(Live, Setup, Options), Live, Setup, Attach)
    of
        Answer -> Answer
    after
        file:del_dir_r(Dir)
    end.

recorded(here, _Setup, Options) -> Options;
recorded({nodes, _, _}, Setup, Options) -> starl_cli_recording:nodes(Setup, Options).

%% The stores of the robots live as long as the run. What a killed run has left goes now.
state_dir() ->
    Prefix = filename:join(os:getenv("TMPDIR", "/tmp"), ?STATE_DIR),
    _ = [file:del_dir_r(Dir) || Dir <- filelib:wildcard(Prefix ++ "*"), abandoned(Dir)],
    Prefix ++ os:getpid().

abandoned(Dir) ->
    ?STATE_DIR ++ Pid = filename:basename(Dir),
    filelib:is_dir("/proc/self") andalso not filelib:is_dir("/proc/" ++ Pid).

options(Dir, Live, #{target := Target, scenario := Scenario, own := Own}, Values) ->
    #{pace := Pace, position_rate := Rate, whole_mm := Whole, walls := Walls} = Values,
    Common = #{
        dir => Dir,
        speed => Pace,
        rate_hz => Rate,
        whole_mm => Whole,
        arena => arena(Walls, Scenario),
        watch => starl_cli_findings:watch_live(Scenario)
    },
    Moving = maps:merge(Common, chassis(Scenario, Own, place(Live, Dir))),
    case Live of
        here ->
            maps:update_with(watch, fun(Watch) -> starl_cli_drive:watching() ++ Watch end, Moving);
        %% the log of a node tells of its crashes
        {nodes, Transport, Chaos} ->
            Moving#{
                chaos => Chaos,
                metrics => maps:get(metrics, Values, none),
                transport => Transport,
                code => lists:ukeysort(1, maps:get(code, Target, []) ++ maps:get(code, Own)),
                log => fun starl_cli_log:node/3
            }
    end.

arena(false, _Scenario) -> none;
arena(true, #{world := Size}) -> Size.

place(here, _Dir) -> here;
place({nodes, _, _}, Dir) -> {node, Dir}.

%% A chassis of the user's own, or an emulated one, for each robot that has one.
chassis(#{chassis := Choice}, Own, Place) ->
    case starl_world_drivers:lines(Choice, Own, starl_world_emulator:all(Choice, Place)) of
        undefined -> #{};
        Lines -> #{chassis => Lines}
    end.

-spec start(live(), starl_cli_setup:t(), map()) -> {ok, handle()} | {error, unicode:chardata()}.
start(here, #{scenario := Scenario}, Options) ->
    case starl_world_run:start(Scenario, Options) of
        {ok, Run} ->
            {ok, #{
                await => fun() -> starl_world_run:await(Run) end,
                status => fun() -> starl_world_run:status(Run) end,
                stop => fun() -> starl_world_run:stop(Run) end,
                finish => fun() -> starl_world_run:finish(Run) end,
                kill => fun(Robot) -> starl_world_run:kill(Run, Robot) end,
                cut => fun(A, B) -> starl_world_run:cut(Run, A, B) end,
                freeze => fun(Robot) -> starl_world_run:freeze_too(Run, Robot) end,
                heal => fun() -> starl_world_run:heal(Run) end,
                scenario => starl_world_run:scenario(Run)
            }};
        {error, Reason} ->
            {error, starl_sim:format_error(Reason)}
    end;
start({nodes, _, _}, #{scenario := Scenario}, Options) ->
    case starl_cluster:start(Scenario, Options) of
        {ok, Cluster} ->
            {ok, #{
                await => fun() -> starl_cluster:await(Cluster) end,
                status => fun() -> starl_cluster:status(Cluster) end,
                stop => fun() -> starl_cluster:stop(Cluster) end,
                finish => fun() -> starl_cluster:finish(Cluster) end,
                kill => fun(Robot) -> starl_cluster:kill(Cluster, Robot) end,
                pause => fun(Robot, Seconds) -> starl_cluster:pause(Cluster, Robot, Seconds) end,
                lose_store => fun(Robot) -> starl_cluster:lose_store(Cluster, Robot) end,
                set_back => fun(Robot) -> starl_cluster:set_back(Cluster, Robot) end,
                cut => fun(A, B) -> starl_cluster:cut(Cluster, A, B) end,
                freeze => fun(Robot) -> starl_cluster:freeze(Cluster, Robot) end,
                heal => fun() -> starl_cluster:heal(Cluster) end,
                scenario => starl_cluster:scenario(Cluster)
            }};
        {error, Reason} ->
            {error, starl_cluster:format_error(Reason)}
    end.

started({error, Why}, _Live, _Setup, _Attach) ->
    {error, [Why]};
started({ok, #{stop := Stop, scenario := Scenario} = Handle}, Live, Setup, Attach) ->
    ok = Attach(maps:with(?HANDS, Handle)),
    starl_cli_signal:on_interrupt(fun() -> spawn(Stop) end),
    Begun = erlang:monotonic_time(millisecond),
    Ending = watched(Handle, Live, Setup),
    starl_cli_progress:erase(),
    WallMs = erlang:monotonic_time(millisecond) - Begun,
    {Outcome, App} = (maps:get(finish, Handle))(),
    starl_cli_signal:on_interrupt(fun() -> ok end),
    starl_cli_simulation:tell(Setup#{live => true}, #{
        scenario => Scenario, ending => Ending, wall_ms => WallMs, outcome => Outcome, app => App
    }).

%% -- progress -------------------------------------------------------------------------------

watched(#{await := Await} = Handle, Live, #{quiet := Quiet, target := #{name := Name}}) ->
    Caller = self(),
    Waiter = spawn_link(fun() -> Caller ! {ended, self(), Await()} end),
    Progress = starl_cli_progress:new(
        case Quiet of
            true -> quiet;
            false -> auto
        end
    ),
    watch(Waiter, Handle, {Name, where(Live)}, Progress).

where(here) -> "live";
where({nodes, dist, _}) -> "live on nodes";
where({nodes, udp, _}) -> "live on nodes, by UDP".

watch(Waiter, #{status := Status} = Handle, {Name, Where} = Label, Progress) ->
    receive
        {ended, Waiter, Ending} -> Ending;
        {'EXIT', Waiter, Reason} -> exit(Reason)
    after ?SHOW_MS ->
        Words = fun() ->
            #{now_us := Now, running := Running} = Status(),
            [
                io_lib:format("~ts ~.1f s", [Name, Now / 1.0e6]),
                Where,
                io_lib:format("~b at work", [Running])
            ]
        end,
        watch(Waiter, Handle, Label, starl_cli_progress:show(Progress, unknown, Words))
    end.
