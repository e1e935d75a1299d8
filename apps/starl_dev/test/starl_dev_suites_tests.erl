%% A case of a suite that is not in its list never runs, and Common Test says nothing. Suites are read as texts:
%% an exported function of one argument that nothing else in its suite names is a case that was left out.
%%
%% Holds: A case that a suite does not list is told
%% Red: with a case out of the list of `starl_cluster_SUITE`, run
-module(starl_dev_suites_tests).
-include_lib("eunit/include/eunit.hrl").

%% The functions of one argument that Common Test itself calls.
-define(FRAME, [
    init_per_suite, end_per_suite, init_per_group, end_per_group, init_per_testcase, group
]).

every_case_is_in_its_suites_list_test_() ->
    [
        {timeout, 60,
            {filename:basename(File), fun() ->
                ?assertEqual([], left_out(forms(File)))
            end}}
     || File <- suites()
    ].

a_case_that_is_left_out_is_told_test() ->
    Forms = parsed(
        "-export([all/0, runs/1, never_runs/1, called/1, init_per_suite/1]).\n"
        "-define(ALL, [runs]).\n"
        "all() -> ?ALL.\n"
        "runs(Config) -> called(Config).\n"
        "called(_) -> ok.\n"
        "never_runs(Config) -> never_runs(Config).\n"
        "init_per_suite(Config) -> Config.\n"
    ),
    ?assertEqual([never_runs], left_out(Forms)).

suites() ->
    Root = starl_cli_target:root(),
    Files = [
        filename:join(Root, File)
     || Pattern <- ["test/**/*_SUITE.erl", "apps/*/test/**/*_SUITE.erl"],
        File <- filelib:wildcard(Pattern, Root)
    ],
    ?assertNotEqual([], Files),
    Files.

forms(File) ->
    {ok, Text} = file:read_file(File),
    parsed(unicode:characters_to_list(Text)).

%% The tokens of each form.
parsed(Text) ->
    {ok, Tokens, _} = erl_scan:string(Text),
    split(Tokens, []).

split([], _Form) -> [];
split([{dot, _} | Tokens], Form) -> [lists:reverse(Form) | split(Tokens, [])];
split([Token | Tokens], Form) -> split(Tokens, [Token | Form]).

left_out(Forms) ->
    Exported = lists:append([exported(Names) || [{'-', _}, {atom, _, export} | Names] <- Forms]),
    [
        Name
     || Name <- Exported -- ?FRAME, not lists:any(fun(Form) -> names(Name, Form) end, Forms)
    ].

exported([{atom, _, Name}, {'/', _}, {integer, _, 1} | Tokens]) -> [Name | exported(Tokens)];
exported([_ | Tokens]) -> exported(Tokens);
exported([]) -> [].

%% A function may say its own name, to run itself on another node.
names(_Name, [{'-', _}, {atom, _, export} | _]) ->
    false;
names(Name, [{atom, _, Name}, {'(', _} | Body]) ->
    length([here || {var, _, 'MODULE'} <- Body]) > 0 andalso lists:keymember(Name, 3, Body);
names(Name, Form) ->
    lists:keymember(Name, 3, [T || {atom, _, _} = T <- Form]).
