%% @doc Runs one test case of a Common Test suite without Common Test itself, which writes HTML
%% pages for every case. The init and end functions of the case are called as in Common Test.
-module(starl_mutate_suite).

-export([paths/1, run/2]).

-export_type([path/0]).

%% The groups that contain a case, from the outermost, and the case.
-type path() :: [atom(), ...].

-type config() :: [{atom(), term()}].

%% @doc All test cases of a loaded suite.
-spec paths(module()) -> [path()].
paths(Suite) -> lists:append([below(Test, Suite) || Test <- Suite:all()]).

below({group, Name}, Suite) ->
    in_group(lists:keyfind(Name, 1, Suite:groups()), Suite);
below({group, Name, _Properties}, Suite) ->
    below({group, Name}, Suite);
below({testcase, Case, _Properties}, _Suite) ->
    [[Case]];
below({Name, Properties, Tests}, Suite) when is_list(Properties) ->
    in_group({Name, Properties, Tests}, Suite);
below(Case, _Suite) when is_atom(Case) -> [[Case]].

in_group({Name, _Properties, Tests}, Suite) ->
    [[Name | Path] || Test <- Tests, Path <- below(Test, Suite)];
in_group({Name, Tests}, Suite) ->
    in_group({Name, [], Tests}, Suite).

%% @doc Runs a case, which fails with an exception. A skipped case counts as passed.
-spec run(module(), path()) -> ok.
run(Suite, Path) ->
    {ok, Dir} = starl_private_dir:new("mutate"),
    Config = [{priv_dir, Dir}, {data_dir, filename:rootname(code:which(Suite)) ++ "_data"}],
    try
        within({init_per_suite, end_per_suite}, [], {Suite, Path, Config}, fun(Inner) ->
            in_groups(Suite, Path, Inner)
        end)
    after
        starl_private_dir:remove(Dir)
    end.

-spec in_groups(module(), path(), config()) -> ok.
in_groups(Suite, [Case], Config) ->
    Around = {init_per_testcase, end_per_testcase},
    within(Around, [Case], {Suite, [Case], Config}, fun(Inner) -> case_run(Suite, Case, Inner) end);
in_groups(Suite, [Group | Path], Config) ->
    Around = {init_per_group, end_per_group},
    within(Around, [Group], {Suite, Path, Config}, fun(Inner) -> in_groups(Suite, Path, Inner) end).

case_run(Suite, Case, Config) ->
    _ = Suite:Case(Config),
    ok.

within({Before, After}, Args, {Suite, _Path, Config}, Run) ->
    case starl_callback:call(Suite, Before, Args ++ [Config], Config) of
        Inner when is_list(Inner) ->
            try
                Run(Inner)
            after
                starl_callback:call(Suite, After, Args ++ [Inner], ok)
            end;
        {Skip, _Reason} when Skip =:= skip; Skip =:= skip_and_save ->
            ok
    end.
