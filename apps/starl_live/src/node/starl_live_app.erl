%% @doc The OTP application of a robot's Erlang node.
-module(starl_live_app).
-behaviour(application).

-export([start/2, stop/1]).

-spec start(application:start_type(), []) -> supervisor:startlink_ret().
start(_Type, []) -> starl_live_sup:start_link().

-spec stop(term()) -> ok.
stop(_State) -> ok.
