%% @doc A window onto the team: a web server on this computer with one page. The page shows a run
%% while it goes on, or a recording. In a run, the user can also apply faults from it.
%% ```
%%   {ok, View} = starl_view:start(#{port => 0}),
%%   io:format("~ts~n", [starl_view:address(View)]),
%%   Hub = starl_view:hub(View).        % reports what happens (starl_view_hub)
%% '''
-module(starl_view).

-export([start/1, stop/1, address/1, hub/1, door/1, format_error/1]).

-export_type([t/0, options/0, reason/0]).

-record(view, {
    name :: reference(), hub :: pid(), feed :: pid(), door :: pid(), address :: binary()
}).

-opaque t() :: #view{}.

%% `port' 0: a free one. `host': the address to listen at, by default only this computer's own.
%% Every page needs the token in the address that {@link address/1} returns.
-type options() :: #{
    port => inet:port_number(),
    host => string(),
    most_bytes => pos_integer(),
    most_waiting => pos_integer()
}.

-define(REQUEST_MS, 5000).

-type reason() ::
    {address, string(), inet:posix()} | {listen, string(), inet:port_number(), term()} | no_cowboy.

%% @doc Starts the server and its hub, linked to the calling process.
-spec start(options()) -> {ok, t()} | {error, reason()}.
start(Options) ->
    Host = maps:get(host, Options, "127.0.0.1"),
    case {application:ensure_all_started(cowboy), inet:getaddr(Host, family(Host))} of
        {{error, _}, _} -> {error, no_cowboy};
        {_, {error, Posix}} -> {error, {address, Host, Posix}};
        {{ok, _}, {ok, Ip}} -> listen(free(Ip, Options), Ip, Host, Options)
    end.

%% Ranch writes reports if a port is taken, beside its answer: so it is tried before.
free(Ip, Options) ->
    case ranch_tcp:listen(#{socket_opts => [{ip, Ip}, {port, maps:get(port, Options, 0)}]}) of
        {ok, Socket} -> gen_tcp:close(Socket);
        {error, _} = Error -> Error
    end.

family(Host) ->
    case lists:member($:, Host) of
        true -> inet6;
        false -> inet
    end.

listen({error, Why}, _Ip, Host, Options) ->
    {error, {listen, Host, maps:get(port, Options, 0), Why}};
listen(ok, Ip, Host, Options) ->
    Port = maps:get(port, Options, 0),
    {ok, Hub} = starl_view_hub:start_link(maps:with([most_bytes], Options)),
    {ok, Feed} = starl_view_foxglove_feed:start_link(maps:with([most_waiting], Options)),
    ok = starl_view_hub:tap(Hub, Feed),
    {ok, Door} = starl_view_door:start_link(),
    Guard = starl_view_guard:new(Ip),
    Name = make_ref(),
    Transport = #{
        socket_opts => [{ip, Ip}, {port, Port}],
        %% the door keeps them few, and never waits
        max_connections => infinity,
        num_acceptors => 4,
        connection_type => supervisor
    },
    Files = #{files => starl_view_page:files()},
    Protocol = protocol(Files#{hub => Hub, feed => Feed, door => Door, guard => Guard}),
    case ranch:start_listener(Name, ranch_tcp, Transport, starl_view_door, Protocol) of
        {ok, _} ->
            Address = address(Host, ranch:get_port(Name), Guard),
            {ok, #view{name = Name, hub = Hub, feed = Feed, door = Door, address = Address}};
        {error, Why} ->
            ok = ended([Hub, Feed, Door]),
            {error, {listen, Host, Port, Why}}
    end.

protocol(#{door := Door} = State) ->
    Routes = [
        {'_', [
            {"/ws", starl_view_socket, State},
            {"/foxglove", starl_view_foxglove, State},
            {'_', starl_view_page, State}
        ]}
    ],
    #{
        env => #{dispatch => cowboy_router:compile(Routes), door => Door},
        connection_type => supervisor,
        max_keepalive => 1000,
        %% a connection that asks for nothing, or goes on asking, is closed
        request_timeout => ?REQUEST_MS
    }.

address(Host, Port, Guard) ->
    Shown =
        case Host of
            "0.0.0.0" -> reachable({203, 0, 113, 1}, inet);
            "::" -> reachable({16#2001, 16#db8, 0, 0, 0, 0, 0, 1}, inet6);
            _ -> Host
        end,
    Bracketed =
        case lists:member($:, Shown) of
            true -> ["[", Shown, "]"];
            false -> Shown
        end,
    Token = starl_view_guard:token(Guard),
    unicode:characters_to_binary(io_lib:format("http://~ts:~b/#~ts", [Bracketed, Port, Token])).

%% The address from which this computer would send to another network: other computers, and telephones, which
%% know no names of a home, reach it there. Nothing is sent. Without a network, its name.
reachable(Elsewhere, Family) ->
    {ok, Socket} = gen_udp:open(0, [Family]),
    Shown =
        case {gen_udp:connect(Socket, Elsewhere, 9), inet:sockname(Socket)} of
            {ok, {ok, {Ip, _}}} -> inet:ntoa(Ip);
            _ -> on_a_network(Family)
        end,
    ok = gen_udp:close(Socket),
    Shown.

%% The first address that is not this computer's alone: a network may lead to no other one.
on_a_network(Family) ->
    {ok, Interfaces} = inet:getifaddrs(),
    Ips = [
        Ip
     || {_, Facts} <- Interfaces,
        lists:member(up, proplists:get_value(flags, Facts, [])),
        {addr, Ip} <- Facts,
        tuple_size(Ip) =:= tuple_size(any(Family)),
        not starl_view_guard:is_near(Ip)
    ],
    case Ips of
        [Ip | _] -> inet:ntoa(Ip);
        [] -> element(2, inet:gethostname())
    end.

any(inet) -> {0, 0, 0, 0};
any(inet6) -> {0, 0, 0, 0, 0, 0, 0, 0}.

%% @doc Ends the server.
-spec stop(t()) -> ok.
stop(#view{name = Name, hub = Hub, feed = Feed, door = Door}) ->
    _ = cowboy:stop_listener(Name),
    ended([Hub, Feed, Door]).

ended(Pids) ->
    _ = [{unlink(Pid), exit(Pid, shutdown)} || Pid <- Pids],
    ok.

%% @doc The address of the page. It contains a token that nobody else should see.
-spec address(t()) -> binary().
address(#view{address = Address}) -> Address.

%% @doc The hub.
-spec hub(t()) -> pid().
hub(#view{hub = Hub}) -> Hub.

%% @doc The door, which knows of the connections.
-spec door(t()) -> pid().
door(#view{door = Door}) -> Door.

%% @doc One line on an error.
-spec format_error(reason()) -> unicode:chardata().
format_error(no_cowboy) ->
    "the web server cowboy is not there; ./starl setup gets it";
format_error({address, Host, Posix}) ->
    io_lib:format("--view-host ~ts: ~ts", [Host, inet:format_error(Posix)]);
format_error({listen, Host, Port, eaddrinuse}) ->
    io_lib:format("--view-port ~b: another program has this port at ~ts", [Port, Host]);
format_error({listen, Host, Port, Why}) when is_atom(Why) ->
    io_lib:format("--view-port ~b at ~ts: ~ts", [Port, Host, inet:format_error(Why)]);
format_error({listen, Host, Port, Why}) ->
    io_lib:format("--view-port ~b at ~ts: ~0tP", [Port, Host, Why, 10]).
