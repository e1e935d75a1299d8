%% @doc A simulation for a window that can restart: with another fault, or to go back in time. What
%% happened before the fault is the same, by the contract of the simulator. So the window gets only
%% what comes after the fault. A run that goes back reports everything from the beginning.
-module(starl_lab_player_run).

-export([start/1, run/2, step/3, halt/1, judge/1, changed/2, back/2, look/2, close/1]).
-export([now/1, until/1, ending/1, is_over/1, is_recorded/1, scenario/1, events/2, window/1]).
-export([clock/1, place/1, result/1, release/1]).

-export_type([t/0, config/0, result/0]).

%% `scenario' and `options' as of {@link starl_sim:start/2}. `started' is called with each simulation,
%% and gives a function that is called when that simulation ends. `until_us': the end of the run.
%% `recorded': the run is on record, so it can neither go back nor be changed.
-type config() :: #{
    hub := pid(),
    scenario := starl_run_scenario:t(),
    options => starl_sim:options(),
    until_us => non_neg_integer(),
    recorded => boolean(),
    started => fun((starl_sim:sim()) -> fun(() -> term())),
    _ => _
}.

%% The run at its end: not finished yet, so that its outcome can be asked for.
-type result() :: #{
    sim := starl_sim:sim(),
    scenario := starl_run_scenario:t(),
    ending := starl_sim_run:ending() | none
}.

%% A run that is made again is told to take about this long at once.
-define(PIECE_MS, 120).
-define(FIRST_US, 20000).

-record(run, {
    config :: config(),
    scenario :: starl_run_scenario:t(),
    facts :: starl_observer:facts(),
    sim :: starl_sim:sim(),
    ended :: fun(() -> term()),
    window_us :: pos_integer(),
    until_us :: non_neg_integer(),
    now = 0 :: non_neg_integer(),
    %% the events before this time have been told
    told = 0 :: non_neg_integer(),
    ending = none :: starl_sim_run:ending() | none,
    running = 0 :: non_neg_integer(),
    %% the end of this run has been judged
    judged = false :: boolean()
}).

-opaque t() :: #run{}.

