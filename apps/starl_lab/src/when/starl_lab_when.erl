%% @doc The command `./starl when': finds when a violation became inevitable. It continues the run
%% from earlier moments with other random draws, and names the event at which the fraction of
%% violating continuations rises most.
-module(starl_lab_when).

-behaviour(starl_cli_command).

-export([command/0]).

-type setup() :: #{
    target := starl_cli_target:t(),
    scenario := starl_run_scenario:t(),
    out := starl_cli_out:t(),
    digest := binary() | any,
    values := map()
}.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "when",
        synopsis => "tell when a violation became inevitable, and by which event",
        argument => {required, "RUN", {example, "out/counter-7-shrunk.term"}},
        subject => fun starl_lab_shrink:subject/2,
        about => [
            "Takes a run that violates a contract (RUN as for ./starl shrink: a shrunk scenario, the "
            "directory of a run, or an application with the flags of ./starl run). The run is repeated "
            "up to earlier moments and goes on with other random draws: loss and delay of packets, "
            "errors of drives and positions, and when and where the faults strike that have not begun. "
            "The share of these futures that break the same contract is a curve over moments. Where it "
            "rises most, halving finds the event.",
            "Written are when.txt, curve.csv and a plot. The same --salt gives the same curve. Ctrl-C "
            "tells what is known so far."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "an event was found"},
            {1, "internal error"},
            {2, "bad usage or input, also where the run violates nothing or is not reproducible"},
            {4, "the share rises nowhere: no draw decides"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

flags(none) -> [{"Flags", own_flags()}];
flags(#{app := App}) -> [{"Flags", own_flags()}, {hidden, starl_run_scenario:options(App)}].

own_flags() ->
    [
        {futures, {integer, 2, 10000}, 20,
            "futures of each moment; a step that is not high gets five times as many"},
        {moments, {integer, 2, 1000}, 16, "moments of the grid, before the halving"},
        {salt, {integer, 0, 1 bsl 32}, 1, "the number from which the draws of the futures follow"},
        {beyond, {optional, {number, 0.001, 1.0e6}}, none,
            "a future ends this long after the violation of the run, s; none: a quarter of its "
            "time, at least 0.1 s"},
        {loss_ahead, {optional, {number, 0, 1}}, none,
            "fraction of the packets that futures lose; none: as many as the run"},
        {out, string, none, "directory for the results; without it a new one under out/"},
        {quiet, switch, false, "no progress line"},
        starl_lab_jobs:at_once()
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := #{name := Name} = Target, values := Values} = Call) ->
    {Unsound, Scenario} = starl_cli_target:scenario(
        Target, starl_cli_target:given(Call, own_flags())
    ),
    {Unwritable, Out} = starl_cli_out:directory(maps:get(out, Values), Name ++ "-when"),
    case Unsound ++ Unwritable of
        [] ->
            ok = starl_cli_log:install(),
            repeated(#{
                target => Target,
                scenario => Scenario,
                out => Out,
                digest => starl_lab_shrink:digest(Call, own_flags()),
                values => Values
            });
        Problems ->
            {error, Problems}
    end.

-spec repeated(setup()) -> starl_cli_command:answer().
repeated(#{scenario := Scenario, digest := Known} = Setup) ->
    case starl_sim_future:repeat(Scenario) of
        {ok, #{digest := Digest}} when Known =/= any, Known =/= Digest ->
            {error, [starl_sim_future:format_error({not_reproducible, [Known, Digest]})]};
        {ok, Run} ->
            search(Run, Setup);
        {error, {trial, {failed, _}} = Reason} ->
            failed(Reason);
        {error, Reason} ->
            {error, [starl_sim_future:format_error(Reason)]}
    end.

search(#{violation := Violation} = Run, #{values := Values} = Setup) ->
    starl_cli_terminal:out([starl_violation:format(Violation), "\n"]),
    Settings = settings(starl_sim_future:settings(Run), Run, Values),
    Self = self(),
    Interrupt = make_ref(),
    starl_cli_signal:on_interrupt(fun() -> Self ! Interrupt end),
    Search = (maps:with([moments, futures, salt, jobs], Values))#{
        interrupt => Interrupt, progress => starl_cli_progress:new(how(Values))
    },
    try starl_lab_futures:step(Run, Settings, Search) of
        Result -> told(Result, Run, Settings, Setup)
    catch
        throw:{future, Reason} -> failed(Reason)
    after
        starl_cli_signal:on_interrupt(quit)
    end.

how(#{quiet := true}) -> quiet;
how(#{quiet := false}) -> auto.

settings(Settings, #{violation := #{at_us := AtUs}}, #{beyond := Beyond, loss_ahead := Loss}) ->
    Given =
        [{until_s, AtUs / 1.0e6 + Beyond} || is_number(Beyond)] ++
            [{loss, Loss} || is_number(Loss)],
    maps:merge(Settings, maps:from_list(Given)).

failed(Reason) ->
    starl_cli_progress:erase(),
    starl_cli_terminal:complain(["when: ", starl_sim_future:format_error(Reason)]),
    1.

%% -- the answer -----------------------------------------------------------------------------

told(Result, Run, Settings, #{target := Target, scenario := Scenario, out := Out}) ->
    starl_cli_progress:erase(),
    Report = starl_lab_when_report:new(Result, Run, Settings),
    Look = look(Result, Run, Target, Scenario),
    Text = [starl_lab_when_report:text(Report, starl_cli_terminal:columns()), Look],
    starl_cli_terminal:out(Text),
    Files = [
        {"when.txt", Text},
        {"curve.csv", starl_lab_when_report:csv(Report)}
    ],
    Written = starl_cli_out:write(Out, fun(New) ->
        starl_lab_when_report:plotted(starl_lab_when_report:plot(Report), Files, New)
    end),
    written(Written, status(Result)).

%% The command that shows the robot just after the event, or all when the fault begins.
look(Result, #{moments := Moments} = Run, Target, Scenario) ->
    case starl_lab_when_report:named(Result, Run) of
        {_, Moment} ->
            Replay = starl_cli_target:command_line("replay", Target, Scenario),
            ["look: ", Replay, until(starl_sim_moments:entry(Moment, Moments)), "\n"];
        none ->
            ""
    end.

until({AtUs, fault, _}) -> io_lib:format(" --until ~.6f", [AtUs / 1.0e6]);
until({_, Robot, #{n := N}}) -> io_lib:format(" --until ~b:~b --inspect ~b", [Robot, N, Robot]).

status(#{complete := false}) -> 130;
status(#{step := none}) -> 4;
status(#{step := _}) -> 0.

written({ok, Dir}, Status) ->
    starl_cli_terminal:out(["result: ", starl_cli_out:shown(Dir), "\n"]),
    Status;
written({error, Why}, _Status) ->
    starl_cli_terminal:complain(["the results could not be written: ", Why]),
    1.
