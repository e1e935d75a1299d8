%% What the applications of StarL say of each other.
-module(starl_dev_applications_tests).
-include_lib("eunit/include/eunit.hrl").

%% A release, and a project's build, have what an application needs, whatever the others bring along.
an_application_lists_those_that_it_calls_test_() ->
    {timeout, 30, fun an_application_lists_those_that_it_calls/0}.

an_application_lists_those_that_it_calls() ->
    Lib = filename:dirname(code:lib_dir(starl_dev)),
    Of = [
        {list_to_atom(filename:basename(File, ".beam")), File, application_of(File)}
     || File <- filelib:wildcard(filename:join([Lib, "starl*", "ebin", "*.beam"]))
    ],
    Apps = maps:from_list([{Module, App} || {Module, _, App} <- Of]),
    Called = lists:usort([{App, Other} || {_, File, App} <- Of, Other <- called(File, Apps)]),
    ?assert(length(Called) > 50),
    ?assertEqual([], [
        {App, Other}
     || {App, Other} <- Called, App =/= Other, not lists:member(Other, listed(App, Lib))
    ]).

application_of(File) -> filename:basename(filename:dirname(filename:dirname(File))).

called(File, Apps) ->
    {ok, {_, [{imports, Imports}]}} = beam_lib:chunks(File, [imports]),
    lists:usort([maps:get(M, Apps) || {M, _, _} <- Imports, is_map_key(M, Apps)]).

listed(App, Lib) ->
    {ok, [{application, _, Keys}]} = file:consult(
        filename:join([Lib, App, "ebin", App ++ ".app"])
    ),
    [atom_to_list(Name) || Name <- proplists:get_value(applications, Keys)].
