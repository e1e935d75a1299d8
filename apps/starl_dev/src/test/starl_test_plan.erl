%% @doc Plans the jobs of `./starl test' ({@link starl_test_vm:job()}): which tests a VM runs
%% together. A suite of Common Test has a VM of its own. So has an EUnit module that starts a
%% program, or that `test/test_times.term' lists as long. All others share a few VMs: the quick
%% modules, and the brief ones, which declare how long they may take.
-module(starl_test_plan).

-export([jobs/3, sources/1]).

-export_type([wanted/0, source/0]).

-type wanted() :: all | quick | {named, [module(), ...], [xref | quick]}.

%% A file with tests and its text.
-type source() :: {module(), Text :: binary()}.

-type job() :: #{name := string(), kind := eunit | suite | xref, modules := [module()]}.

%% The number of jobs that the quick modules are dealt to, and the brief ones.
-define(QUICK_HANDS, 4).
-define(BRIEF_HANDS, 10).

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
%% how to test. A module among the long ones shares its VM with no other.
-spec jobs(wanted(), [source()], Long :: [module()]) -> [job()].
jobs(all, Sources, Long) ->
    {Suites, Modules} = lists:partition(fun is_suite/1, Sources),
    [xref() | [suite(Name) || {Name, _} <- Suites] ++ eunit(Modules, Long)];
jobs(quick, Sources, _Long) ->
    [xref() | hands(quick, ?QUICK_HANDS, quick_modules(Sources))];
jobs({named, Names, []}, Sources, Long) ->
    Named = [{Name, proplists:get_value(Name, Sources, <<>>)} || Name <- lists:usort(Names)],
    {Suites, Modules} = lists:partition(fun is_suite/1, Named),
    [suite(Name) || {Name, _} <- Suites] ++ eunit(Modules, Long);
jobs({named, Names, [quick]}, Sources, Long) ->
    jobs({named, Names ++ quick_modules(Sources), []}, Sources, Long).

quick_modules(Sources) ->
    [Name || {Name, _} = S <- Sources, not is_suite(S), sharing(S, []) =:= quick].

is_suite({Name, _Text}) -> lists:suffix("_SUITE", atom_to_list(Name)).

%% Which VM a module of EUnit has.
sharing({Name, Text}, Long) ->
    Has = fun(Words) -> binary:match(Text, Words) =/= nomatch end,
    Own = Has([<<"_vm:">>, <<"open_port">>, <<"peer:">>]) orelse lists:member(Name, Long),
    case Has([<<"{timeout,">>]) of
        _ when Own -> own;
        true -> brief;
        false -> quick
    end.

eunit(Modules, Long) ->
    Of = fun(Sharing) -> [Name || {Name, _} = S <- Modules, sharing(S, Long) =:= Sharing] end,
    [job(atom_to_list(Name), eunit, [Name]) || Name <- Of(own)] ++
        hands(brief, ?BRIEF_HANDS, Of(brief)) ++ hands(quick, ?QUICK_HANDS, Of(quick)).

%% Every so many-th module, since those of one application are of a kind.
hands(Sharing, Most, Modules) ->
    Dealt = lists:zip(Modules, [1 + N rem Most || N <- lists:seq(1, length(Modules))]),
    [
        job(lists:concat([Sharing, "_", Hand]), eunit, Own)
     || Hand <- lists:seq(1, Most),
        [_ | _] = Own <- [[Name || {Name, H} <- Dealt, H =:= Hand]]
    ].

xref() -> job("xref", xref, []).

suite(Name) -> job(atom_to_list(Name), suite, [Name]).

job(Name, Kind, Modules) -> #{name => Name, kind => Kind, modules => Modules}.
