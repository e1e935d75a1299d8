%% @doc Loads a module over its former definition, as a cell of a notebook does, without harm to an
%% application in mid-step. It does not reload robots: that is {@link starl_reload}. It also finds
%% the place of code in its source.
%%
%% The VM keeps two versions of a module: the newest, and the previous one for processes that still
%% run it. A step that blocks stays in the code in which it began. To load a third version removes
%% the oldest, and the VM kills every process that runs it: the application and its state. So this
%% module loads code only when no process runs the version before the newest.
-module(starl_code).

-export([load/3, format_error/1]).
-export([line/3, is_library/1, is_runtime/1, resembling/1, exports/3, versions/1]).

-export_type([reason/0]).

%% Why code cannot be loaded: the file does not fit this module, or not this VM.
-type reason() :: {bad_code, module(), term()}.

%% @doc Loads new code, unless a process runs the version before the newest. Never ends a process.
-spec load(module(), file:filename(), Beam :: binary()) -> ok | waits | {error, reason()}.
load(Module, File, Beam) ->
    case code:prepare_loading([{Module, File, Beam}]) of
        {ok, Prepared} -> finished(code:soft_purge(Module), Module, Prepared);
        {error, Reasons} -> {error, {bad_code, Module, Reasons}}
    end.

finished(false, _Module, _Prepared) ->
    waits;
finished(true, Module, Prepared) ->
    case code:finish_loading(Prepared) of
        ok -> ok;
        %% another process has loaded code meanwhile
        {error, [{Module, not_purged}]} -> waits;
        {error, Reasons} -> {error, {bad_code, Module, Reasons}}
    end.

%% @doc One line that says why code cannot be loaded.
-spec format_error(reason()) -> unicode:chardata().
format_error({bad_code, Module, Reasons}) ->
    io_lib:format("~ts: this is no code that can be loaded for it: ~0tp", [Module, Reasons]).

%% -- where it stands ------------------------------------------------------------------------

%% @doc The source file of a function, and the line in which it begins, where the source is at hand.
%% `none' as a function is the module itself: the line where it states its behaviour or its name.
-spec line(module(), Function :: atom(), arity()) -> {ok, file:filename(), pos_integer()} | none.
line(Module, Function, Arity) ->
    case code:ensure_loaded(Module) of
        {module, Module} ->
            Source = proplists:get_value(source, Module:module_info(compile), ""),
            line_in(epp:parse_file(Source, []), Source, Function, Arity);
        {error, _} ->
            none
    end.

line_in({ok, Forms}, Source, Function, Arity) ->
    case annotations(Forms, Function, Arity) of
        [Anno | _] -> {ok, Source, erl_anno:line(Anno)};
        [] -> none
    end;
line_in({error, _}, _Source, _Function, _Arity) ->
    none.

annotations(Forms, none, 0) ->
    Attributes = [{Name, Anno} || {attribute, Anno, Name, _} <- Forms],
    [Anno || {behaviour, Anno} <- Attributes] ++ [Anno || {module, Anno} <- Attributes];
annotations(Forms, Function, Arity) ->
    [Anno || {function, Anno, F, A, _} <- Forms, F =:= Function, A =:= Arity].

%% @doc Does this module belong to Erlang/OTP or to StarL?
-spec is_library(module()) -> boolean().
is_library(Module) ->
    case code:which(Module) of
        File when is_list(File), File =/= "" ->
            is_below(code:lib_dir(), File) orelse is_below(filename:dirname(own_dir()), File);
        _ ->
            lists:member(Module, erlang:pre_loaded())
    end.

is_below(Dir, File) -> lists:prefix(Dir ++ "/", File).

%% The folder of this application among those of the others.
own_dir() -> filename:dirname(filename:dirname(code:which(?MODULE))).

%% @doc Does this module run machines or applications? Its frames in their stacks say nothing to those who
%% wrote them.
-spec is_runtime(module()) -> boolean().
is_runtime(Module) ->
    lists:member(Module, [
        starl_app_proc,
        starl_app_code,
        starl_machine_proc,
        gen_statem,
        proc_lib
    ]).

%% @doc The modules of StarL whose name a mistyped one may have meant, best first.
-spec resembling(module()) -> [module()].
resembling(Module) ->
    Names = [list_to_atom(Name) || {"starl" ++ _ = Name, _, _} <- code:all_available()],
    Whole = list_to_atom("starl_" ++ atom_to_list(Module)),
    [Whole || lists:member(Whole, Names)] ++ starl_similar:atoms(Module, Names).

%% @doc Is there a module of this name with this function? No atom is made of the text.
-spec exports(Module :: string(), Function :: atom(), arity()) -> boolean().
exports(Text, Function, Arity) ->
    try list_to_existing_atom(Text) of
        Module ->
            starl_callback:exported(Module, Function, Arity)
    catch
        error:badarg -> false
    end.

%% @doc The versions of applications of StarL that are in the path: one, or which application has which.
%% Applications that a project takes from unlike commits do not know each other's messages.
-spec versions([atom(), ...]) -> same | {differ, [{atom(), Version :: string()}, ...]}.
versions(Apps) ->
    Known = [{App, Version} || App <- Apps, {ok, Version} <- [version(App)]],
    case lists:usort([Version || {_, Version} <- Known]) of
        [_, _ | _] -> {differ, Known};
        _ -> same
    end.

version(App) ->
    case application:load(App) of
        {error, {already_loaded, App}} -> application:get_key(App, vsn);
        ok -> application:get_key(App, vsn);
        {error, _NotInThePath} -> undefined
    end.
