%% @doc The second part of `./starl hostile': kills the node of a robot again and again, at random instants, while the
%% robots send each other numbers. The monitor of SAP judges whether a message was acknowledged and not
%% delivered. Afterwards every robot must be acknowledged by every other.
-module(starl_dev_hostile_kills).

-export([run/1]).

%% The longest time of a life after its first acknowledged message, and the pause between two looks.
-define(LIFE_MS, 400).
-define(LOOK_MS, 50).
%% Looks before a robot counts as unheard: two minutes.
-define(LOOKS, 2400).

%% @doc Kills the node of one robot as often as wanted.
-spec run(#{kills := pos_integer(), robots := pos_integer(), seed := integer(), atom() => term()}) ->
    ok | {wrong, [unicode:chardata()]} | {error, [unicode:chardata()]}.
run(Values) -> starl_dev_hostile_run:with_dir(fun(Dir) -> run(Dir, Values) end).

run(Dir, #{robots := Robots, seed := Seed, speed := Speed} = Values) ->
    Scenario = #{app => starl_hostile_traffic, robots => Robots, seed => Seed, time => 40000},
    Options = #{dir => Dir, transport => udp, speed => Speed, log => fun starl_cli_log:node/3},
    case starl_world_run:start(Scenario, Options) of
        {ok, Cluster} -> killed(Cluster, Dir, Values);
        {error, Reason} -> {error, [starl_world_run:format_error(Reason)]}
    end.

killed(Cluster, Dir, #{robots := Robots, kills := Kills, seed := Seed}) ->
    Victim = 1 + Seed rem Robots,
    Begun = erlang:monotonic_time(millisecond),
    starl_cli_signal:on_interrupt(fun() -> spawn(fun() -> starl_world_run:stop(Cluster) end) end),
    Kill = fun(N, Unheard) -> Unheard orelse kill(Cluster, Victim, Dir, N, Seed) end,
    Unheard = lists:foldl(Kill, false, lists:seq(1, Kills)),
    Deaf = [{From, To} || not Unheard, {From, To} <- pairs(Robots), not hears(From, To, Dir)],
    #{now_us := Us, restarts := #{Victim := Restarts}} = starl_world_run:status(Cluster),
    ok = starl_world_run:stop(Cluster),
    {#{violations := Violations, monitors := #{starl_sap_monitor := Sap}}, _} =
        starl_world_run:finish(Cluster),
    starl_cli_terminal:out(
        "robot ~b: killed and started anew ~b times in ~.1f s (~.1f s of the run)\n"
        "  messages: ~b sent, ~b delivered, ~b acknowledged, ~b lost; violations: ~b\n",
        [Victim, Restarts, (erlang:monotonic_time(millisecond) - Begun) / 1000, Us / 1.0e6] ++
            [maps:get(Key, Sap) || Key <- [sent, delivered, acknowledged, lost]] ++
            [length(Violations)]
    ),
    wrong([
        {not Unheard, io_lib:format("robot ~b is not heard any more", [Victim])},
        {Deaf =:= [], io_lib:format("not acknowledged (from, to): ~0tp", [Deaf])},
        {Violations =:= [], [starl_violation:format(V) || V <- Violations]}
    ]).

wrong(Checks) ->
    case [Line || {false, Line} <- Checks] of
        [] -> ok;
        Lines -> {wrong, Lines}
    end.

pairs(Robots) ->
    Ids = lists:seq(1, Robots),
    [{From, To} || From <- Ids, To <- Ids, From =/= To].

%% Kills the node some time after its present life has had a message acknowledged. True: it has none
%% for minutes.
kill(Cluster, Victim, Dir, N, Seed) ->
    case looks(?LOOKS, fun() -> is_heard(Victim, N, Dir) end) of
        true ->
            {Ms, _} = rand:uniform_s(?LIFE_MS, rand:seed_s(exsss, {Seed, N, Victim})),
            ok = pause(Ms),
            ok = starl_world_run:inject(Cluster, [{reboot, Victim, #{}, 0}]),
            starl_cli_progress:note(io_lib:format("kill ~b", [N])),
            false;
        false ->
            true
    end.

%% In its Nth life the robot has heard and been heard.
is_heard(Robot, N, Dir) ->
    {Lives, Facts} = starl_dev_hostile_run:last_facts(Dir, Robot),
    Lives >= N andalso
        lists:any(fun is_acknowledged/1, Facts) andalso lists:any(fun is_delivered/1, Facts).

is_acknowledged({_, _, sap, {outcome, _, _, acknowledged}}) -> true;
is_acknowledged(_) -> false.

is_delivered({_, _, sap, {delivered, _, _, _}}) -> true;
is_delivered(_) -> false.

%% Acknowledged from now on. Robots that were not killed have one long life.
hears(From, To, Dir) ->
    {_, Before} = starl_dev_hostile_run:last_facts(Dir, From),
    Last = lists:max([0 | acknowledged(To, Before)]),
    looks(?LOOKS, fun() ->
        {_, Facts} = starl_dev_hostile_run:last_facts(Dir, From),
        lists:any(fun(At) -> At > Last end, acknowledged(To, Facts))
    end).

acknowledged(By, Facts) -> [At || {At, _, sap, {outcome, _, R, acknowledged}} <- Facts, R =:= By].

looks(0, _Seen) ->
    false;
looks(Left, Seen) ->
    Seen() orelse
        begin
            ok = pause(?LOOK_MS),
            looks(Left - 1, Seen)
        end.

pause(Ms) ->
    receive
    after Ms -> ok
    end.
