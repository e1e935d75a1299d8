%% @doc Merges the outcomes of the jobs of `./starl test'. It returns the lines to print as each job
%% ends, the seconds for the next run, and the count. Whatever did not end well counts as failed.
%%
%% What failed is run once more, alone ({@link again/1}). If it passes then, it is flaky: it counts
%% as passed, and `flaky: CASE' is printed.
-module(starl_test_report).

-export([new/1, ended/3, again/1, repeated/3, flaky/1, summary/2, seconds/1, duration/2]).

-export_type([t/0]).

-record(report, {
    expected :: non_neg_integer(),
    ended = 0 :: non_neg_integer(),
    passed = 0 :: non_neg_integer(),
    failed = 0 :: non_neg_integer(),
    skipped = 0 :: non_neg_integer(),
    again = [] :: [again()],
    flaky = [] :: [unicode:chardata()],
    seconds = [] :: [{Job :: string(), Seconds :: float()}]
}).

-opaque t() :: #report{}.

%% A job that did not give an outcome: why, and the case that began last.
-type lost() :: {lost, Reason :: term(), Case :: string() | none}.

%% What is run again: the job of it, how much of it failed, and the names of what failed.
-type again() :: {starl_test_vm:job(), Failed :: pos_integer(), Names :: [unicode:chardata()]}.

%% If more has failed, it is not chance.
-define(MOST_AGAIN, 20).

%% The depth to which the reason of a lost job is printed.
-define(DEPTH, 20).

%% @doc A report of jobs that have so many modules and suites.
-spec new([starl_test_vm:job()]) -> t().
new(Jobs) -> #report{expected = lists:sum([length_of(Job) || Job <- Jobs])}.

