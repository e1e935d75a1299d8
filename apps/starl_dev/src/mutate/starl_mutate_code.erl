%% @doc Loads and compiles code for mutation testing. It reads a module's abstract code from its
%% debugging information, and compiles changed code in memory. It compiles the tests of a checkout
%% beside the build.
-module(starl_mutate_code).

-export([forms/1, compiled/2, tests/1]).

-export_type([source/0]).

%% A module: its source file, its forms and its compiler options.
-type source() :: #{
    module := module(),
    file := file:filename(),
    forms := [erl_parse:abstract_form()],
    options := [compile:option()],
    md5 := binary()
}.

%% @doc The forms of the module of a source file.
-spec forms(file:filename()) -> {ok, source()} | {error, unicode:chardata()}.
forms(File) ->
    Module = list_to_atom(filename:basename(File, ".erl")),
    case code:which(Module) of
        Beam when is_list(Beam) -> read(Module, File, Beam);
        _ -> {error, [File, ": the module is not built"]}
    end.

read(Module, File, Beam) ->
    case beam_lib:chunks(Beam, [abstract_code, compile_info]) of
        {ok, {Module, [{abstract_code, {raw_abstract_v1, Forms}}, {compile_info, Info}]}} ->
            Options = kept(proplists:get_value(options, Info, [])),
            {ok, Module, Code} = compile:forms(Forms, Options),
            {ok, {Module, Md5}} = beam_lib:md5(Code),
            {ok, #{module => Module, file => File, forms => Forms, options => Options, md5 => Md5}};
        _ ->
            {error, [File, ": it was built without debug_info"]}
    end.

%% Options for warnings are dropped, because a mutant may cause warnings.
kept(Options) -> [O || O <- Options, O =:= strict_record_updates].

%% @doc The machine code with one function changed; `broken': it does not compile; `same': the code
%% is the same as before.
-spec compiled(erl_parse:abstract_form(), source()) -> {ok, binary()} | broken | same.
compiled({function, _, Name, Arity, _} = Function, #{forms := Forms} = Source) ->
    #{options := Options} = Source,
    Changed = [changed(Form, Name, Arity, Function) || Form <- Forms],
    try compile:forms(Changed, [return_errors | Options]) of
        {ok, _Module, Code} -> differs(Code, Source);
        _ -> broken
    catch
        _:_ -> broken
    end.

changed({function, _, Name, Arity, _}, Name, Arity, Function) -> Function;
changed(Form, _Name, _Arity, _Function) -> Form.

differs(Code, #{module := Module, md5 := Md5}) ->
    case beam_lib:md5(Code) of
        {ok, {Module, Md5}} -> same;
        {ok, {Module, _}} -> {ok, Code}
    end.

%% @doc Compiles the tests of a checkout whose source is newer than their code; gives the folder of
%% the code and the modules.
-spec tests(Root :: file:filename()) ->
    {ok, file:filename(), [module()]} | {error, [unicode:chardata(), ...]}.
tests(Root) ->
    Dir = filename:join([Root, "_build", "mutate", "test"]),
    ok = filelib:ensure_path(Dir),
    Files = lists:append([
        filelib:wildcard(filename:join(Root, Pattern))
     || Pattern <- ["apps/*/test/*.erl", "test/*.erl", "test/*/*.erl"]
    ]),
    case lists:append([problems(File, Dir) || File <- Files, is_old(File, Dir)]) of
        [] -> {ok, Dir, [list_to_atom(filename:basename(File, ".erl")) || File <- Files]};
        [_ | _] = Problems -> {error, Problems}
    end.

is_old(File, Dir) ->
    Beam = filename:join(Dir, filename:basename(File, ".erl") ++ ".beam"),
    filelib:last_modified(Beam) =< filelib:last_modified(File).

problems(File, Dir) ->
    case compile:file(File, [{outdir, Dir}, debug_info, return_errors]) of
        {ok, _Module} -> [];
        _ -> [[File, ": this test does not compile"]]
    end.
