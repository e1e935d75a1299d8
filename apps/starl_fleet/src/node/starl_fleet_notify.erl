%% @doc Sends a service's notifications to systemd (manual page sd_notify). They are datagrams to
%% the socket that the environment names. Without systemd nobody receives them.
-module(starl_fleet_notify).

-export([here/0, new/2, period_ms/1, tell/2]).

-export_type([t/0]).

-record(notify, {
    socket :: gen_udp:socket() | none,
    path = none :: binary() | none,
    period_ms :: pos_integer()
}).

-opaque t() :: #notify{}.

%% Where systemd expects nothing, the robot is still looked at.
-define(USUAL_MS, 5000).

%% @doc The line to the service manager of this VM.
-spec here() -> t().
here() -> new(os:getenv("NOTIFY_SOCKET", ""), os:getenv("WATCHDOG_USEC", "")).

%% @doc A line to a socket. A name that begins with `@' is in Linux' abstract space. The watchdog is
%% fed twice in its time.
-spec new(Socket :: string(), WatchdogUs :: string()) -> t().
new("", Us) ->
    #notify{socket = none, period_ms = period(string:to_integer(Us))};
new(Name, Us) ->
    {ok, Socket} = gen_udp:open(0, [local]),
    #notify{socket = Socket, path = path(Name), period_ms = period(string:to_integer(Us))}.

path([$@ | Name]) -> <<0, (unicode:characters_to_binary(Name))/binary>>;
path(Name) -> unicode:characters_to_binary(Name).

period({Us, _}) when is_integer(Us) -> max(1, Us div 2000);
period(_) -> ?USUAL_MS.

%% @doc The time between two notifications to the watchdog.
-spec period_ms(t()) -> pos_integer().
period_ms(#notify{period_ms = Ms}) -> Ms.

%% @doc Sends a notification, such as `READY=1'.
-spec tell(string(), t()) -> ok.
tell(_Word, #notify{socket = none}) ->
    ok;
tell(Word, #notify{socket = Socket, path = Path}) ->
    case gen_udp:send(Socket, {local, Path}, 0, Word) of
        ok -> ok;
        {error, Why} -> logger:warning(#{what => service_manager_deaf, word => Word, why => Why})
    end.
