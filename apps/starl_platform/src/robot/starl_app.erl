%% @doc The behaviour of a sequential application, which reads like the paper's pseudo-code.
%%
%% `step/2' is the body of "repeat … until done". It may block in `starl:send', `starl:await',
%% `starl:go_to', `starl:sleep' and in the calls of the building blocks. The runtime calls it
%% through its fully qualified name, so newly loaded code takes effect at the next step; an
%% optional `code_change/2' (old state, old module version) converts the state. If that fails,
%% the application waits with its old state before the next step until other code is loaded that can
%% convert the state; the old code can, too. The rest of the robot goes on. Earlier effects of the
%% application, and messages that arrive meanwhile, are kept.
%%
%% An application may also list its building blocks and its options; with its blocks it gets their
%% contracts. It may have contracts of its own ({@link starl_monitor}), and figures for the
%% report: `report/2' of the behaviour {@link starl_scene}. An application with a scene of its own also has the behaviour {@link starl_scene}.
-module(starl_app).

-export([options/1]).

%% `Args' are the values of the application's options, unless its scene says otherwise.
-callback init(starl:robot(), Args :: term()) -> State :: term().
-callback step(starl:robot(), State :: term()) -> {continue, State :: term()} | {done, term()}.
-callback code_change(State :: term(), OldVsn :: term()) -> State :: term().
%% The building blocks of the application, as in `[starl_election, {starl_mutex, #{lease_ms =>
%% 2000}}]'; not needed with a scene of its own.
-callback blocks() -> [starl_block:entry()].
-callback options() -> [starl_options:option()].
%% The application's own contracts, with the configuration of each.
-callback monitors(starl_scene:context()) -> [{module(), Config :: map()}].

-optional_callbacks([code_change/2, blocks/0, options/0, monitors/1]).

%% @doc The application's own options.
-spec options(module()) -> [starl_options:option()].
options(App) ->
    _ = code:ensure_loaded(App),
    case erlang:function_exported(App, options, 0) of
        true -> App:options();
        false -> []
    end.
