%% A WebSocket client for tests, as good or as bad as a test wants.
-module(starl_view_client).

-export([connect/2, connect/3, get/3, send/2, raw/2, rows/2, next/2, frame/2, close/1]).

-define(PATIENCE_MS, 20000).

connect(Port, Headers) -> connect(Port, "/ws", Headers).

%% The status line of the answer, and the socket.
connect(Port, Path, Headers) ->
    Upgrade = [
        {"Upgrade", "websocket"},
        {"Connection", "Upgrade"},
        {"Sec-WebSocket-Version", "13"},
        {"Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="}
    ],
    asked(Port, Path, Upgrade ++ Headers).

get(Port, Path, Headers) ->
    {Status, Socket} = asked(Port, Path, Headers ++ [{"Connection", "close"}]),
    Body = body(Socket, <<>>),
    {Status, Body}.

%% With the token of the page's address, or without one.
asked({Port, Token}, Path, Headers) ->
    Mark =
        case lists:member($?, Path) of
            true -> "&";
            false -> "?"
        end,
    asked(Port, Path ++ Mark ++ "token=" ++ Token, Headers);
asked(Port, Path, Headers) ->
    {ok, Socket} = gen_tcp:connect({127, 0, 0, 1}, Port, [binary, {active, false}, {recbuf, 4096}]),
    Own = [
        {"Host", "127.0.0.1:" ++ integer_to_list(Port)}
     || not lists:keymember("Host", 1, Headers)
    ],
    Lines = [[Name, ": ", Value, "\r\n"] || {Name, Value} <- Own ++ Headers],
    ok = gen_tcp:send(Socket, ["GET ", Path, " HTTP/1.1\r\n", Lines, "\r\n"]),
    ok = inet:setopts(Socket, [{packet, http_bin}]),
    {ok, {http_response, _, Status, _}} = gen_tcp:recv(Socket, 0, ?PATIENCE_MS),
    ok = headers(Socket),
    ok = inet:setopts(Socket, [{packet, raw}]),
    {Status, Socket}.

headers(Socket) ->
    case gen_tcp:recv(Socket, 0, ?PATIENCE_MS) of
        {ok, http_eoh} -> ok;
        {ok, {http_header, _, _, _, _}} -> headers(Socket)
    end.

body(Socket, Body) ->
    case gen_tcp:recv(Socket, 0, ?PATIENCE_MS) of
        {ok, More} -> body(Socket, <<Body/binary, More/binary>>);
        {error, closed} -> Body
    end.

%% A text, masked as a client's must be.
send(Text, Socket) ->
    Bytes = iolist_to_binary(Text),
    Size = byte_size(Bytes),
    Length =
        if
            Size < 126 -> <<1:1, Size:7>>;
            Size < 65536 -> <<1:1, 126:7, Size:16>>;
            true -> <<1:1, 127:7, Size:64>>
        end,
    raw([<<1:1, 0:3, 1:4>>, Length, <<0:32>>, Bytes], Socket).

raw(Bytes, Socket) -> gen_tcp:send(Socket, Bytes).

%% The next message: the rows of a text, or {close, Code}.
next(Socket, Ms) ->
    case gen_tcp:recv(Socket, 2, Ms) of
        {ok, <<_:4, Type:4, 0:1, Length:7>>} -> message(Type, sized(Length, Socket), Socket);
        {error, _} = Error -> Error
    end.

sized(126, Socket) ->
    {ok, <<Size:16>>} = gen_tcp:recv(Socket, 2, ?PATIENCE_MS),
    Size;
sized(127, Socket) ->
    {ok, <<Size:64>>} = gen_tcp:recv(Socket, 8, ?PATIENCE_MS),
    Size;
sized(Size, _Socket) ->
    Size.

%% The next message as it is, with its type: 1 a text, 2 bytes, 8 the end.
frame(Socket, Ms) ->
    case gen_tcp:recv(Socket, 2, Ms) of
        {ok, <<_:4, Type:4, 0:1, 0:7>>} ->
            {Type, <<>>};
        {ok, <<_:4, Type:4, 0:1, Length:7>>} ->
            {ok, Content} = gen_tcp:recv(Socket, sized(Length, Socket), ?PATIENCE_MS),
            {Type, Content};
        {error, _} = Error ->
            Error
    end.

message(_Type, 0, _Socket) ->
    {rows, []};
message(Type, Size, Socket) ->
    {ok, Content} = gen_tcp:recv(Socket, Size, ?PATIENCE_MS),
    case {Type, Content} of
        {1, _} ->
            {ok, Rows} = starl_json:decode(Content),
            {rows, Rows};
        {8, <<Code:16, _/binary>>} ->
            {close, Code};
        {Type, _} ->
            {other, Type}
    end.

%% Reads, and acknowledges, until a row of a kind has come: all rows.
rows(Kind, Socket) ->
    {rows, Rows} = next(Socket, ?PATIENCE_MS),
    ok = send("k", Socket),
    case [Row || [K | _] = Row <- Rows, K =:= Kind] of
        [] -> Rows ++ rows(Kind, Socket);
        _ -> Rows
    end.

close(Socket) -> gen_tcp:close(Socket).
