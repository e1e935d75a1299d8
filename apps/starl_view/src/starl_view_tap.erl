%% @doc Looks on at a run for a window: a monitor that judges nothing and tells every event to the
%% window's hub ({@link starl_view_hub}).
-module(starl_view_tap).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-record(tap, {hub :: pid(), from_us :: integer()}).

-spec interests() -> all.
interests() -> all.

%% @doc `from_us': the hub knows all events before this time already.
-spec init(#{hub := pid(), from_us => integer()}) -> #tap{}.
init(#{hub := Hub} = Config) -> #tap{hub = Hub, from_us = maps:get(from_us, Config, 0)}.

-spec step(starl_monitor:trace_event(), #tap{}) -> {ok, #tap{}}.
step({T, Robot, Machine, Event}, #tap{hub = Hub, from_us = From} = Tap) when T >= From ->
    Hub ! {trace, T, {Robot, Machine, Event}},
    {ok, Tap};
step(_Known, Tap) ->
    {ok, Tap}.

-spec finish(integer(), #tap{}) -> {ok, #{}}.
finish(_EndUs, _Tap) -> {ok, #{}}.
