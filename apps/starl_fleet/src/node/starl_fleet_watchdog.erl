%% @doc Checks the robot of this node, and notifies systemd while the robot's link answers. A node
%% whose robot hangs is killed and started anew.
-module(starl_fleet_watchdog).
-behaviour(gen_server).

-export([start_link/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-record(watchdog, {
    notify :: starl_fleet_notify:t(),
    answers :: fun((TimeoutMs :: pos_integer()) -> boolean()),
    is_ready = false :: boolean()
}).

%% @doc Starts the watchdog with its connection to systemd, and a function that checks whether the
%% robot answers.
-spec start_link(starl_fleet_notify:t(), fun((TimeoutMs :: pos_integer()) -> boolean())) ->
    gen_server:start_ret().
start_link(Notify, Answers) -> gen_server:start_link(?MODULE, {Notify, Answers}, []).

-spec init({starl_fleet_notify:t(), fun((pos_integer()) -> boolean())}) -> {ok, #watchdog{}}.
init({Notify, Answers}) ->
    self() ! look,
    {ok, #watchdog{notify = Notify, answers = Answers}}.

-spec handle_call(term(), gen_server:from(), #watchdog{}) -> {reply, ok, #watchdog{}}.
handle_call(_Question, _From, Watchdog) -> {reply, ok, Watchdog}.

-spec handle_cast(term(), #watchdog{}) -> {noreply, #watchdog{}}.
handle_cast(_Request, Watchdog) -> {noreply, Watchdog}.

-spec handle_info(look, #watchdog{}) -> {noreply, #watchdog{}}.
handle_info(look, #watchdog{notify = Notify, answers = Answers} = Watchdog) ->
    Period = starl_fleet_notify:period_ms(Notify),
    _ = erlang:send_after(Period, self(), look),
    case Answers(Period) of
        true -> {noreply, alive(Watchdog)};
        false -> {noreply, Watchdog}
    end.

alive(#watchdog{notify = Notify, is_ready = false} = Watchdog) ->
    ok = starl_fleet_notify:tell("READY=1", Notify),
    alive(Watchdog#watchdog{is_ready = true});
alive(#watchdog{notify = Notify} = Watchdog) ->
    ok = starl_fleet_notify:tell("WATCHDOG=1", Notify),
    Watchdog.