length_of(#{modules := []}) -> 1;
length_of(#{modules := Modules}) -> length(Modules).

%% @doc Takes a job's outcome; gives what is to be printed of it.
-spec ended(starl_test_vm:job(), starl_test_vm:outcome() | lost(), t()) ->
    {unicode:chardata(), t()}.
ended(Job, #{modules := Modules, told := Told} = Outcome, Report) ->
    {Lines, Known} = lists:mapfoldl(fun tested/2, Report, Modules ++ silent(Job, Modules)),
    Failed = Known#report.failed - Report#report.failed,
    Again = [{starl_test_vm:again(Job, Outcome), Failed, names(Told)} || Failed > 0],
    {[Told, Lines], took(Job, Modules, Known#report{again = Again ++ Known#report.again})};
ended(#{name := Name} = Job, {lost, Reason, Case}, Report) ->
    Ended = Report#report.ended + length_of(Job),
    Where = [[", in ", Case] || Case =/= none],
    Line = io_lib:format("~ts ~ts: FAILED, ~ts~ts~n", [
        number(Ended, Report), Name, lost(Reason), Where
    ]),
    #report{failed = Failed, again = Again} = Report,
    {Line, Report#report{
        ended = Ended, failed = Failed + 1, again = [{alone(Job), 1, [Name]} | Again]
    }}.

alone(Job) -> starl_test_vm:again(Job, #{modules => [], told => []}).

%% `FAILED a_SUITE:b' and the reason in further lines.
names(Told) ->
    [
        string:trim(hd(string:split(string:prefix(Text, "FAILED "), "\n")))
     || Text <- [unicode:characters_to_list(One) || One <- Told], lists:prefix("FAILED ", Text)
    ].

%% @doc The jobs that are run again, alone: what failed, unless that is so much that it is not chance.
-spec again(t()) -> [starl_test_vm:job()].
again(#report{again = Again}) when length(Again) > ?MOST_AGAIN -> [];
again(#report{again = Again}) -> lists:reverse([Job || {Job, _, _} <- Again]).

%% @doc Takes the outcome of a job that was run again.
-spec repeated(starl_test_vm:job(), starl_test_vm:outcome() | lost(), t()) ->
    {unicode:chardata(), t()}.
repeated(#{name := Name}, #{modules := Modules, told := Told}, Report) ->
    Passed = lists:sum([P || #{passed := P} <- Modules]),
    case lists:sum([F || #{failed := F} <- Modules]) of
        0 when Passed > 0 -> flaky(Name, Report);
        _ -> {[Told, Name, " has failed again, alone.\n"], Report}
    end;
repeated(#{name := Name}, {lost, Reason, _Case}, Report) ->
    {[Name, " has failed again, alone: ", lost(Reason), "\n"], Report}.

flaky(Name, #report{again = Again, passed = Passed, failed = Failed, flaky = Flaky} = Report) ->
    [{_, N, Names}] = [One || {#{name := Job}, _, _} = One <- Again, Job =:= Name],
    {
        [["flaky: ", One, ", it has passed alone\n"] || One <- Names],
        Report#report{passed = Passed + N, failed = Failed - N, flaky = Flaky ++ Names}
    }.

%% @doc The names of what failed, and passed alone.
-spec flaky(t()) -> [unicode:chardata()].
flaky(#report{flaky = Flaky}) -> Flaky.

%% A suite or a module in which nothing ran, although its job was to run it.
silent(#{kind := eunit, modules := Wanted}, Modules) ->
    Seen = [Name || #{name := Name} <- Modules],
    [none_ran(Name) || Module <- Wanted, Name <- [atom_to_list(Module)], not has(Name, Seen)];
silent(_Job, _Modules) ->
    [].

%% The tests of a module are in it or in a module of their own.
has(Name, Seen) -> lists:member(Name, Seen) orelse lists:member(Name ++ "_tests", Seen).

none_ran(Name) -> #{name => Name, passed => 0, failed => 0, ms => 0}.

tested(#{name := Name, passed := 0, failed := 0} = Tested, Report) when Name =/= "xref" ->
    case maps:get(skipped, Tested, 0) of
        0 -> line(Tested#{failed := 1}, ", no test ran", Report);
        _ -> line(Tested, "", Report)
    end;
tested(Tested, Report) ->
    line(Tested, "", Report).

line(#{name := Name, passed := Good, failed := Bad, ms := Ms} = Tested, Why, Report) ->
    #report{ended = Before, passed = Passed, failed = Failed} = Report,
    Skipped = [io_lib:format(", ~b skipped", [N]) || {skipped, N} <- maps:to_list(Tested), N > 0],
    Failures = [io_lib:format(", ~b FAILED", [Bad]) || Bad > 0],
    Line = io_lib:format("~ts ~ts: ~b passed~ts~ts~ts, ~.1f s~n", [
        number(Before + 1, Report), Name, Good, Failures, Why, Skipped, Ms / 1000
    ]),
    {Line, Report#report{
        ended = Before + 1,
        passed = Passed + Good,
        failed = Failed + Bad,
        skipped = Report#report.skipped + maps:get(skipped, Tested, 0)
    }}.

number(Ended, #report{expected = Expected}) ->
    io_lib:format("~-9ts", [io_lib:format("[~b/~b]", [Ended, max(Ended, Expected)])]).

took(#{name := Name}, Modules, #report{seconds = Known} = Report) ->
    Seconds = lists:sum([Ms || #{ms := Ms} <- Modules]) / 1000,
    Report#report{seconds = [{Name, Seconds} | Known]}.

lost(timeout) -> "it hung and was killed";
lost({timeout, _}) -> lost(timeout);
lost(Reason) -> ["its VM has ended: ", io_lib:format("~0tP", [Reason, ?DEPTH])].

%% @doc How long each job took that gave an outcome.
-spec seconds(t()) -> [{Job :: string(), Seconds :: float()}].
seconds(#report{seconds = Seconds}) -> Seconds.

%% @doc The line on how long it took, s: the tests, and the build before them.
-spec duration(Tests :: non_neg_integer(), Built :: non_neg_integer()) -> unicode:chardata().
duration(Tests, Built) ->
    Long = fun(S) -> io_lib:format("~b min ~b s", [S div 60, S rem 60]) end,
    [
        "The tests took ",
        Long(Tests),
        [[", after ", Long(Built), " of building"] || Built > 0],
        ".\n"
    ].

%% @doc The last lines, and whether all is well: all has run, something has, and nothing failed.
-spec summary(done | interrupted, t()) -> {Lines :: unicode:chardata(), Sound :: boolean()}.
summary(How, #report{expected = Expected, ended = Ended} = Report) ->
    #report{passed = Passed, failed = Failed, skipped = Skipped} = Report,
    Complete = How =:= done andalso Ended >= Expected,
    Lines = [
        [
            io_lib:format("interrupted: ~b of ~b modules have run~n", [Ended, Expected])
         || How =:= interrupted
        ],
        [
            io_lib:format("FAILED: only ~b of ~b modules have run~n", [Ended, Expected])
         || How =:= done, Ended < Expected
        ],
        [["flaky: ", Name, "\n"] || Name <- flaky(Report)],
        [io_lib:format("~b skipped, see above~n", [Skipped]) || Skipped > 0],
        ["starl: no test ran\n" || Passed + Failed =:= 0],
        ["Not everything is sound, see above.\n" || not Complete orelse Failed > 0]
    ],
    Count = io_lib:format("~b passed, ~b failed~n", [Passed, Failed]),
    {[Lines, Count], Complete andalso Failed =:= 0 andalso Passed > 0}.
