%% @doc Versions of code that run side by side. A VM has one current version of a module, but half
%% of a team may run new code while the other half runs the former code. So a new version gets a
%% module name of its own, and a robot is commanded to go on with that module.
%%
%% The name is made of the module's name and a hash of its code, as in `my_app@1f0c22ab': the same
%% code has the same name in every VM and every run. All modules that are reloaded together call each
%% other in the new version: each call with a module's name in the source is renamed. A name that is
%% plain data is not: it means the same in both versions. So `apply(?MODULE, f, [])' calls the former
%% code, `?MODULE:f()' the new one.
-module(starl_version).

-export([make/1, load/1, original/1, format_found/1, format_found/2]).

-export_type([source/0, code/0, t/0]).

%% A source file, a module whose code is in the path, or code that was compiled in memory; compiled
%% code must have its debugging information.
-type source() :: file:filename() | module() | code().

-type code() :: {module(), file:filename(), Beam :: binary()}.

%% The new module of each, and the code of the new modules.
-type t() :: #{versions := #{module() => module()}, code := [code()]}.

-type forms() :: [erl_parse:abstract_form() | erl_parse:form_info()].

%% @doc Makes new versions of these modules. If it cannot, returns one line per problem.
-spec make([source()]) -> {ok, t()} | {error, [unicode:chardata(), ...]}.
make(Sources) ->
    Read = [read(Source) || Source <- Sources],
    case [Line || {error, Lines} <- Read, Line <- Lines] of
        [] -> renamed([Forms || {ok, Forms} <- Read]);
        Problems -> {error, Problems}
    end.

%% @doc Loads the code of new versions. Nothing runs it yet, and loading never ends a process.
-spec load([code()]) -> ok | {error, unicode:chardata()}.
load(Code) ->
    New = [C || {Module, _, _} = C <- Code, not erlang:module_loaded(Module)],
    case code:prepare_loading(New) of
        {ok, Prepared} -> code:finish_loading(Prepared);
        {error, Reasons} -> {error, io_lib:format("the code cannot be loaded: ~0tp", [Reasons])}
    end.

%% @doc The name of the module of which this is a version, or its own name.
-spec original(module()) -> module().
original(Module) ->
    case string:split(atom_to_list(Module), "@", trailing) of
        %% at most one atom for each module that was loaded
        [Original, [_, _, _, _, _, _, _, _]] -> list_to_atom(Original);
        _ -> Module
    end.

%% @doc The errors or warnings of the compiler in files, a line each: `FILE:LINE: what it is'.
-spec format_found([{file:filename(), [erl_lint:error_info()]}]) -> [unicode:chardata()].
format_found(Found) -> [line(File, Info) || {File, Infos} <- Found, Info <- Infos].

%% @doc The messages that ended a compilation, in such lines: errors, or warnings that the source
%% treats as errors.
-spec format_found(Errors :: Found, Warnings :: Found) -> [unicode:chardata()] when
    Found :: [{file:filename(), [erl_lint:error_info()]}].
format_found([], Warnings) -> format_found(Warnings);
format_found(Errors, _Warnings) -> format_found(Errors).

line(File, {none, Module, What}) ->
    [File, ": ", Module:format_error(What)];
line(File, {{Line, _Column}, Module, What}) ->
    line(File, {Line, Module, What});
line(File, {Line, Module, What}) ->
    io_lib:format("~ts:~b: ~ts", [File, Line, Module:format_error(What)]).

%% -- reading --------------------------------------------------------------------------------

-spec read(source()) ->
    {ok, {module(), file:filename(), forms()}} | {error, [unicode:chardata(), ...]}.
read({Module, File, Beam}) ->
    forms(Module, File, Beam);
read(Module) when is_atom(Module) ->
    case code:get_object_code(Module) of
        {Module, Beam, File} -> forms(Module, File, Beam);
        error -> {error, [io_lib:format("there is no code of ~ts in the path", [Module])]}
    end;
read(File) ->
    case filelib:is_regular(File) of
        true -> compiled(File, compile:file(File, [binary, return, debug_info]));
        false -> {error, [[File, ": there is no such file"]]}
    end.

compiled(File, {ok, Module, Beam, _Warnings}) -> forms(Module, File, Beam);
compiled(_File, {error, Errors, Warnings}) -> {error, format_found(Errors, Warnings)}.

forms(Module, File, Beam) ->
    case beam_lib:chunks(Beam, [abstract_code]) of
        {ok, {Module, [{abstract_code, {raw_abstract_v1, Forms}}]}} -> {ok, {Module, File, Forms}};
        {ok, {Module, _}} -> {error, [[File, ": compile it with debug_info"]]};
        {ok, {Other, _}} -> {error, [io_lib:format("~ts: this is module ~ts", [File, Other])]};
        {error, beam_lib, _} -> {error, [[File, ": this is no compiled Erlang module"]]}
    end.

%% -- renaming -------------------------------------------------------------------------------

renamed(Read) ->
    <<Hash:32, _/binary>> = erlang:md5(term_to_binary([anywhere(Forms) || {_, _, Forms} <- Read])),
    Names = maps:from_list([{Module, name(Module, Hash)} || {Module, _, _} <- Read]),
    Codes = [code(maps:get(Module, Names), File, Forms, Names) || {Module, File, Forms} <- Read],
    case [Line || {error, Lines} <- Codes, Line <- Lines] of
        [] -> {ok, #{versions => Names, code => Codes}};
        Problems -> {error, Problems}
    end.

%% A version has the same name in every directory: a result may hold it.
anywhere(Forms) ->
    [
        case Form of
            {attribute, At, file, {File, Line}} ->
                {attribute, At, file, {filename:basename(File), Line}};
            _ ->
                Form
        end
     || Form <- Forms
    ].

name(Module, Hash) -> list_to_atom(lists:flatten(io_lib:format("~ts@~8.16.0b", [Module, Hash]))).

code(Name, File, Forms, Names) ->
    case compile:forms(rename(Forms, Names), [return | source(Forms)]) of
        {ok, Name, Beam, _Warnings} -> {Name, File, Beam};
        {error, Errors, Warnings} -> {error, format_found(Errors, Warnings)}
    end.

%% Places in the source are told of the new module, too.
source(Forms) ->
    lists:sublist([{source, Source} || {attribute, _, file, {Source, _}} <- Forms], 1).

rename(Forms, Names) when is_list(Forms) -> some(Forms, Names);
rename({attribute, At, module, Module}, Names) ->
    {attribute, At, module, maps:get(Module, Names)};
rename({remote, At, Module, Function}, Names) ->
    {remote, At, target(Module, Names), rename(Function, Names)};
rename({'fun', At, {function, Module, Function, Arity}}, Names) ->
    {'fun', At, {function, target(Module, Names), rename(Function, Names), rename(Arity, Names)}};
rename(Form, Names) when is_tuple(Form) ->
    list_to_tuple([rename(Part, Names) || Part <- tuple_to_list(Form)]);
rename(Part, _Names) ->
    Part.

target({atom, At, Module}, Names) -> {atom, At, maps:get(Module, Names, Module)};
target(Expression, Names) -> rename(Expression, Names).

%% Improper lists are texts and places in the source.
some([Form | Forms], Names) -> [rename(Form, Names) | some(Forms, Names)];
some(End, _Names) -> End.
