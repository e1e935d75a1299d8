%% @doc Checks the robot of this node, and notifies systemd while the robot's link answers. A node
%% whose robot hangs is killed and started anew. A node whose watcher (the daemon of `bin/robot') has
%% ended stops, since nobody would start it anew.
%%
%% Notifications are datagrams to the socket that the environment names (manual page sd_notify).
%% Without systemd nobody receives them.
-module(starl_fleet_watchdog).
-behaviour(gen_server).

-export([start_link/3, systemd/0, watcher/0]).
-export([parent/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([systemd/0]).

%% The name of systemd's socket, and the time in which it expects a notification, in microseconds. Both
%% are empty where there is none.
-type systemd() :: {Socket :: string(), WatchdogUs :: string()}.

%% The process that watches this VM, its parent; `none': systemd, or nobody.
-type watcher() :: none | {Pid :: string(), Ended :: fun(() -> ok)}.

-type answers() :: fun((TimeoutMs :: pos_integer()) -> boolean()).

-record(watchdog, {
    socket :: gen_udp:socket() | none,
    path = none :: binary() | none,
    period_ms :: pos_integer(),
    answers :: answers(),
    watcher :: watcher(),
    is_ready = false :: boolean()
}).

%% Where systemd expects nothing, the robot is still checked.
-define(USUAL_MS, 5000).

%% @doc The service manager of this VM.
-spec systemd() -> systemd().
systemd() -> {os:getenv("NOTIFY_SOCKET", ""), os:getenv("WATCHDOG_USEC", "")}.

%% @doc The watcher that the environment names; without it the VM stops.
-spec watcher() -> watcher().
watcher() ->
    case os:getenv("STARL_WATCHER", "") of
        "" -> none;
        Pid -> {Pid, fun init:stop/0}
    end.

%% @doc The parent of a process of this computer.
-spec parent(Pid :: string()) -> {ok, Pid :: string()} | {error, unknown}.
parent(Pid) ->
    %% the name of the program, in brackets, may hold anything
    case file:read_file("/proc/" ++ Pid ++ "/stat") of
        {ok, Stat} ->
            [_, Rest] = string:split(binary_to_list(Stat), ")", trailing),
            [_State, Parent | _] = string:lexemes(Rest, " "),
            {ok, Parent};
        {error, _} ->
            {error, unknown}
    end.

%% @doc Starts the watchdog with a function that checks whether the robot answers.
-spec start_link(systemd(), watcher(), answers()) -> gen_server:start_ret().
start_link(Systemd, Watcher, Answers) ->
    gen_server:start_link(?MODULE, {Systemd, Watcher, Answers}, []).

-spec init({systemd(), watcher(), answers()}) -> {ok, #watchdog{}}.
init({{Name, Us}, Watcher, Answers}) ->
    self() ! look,
    Watchdog = #watchdog{
        socket = none,
        period_ms = period_ms(string:to_integer(Us)),
        answers = Answers,
        watcher = Watcher
    },
    {ok, connected(Name, Watchdog)}.

%% The watchdog is fed twice in its time.
period_ms({Us, _}) when is_integer(Us) -> max(1, Us div 2000);
period_ms(_) -> ?USUAL_MS.

%% A name that begins with `@' is in Linux' abstract space.
connected("", Watchdog) ->
    Watchdog;
connected(Name, Watchdog) ->
    {ok, Socket} = gen_udp:open(0, [local]),
    Watchdog#watchdog{socket = Socket, path = path(Name)}.

path([$@ | Name]) -> <<0, (unicode:characters_to_binary(Name))/binary>>;
path(Name) -> unicode:characters_to_binary(Name).

-spec handle_call(term(), gen_server:from(), #watchdog{}) -> {reply, ok, #watchdog{}}.
handle_call(_Question, _From, Watchdog) -> {reply, ok, Watchdog}.

-spec handle_cast(term(), #watchdog{}) -> {noreply, #watchdog{}}.
handle_cast(_Request, Watchdog) -> {noreply, Watchdog}.

-spec handle_info(look, #watchdog{}) -> {noreply, #watchdog{}}.
handle_info(look, #watchdog{period_ms = Period, answers = Answers} = Watchdog) ->
    ok = watched(Watchdog#watchdog.watcher),
    _ = erlang:send_after(Period, self(), look),
    case Answers(Period) of
        true -> {noreply, alive(Watchdog)};
        false -> {noreply, Watchdog}
    end.

watched(none) ->
    ok;
watched({Pid, Ended}) ->
    case parent(os:getpid()) of
        {ok, Parent} when Parent =/= Pid ->
            logger:error(#{what => watcher_ended, pid => Pid}),
            Ended();
        _ ->
            ok
    end.

alive(#watchdog{is_ready = false} = Watchdog) ->
    ok = notify("READY=1", Watchdog),
    alive(Watchdog#watchdog{is_ready = true});
alive(Watchdog) ->
    ok = notify("WATCHDOG=1", Watchdog),
    Watchdog.

notify(_State, #watchdog{socket = none}) ->
    ok;
notify(State, #watchdog{socket = Socket, path = Path}) ->
    case gen_udp:send(Socket, {local, Path}, 0, State) of
        ok -> ok;
        {error, Why} -> logger:warning(#{what => service_manager_deaf, word => State, why => Why})
    end.
