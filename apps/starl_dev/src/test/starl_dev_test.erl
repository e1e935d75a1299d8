%% @doc `./starl test': runs xref, EUnit and Common Test in several VMs at once.
%%
%% The script `./starl' has compiled the tests and starts this command with their code; what this
%% command does without them is to explain itself.
-module(starl_dev_test).
-behaviour(starl_cli_command).

-export([command/0]).

%% A job that takes longer hangs, s.
-define(LONGEST_S, 1800).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "test",
        synopsis => "run every test, or some",
        argument => {optional, "MODULE...", {example, "starl_sap_SUITE"}},
        subject => fun subject/2,
        about => [
            "Runs xref, EUnit and Common Test and ends with the line 'N passed, N failed'. With names, "
            "only those modules run: NAME_SUITE is a Common Test suite, any other is a module for EUnit.",
            "In the directory of a project of your own, as ./starl new makes it, this runs its tests: those of EUnit, "
            "or of mix.",
            "Each suite runs in a VM of its own, with its log, pages and error reports in "
            "_build/starl/tests; suites that wait run beside those that compute (test/test_times.term). "
            "A suite that hangs or whose VM ends has failed. Ctrl-C ends all, with the results so far.",
            "What failed is run once more at the end, alone, with its log in _build/starl/tests/again. If it "
            "passes then, a line says `flaky: CASE`, and it counts as passed; flaky.txt beside the logs keeps "
            "the line. A case that was flaky twice is a defect to be mended."
        ],
        flags => [
            {"Flags", [
                {quick, switch, false,
                    "only xref and the quick tests of EUnit, in less than a minute"},
                {cases, {optional, {integer, 1, 1000000000}}, none,
                    "the number of cases of each property; without it the test's own"}
            ]}
        ],
        statuses => [
            {0, "all passed"},
            {1, "some failed, or a call goes upwards"},
            {130, "interrupted, with the results so far"}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) -> {ok, [string()], [string()]}.
subject(Word, Args) ->
    {Names, Flags} = lists:splitwith(fun(Arg) -> hd(Arg ++ "-") =/= $- end, Args),
    {ok, [Word | Names], Flags}.

