%% @doc The command `./starl when'. It answers what a run could have come to with other random draws.
%% It repeats a run up to earlier points and continues it from there many times. It finds the event by
%% which a violation became inevitable; with `--at' it prints what the run comes to from a time on.
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

%% The points of the curve, unless a number is given.
-define(POINTS, 16).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "when",
        synopsis => "find when a violation became inevitable, or continue a run from a time",
        argument => {required, "RUN", {example, "out/counter-7-shrunk.term"}},
        subject => fun subject/2,
        about => [
            "Repeats a run (RUN as for ./starl shrink: a shrunk scenario, the directory of a run, or an "
            "application with the flags of ./starl run) up to earlier points, and continues it from "
            "there with other random draws: loss and delay of packets, errors of drives and positions, "
            "and when and where the faults strike that have not begun. The fraction of these "
            "continuations that break the contract is a curve over the points. Where it rises most, "
            "halving finds the event.",
            "Without --at the run violates a contract, and the answer is the event by which the "
            "violation became inevitable. With --at 12.5 the run may be sound, and the answer is the "
            "fraction of the continuations from that time on that break a contract; with --points 8 "
            "also the event by which it became likely.",
            "Written are when.txt, curve.csv and a plot. The same --branch-seed gives the same curve. "
            "Ctrl-C prints what is known so far."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "an event was found; with --at: no continuation breaks a contract"},
            {1, "internal error"},
            {2, "bad usage or input, also where the run violates nothing or is not reproducible"},
            {3, "with --at: some continuations break a contract"},
            {4, "the fraction rises nowhere: no draw decides"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

flags(none) -> [{"Flags", own_flags()}];
flags(#{app := App}) -> [{"Flags", own_flags()}, {hidden, starl_run_scenario:options(App)}].

own_flags() ->
    [
        {at, {optional, {number, 0, 1.0e7}}, none,
            "continue the run from this time, s; none: find when its violation became inevitable"},
        {since, {number, 0, 1.0e7}, 0, "with --at: the points lie after this time, s"},
        {draws, {integer, 1, 10000}, 20,
            "continuations of each point; a step that is not high gets five times as many"},
        {points, {optional, {integer, 1, 1000}}, none,
            "points of the curve, before the halving; none: 16, with --at 1"},
        {branch_seed, {integer, 0, 1 bsl 32}, 1,
            "the number from which the draws of the continuations follow"},
        {contract, {optional, string}, none,
            "with --at: only this contract counts as broken, as mutex; none: any"},
        {beyond, {optional, {number, 0.001, 1.0e6}}, none,
            "a continuation ends this long after the violation of the run, or after --at, s; none: "
            "a quarter of that time after the violation, at least 0.1 s, or after the end of the run, at "
            "least 1 s"},
        {loss_ahead, {optional, {number, 0, 1}}, none,
            "fraction of the packets that continuations lose; none: as many as the run"},
        {out, string, none, "directory for the results; without it a new one under out/"},
        {quiet, switch, false, "no progress line"},
        starl_lab_jobs:at_once()
    ].

%% The file of a recording stands for the run that left it.
-spec subject(string(), [string()]) ->
    {ok, starl_cli_target:t(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    Dir = filename:dirname(Word),
    case {filename:extension(Word), filelib:is_regular(filename:join(Dir, "run.term"))} of
        {".mcap", true} ->
            starl_lab_shrink:subject(Dir, Args);
        {".mcap", false} ->
            {error, [[Word, ": the run is repeated from its run.term, which is not there"]]};
        {_, _} ->
            starl_lab_shrink:subject(Word, Args)
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := #{name := Name} = Target, values := Values} = Call) ->
    {Unsound, Scenario} = starl_cli_target:scenario(
        Target, starl_cli_target:given(Call, own_flags())
    ),
    {Unwritable, Out} = starl_cli_out:directory(maps:get(out, Values), Name ++ "-when"),
    case misused(Target, Values) ++ Unsound ++ Unwritable of
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

misused(#{record := #{digest := ""}, file := File}, _Values) ->
    [[File, ": the run passed in real time, or lost a node, so it cannot be continued"]];
misused(#{record := #{ending := stopped}, file := File}, _Values) ->
    [[File, ": the run was interrupted, so its scenario does not give it again"]];
misused(_Target, #{at := none, contract := Contract}) when Contract =/= none ->
    ["--contract: only with --at"];
misused(_Target, #{at := none, since := Since}) when Since > 0 ->
    ["--since: only with --at"];
misused(_Target, #{at := At, since := Since}) when is_number(At), Since > 0, Since >= At ->
    [io_lib:format("--since ~w: the points lie after it, up to --at ~w", [Since, At])];
misused(_Target, _Values) ->
    [].

-spec repeated(setup()) -> starl_cli_command:answer().
repeated(#{scenario := Scenario, digest := Known, values := Values} = Setup) ->
    case starl_sim_continuation:repeat(Scenario) of
        {ok, #{digest := Digest}} when Known =/= any, Known =/= Digest ->
            {error, [starl_sim_continuation:format_error({not_reproducible, [Known, Digest]})]};
        {ok, Run} ->
            Question = question(Values),
            case starl_sim_continuation:settings(Run, Question) of
                {ok, Settings} -> search(Run, Question, chosen(Settings, Run, Values), Setup);
                {error, Reason} -> {error, [starl_sim_continuation:format_error(Reason)]}
            end;
        {error, {trial, {failed, _}} = Reason} ->
            failed(Reason);
        {error, Reason} ->
            {error, [starl_sim_continuation:format_error(Reason)]}
    end.

question(#{at := none}) -> violation;
question(#{at := Seconds}) -> {at, us(Seconds)}.

us(Seconds) -> round(1.0e6 * Seconds).

%% The settings, with those that flags name.
chosen(Settings, Run, #{contract := Contract, beyond := Beyond, loss_ahead := Loss} = Values) ->
    Given =
        [{contract, Contract} || Contract =/= none] ++
            [{until_s, asked_us(question(Values), Run) / 1.0e6 + Beyond} || is_number(Beyond)] ++
            [{loss, Loss} || is_number(Loss)],
    maps:merge(Settings, maps:from_list(Given)).

%% The time that the question is about.
asked_us(violation, #{violation := #{at_us := AtUs}}) -> AtUs;
asked_us({at, AtUs}, _Run) -> AtUs.

search(Run, Question, Settings, #{values := Values} = Setup) ->
    _ = [
        starl_cli_terminal:out([starl_violation:format(maps:get(violation, Run)), "\n"])
     || Question =:= violation
    ],
    Self = self(),
    Interrupt = make_ref(),
    starl_cli_signal:on_interrupt(fun() -> Self ! Interrupt end),
    Search = (maps:with([draws, branch_seed, jobs], Values))#{
        grid => grid(Question, Run, Values),
        interrupt => Interrupt,
        progress => starl_cli_progress:new(how(Values))
    },
    try starl_lab_continuations:search(Run, Settings, Search) of
        Result -> answer(starl_lab_when_report:new(Result, Run, Question, Settings), Setup)
    catch
        throw:{continuation, Reason} -> failed(Reason)
    after
        starl_cli_signal:on_interrupt(quit)
    end.

grid(violation, #{timeline := Timeline} = Run, #{points := Points}) ->
    N = number(Points, ?POINTS),
    Last = starl_sim_timeline:at(asked_us(violation, Run), Timeline),
    starl_sim_inevitable:grid(N, Last, Timeline);
grid({at, Last}, #{timeline := Timeline}, #{points := Points, since := Since}) ->
    N = number(Points, 1),
    First = us(Since),
    lists:usort([
        starl_sim_timeline:at(First + (Last - First) * I div N, Timeline)
     || I <- lists:seq(1, N)
    ]).

number(none, Default) -> Default;
number(N, _Default) -> N.

how(#{quiet := true}) -> quiet;
how(#{quiet := false}) -> auto.

failed(Reason) ->
    starl_cli_progress:erase(),
    starl_cli_terminal:complain(["when: ", starl_sim_continuation:format_error(Reason)]),
    1.

%% -- the answer -----------------------------------------------------------------------------

answer(Report, #{out := Out} = Setup) ->
    starl_cli_progress:erase(),
    Text = [
        starl_lab_when_report:text(Report, starl_cli_terminal:columns()), look(Report, Setup)
    ],
    starl_cli_terminal:out(Text),
    Files = [{"when.txt", Text}, {"curve.csv", starl_lab_when_report:csv(Report)}],
    Written = starl_cli_out:write(Out, fun(New) ->
        case starl_lab_when_report:plot(Report) of
            none -> starl_lab_files:put_all(New, Files);
            {ok, Plot} -> starl_lab_sweep_plot:put(New, Files, Plot)
        end
    end),
    case Written of
        {ok, Dir} ->
            starl_cli_terminal:out(["result: ", starl_cli_out:shown(Dir), "\n"]),
            starl_lab_when_report:status(Report);
        {error, Why} ->
            starl_cli_terminal:complain(["the results could not be written: ", Why]),
            1
    end.

%% The command that shows the robot just after the event, or all when the fault begins.
look(Report, #{target := Target, scenario := Scenario}) ->
    case starl_lab_when_report:event(Report) of
        {Entry, _Facts} ->
            Replay = starl_cli_target:command_line("replay", Target, Scenario),
            ["look: ", Replay, until(Entry), "\n"];
        none ->
            ""
    end.

until({AtUs, fault, _}) -> io_lib:format(" --until ~.6f", [AtUs / 1.0e6]);
until({_, Robot, #{n := N}}) -> io_lib:format(" --until ~b:~b --inspect ~b", [Robot, N, Robot]).
