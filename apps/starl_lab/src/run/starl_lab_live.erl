%% @doc Runs the robots of a command line in real time, in this VM or on one node each. It shows the
%% progress, obeys Ctrl-C, and leaves the same files as a simulation.
-module(starl_lab_live).

-export([flags/0, run/3]).

-export_type([live/0]).

%% Where the robots run; how packets travel between nodes, and what happens to these.
-type live() ::
    here
    | {nodes, starl_world_setup:name(),
        Chaos :: [{AtUs :: integer(), starl_cluster_chaos:fault()}]}.

-define(NO_DRAWN_FAULTS,
    "drawn faults need the simulator; live, --faults plays a schedule, and ./starl cluster --chaos "
    "disturbs the robots"
).
-define(NO_RELOADS,
    "a reload at a time of the run needs the simulator; live, ./starl cluster reload"
).
-define(SHOW_MS, 100).
-define(NO_CABLE, "only a Create has a cable: add --chassis create or create_1").
%% The beginning of the name of the directory of the stores; the number of the OS process follows.
-define(STATE_DIR, "live").

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
-spec run(live(), starl_lab_setup:t(), Values :: #{atom() => term()}) ->
    starl_cli_command:answer().
run(Live, #{scenario := Scenario} = Setup, Values) ->
    case refused(Live, Setup, Values) ++ too_fast(Scenario, Values) ++ no_cable(Scenario, Values) of
        [] -> run_with(own(Scenario), Live, Setup, Values);
        Problems -> {error, Problems}
    end.

own(#{chassis := Choice} = Scenario) ->
    starl_world_own_chassis:resolve(
        Choice, starl_run_plan:profiles(Scenario), fun starl_cli_source:driver/1
    ).

run_with({error, _} = Error, _Live, _Setup, _Values) ->
    Error;
run_with({ok, Own}, Live, Checked, Values) ->
    Setup = Checked#{own => Own},
    Recorded =
        case starl_lab_recording:wanted(live, Values) of
            true -> live;
            false -> none
        end,
    starl_lab_recording:recorded(Recorded, Values, Setup, fun(With) ->
        starl_lab_window:live(Values, fun(Options, Attach) ->
            prepared(Live, With, Values, {Options, Attach})
        end)
    end).

%% What only the simulator can do; what needs a Create.
refused(Live, #{target := Target, scenario := Scenario}, Values) ->
    #{faults := Faults, random_faults := Random, reloads := Reloads} = Scenario,
    Place = fun(Key) -> [starl_cli_target:place(Key, Target, Scenario), ": "] end,
    [[Place(faults), Line] || Line <- starl_run_manual_fault:refused(world(Live), Faults)] ++
        [
            [Place(faults), io_lib:format("fault ~ts: ~ts", [Id, too_long(Pace)])]
         || {Id, From, To, pause, _, _} <- Faults,
            #{pace := Pace} <- [Values],
            To - From > Pace * starl_cluster:most_halted_ms()
        ] ++
        [
            [Place(faults), io_lib:format("fault ~ts: serial_gone: ~ts", [Id, ?NO_CABLE])]
         || {Id, _, _, serial_gone, _, _} <- Faults, not has_cable(Scenario)
        ] ++
        [[Place(random_faults), ?NO_DRAWN_FAULTS] || Random =/= []] ++
        [[Place(reloads), ?NO_RELOADS] || Reloads =/= []].

too_long(Pace) ->
    io_lib:format("pause: a node can be halted for ~b ms of the run at most at this pace", [
        round(Pace * starl_cluster:most_halted_ms())
    ]).

world(here) -> one_vm;
world({nodes, _, _}) -> nodes.

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

no_cable(Scenario, #{unplug := Times}) ->
    ["unplug: " ++ ?NO_CABLE || Times > 0, not has_cable(Scenario)];
no_cable(_Scenario, _Values) ->
    [].

has_cable(#{chassis := Choice}) -> starl_world_emulator:all(Choice, here) =/= undefined.

prepared(Live, Setup, Values, {Viewed, Attach}) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    %% the stores of the robots live as long as the run
    ok = starl_private_dir:clean(?STATE_DIR),
    case starl_private_dir:new(?STATE_DIR) of
        {ok, Dir} -> in_dir(Dir, Live, Setup, Values, {Viewed, Attach});
        {error, Reason} -> {error, [starl_private_dir:format_error(Reason)]}
    end.

in_dir(Dir, Live, Setup, Values, {Viewed, Attach}) ->
    try
        Own = options(Dir, Live, Setup, Values),
        Options = Viewed(starl_lab_recording:options(Setup, recorded(Live, Setup, Own))),
        #{scenario := Scenario} = Setup,
        started(starl_run:start(starl_world_run, Scenario, Options), Live, Setup, Attach)
    of
        Answer -> Answer
    after
        starl_private_dir:remove(Dir)
    end.

recorded(here, _Setup, Options) -> Options;
recorded({nodes, _, _}, Setup, Options) -> starl_lab_recording:nodes(Setup, Options).

options(Dir, Live, #{target := Target, scenario := Scenario, own := Own}, Values) ->
    #{pace := Pace, position_rate := Rate, whole_mm := Whole, walls := Walls} = Values,
    Common = #{
        dir => Dir,
        speed => Pace,
        rate_hz => Rate,
        whole_mm => Whole,
        arena => arena(Walls, Scenario),
        watch => starl_lab_findings:watch_live(Scenario)
    },
    Moving = maps:merge(Common, chassis(Scenario, Own, place(Live, Dir))),
    case Live of
        here ->
            maps:update_with(watch, fun(Watch) -> starl_lab_drive:watching() ++ Watch end, Moving);
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
    case starl_world_own_chassis:lines(Choice, Own, starl_world_emulator:all(Choice, Place)) of
        undefined -> #{};
        Lines -> #{chassis => Lines}
    end.

started({error, Why}, _Live, _Setup, _Attach) ->
    {error, [Why]};
started({ok, Run}, Live, Setup, Attach) ->
    ok = Attach(Run),
    starl_cli_signal:on_interrupt(fun() -> spawn(fun() -> starl_run:stop(Run) end) end),
    Begun = erlang:monotonic_time(millisecond),
    Ending = watched(Run, Live, Setup),
    starl_cli_progress:erase(),
    WallMs = erlang:monotonic_time(millisecond) - Begun,
    Scenario = starl_run:scenario(Run),
    {Outcome, App} = starl_run:finish(Run),
    starl_cli_signal:on_interrupt(fun() -> ok end),
    starl_lab_simulation:tell(Setup#{live => true}, #{
        scenario => Scenario, ending => Ending, wall_ms => WallMs, outcome => Outcome, app => App
    }).

%% -- progress -------------------------------------------------------------------------------

watched(Run, Live, #{quiet := Quiet, target := #{name := Name}}) ->
    Caller = self(),
    Waiter = spawn_link(fun() -> Caller ! {ended, self(), starl_run:await(Run)} end),
    Progress = starl_cli_progress:new(
        case Quiet of
            true -> quiet;
            false -> auto
        end
    ),
    watch(Waiter, Run, {Name, where(Live)}, Progress).

where(here) -> "live";
where({nodes, dist, _}) -> "live on nodes";
where({nodes, Name, _}) -> "live on nodes, by " ++ string:uppercase(atom_to_list(Name)).

watch(Waiter, Run, {Name, Where} = Label, Progress) ->
    receive
        {ended, Waiter, Ending} -> Ending;
        {'EXIT', Waiter, Reason} -> exit(Reason)
    after ?SHOW_MS ->
        Words = fun() ->
            #{now_us := Now, running := Running} = starl_run:status(Run),
            [
                io_lib:format("~ts ~.1f s", [Name, Now / 1.0e6]),
                Where,
                io_lib:format("~b at work", [Running])
            ]
        end,
        watch(Waiter, Run, Label, starl_cli_progress:show(Progress, unknown, Words))
    end.
