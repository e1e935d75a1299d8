%% @doc Versions of an application's code, and its state under each: what new code makes of the state of the former
%% one, and with which state the former code goes on when the new one is left. A part of {@link starl_app_proc}.
-module(starl_app_code).

-export([version/1, carried/3, kept/3, way_back/3]).

-export_type([kept/0, resort/0, running/0]).

%% What runs: the module, its next state, and the version of the code that has made it.
-type running() :: {module(), State :: term(), Md5 :: binary()}.

%% The way back from a version: that of the code before, the state before the switch, and whether
%% the new code has converted it. `none' in an application that has started with this version.
-type kept() :: #{md5 := binary(), state := term(), converted := boolean()}.

%% The state before the switch to a version.
-type resort() :: {starl_reload:count(), State :: term()}.

%% @doc The version of the code that is loaded.
-spec version(module()) -> binary().
version(Module) -> Module:module_info(md5).

%% @doc The state as this code takes it over from an older version.
-spec carried(module(), State :: term(), Old :: binary()) ->
    {ok, State :: term()} | {failed, starl_crash:cause()}.
carried(Module, State, Old) ->
    try
        {module, Module} = code:ensure_loaded(Module),
        case erlang:function_exported(Module, code_change, 2) of
            true -> {ok, Module:code_change(State, Old)};
            false -> {ok, State}
        end
    catch
        Class:Reason:Stack ->
            {failed, starl_crash:cause(starl_crash:reason(Class, Reason, Stack))}
    end.

%% @doc What is kept of the state before the switch to this module.
-spec kept(module(), State :: term(), Md5 :: binary()) -> kept().
kept(New, State, Md5) -> #{md5 => Md5, state => State, converted => converts(New)}.

converts(Module) -> erlang:function_exported(Module, code_change, 2).

%% @doc The state with which the former code goes on: the one before the last version that has converted
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
