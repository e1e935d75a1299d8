%% The tables of the benchmarks, of the acceptance table and of mutation testing fit 80 columns.
-module(starl_dev_columns_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, narrow/1]).

-define(PATIENCE_S, 120).

%% Each benchmark, in a short run.
benchmarks_test_() ->
    [
        {atom_to_list(M), {timeout, ?PATIENCE_S, fun() -> short(M, Some) end}}
     || {M, Some} <- short()
    ].

short() ->
    [
        {starl_dev_bench_ring, #{robots => [4], reps => 1}},
        {starl_dev_bench_swarm, #{robots => [1000], seconds => 1, reps => 1}},
        {starl_dev_bench_events, #{robots => [100], seconds => 20, reps => 1}},
        {starl_dev_bench_scale, #{robots => [4]}},
        {starl_dev_bench_painting, #{robots => [2], pictures => ["lines"], seeds => 1, reps => 1}},
        {starl_dev_bench_blocks, #{robots => [4]}},
        {starl_dev_bench_dpp, #{edges => [100], requests => 50}}
    ].

short(Module, Some) ->
    Options = maps:merge(starl_cli_flags:defaults(Module:flags()), Some),
    {[_ | _], Text} = starl_dev_captured:of_call(fun() -> Module:run(Options) end),
    ?assert(length(string:lexemes(Text, "\n")) >= 3),
    narrow(Text).

%% The one of live robots starts nodes; its rows are shown here.
live_test() ->
    Row = [
        {transport, <<"local">>},
        {bare_us_median, 12345678},
        {bare_us_p99, 12345678},
        {message_us_median, 12345678},
        {message_us_p99, 12345678},
        {times_bare, 1234.5},
        {messages_per_s, 12345678}
    ],
    narrow(
        unicode:characters_to_list([
            starl_dev_bench_live:head(100000), starl_dev_bench_live:line(Row)
        ])
    ).

table_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["table", "--pictures", "lines", "--robots", "2", "--loss", "0,0.25"],
        Text = says(0, "all 2 runs: painted 100 %", Args ++ ["--seeds", "1", "--jobs", "1"]),
        narrow(Text)
    end}.

%% The longest names and figures of a row.
longest_row_test() ->
    Result = #{
        covered => 0.99999,
        violations => 12,
        separation => 12345.6,
        safe => 400,
        makespan => 39999.9,
        ratio => 123.45,
        detour => 12.34,
        deadlocks => 12345,
        wall => 12345.6,
        digest => <<"00">>
    },
    Cell = {"/tmp/starl-random-1/random-10000.svg", 1000, 0.25},
    narrow(
        unicode:characters_to_list([
            starl_dev_table_rows:header(100000),
            starl_dev_table_rows:line(Cell, [Result]),
            starl_dev_table_rows:line(Cell, [failed])
        ])
    ).

%% Mutants of the module with the longest name: the table, the differences and the list.
mutants_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        %% As the command names it.
        File = "apps/starl_blocks/src/election/starl_election_bully_monitor.erl",
        {ok, Read} = starl_mutate_code:forms(filename:join(starl_cli_target:root(), File)),
        {Drawn, _} = starl_mutate_sample:draw(
            starl_mutate_sample:all([Read#{file := File}]), 20, 1
        ),
        Survived = [{D, survived} || D <- Drawn],
        Unit = {suite, starl_election_SUITE, [election, {group, all}, a_case_with_a_long_name]},
        Caught = [
            {D, {caught, Unit, {failed, "no such word in the answer " ++ "at all"}}}
         || D <- Drawn
        ],
        narrow(
            unicode:characters_to_list([
                starl_mutate_report:table(Survived ++ Caught),
                starl_mutate_report:survivors(Survived, #{}),
                [starl_mutate_report:line(Result) || Result <- Survived ++ Caught]
            ])
        )
    end}.
