%% Versions of code: their names, which calls are led to them, and what is said of code that cannot be one.
-module(starl_version_tests).
-include_lib("eunit/include/eunit.hrl").

-export([format_error/1]).

-define(V, starl_version).

%% -- names ------------------------------------------------------------------------------------

the_same_code_has_the_same_name_test() ->
    [Name, Same, Other] = in_directory(fun(Dir) ->
        [
            begin
                {ok, #{versions := #{vt_name := Version}}} = made([
                    source(Dir, vt_name, "f() -> " ++ N ++ ".")
                ]),
                Version
            end
         || N <- ["1", "1", "2"]
        ]
    end),
    ?assertMatch({match, _}, re:run(atom_to_list(Name), "^vt_name@[0-9a-f]{8}$")),
    ?assertEqual(Name, Same),
    ?assertNotEqual(Name, Other).

%% A result may hold the name, and a run is repeated from the sources that it has kept.
code_in_another_directory_has_the_same_name_test() ->
    Version = fun(Dir) ->
        {ok, #{versions := #{vt_there := Name}}} = made([source(Dir, vt_there, "f() -> 1.")]),
        Name
    end,
    ?assertEqual(in_directory(Version), in_directory(Version)).

a_version_has_an_original_test() ->
    [
        ?assertEqual(Original, ?V:original(Module))
     || {Module, Original} <- [
            {'my_app@1f0c22ab', my_app},
            {'my@app@1f0c22ab', 'my@app'},
            {my_app, my_app},
            {'my_app@1f0c22a', 'my_app@1f0c22a'},
            {'my_app@1f0c22abc', 'my_app@1f0c22abc'}
        ]
    ].

%% -- calls ------------------------------------------------------------------------------------

%% Modules that are reloaded together call each other in the new version, in whatever way the source names
%% them; a name that is data, and a module that is not reloaded, stay.
calls_go_to_the_new_versions_test() ->
    {ok, #{versions := #{vt_calls := New, vt_other := Newer}, code := Code}} = in_directory(
        fun(Dir) ->
            made([
                source(
                    Dir,
                    vt_calls,
                    "f() -> [?MODULE:m(), vt_other:m(), h(fun vt_other:m/0), lists:max([1, 2])].\n"
                    "h(F) -> F().\n"
                    "d(M) -> [vt_other, M:m(), h(fun M:m/0), [\"vt_other\" | vt_other]].\n"
                    "n(M) -> (h(fun() -> n(M, vt_other:n()) end)):m().\n"
                    "n(M, other) -> M.\n"
                    "m() -> calls."
                ),
                source(Dir, vt_other, "m() -> n().\nn() -> other.")
            ])
        end
    ),
    ?assertEqual([New, Newer], [Module || {Module, _, _} <- Code]),
    ok = ?V:load(Code),
    ?assertEqual([calls, other, other, 2], New:f()),
    ?assertEqual([vt_other, other, other, ["vt_other" | vt_other]], New:d(Newer)),
    ?assertEqual(other, New:n(Newer)).

%% A crash tells the place in the source.
places_are_those_of_the_source_test() ->
    {File, {ok, #{code := [{Name, _, _}] = Code}}} = in_directory(fun(Dir) ->
        Source = source(Dir, vt_place, "f() ->\n error(here)."),
        {Source, made([Source])}
    end),
    ok = ?V:load(Code),
    ?assertMatch([{Name, f, 0, [{file, File}, {line, 4}]} | _], stack(Name)),
    ?assertEqual(File, proplists:get_value(source, Name:module_info(compile))).

stack(Name) ->
    try
        Name:f()
    catch
        error:here:Stack -> Stack
    end.

%% -- sources ----------------------------------------------------------------------------------

%% A module in the path and its code in memory are one and the same.
every_kind_of_source_is_taken_test() ->
    {?V, Beam, Path} = code:get_object_code(?V),
    [{Name, Path}, {Name, "here"}] = [
        begin
            {ok, #{versions := #{?V := Name}, code := [{Name, From, _}]}} = made([Source]),
            {Name, From}
        end
     || Source <- [?V, {?V, "here", Beam}]
    ].

what_is_wrong_with_a_source_is_said_test() ->
    {?V, Beam, _} = code:get_object_code(?V),
    {ok, {?V, Bare}} = beam_lib:strip(Beam),
    Said = fun(Sources) ->
        {error, Found} = made(Sources),
        lines(Found)
    end,
    Wrong = [
        {vt_nowhere, "there is no code of vt_nowhere in the path"},
        {"vt_nowhere.erl", "vt_nowhere.erl: there is no such file"},
        {{?V, "v.erl", Bare}, "v.erl: compile it with debug_info"},
        {{vt_else, "v.erl", Beam}, "v.erl: this is module starl_version"},
        {{?V, "v.erl", <<"none">>}, "v.erl: this is no compiled Erlang module"}
    ],
    [?assertEqual([Line], Said([Source])) || {Source, Line} <- Wrong],
    %% all of them at once, and nothing of what is right
    ?assertEqual([Line || {_, Line} <- Wrong], Said([?V | [Source || {Source, _} <- Wrong]])),
    in_directory(fun(Dir) ->
        Unbound = source(Dir, vt_unbound, "f() ->\n X."),
        ?assertEqual([Unbound ++ ":4: variable 'X' is unbound"], Said([Unbound]))
    end).

%% A warning that the source takes for an error is said, be it found in the source or in its new version.
%% Holds: A source whose warnings count as errors is refused with them, by a reload and by `./starl
%% run`
%% Red: b93e94e, run: the reload goes ahead without it, the command says nothing
a_warning_that_counts_as_an_error_is_said_test() ->
    in_directory(fun(Dir) ->
        File = source(Dir, vt_strict, "-compile(warnings_as_errors).\nf() ->\n X = 1."),
        {ok, _, Beam} = compile:file(File, [binary, debug_info, nowarn_unused_vars]),
        [
            begin
                {error, Found} = made([?V, Source]),
                ?assertEqual([File ++ ":5: variable 'X' is unused"], lines(Found))
            end
         || Source <- [File, {vt_strict, File, Beam}]
        ]
    end).

findings_are_lines_test() ->
    ?assertEqual(
        ["a.erl:3: x", "a.erl:4: y", "b.erl: z"],
        lines(
            ?V:format_found([
                {"a.erl", [{{3, 7}, ?MODULE, x}, {4, ?MODULE, y}]}, {"b.erl", [{none, ?MODULE, z}]}
            ])
        )
    ).

format_error(Atom) -> atom_to_list(Atom).

%% A version that is loaded already stays, whatever comes under its name.
loaded_once_test() ->
    {ok, #{code := [{Name, File, _}] = Code}} = in_directory(fun(Dir) ->
        made([source(Dir, vt_once, "f() -> 1.")])
    end),
    ?assertEqual(ok, ?V:load(Code)),
    ?assertEqual(ok, ?V:load([{Name, File, <<>>}])),
    ?assertEqual(1, Name:f()),
    {error, Text} = ?V:load([{vt_broken, File, <<>>}]),
    ?assertEqual("the code cannot be loaded: [{vt_broken,badfile}]", lists:flatten(Text)).

%% -- helpers ----------------------------------------------------------------------------------

made(Sources) -> ?V:make(Sources).

lines(Lines) -> [lists:flatten(Line) || Line <- Lines].

%% A file with this code from its third line on; it exports everything.
source(Dir, Name, Code) ->
    File = filename:join(Dir, atom_to_list(Name) ++ ".erl"),
    Head = ["-module(", atom_to_list(Name), ").\n-compile([export_all, nowarn_export_all]).\n"],
    ok = file:write_file(File, [Head, Code, "\n"]),
    File.

in_directory(Fun) ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    Dir = filename:join("/tmp", "starl_version_" ++ os:getpid() ++ "_" ++ Unique),
    ok = filelib:ensure_path(Dir),
    try
        Fun(Dir)
    after
        ok = file:del_dir_r(Dir)
    end.
