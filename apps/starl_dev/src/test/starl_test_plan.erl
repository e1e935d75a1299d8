%% @doc The jobs of `./starl test' ({@link starl_test_vm:job()}): which tests a VM runs together. A
%% suite of Common Test has a VM of its own, and so has a module of EUnit that says how long it may
%% take or that starts a program. All others, the quick ones, share a few VMs.
-module(starl_test_plan).

-export([jobs/2, sources/1]).

-export_type([wanted/0, source/0]).

-type wanted() :: all | quick | {named, [module(), ...], [xref | quick]}.

%% A file with tests and its text.
-type source() :: {module(), Text :: binary()}.

-type job() :: #{name := string(), kind := eunit | suite | xref, modules := [module()]}.

%% The number of jobs that the quick modules are dealt to.
-define(HANDS, 4).

%% @doc Reads the tests of the checkout.
-spec sources(file:filename()) -> [source()].
sources(Root) ->
    [
        {list_to_atom(filename:basename(File, ".erl")), Text}
     || Dir <- ["apps/*/test/", "test/", "test/*/"],
        Kind <- ["*_tests.erl", "*_SUITE.erl"],
        File <- filelib:wildcard(filename:join(Root, Dir ++ Kind)),
        {ok, Text} <- [file:read_file(File)]
    ].

%% @doc The jobs for the wanted tests. A name without a source of tests is a module that EUnit knows
%% how to test.
-spec jobs(wanted(), [source()]) -> [job()].
jobs(all, Sources) ->
    {Suites, Modules} = lists:partition(fun is_suite/1, Sources),
    [xref() | [suite(Name) || {Name, _} <- Suites] ++ eunit(Modules)];
jobs(quick, Sources) ->
    [xref() | hands([Name || {Name, _} = S <- Sources, not is_suite(S), is_quick(S)])];
jobs({named, Names, []}, Sources) ->
    Named = [{Name, proplists:get_value(Name, Sources, <<>>)} || Name <- lists:usort(Names)],
    {Suites, Modules} = lists:partition(fun is_suite/1, Named),
    [suite(Name) || {Name, _} <- Suites] ++ eunit(Modules);
jobs({named, Names, [quick]}, Sources) ->
    Quick = lists:append([Modules || #{modules := Modules} <- jobs(quick, Sources)]),
    jobs({named, Names ++ Quick, []}, Sources).

is_suite({Name, _Text}) -> lists:suffix("_SUITE", atom_to_list(Name)).

is_quick({_Name, Text}) ->
    binary:match(Text, [<<"{timeout,">>, <<"_vm:">>, <<"open_port">>, <<"peer:">>]) =:= nomatch.

eunit(Modules) ->
    {Quick, Slow} = lists:partition(fun is_quick/1, Modules),
    [job(atom_to_list(Name), eunit, [Name]) || {Name, _} <- Slow] ++
        hands([Name || {Name, _} <- Quick]).

%% Every so many-th module, since those of one application are of a kind.
hands(Modules) ->
    Dealt = lists:zip(Modules, [1 + N rem ?HANDS || N <- lists:seq(1, length(Modules))]),
    [
        job(lists:concat(["quick_", Hand]), eunit, Own)
     || Hand <- lists:seq(1, ?HANDS),
        [_ | _] = Own <- [[Name || {Name, H} <- Dealt, H =:= Hand]]
    ].

xref() -> job("xref", xref, []).

suite(Name) -> job(atom_to_list(Name), suite, [Name]).

job(Name, Kind, Modules) -> #{name => Name, kind => Kind, modules => Modules}.
