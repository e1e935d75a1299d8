%% @doc Looks at the robot of this node, and tells systemd that it is there. The watchdog is fed only
%% while the robot's link answers: a node whose robot hangs is killed and started anew.
-module(starl_fleet_watchdog).
-behaviour(gen_server).

-export([start_link/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-record(watchdog, {notify :: starl_fleet_notify:t(), said = [] :: [ready]}).

%% @doc Starts the watchdog, with its line to systemd.
-spec start_link(starl_fleet_notify:t()) -> gen_server:start_ret().
start_link(Notify) -> gen_server:start_link(?MODULE, Notify, []).

-spec init(starl_fleet_notify:t()) -> {ok, #watchdog{}}.
init(Notify) ->
    self() ! look,
    {ok, #watchdog{notify = Notify}}.

-spec handle_call(term(), gen_server:from(), #watchdog{}) -> {reply, ok, #watchdog{}}.
handle_call(_Question, _From, Watchdog) -> {reply, ok, Watchdog}.

-spec handle_cast(term(), #watchdog{}) -> {noreply, #watchdog{}}.
handle_cast(_Request, Watchdog) -> {noreply, Watchdog}.

-spec handle_info(look, #watchdog{}) -> {noreply, #watchdog{}}.
handle_info(look, #watchdog{notify = Notify} = Watchdog) ->
    Period = starl_fleet_notify:period_ms(Notify),
    _ = erlang:send_after(Period, self(), look),
    case starl_fleet_node:answers(Period) of
        true -> {noreply, alive(Watchdog)};
        false -> {noreply, Watchdog}
    end.

alive(#watchdog{notify = Notify, said = []} = Watchdog) ->
    ok = starl_fleet_notify:tell("READY=1", Notify),
    alive(Watchdog#watchdog{said = [ready]});
alive(#watchdog{notify = Notify} = Watchdog) ->
    ok = starl_fleet_notify:tell("WATCHDOG=1", Notify),
    Watchdog.