-spec run(starl_cli_command:call()) -> starl_cli_terminal:status() | {error, [string(), ...]}.
run(#{subject := Names, values := #{quick := Quick}}) ->
    case os:getenv("STARL_TESTS") of
        false -> {error, ["only the script ./starl runs this"]};
        Logs -> tested(wanted(Names, Quick), starl_cli_target:root(), Logs)
    end.

wanted(none, false) -> all;
wanted(none, true) -> quick;
wanted(Names, Quick) -> {named, [module(Name) || Name <- Names], [quick || Quick]}.

module(Name) -> list_to_atom(filename:basename(Name, ".erl")).

tested(Wanted, Root, Logs) ->
    Begin = erlang:monotonic_time(second),
    Cores = erlang:system_info(logical_processors_available),
    Times = filename:join(Logs, "test_times.term"),
    Own = rows(filename:join([Root, "test", "test_times.term"])),
    Known = starl_test_schedule:known(Own, rows(Times)),
    Code = ["_build/test/lib/*/test", "_build/test/extras/test"],
    ok = code:add_pathsa([Dir || C <- Code, Dir <- filelib:wildcard(filename:join(Root, C))]),
    Long = [Name || {Name, _, _} <- Own],
    Found = starl_test_plan:jobs(Wanted, starl_test_plan:sources(Root), Long),
    Jobs = [Job#{root => Root, logs => Logs} || Job <- starl_test_schedule:order(Found, Known)],
    lists:foreach(fun clear/1, Jobs),
    {First, All} = together(Jobs, Known, Cores),
    {How, Report} = again(First, All),
    ok = note_flaky(starl_test_report:flaky(Report), filename:join(Logs, "flaky.txt")),
    Seconds = erlang:monotonic_time(second) - Begin,
    {Summary, Sound} = starl_test_report:summary(How, Report),
    starl_cli_terminal:out([
        starl_test_report:duration(Seconds, built_s()), Summary
    ]),
    ok = keep(Wanted, How, Seconds, {Times, Known}, starl_test_report:seconds(Report)),
    status(How, Sound).

%% The script has built the tests before it started this command.
built_s() -> list_to_integer(os:getenv("STARL_TESTS_BUILT", "0")).

status(interrupted, _Sound) -> 130;
status(done, true) -> 0;
status(done, false) -> 1.

rows(File) ->
    case file:consult(File) of
        {ok, Rows} -> Rows;
        {error, _} -> []
    end.

%% A run of some tests deals those that share a VM otherwise.
keep(all, done, Seconds, {File, Known}, Took) ->
    Rows = starl_test_schedule:kept(Took, Known),
    ok = file:write_file(File, [io_lib:format("~0tp.~n", [Row]) || Row <- Rows]),
    file:write_file(filename:join(filename:dirname(File), "seconds"), integer_to_list(Seconds));
keep(_Wanted, _How, _Seconds, _Times, _Took) ->
    ok.

%% What an earlier run has left would be taken for this one's.
clear(#{name := Name, logs := Logs} = Job) ->
    _ = file:delete(starl_test_vm:case_file(Job)),
    _ = file:del_dir_r(filename:join(Logs, Name)),
    ok.

together(Jobs, Known, Cores) ->
    starl_lab_jobs:run(
        Jobs,
        #{
            work => {starl_test_vm, run},
            at_once => starl_test_schedule:at_most(Cores),
            what => "jobs",
            each => fun ended/3,
            schedulers => erlang:system_info(schedulers_online),
            limit_ms => fun(_Job) -> 1000 * ?LONGEST_S end,
            output => starl_mutate_worker:sink(),
            renew => fun(_Outcome) -> true end,
            next => fun(Running, Later) ->
                starl_test_schedule:next(Running, Later, Known, Cores)
            end
        },
        starl_test_report:new(Jobs)
    ).

%% What failed, one after the other: what fails by chance fails beside other work.
again(interrupted, Report) ->
    {interrupted, Report};
again(done, Report) ->
    case starl_test_report:again(Report) of
        [] ->
            {done, Report};
        Jobs ->
            starl_cli_terminal:out("What failed is run once more, alone.\n"),
            lists:foreach(fun clear/1, Jobs),
            starl_lab_jobs:run(
                Jobs,
                #{
                    work => {starl_test_vm, run},
                    at_once => 1,
                    what => "jobs",
                    each => fun repeated/3,
                    schedulers => erlang:system_info(schedulers_online),
                    limit_ms => fun(_Job) -> 1000 * ?LONGEST_S end,
                    output => starl_mutate_worker:sink(),
                    renew => fun(_Outcome) -> true end
                },
                Report
            )
    end.

note_flaky([], _File) ->
    ok;
note_flaky(Names, File) ->
    Earlier =
        case file:read_file(File) of
            {ok, Text} -> Text;
            {error, _} -> <<>>
        end,
    Date = calendar:system_time_to_rfc3339(erlang:system_time(second)),
    _ = [
        starl_cli_terminal:out("~ts was flaky before, too: mend it\n", [Name])
     || Name <- Names,
        binary:match(Earlier, unicode:characters_to_binary([" ", Name, "\n"])) =/= nomatch
    ],
    file:write_file(
        File, unicode:characters_to_binary([[Date, " ", Name, "\n"] || Name <- Names]), [append]
    ).

repeated(Job, Answer, Report) ->
    {Text, Next} = starl_test_report:repeated(Job, outcome(Answer, Job), Report),
    starl_cli_progress:erase(),
    starl_cli_terminal:out(Text),
    Next.

ended(Job, Answer, Report) ->
    {Text, Next} = starl_test_report:ended(Job, outcome(Answer, Job), Report),
    starl_cli_progress:erase(),
    starl_cli_terminal:out(Text),
    Next.

outcome({ok, Outcome}, _Job) ->
    Outcome;
outcome({crashed, Reason}, Job) ->
    case file:read_file(starl_test_vm:case_file(Job)) of
        {ok, Case} -> {lost, Reason, Case};
        {error, _} -> {lost, Reason, none}
    end.
