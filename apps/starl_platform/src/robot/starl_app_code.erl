%% @doc Keeps the code of a sequential application and converts its state from one version to
%% another. It holds the versions of the code, the reload commands that wait for the next step, and
%% the states with which the former code may go on. It neither takes steps nor acts: it returns what
%% is to be reported. A part of {@link starl_app_proc}.
-module(starl_app_code).

-export([new/1, module/1, received/3, next_command/1, apply_command/4, with_later_commands/2]).
-export([may_crash/2, stepped/1, taken_back/4]).
-export([version/1, carried/3]).

-export_type([t/0]).

%% What runs: the module, its next state, and the version of the code that has made it.
-type running() :: {module(), State :: term(), Md5 :: binary()}.

%% The way back from a version: that of the code before, the state before the switch, and whether
%% the new code has converted it. `none' in an application that has started with this version.
-type kept() :: #{md5 := binary(), state := term(), converted := boolean()}.

%% The state before the switch to a version.
-type resort() :: {starl_reload:count(), State :: term()}.

-record(code, {
    module :: module(),
    %% its versions, with {@link kept()}
    lineage :: starl_lineage:t(),
    %% reload commands, to be applied before the next step, in their order
    commands = [] :: [starl_reload:word()],
    %% the states with which it goes on, if the former code crashes with what new code has left
    resorts = [] :: [resort()]
}).

-opaque t() :: #code{}.

%% What is reported of the reload commands.
-type reports() :: [starl_reload:told()].

%% @doc The code of an application that starts.
-spec new(starl_lineage:t()) -> t().
new(Lineage) -> #code{module = starl_lineage:code(Lineage), lineage = Lineage}.

%% @doc The module that runs.
-spec module(t()) -> module().
module(#code{module = Module}) -> Module.

%% -- reload commands ------------------------------------------------------------------------

%% @doc A reload command has come. If the application is over, it comes too late. Code that was not
%% taken yet need not be taken back.
-spec received(starl_reload:word(), IsOver :: boolean(), t()) -> {reports(), t()}.
received({take, #{number := N}}, true, #code{lineage = Lineage} = Code) ->
    {[starl_reload:told(N, done, nobody, Lineage)], Code};
received({back, _, _}, true, Code) ->
    {[], Code};
received({back, N, Robot} = Command, false, #code{commands = Commands, lineage = Lineage} = Code) ->
    case [S || {take, #{number := M} = S} <- Commands, M =:= N] of
        [Switch | _] ->
            Reports = [starl_reload:told(N, {back, Robot}, nobody, Lineage)],
            {Reports, Code#code{commands = lists:delete({take, Switch}, Commands)}};
        [] ->
            {[], Code#code{commands = Commands ++ [Command]}}
    end;
received(Command, false, #code{commands = Commands} = Code) ->
    {[], Code#code{commands = Commands ++ [Command]}}.

%% @doc The first reload command that has come since the last step.
-spec next_command(t()) -> {starl_reload:word(), t()} | none.
next_command(#code{commands = []}) ->
    none;
next_command(#code{commands = [Command | Commands]} = Code) ->
    {Command, Code#code{commands = Commands}}.

%% @doc A reload command was applied, and others may have come meanwhile: `code_change/2' may block.
-spec with_later_commands(Applied :: t(), Present :: t()) -> t().
with_later_commands(Applied, #code{commands = Commands}) -> Applied#code{commands = Commands}.

%% @doc Applies a reload command before the next step. If it cannot be taken back, the application
%% crashes after its report.
-spec apply_command(starl_reload:word(), running(), NowUs :: integer(), t()) ->
    {ok, reports(), running(), t()} | {no_way_back, reports()}.
apply_command({take, #{number := N} = Switch}, Running, Now, #code{lineage = Lineage} = Code) ->
    case starl_lineage:has(N, Lineage) of
        %% it has started with this code
        true -> {ok, [], Running, Code};
        false -> taken(Switch, Running, Now, Code)
    end;
apply_command({back, N, Robot}, {_, State, _} = Running, _Now, #code{lineage = Lineage} = Code) ->
    case starl_lineage:leave(N, Lineage) of
        {left, Left, Earlier} ->
            sent_back({back, Robot}, Left, Earlier, State, Code);
        {skipped, Skipped} ->
            Reports = [starl_reload:told(N, {back, Robot}, nobody, Skipped)],
            {ok, Reports, Running, Code#code{lineage = Skipped}};
        unknown ->
            {ok, [], Running, Code}
    end.

taken(#{number := N, module := New} = Switch, {_Module, State, Md5} = Running, Now, Code) ->
    case carried(New, State, Md5) of
        {ok, Next} ->
            #code{lineage = Lineage} = Taken = on_trial(Switch, State, Md5, Now, Code),
            Reports = [starl_reload:told(N, taken, nobody, Lineage)],
            {ok, Reports, {New, Next, version(New)}, Taken};
        {failed, Cause} ->
            #code{lineage = Lineage} = Code,
            Reports = [starl_reload:told(N, {migration_failed, Cause}, nobody, Lineage)],
            {ok, Reports, Running, Code}
    end.

%% A state that no step of the former code has taken yet is not kept.
on_trial(#{module := New} = Switch, State, Md5, Now, #code{lineage = Lineage} = Code) ->
    {_, Proven} = lists:last([{New, State} | Code#code.resorts]),
    Taken = starl_lineage:take(Switch#{kept => kept(New, Proven, Md5)}, Now, Lineage),
    Code#code{module = New, lineage = Taken, resorts = []}.

sent_back(Outcome, Left, Earlier, State, Code) ->
    Reports = starl_reload:left(Outcome, nobody, {Left, Earlier}),
    case way_back(Left, Earlier, State) of
        none -> {no_way_back, Reports};
        {Former, Resorts} -> {ok, Reports, Former, back_on(Earlier, Resorts, Code)}
    end.

back_on(Earlier, Resorts, Code) ->
    Code#code{module = starl_lineage:code(Earlier), lineage = Earlier, resorts = Resorts}.

%% -- trials ---------------------------------------------------------------------------------

%% @doc A step of new code on trial may crash, and so may the first step after the return to the
%% former code.
-spec may_crash(NowUs :: integer(), t()) -> boolean().
may_crash(_Now, #code{resorts = [_ | _]}) -> true;
may_crash(Now, #code{lineage = Lineage}) -> starl_lineage:is_on_trial(Now, Lineage).

%% @doc A step has ended well.
-spec stepped(t()) -> t().
stepped(#code{resorts = []} = Code) -> Code;
stepped(Code) -> Code#code{resorts = []}.

%% @doc A step that may crash has crashed. Its effects stand, as after any crash, and the other
%% machines are notified of one. `none': the application itself crashes, and starts anew.
-spec taken_back(starl_crash:cause(), module(), State :: term(), t()) ->
    {reports(), running(), t()} | none.
taken_back(Cause, Module, _State, #code{resorts = [{N, Before} | Resorts]} = Code) ->
    Reports = [starl_reload:told(N, {restored, Cause}, others, Code#code.lineage)],
    {Reports, {Module, Before, version(Module)}, Code#code{resorts = Resorts}};
taken_back(Cause, _Module, State, #code{lineage = Lineage} = Code) ->
    {Left, Earlier} = starl_lineage:back(Lineage),
    case way_back(Left, Earlier, State) of
        none ->
            none;
        {Former, Resorts} ->
            Reports = starl_reload:left({crashed, Cause}, others, {Left, Earlier}),
            {Reports, Former, back_on(Earlier, Resorts, Code)}
    end.

%% -- states ---------------------------------------------------------------------------------

%% @doc The version of the code that is loaded.
-spec version(module()) -> binary().
version(Module) -> Module:module_info(md5).

%% @doc The state as this code takes it over from an older version.
-spec carried(module(), State :: term(), Old :: binary()) ->
    {ok, State :: term()} | {failed, starl_crash:cause()}.
carried(Module, State, Old) ->
    try
        {module, Module} = code:ensure_loaded(Module),
        {ok, starl_callback:call(Module, code_change, [State, Old], State)}
    catch
        Class:Reason:Stack ->
            {failed, starl_crash:cause(starl_crash:reason(Class, Reason, Stack))}
    end.

%% What is kept of the state before the switch to this module.
-spec kept(module(), State :: term(), Md5 :: binary()) -> kept().
kept(New, State, Md5) -> #{md5 => Md5, state => State, converted => converts(New)}.

converts(Module) -> starl_callback:exported(Module, code_change, 2).

%% The state with which the former code goes on: the one before the last version that has converted
%% it; and those to try next, if the former code crashes with that. `none': what has started with
%% code that converts states has none for the former code.
-spec way_back([starl_lineage:version()], starl_lineage:t(), State :: term()) ->
    none | {running(), [resort()]}.
way_back(Left, Earlier, State) ->
    Former = starl_lineage:code(Earlier),
    case lists:foldl(fun before/2, [{now, State}], Left) of
        [] -> none;
        [{_, Best} | Resorts] -> {{Former, Best, md5(Left, Former)}, Resorts}
    end.

-spec before(starl_lineage:version(), Best) -> Best when
    Best :: [{starl_reload:count() | now, State :: term()}].
before(#{number := N, kept := #{state := Before, converted := Converted}}, States) ->
    [State || State <- States, not Converted] ++ [{N, Before}];
before(#{module := Module, kept := none}, States) ->
    [State || State <- States, not converts(Module)].

%% The version of the former code that has made the state.
md5(Left, Former) ->
    case lists:last(Left) of
        #{kept := #{md5 := Md5}} -> Md5;
        #{kept := none} -> version(Former)
    end.
