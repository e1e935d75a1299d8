%% @doc Loads new code for running applications, without harm to an application in mid-step.
%%
%% The VM keeps two versions of a module: the newest, and the previous one for processes that still
%% run it. A step that blocks stays in the code in which it began. To load a third version removes
%% the oldest, and the VM kills every process that runs it: the application and its state. So this
%% module loads code only when no process runs the version before the newest; else the new code has
%% to wait.
-module(starl_code).

-export([check/3, is_free/1, load/3, users/1, format_error/1]).

-export_type([reason/0]).

%% Why code cannot be loaded: the file does not fit this module, or not this VM.
-type reason() :: {bad_code, module(), term()}.

%% @doc Can this code be loaded at all?
-spec check(module(), file:filename(), Beam :: binary()) -> ok | {error, reason()}.
check(Module, File, Beam) ->
    case code:prepare_loading([{Module, File, Beam}]) of
        {ok, _Prepared} -> ok;
        {error, Reasons} -> {error, {bad_code, Module, Reasons}}
    end.

%% @doc Does no process run the version before the newest? If so, that version is removed.
-spec is_free(module()) -> boolean().
is_free(Module) -> code:soft_purge(Module).

%% @doc Loads new code, unless a process runs the version before the newest. Never ends a process.
-spec load(module(), file:filename(), Beam :: binary()) -> ok | waits | {error, reason()}.
load(Module, File, Beam) ->
    case code:prepare_loading([{Module, File, Beam}]) of
        {ok, Prepared} -> finished(is_free(Module), Module, Prepared);
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

%% @doc The robots whose processes run the version before the newest.
-spec users(module()) -> [starl:robot_id()].
users(Module) ->
    Late = [Pid || Pid <- processes(), erlang:check_process_code(Pid, Module) =:= true],
    lists:usort([Robot || Pid <- Late, Robot <- robot(Pid)]).

robot(Pid) ->
    case erlang:process_info(Pid, dictionary) of
        {dictionary, Words} ->
            [Robot || {'$logger_metadata$', #{robot := Robot}} <- Words];
        undefined ->
            []
    end.

%% @doc One line that says why code cannot be loaded.
-spec format_error(reason()) -> unicode:chardata().
format_error({bad_code, Module, Reasons}) ->
    io_lib:format("~ts: this is no code that can be loaded for it: ~0tp", [Module, Reasons]).
