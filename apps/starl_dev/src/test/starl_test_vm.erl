%% @doc One job of `./starl test', run in a VM of its own: modules of EUnit, a suite of Common Test,
%% or xref.
%%
%% What a job prints goes to `NAME.log' in the directory of the logs, the error reports of crashes
%% that tests provoke to `NAME.errors', and Common Test's pages to `NAME/'. `NAME.case' names the
%% case that began last, to show where a VM died or hung.
-module(starl_test_vm).

-export([run/1, again/2, case_file/1]).

-export_type([job/0, outcome/0, tested/0]).

%% `logs' is an absolute directory; `root' is that of the checkout.
%% `cases': of a suite only these, with their group.
-type job() :: #{
    name := string(),
    cases => [Case :: atom() | {Case :: atom(), Group :: atom()}, ...],
    kind := eunit | suite | xref,
    modules := [module()],
    root := file:filename(),
    logs := file:filename()
}.

%% The modules that ran, in their order, and what is to be printed about failed and skipped tests; of a suite the
%% cases that failed, if nothing else did.
-type outcome() :: #{
    modules := [tested()],
    told := [unicode:chardata()],
    failed => [Case :: atom() | {Case :: atom(), Group :: atom()}]
}.

-type tested() :: #{
    name := string(),
    passed := non_neg_integer(),
    failed := non_neg_integer(),
    skipped => non_neg_integer(),
    ms := non_neg_integer()
}.

%% The depth to which the reason of a failed case is printed.
-define(DEPTH, 60).

%% @doc Runs a job. It may also crash, which is a failure of the job.
-spec run(job()) -> outcome().
run(#{name := Name, logs := Logs} = Job) ->
    ok = filelib:ensure_dir(filename:join(Logs, Name)),
    {ok, Log} = file:open(filename:join(Logs, Name ++ ".log"), [write, {encoding, utf8}]),
    true = group_leader(Log, self()),
    ok = report_to(filename:join(Logs, Name ++ ".errors")),
    %% The command line of a test is not the one that has started the tests.
    _ = [os:unsetenv(Variable) || Variable <- told_by_the_script()],
    Begin = erlang:monotonic_time(millisecond),
    ran(Job, Begin).

told_by_the_script() ->
    ["STARL_COMMAND", "STARL_ROOT", "STARL_VERSION", "STARL_TTY", "STARL_COLUMNS"].

report_to(File) ->
    ok = logger:set_primary_config(level, notice),
    _ = logger:remove_handler(default),
    logger:add_handler(default, logger_std_h, #{config => #{file => File}}).

%% @doc The job of what has failed in a job: cases of a suite, or modules of EUnit. Its logs lie beside.
-spec again(job(), outcome()) -> job().
again(#{logs := Logs} = Job, Outcome) ->
    failed_of(Job#{logs := filename:join(Logs, "again")}, Outcome).

failed_of(#{kind := suite} = Job, #{failed := [_ | _] = Cases}) ->
    Job#{cases => lists:usort(Cases)};
failed_of(#{kind := eunit, modules := All} = Job, #{modules := Tested}) ->
    Sound = [Name || #{name := Name, failed := 0, passed := Passed} <- Tested, Passed > 0],
    case [M || M <- All, not lists:member(atom_to_list(M), Sound)] of
        [] -> Job;
        Failed -> Job#{modules := Failed}
    end;
failed_of(Job, _Outcome) ->
    Job.

%% @doc The file that names the case that began last.
-spec case_file(job()) -> file:filename_all().
case_file(#{name := Name, logs := Logs}) -> filename:join(Logs, Name ++ ".case").

ran(#{kind := eunit, modules := Modules} = Job, _Begin) ->
    ok = file:set_cwd(maps:get(root, Job)),
    _ = eunit:test(Modules, [no_tty, {report, {starl_dev_eunit, [{to, self()}]}}]),
    receive
        {starl_dev_eunit, Outcome} -> Outcome
    end;
ran(#{kind := suite, modules := [Suite], name := Name} = Job, Begin) ->
    Pages = filename:join(maps:get(logs, Job), Name),
    ok = filelib:ensure_dir(filename:join(Pages, "any")),
    Answer = ct:run_test(
        cases_of(Job) ++
            [
                {dir, filename:dirname(code:which(Suite))},
                {suite, Suite},
                {logdir, Pages},
                {auto_compile, false},
                %% they are for cases that hang, not for a busy computer
                {multiply_timetraps, 3},
                {ct_hooks, [
                    {starl_test_hook, #{to => pid_to_list(self()), file => case_file(Job)}}
                ]}
            ]
    ),
    suite(Name, Answer, cases([]), erlang:monotonic_time(millisecond) - Begin);
ran(#{kind := xref, name := Name, root := Root}, Begin) ->
    {Status, Text} = rebar(["xref"], Root),
    Ms = erlang:monotonic_time(millisecond) - Begin,
    Found = ["FAILED xref found forbidden or undefined calls\n", Text],
    #{
        modules => [#{name => Name, passed => 0, failed => min(1, Status), ms => Ms}],
        told => [Found || Status =/= 0]
    }.

%% Groups of groups are found by their names.
cases_of(#{cases := Cases}) ->
    Groups = lists:usort([Group || {_, Group} <- Cases]),
    Names = [
        case One of
            {Case, _} -> Case;
            Case -> Case
        end
     || One <- Cases
    ],
    [{group, Groups} || Groups =/= []] ++ [{testcase, lists:usort(Names)}];
cases_of(_Job) ->
    [].

%% What the hook has told, in its order.
cases(Told) ->
    receive
        {starl_test_hook, Kind, Suite, Case, Reason} -> cases([{Kind, Suite, Case, Reason} | Told])
    after 0 -> lists:reverse(Told)
    end.

named(Suite, Case) -> lists:concat([Suite, ":", name(Case)]).

%% Only if nothing but cases has failed are these run again by themselves.
failed_cases(Told) ->
    Failed = [{Kind, Case} || {Kind, _, Case, _} <- Told, Kind =/= skipped],
    Alone = [Case || {failed, Case} <- Failed, is_case(Case)],
    [Case || length(Alone) =:= length(Failed), Case <- Alone].

is_case(init_per_suite) -> false;
is_case(end_per_suite) -> false;
is_case({init_per_group, _}) -> false;
is_case({end_per_group, _}) -> false;
is_case({_, Group}) -> is_atom(Group);
is_case(_) -> true.

name({Function, Group}) -> lists:concat([Function, "(", Group, ")"]);
name(Case) -> atom_to_list(Case).

%% A case that was skipped because its preparation failed has failed, and so has a preparation or an
%% end on which no case depends.
suite(Name, {Passed, Failed, {Skipped, Unprepared}}, Told, Ms) ->
    Seen = length([failed || {failed, _, _, _} <- Told]),
    #{
        modules => [
            #{
                name => Name,
                passed => Passed,
                failed => max(Failed + Unprepared, Seen),
                skipped => Skipped,
                ms => Ms
            }
        ],
        told => [told(Kind, named(In, Case), Reason) || {Kind, In, Case, Reason} <- Told],
        failed => failed_cases(Told)
    };
suite(Name, Answer, Told, Ms) ->
    #{
        modules => [#{name => Name, passed => 0, failed => 1, ms => Ms}],
        told =>
            [told(Kind, named(In, Case), Reason) || {Kind, In, Case, Reason} <- Told] ++
            [told(failed, Name, Answer)]
    }.

told(failed, Case, Reason) ->
    io_lib:format("FAILED ~ts~n~ts~n", [Case, text(Reason)]);
told(unprepared, Case, Reason) ->
    io_lib:format("FAILED ~ts, since its preparation failed:~n~ts~n", [Case, text(Reason)]);
told(skipped, Case, Reason) ->
    io_lib:format("skipped ~ts: ~ts~n", [Case, text(Reason)]).

text({skip, Reason}) ->
    text(Reason);
text(Reason) ->
    case io_lib:printable_unicode_list(Reason) of
        true -> Reason;
        false -> io_lib:format("~tP", [Reason, ?DEPTH])
    end.

rebar(Args, Root) ->
    Port = open_port({spawn_executable, os:find_executable("rebar3")}, [
        {args, Args}, {cd, Root}, exit_status, stderr_to_stdout, binary
    ]),
    rest(Port, []).

rest(Port, Text) ->
    receive
        {Port, {data, More}} -> rest(Port, [Text, More]);
        {Port, {exit_status, Status}} -> {Status, without_colours(Text)}
    end.

without_colours(Text) -> re:replace(Text, "\e\\[[0-9;]*m", "", [global, unicode]).
