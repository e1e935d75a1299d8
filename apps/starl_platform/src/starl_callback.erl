%% @doc Calls optional callbacks. Functions of a module that is not loaded count as not exported, so
%% the module is loaded first.
-module(starl_callback).

-export([call/4, exported/3]).

%% @doc Calls an optional callback; without it the result is the default.
-spec call(module(), Function :: atom(), Args :: [term()], Default) -> Result :: term() | Default.
call(Module, Function, Args, Default) ->
    case exported(Module, Function, length(Args)) of
        true -> apply(Module, Function, Args);
        false -> Default
    end.

%% @doc Does the module export this function?
-spec exported(module(), Function :: atom(), arity()) -> boolean().
exported(Module, Function, Arity) ->
    _ = erlang:module_loaded(Module) orelse code:ensure_loaded(Module),
    erlang:function_exported(Module, Function, Arity).
