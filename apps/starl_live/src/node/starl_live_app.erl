%% @doc The OTP application of a robot's Erlang node.
-module(starl_live_app).
-behaviour(application).

-export([start/2, stop/1]).

-spec start(application:start_type(), []) -> {ok, pid()} | {error, term()}.
start(_Type, []) ->
    case starl_live_sup:start_link() of
        {ok, Pid} -> {ok, Pid};
        {error, _} = Error -> Error
    end.

-spec stop(term()) -> ok.
stop(_State) -> ok.
