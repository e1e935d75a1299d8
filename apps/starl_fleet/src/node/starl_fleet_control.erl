%% @doc A socket in the robot's directory, through which `bin/robot' asks the running node. A
%% question is a line of words, the answer one Erlang term. Only the user of the node may open the
%% socket.
-module(starl_fleet_control).

-export([start_link/1, ask/3, is_used/1]).
-export([init/1]).

-define(SOCKET, "control").
-define(QUESTION_MS, 5000).

%% @doc Listens.
-spec start_link(starl_fleet_place:t()) -> {ok, pid()} | {error, term()}.
start_link(Place) -> proc_lib:start_link(?MODULE, init, [Place]).

%% @doc Asks the node of a robot, from another VM; `none': no node listens.
-spec ask(State :: file:filename(), Question :: [string()], TimeoutMs :: pos_integer()) ->
    {ok, term()} | none.
ask(State, Question, Ms) ->
    Address = {local, filename:join(State, ?SOCKET)},
    case gen_tcp:connect(Address, 0, [binary, {active, false}], Ms) of
        {ok, Socket} ->
            ok = gen_tcp:send(Socket, [lists:join($\s, Question), $\n]),
            Answer = rest(Socket, Ms, <<>>),
            ok = gen_tcp:close(Socket),
            Answer;
        {error, _} ->
            none
    end.

%% @doc Does a node listen at the socket in this directory? The socket of a node that was killed is
%% there, and nobody listens.
-spec is_used(State :: file:filename()) -> boolean().
is_used(State) ->
    case gen_tcp:connect({local, filename:join(State, ?SOCKET)}, 0, [], ?QUESTION_MS) of
        {ok, Socket} ->
            ok = gen_tcp:close(Socket),
            true;
        {error, _} ->
            false
    end.

rest(Socket, Ms, Text) ->
    case gen_tcp:recv(Socket, 0, Ms) of
        {ok, More} -> rest(Socket, Ms, <<Text/binary, More/binary>>);
        {error, closed} -> starl_fleet_term:read(Text);
        {error, _} -> none
    end.

%% @private
-spec init(starl_fleet_place:t()) -> no_return().
init(#{state := State} = Place) ->
    Path = filename:join(State, ?SOCKET),
    ok = filelib:ensure_path(State),
    _ = file:delete(Path),
    Options = [binary, {active, false}, {packet, line}, {ifaddr, {local, Path}}],
    {ok, Listen} = gen_tcp:listen(0, Options),
    ok = file:change_mode(Path, 8#600),
    proc_lib:init_ack({ok, self()}),
    serve(Listen, Place).

serve(Listen, Place) ->
    {ok, Socket} = gen_tcp:accept(Listen),
    _ = answered(gen_tcp:recv(Socket, 0, ?QUESTION_MS), Socket),
    ok = gen_tcp:close(Socket),
    serve(Listen, Place).

answered({ok, Line}, Socket) ->
    Words = string:lexemes(binary_to_list(string:trim(Line)), " "),
    gen_tcp:send(Socket, starl_fleet_term:write(answer(Words)));
answered({error, _}, _Socket) ->
    ok.

answer(["status"]) -> starl_fleet_node:status();
answer(["reload" | Words]) -> starl_fleet_reload:answer(Words);
answer(_) -> {error, "unknown question"}.
