%% @doc `./starl mutate BLOCK': mutation testing. It changes the code of a block, one small change
%% at a time, and reports which changes the block's tests do not notice.
-module(starl_dev_mutate).

-behaviour(starl_cli_command).

-export([command/0]).

-type values() :: #{atom() => term()}.

-define(WIDTH, 80).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "mutate",
        synopsis => "change a block's code in small places; do its tests notice?",
        argument => fun argument/0,
        about => fun about/1,
        flags => [
            {"Flags", [
                {sample, {integer, 1, 1000000}, 200, "number of mutants to draw"},
                {from, {integer, 0, 1 bsl 31}, 1, "the seed of the sample"},
                {seeds, {integer, 0, 100000}, 24,
                    "runs of soak for each mutant, in teams of 2 to 10"},
                {only, string, none, "only the mutant with this name, as it was printed"},
                {at_least, {number, 0, 100}, 90, "the part of the mutants that must be caught, %"},
                {longest, {number, 0, 600}, 15,
                    "tests that take longer without a change are left out, s"},
                starl_lab_jobs:at_once(),
                {list, switch, false, "lists the test that caught each mutant"}
            ]}
        ],
        statuses => [
            {0, "enough mutants were caught"},
            {3, "too few"},
            {4, "a test fails on the unchanged code"},
            {130, "interrupted, with the results so far"}
        ],
        run => fun run/1
    }.

argument() -> {required, "BLOCK", [{Block, ""} || Block <- starl_mutate_block:names()]}.

about(_Subject) ->
    [
        "Changes the code of a block in one small place at a time and runs the block's tests against "
        "each such mutant, the cheapest first, until one notices: EUnit, runs of soak, the quick "
        "check, Common Test. Only tests that call the changed function run. It prints who caught how "
        "many, and the survivors as differences: each needs a test, or a line in "
        "test/mutants/BLOCK.term that says why it is equivalent. doc/mutation.md tells more.",
        [
            "Blocks: ",
            lists:join(", ", [atom_to_list(Block) || Block <- starl_mutate_block:names()])
        ],
        {list, "Operators", [
            {atom_to_list(Operator), Doc}
         || {Operator, Doc} <- starl_mutate_operators:operators()
        ]}
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Block, values := Values}) ->
    with_tests(starl_mutate_code:tests(starl_cli_target:root()), Block, Values).

with_tests({error, _} = Error, _Block, _Values) ->
    Error;
with_tests({ok, Dir, Tests}, Block, Values) ->
    ok = starl_cli_log:install(),
    true = code:add_pathz(Dir),
    Files = starl_mutate_block:sources(Block, starl_cli_target:root()),
    Read = [starl_mutate_code:forms(File) || File <- Files],
    case {[Source || {ok, Source} <- Read], [Problem || {error, Problem} <- Read]} of
        {[], []} ->
            {error, ["no sources here; run it in a checkout"]};
        {Sources, []} ->
            All = starl_mutate_sample:all(Sources),
            _ = [
                starl_cli_terminal:out("named equivalent, but no mutant any more: ~s~n", [Id])
             || Id <- starl_mutate_sample:stale(All, lists:sort(maps:keys(reviewed())))
            ],
            drawn(wanted(All, Values), Block, Tests, Values);
        {_, Problems} ->
            {error, Problems}
    end.

wanted(All, #{only := none}) -> All;
wanted(All, #{only := Id}) -> starl_mutate_sample:only(All, Id).

drawn([], _Block, _Tests, #{only := Id}) ->
    {error, [["--only: no mutant of these sources is named ", Id]]};
drawn(Candidates, Block, Tests, #{sample := Sample, from := From, seeds := Seeds} = Values) ->
    {Drawn, #{broken := Broken, same := Same}} = starl_mutate_sample:draw(Candidates, Sample, From),
    starl_cli_terminal:out(
        "~b of ~b mutants of ~s, drawn with --from ~b;~n"
        "~b more did not compile, ~b were the same code~n",
        [length(Drawn), length(Candidates), Block, From, Broken, Same]
    ),
    Units = starl_mutate_block:units(Block, Tests, Seeds),
    Modules = lists:usort([M || #{candidate := #{source := #{module := M}}} <- Drawn]),
    measured(starl_mutate_plan:baseline(Units, Modules, maps:get(jobs, Values)), Drawn, Values).

%% A test that fails on the unchanged code is useless here.
measured({interrupted, _, _}, _Drawn, _Values) ->
    130;
measured({done, _, [_ | _] = Failed}, _Drawn, _Values) ->
    starl_cli_progress:erase(),
    _ = [
        starl_cli_terminal:complain(
            io_lib:format("mutate: ~0tp fails on the unchanged code: ~0tP", [Unit, Why, 20])
        )
     || {Unit, Why} <- Failed
    ],
    4;
measured({done, Measures, []}, Drawn, #{longest := Longest, jobs := Most} = Values) ->
    Short = maps:filter(fun(_, #{cpu_ms := Ms}) -> Ms =< 1000 * Longest end, Measures),
    told(maps:keys(Short), maps:keys(Measures)),
    Jobs = starl_mutate_plan:jobs(Drawn, Short),
    {How, Found} = starl_mutate_plan:run(Jobs, Most, fun(_) -> ok end),
    starl_cli_signal:on_interrupt(quit),
    Known = maps:from_list(Found),
    Results = [{D, maps:get(Id, Known)} || #{id := Id} = D <- Drawn, is_map_key(Id, Known)],
    tell(How, Results, Values).

told(Short, All) ->
    starl_cli_terminal:out("~b tests pass without a change", [length(All)]),
    _ = [
        starl_cli_terminal:out([
            io_lib:format("; ~b take too long and are left out:", [length(Long)]),
            [["\n  ", unit(Unit)] || Unit <- Long]
        ])
     || [_ | _] = Long <- [All -- Short]
    ],
    starl_cli_terminal:out("\n\n").

unit(Unit) -> starl_cli_terminal:wrap(io_lib:format("~0tp", [Unit]), 4, ?WIDTH).

-spec tell(done | interrupted, [starl_mutate_report:result()], values()) ->
    starl_cli_terminal:status().
tell(How, Results, #{at_least := Least, list := List} = Values) ->
    Reviewed = reviewed(),
    {Part, Words} = starl_mutate_report:score(Results, Reviewed),
    starl_cli_terminal:out([
        [starl_mutate_report:line(Result) || Result <- Results, List],
        starl_mutate_report:survivors(Results, Reviewed),
        [starl_mutate_report:table(Results) || maps:get(only, Values) =:= none],
        [["named equivalent, but caught: ", Id, "\n"] || Id <- caught(Results, Reviewed)],
        Words
    ]),
    status(How, 100 * Part >= Least).

caught(Results, Reviewed) ->
    [Id || {#{id := Id}, {caught, _, _}} <- Results, is_map_key(Id, Reviewed)].

status(interrupted, _) -> 130;
status(done, true) -> 0;
status(done, false) -> 3.

%% The reviewed survivors, each with the reason why it is equivalent to the block.
reviewed() ->
    Pattern = filename:join([starl_cli_target:root(), "test", "mutants", "*.term"]),
    Terms = [
        Term
     || File <- filelib:wildcard(Pattern), {ok, Read} <- [file:consult(File)], Term <- Read
    ],
    lists:foldl(fun maps:merge/2, #{}, Terms).
