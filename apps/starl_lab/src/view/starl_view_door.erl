%% @doc Decides which connections to the window stay open. A client shows the token when it asks for a WebSocket, so a
%% new connection is a stranger. There is always room for one more: with too many strangers, the oldest stranger of the
%% address that has most of them is closed. A connection that has shown the token stays.
%%
%% Each connection is handled by cowboy; this is the protocol that ranch starts for it.
-module(starl_view_door).
-behaviour(gen_server).
-behaviour(ranch_protocol).

-export([start_link/0, start_link/3, strangers/1, knows/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

%% More than a browser and some viewers need to load their pages.
-define(MOST_STRANGERS, 128).

%% A connection; its address and socket are looked up when there are too many.
-type stranger() :: {pid(), unknown | {inet:ip_address(), inet:socket()}}.

%% The strangers, the oldest first: the numbers count them.
-record(door, {
    next = 1 :: pos_integer(),
    strangers = #{} :: #{pos_integer() => stranger()},
    numbers = #{} :: #{pid() => pos_integer()}
}).

%% @doc A door without connections.
-spec start_link() -> gen_server:start_ret().
start_link() -> gen_server:start_link(?MODULE, none, []).

%% @doc The number of connections that have not shown the token.
-spec strangers(pid()) -> non_neg_integer().
strangers(Door) -> gen_server:call(Door, strangers, infinity).

%% @doc The calling connection has shown the token.
-spec knows(pid()) -> ok.
knows(Door) -> gen_server:cast(Door, {knows, self()}).

%% @private A connection begins (called by ranch).
-spec start_link(ranch:ref(), module(), map()) -> {ok, pid()}.
start_link(Ref, Transport, #{env := #{door := Door}} = Options) ->
    {ok, Connection} = cowboy_clear:start_link(Ref, Transport, Options),
    ok = gen_server:cast(Door, {enters, Connection}),
    {ok, Connection}.

-spec init(none) -> {ok, #door{}}.
init(none) -> {ok, #door{}}.

-spec handle_call(strangers, gen_server:from(), #door{}) -> {reply, non_neg_integer(), #door{}}.
handle_call(strangers, _From, #door{strangers = Strangers} = Door) ->
    {reply, map_size(Strangers), Door}.

-spec handle_cast({enters | knows, pid()}, #door{}) -> {noreply, #door{}}.
handle_cast({enters, Connection}, #door{next = N, strangers = Strangers, numbers = Numbers}) ->
    _ = monitor(process, Connection),
    {noreply,
        shut(#door{
            next = N + 1,
            strangers = Strangers#{N => {Connection, unknown}},
            numbers = Numbers#{Connection => N}
        })};
handle_cast({knows, Connection}, Door) ->
    {noreply, forget(Connection, Door)}.

-spec handle_info(term(), #door{}) -> {noreply, #door{}}.
handle_info({'DOWN', _, process, Connection, _}, Door) -> {noreply, forget(Connection, Door)};
handle_info(_, Door) -> {noreply, Door}.

forget(Connection, #door{strangers = Strangers, numbers = Numbers} = Door) ->
    case maps:take(Connection, Numbers) of
        {N, Left} -> Door#door{strangers = maps:remove(N, Strangers), numbers = Left};
        error -> Door
    end.

shut(#door{strangers = Strangers} = Door) when map_size(Strangers) =< ?MOST_STRANGERS -> Door;
shut(#door{strangers = Strangers} = Door) ->
    Known = maps:map(fun looked_up/2, Strangers),
    case crowd(lists:sort(maps:to_list(Known))) of
        [{_, {Connection, {_, Socket}}} | _] ->
            %% the connection ends itself, without a report
            _ = gen_tcp:shutdown(Socket, read_write),
            forget(Connection, Door#door{strangers = Known});
        [] ->
            Door#door{strangers = Known}
    end.

%% The strangers of the address that has most of them.
crowd(Strangers) ->
    Crowds = maps:groups_from_list(
        fun({_, {_, {Ip, _}}}) -> Ip end, [S || {_, {_, {_, _}}} = S <- Strangers]
    ),
    {_, Crowd} = lists:max([{0, []} | [{length(C), C} || C <- maps:values(Crowds)]]),
    Crowd.

%% A connection that has only begun, or has ended, has no socket. It takes time to ask a process, so each is asked
%% but once, as a rule.
looked_up(_N, {Connection, unknown}) ->
    Links =
        case erlang:process_info(Connection, links) of
            {links, All} -> All;
            undefined -> []
        end,
    Peers = [{Ip, S} || S <- Links, is_port(S), {ok, {Ip, _}} <- [inet:peername(S)]],
    {Connection, hd(Peers ++ [unknown])};
looked_up(_N, Known) ->
    Known.