%% @doc Starts the simulation, at its beginning.
-spec start(config()) -> {ok, t()} | {error, starl_sim:reason()}.
start(#{scenario := Given} = Config) ->
    case starl_sim:plan(Given, options(Config)) of
        {ok, Planned} -> planned(Planned, Config);
        {error, _} = Error -> Error
    end.

planned({#{time := Seconds} = Scenario, _, #{window_us := Window}} = Planned, Config) ->
    Facts = starl_run_plan:facts(Planned, maps:get(watch, options(Config), [])),
    ok = head(Facts, Config),
    case simulation(Scenario, 0, Config) of
        {ok, Sim, Ended} ->
            {ok, #run{
                config = Config,
                scenario = Scenario,
                facts = Facts,
                sim = Sim,
                ended = Ended,
                window_us = Window,
                until_us = maps:get(until_us, Config, round(Seconds * 1.0e6))
            }};
        {error, _} = Error ->
            Error
    end.

options(Config) -> maps:get(options, Config, #{}).

head(#{robots := Robots, machines := Machines} = Facts, #{hub := Hub}) ->
    Kinds = [
        Kind
     || [_, Shape | _] = Kind <- starl_lab_window_fault:kinds(simulation),
        Shape =/= floor orelse is_map_key(floor, Facts)
    ],
    Extra = #{kind => simulation, kinds => Kinds, machines => lists:sort(maps:keys(Machines))},
    starl_view_hub:head(Hub, {starl_view_head:rows(Facts, Extra), length(Robots)}).

simulation(Scenario, ToldUs, #{hub := Hub} = Config) ->
    Options = options(Config),
    Observe = starl_observer:all([
        maps:get(observe, Options, none), starl_view_hub:observer(Hub, ToldUs)
    ]),
    case starl_sim:start(Scenario, Options#{observe => Observe, packets => true}) of
        {ok, Sim} ->
            Started = maps:get(started, Config, fun(_) -> fun() -> ok end end),
            {ok, Sim, Started(Sim)};
        {error, _} = Error ->
            Error
    end.

%% @doc Runs to a time.
-spec run(Us :: non_neg_integer(), t()) -> t().
run(Us, #run{sim = Sim} = Run) -> moved(starl_sim:run(Sim, Us / 1.0e6), Run).

moved(#{now_us := Now, ending := Ending, running := Running}, Run) ->
    Run#run{now = Now, told = Now, ending = Ending, running = Running}.

%% @doc Runs until a robot has had this many events. It halts within a window of which nothing has
%% been reported yet.
-spec step(starl:robot_id(), Events :: pos_integer(), t()) ->
    {ok, t()} | {error, unicode:chardata(), t()}.
step(Robot, N, #run{sim = Sim, told = Told} = Run) ->
    case starl_sim:run_until_event(Sim, Robot, N) of
        {ok, #{now_us := Now, ending := Ending}} ->
            {ok, Run#run{now = max(Now, Told), ending = Ending}};
        {error, Missed} ->
            {error, starl_sim:format_error(Missed), moved(starl_sim:status(Sim), Run)}
    end.

%% @doc Ends the run where it is.
-spec halt(t()) -> t().
halt(#run{sim = Sim, ending = none} = Run) ->
    ok = starl_sim:stop(Sim),
    Run#run{ending = stopped};
halt(Run) ->
    Run.

%% @doc Tells the violations that show only at the end of a run, once.
-spec judge(t()) -> t().
judge(#run{judged = true} = Run) ->
    Run;
judge(#run{sim = Sim, config = #{hub := Hub}} = Run) ->
    Rows = [starl_view_row:violation(Violation) || Violation <- starl_sim:violations(Sim)],
    ok = lists:foreach(fun(Row) -> starl_view_hub:put(Hub, Row) end, Rows),
    Run#run{judged = true}.

%% @doc Restarts with other faults and goes to the present.
-spec changed([starl_run_fault:t()], t()) -> t().
changed(Faults, #run{scenario = Scenario} = Run) ->
    anew(Scenario#{faults := Faults}, present(Run), Run).

%% @doc Restarts and goes back to a time, or to the beginning of the window that contains it.
-spec back(Us :: non_neg_integer(), t()) -> t().
back(Us, #run{scenario = Scenario, window_us = Window} = Run) ->
    anew(Scenario, Us div Window * Window, Run#run{told = 0}).

%% What was judged at the end is no longer true.
anew(Scenario, To, #run{judged = true} = Run) ->
    anew(Scenario, To, Run#run{judged = false, told = 0});
anew(Scenario, To, #run{told = Told, facts = Before, config = Config} = Run) ->
    ok = close(Run),
    Facts = Before#{scenario := Scenario},
    ok = head(Facts, Config),
    ok = tell_faults(Scenario, Run),
    case simulation(Scenario, Told, Config) of
        {ok, Sim, Ended} ->
            Begun = Run#run{
                sim = Sim, ended = Ended, scenario = Scenario, facts = Facts, now = 0, ending = none
            },
            again(To, ?FIRST_US, Begun);
        {error, Reason} ->
            %% a checked fault in a checked scenario
            exit({starl_lab_player_run, Reason})
    end.

tell_faults(#{faults := Faults}, #run{told = 0, config = #{hub := Hub}}) ->
    ok = starl_view_hub:reset(Hub),
    told(0, [{new, Fault} || Fault <- Faults], Hub);
tell_faults(#{faults := Faults}, #run{now = Now, scenario = #{faults := Before}} = Run) ->
    #run{config = #{hub := Hub}} = Run,
    New = [{is_known(Fault, Before), Fault} || Fault <- Faults -- Before],
    told(Now, New, Hub).

is_known(Fault, Before) ->
    case lists:keymember(element(1, Fault), 1, Before) of
        true -> known;
        false -> new
    end.

told(Now, Faults, Hub) ->
    lists:foreach(fun(F) -> ok = starl_view_hub:fault(Hub, Now, F) end, Faults).

again(To, Piece, #run{now = Now, ending = none, sim = Sim, told = Told} = Run) when Now < To ->
    Begun = erlang:monotonic_time(millisecond),
    #{now_us := At} = Status = starl_sim:run(Sim, min(To, Now + Piece) / 1.0e6),
    Ms = erlang:monotonic_time(millisecond) - Begun,
    #run{config = #{hub := Hub}} = Run,
    _ = At > Told andalso starl_view_hub:flush(Hub),
    Next = moved(Status, Run),
    Fitted = max(1000, min(4 * Piece, Piece * ?PIECE_MS div max(1, Ms))),
    again(To, Fitted, Next#run{told = max(Told, At)});
again(_To, _Piece, Run) ->
    Run.

%% @doc Ends the simulation and forgets it.
-spec close(t()) -> ok.
close(#run{ended = Ended, sim = Sim}) ->
    _ = Ended(),
    starl_sim:close(Sim).

%% @doc All of a robot, as texts for the page.
-spec look(starl:robot_id(), t()) -> {ok, #{atom() => starl_json:value()}} | none.
look(Robot, #run{sim = Sim, config = #{hub := Hub}}) ->
    case starl_sim:inspect(Sim, Robot) of
        #{} = Machines ->
            {Robot, Summary} = lists:keyfind(Robot, 1, starl_sim:robots(Sim)),
            Timers = starl_sim:timers(Sim, Robot),
            Last = starl_view_hub:events(Hub, Robot),
            {ok, starl_lab_robot_text:robot(Summary, Machines, Timers, Last)};
        _ ->
            none
    end.

%% @doc The time that has been reached.
-spec now(t()) -> non_neg_integer().
now(#run{now = Now}) -> Now.

%% @doc The end of the run, if nothing ends it before.
-spec until(t()) -> non_neg_integer().
until(#run{until_us = Until}) -> Until.

%% @doc Is the run over? By itself, or since its time is.
-spec is_over(t()) -> boolean().
is_over(#run{ending = Ending, now = Now, until_us = Until}) -> Ending =/= none orelse Now >= Until.

%% @doc Is the run on record?
-spec is_recorded(t()) -> boolean().
is_recorded(#run{config = Config}) -> maps:get(recorded, Config, false).

%% @doc What has ended the run; its time has not, as long as it could go on.
-spec ending(t()) -> starl_sim_run:ending() | none.
ending(#run{ending = Ending}) -> Ending.

%% @doc The scenario, with the manual faults.
-spec scenario(t()) -> starl_run_scenario:t().
scenario(#run{scenario = Scenario}) -> Scenario.

%% @doc The run at its end.
-spec result(t()) -> result().
result(#run{sim = Sim, scenario = Scenario, ending = Ending}) ->
    #{sim => Sim, scenario => Scenario, ending => Ending}.

%% @doc The run is no longer played. Its simulation stays, and is to be closed.
-spec release(t()) -> ok.
release(#run{ended = Ended}) ->
    _ = Ended(),
    ok.

%% @doc The number of events that a robot has had.
-spec events(starl:robot_id(), t()) -> {ok, non_neg_integer()} | none.
events(Robot, #run{sim = Sim}) ->
    case lists:keyfind(Robot, 1, starl_sim:robots(Sim)) of
        {Robot, #{events := N}} -> {ok, N};
        false -> none
    end.

%% @doc The length of a window of the simulator.
-spec window(t()) -> pos_integer().
window(#run{window_us = Window}) -> Window.

%% @doc What a page's clock shows of it.
-spec clock(t()) -> #{now_us := non_neg_integer(), atom() => term()}.
clock(#run{now = Now, running = Running, until_us = Until} = Run) ->
    #{now_us => Now, running => Running, ending => shown(Run), until => Until}.

shown(#run{ending = none} = Run) ->
    case is_over(Run) of
        true -> time;
        false -> null
    end;
shown(#run{ending = Ending}) ->
    Ending.

%% A fault begins with the next window at the earliest.
present(#run{now = Now, window_us = Window}) -> (Now + Window - 1) div Window * Window.

%% @doc The possible places and times of a manual fault.
-spec place(t()) -> starl_lab_window_fault:where().
place(#run{scenario = #{faults := Faults, robots := Robots}, facts = Facts} = Run) ->
    #{machines := Machines} = Facts,
    #{
        from_ms => (present(Run) + 999) div 1000,
        until_ms => Run#run.until_us div 1000,
        robots => Robots,
        machines => maps:keys(Machines),
        faults => Faults
    }.
