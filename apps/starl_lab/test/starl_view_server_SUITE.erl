%% The server among good and bad clients: who gets in, and what one may do without harm to a run.
-module(starl_view_server_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, init_per_testcase/2, end_per_testcase/2]).
-export([files/1, only_its_own_page/1, a_token_for_others/1, a_page_gets_the_run/1]).
-export([an_odd_request_is_refused/1, a_token_for_neighbours/1]).
-export([the_first_page/1]).
-export([
    a_page_before_the_run/1,
    garbage/1,
    one_that_reads_nothing/1,
    a_hundred_pages/1,
    a_page_left_open/1
]).
-export([a_hundred_pages_and_a_run/1, a_port_that_is_taken/1]).
-export([log/2]).

-define(C, starl_view_client).
-define(FOXGLOVE, "foxglove.websocket.v1").
%% A third of a MB each, with the run itself.
-define(MOST_FOR_100_PAGES, 32 * 1024 * 1024).

all() ->
    [
        files,
        only_its_own_page,
        a_token_for_others,
        a_token_for_neighbours,
        an_odd_request_is_refused,
        the_first_page,
        a_page_gets_the_run,
        a_page_before_the_run,
        garbage,
        one_that_reads_nothing,
        a_hundred_pages,
        a_hundred_pages_and_a_run,
        a_page_left_open,
        a_port_that_is_taken
    ].

init_per_testcase(_Case, Config) ->
    {ok, View} = starl_view:start(#{port => 0, most_bytes => 200000}),
    #{port := Port, fragment := Token} = uri_string:parse(
        binary_to_list(starl_view:address(View))
    ),
    [{view, View}, {port, Port}, {door, {Port, Token}}, {hub, starl_view:hub(View)} | Config].

end_per_testcase(_Case, Config) -> starl_view:stop(?config(view, Config)).

files(Config) ->
    Port = ?config(port, Config),
    {200, Index} = ?C:get(Port, "/", []),
    %% nothing comes from elsewhere
    ?assertEqual(nomatch, binary:match(Index, <<"//">>)),
    {match, Named} = re:run(Index, "(?:src|href)=\"([^\"]+)\"", [
        global, {capture, all_but_first, list}
    ]),
    ?assertEqual(3, length(Named)),
    [?assertMatch({200, _}, ?C:get(Port, "/" ++ Name, [])) || [Name] <- Named],
    [
        ?assertMatch({404, _}, ?C:get(Port, Path, []))
     || Path <- ["/..%2f..%2febin/starl_lab.app", "/../starl_lab.app", "/none", "/%00"]
    ].

%% A site's script can neither reach the server by a name that it has made to point here, nor open a
%% WebSocket from its own page.
only_its_own_page(Config) ->
    {Port, _} = Door = ?config(door, Config),
    Here = integer_to_list(Port),
    Host = fun(Name) -> {"Host", Name ++ ":" ++ Here} end,
    Origin = fun(Name) -> {"Origin", "http://" ++ Name ++ ":" ++ Here} end,
    ?assertMatch({403, _}, ?C:get(Port, "/", [Host("evil.example")])),
    Refused = [
        [],
        [Origin("evil.example")],
        [Host("evil.example"), Origin("evil.example")],
        [Host("localhost"), Origin("127.0.0.1")],
        [{"Origin", "null"}]
    ],
    [?assertMatch({403, _}, ?C:connect(Door, Headers)) || Headers <- Refused],
    ?assertMatch({101, _}, ?C:connect(Door, [Origin("127.0.0.1")])),
    ?assertMatch({101, _}, ?C:connect(Door, [Host("localhost"), Origin("localhost")])).

%% Another user of this computer knows the port, and not the address.
%% Holds: Every visitor of the window has its token
%% Red: 961f67c9: 101 without one
a_token_for_neighbours(Config) ->
    {Port, Token} = ?config(door, Config),
    ?assertMatch({match, _}, re:run(Token, "^[a-z2-9]{26}$")),
    Headers = [{"Origin", "http://127.0.0.1:" ++ integer_to_list(Port)}],
    ?assertMatch({403, _}, ?C:connect(Port, Headers)),
    Wrong = {Port, lists:duplicate(26, $a)},
    ?assertMatch({403, _}, ?C:connect(Wrong, Headers)),
    ?assertMatch({403, _}, ?C:connect(Wrong, "/", [{"Sec-WebSocket-Protocol", ?FOXGLOVE}])),
    ?assertMatch({403, _}, ?C:connect(Port, "/", [{"Sec-WebSocket-Protocol", ?FOXGLOVE}])).

%% Whoever has no token cannot even make the server say something on the user's terminal.
an_odd_request_is_refused(Config) ->
    {Port, Token} = ?config(door, Config),
    Own = {"Origin", "http://127.0.0.1:" ++ integer_to_list(Port)},
    Foxglove = {"Sec-WebSocket-Protocol", ?FOXGLOVE},
    Queries = ["token", "token=", "token=%zz", "token=%ff", "%", "token=%", "token&token", "&&=&"],
    [
        ?assertMatch({Query, {403, _}}, {Query, ?C:connect(Port, Path ++ Query, Headers)})
     || Query <- Queries, {Path, Headers} <- [{"/ws?", [Own]}, {"/foxglove?", [Foxglove]}]
    ],
    [
        ?assertMatch(
            {Origin, {403, _}},
            {Origin, ?C:connect({Port, Token}, "/", [Foxglove, {"Origin", Origin}])}
        )
     || Origin <- [[255], "http://[::", "http://localhost:8080.evil.example", "//", "file:"]
    ].

a_token_for_others(_Config) ->
    {ok, View} = starl_view:start(#{port => 0, host => "0.0.0.0"}),
    Address = binary_to_list(starl_view:address(View)),
    #{host := Host, port := Port, fragment := Token} = uri_string:parse(Address),
    %% it is typed there
    ?assertMatch({match, _}, re:run(Token, "^[a-z2-9]{12}$")),
    %% a telephone knows no names of a home
    ?assertEqual(is_on_a_network(), element(1, inet:parse_address(Host)) =:= ok, Host),
    Headers = [{"Origin", "http://127.0.0.1:" ++ integer_to_list(Port)}],
    ?assertMatch({403, _}, ?C:connect(Port, Headers)),
    ?assertMatch({403, _}, ?C:connect(Port, "/ws?token=" ++ lists:duplicate(12, $a), Headers)),
    ?assertMatch({101, _}, ?C:connect(Port, "/ws?token=" ++ Token, Headers)),
    starl_view:stop(View).

is_on_a_network() ->
    {ok, Interfaces} = inet:getifaddrs(),
    lists:any(
        fun(Ip) -> tuple_size(Ip) =:= 4 andalso element(1, Ip) =/= 127 end,
        [
            Ip
         || {_, Facts} <- Interfaces,
            lists:member(up, proplists:get_value(flags, Facts, [])),
            {addr, Ip} <- Facts
        ]
    ).

%% A run that waits for its first page is told of it, once.
the_first_page(Config) ->
    Hub = ?config(hub, Config),
    ?assertNot(starl_view_hub:is_attended(Hub)),
    ok = starl_view_hub:first_page(Hub),
    _ = [page(Config) || _ <- [1, 2]],
    receive
        {first_page, Hub} -> ok
    end,
    ?assert(starl_view_hub:is_attended(Hub)),
    ok = starl_view_hub:first_page(Hub),
    receive
        {first_page, Hub} -> ok
    end,
    ?assertEqual(ok, starl_view_hub:flush(Hub)),
    ?assertEqual({messages, []}, erlang:process_info(self(), messages)).

a_page_gets_the_run(Config) ->
    ok = starl_view_hub:head(?config(hub, Config), {[[<<"run">>, #{app => x}]], 1}),
    Socket = page(Config),
    ?assertMatch([[<<"run">>, #{<<"app">> := <<"x">>}] | _], ?C:rows(<<"run">>, Socket)),
    tell(1, Config),
    ?assertMatch([[<<"m">>, 1000000 | _], [<<"t">>, 1000000, _]], ?C:rows(<<"t">>, Socket)).

%% A browser may be faster than the run, which is made ready while its page is open already.
a_page_before_the_run(Config) ->
    Socket = page(Config),
    {rows, []} = ?C:next(Socket, 20000),
    ok = starl_view_hub:head(?config(hub, Config), {[[<<"run">>, #{app => x}]], 1}),
    tell(1, Config),
    ?assertMatch([[<<"run">>, #{<<"app">> := <<"x">>}] | _], ?C:rows(<<"run">>, Socket)).

garbage(Config) ->
    Other = page(Config),
    Garbage = [
        "",
        "{",
        "null",
        "[1]",
        "{\"do\":1}",
        <<255, 254>>,
        lists:duplicate(10000, $[),
        "\"k\"",
        "-1e999"
    ],
    [
        begin
            Socket = page(Config),
            ok = ?C:send(Text, Socket),
            ok = ?C:close(Socket)
        end
     || Text <- Garbage
    ],
    %% it is shut out in the end
    Bad = page(Config),
    [ok = ?C:send("{", Bad) || _ <- lists:seq(1, 21)],
    ?assertMatch({close, 1008}, closed(Bad)),
    %% too long, and no frame at all
    Long = page(Config),
    _ = ?C:send(lists:duplicate(100000, $x), Long),
    %% a client that goes on to send may miss the last word
    ?assert(lists:member(closed(Long), [{close, 1009}, {error, closed}, {error, econnreset}])),
    None = page(Config),
    ok = ?C:raw(crypto:strong_rand_bytes(2000), None),
    _ = ?C:raw(<<"GET / HTTP/1.1\r\n\r\n">>, None),
    %% meanwhile another page goes on
    tell(1, Config),
    ?assertMatch([_ | _], ?C:rows(<<"m">>, Other)).

closed(Socket) ->
    case ?C:next(Socket, 20000) of
        {rows, _} -> closed(Socket);
        Other -> Other
    end.

%% It never reads what it is sent: the hub goes on, and neither its memory nor the page's process grows.
one_that_reads_nothing(Config) ->
    Hub = ?config(hub, Config),
    _Deaf = page(Config),
    Good = page(Config),
    tell_many(1, 300, Config),
    Before = memory(Hub),
    tell_many(301, 3000, Config),
    ?assert(memory(Hub) < Before + 3000000),
    ?assertMatch({_, N} when N < 10, erlang:process_info(Hub, message_queue_len)),
    %% one that was away as long gets the state of now
    Rows = ?C:rows(<<"m">>, Good),
    ?assert(lists:any(fun([Kind | _]) -> Kind =:= <<"m">> end, Rows)).

a_hundred_pages(Config) ->
    Hub = ?config(hub, Config),
    Pages = [page(Config) || _ <- lists:seq(1, 100)],
    tell(1, Config),
    [?assertMatch([_ | _], ?C:rows(<<"m">>, Page)) || Page <- Pages],
    Before = memory(Hub),
    tell_many(2, 1000, Config),
    ?assert(memory(Hub) < Before + 5000000),
    [ok = ?C:close(Page) || Page <- Pages],
    gone(Hub).

%% A run with a hundred pages, of which half read nothing: its digest is its own, and the server keeps no
%% more than a fixed part for each of them.
a_hundred_pages_and_a_run(Config) ->
    Hub = ?config(hub, Config),
    Scenario = #{app => painting, robots => 4, seed => 1},
    Before = erlang:memory(total),
    Deaf = [page(Config) || _ <- lists:seq(1, 50)],
    Readers = [reader(Config) || _ <- lists:seq(1, 50)],
    {ok, #{sim := Sim}} =
        starl_lab_player:play(#{hub => Hub, scenario => Scenario, speed => max}),
    ?assertEqual(100, starl_view_hub:pages(Hub)),
    {#{digest := Digest}, _} = starl_sim:finish(Sim),
    Kept = lists:min([collected() - Before || _ <- lists:seq(1, 20)]),
    ct:pal("100 pages and a run: ~b kB more", [Kept div 1024]),
    ?assert(Kept < ?MOST_FOR_100_PAGES),
    ?assertEqual(alone(Scenario), Digest),
    [ok = ?C:close(Page) || Page <- Deaf],
    [true = exit(Reader, kill) || Reader <- Readers],
    gone(Hub).

%% What this VM holds. The readers are still at work on what they were sent last, which is not kept: so one
%% look can show more than is kept, never less.
collected() ->
    _ = [erlang:garbage_collect(Pid) || Pid <- processes()],
    erlang:memory(total).

reader(Config) ->
    Page = page(Config),
    Reader = spawn(fun() -> reads_on(Page) end),
    ok = gen_tcp:controlling_process(Page, Reader),
    Reader.

alone(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {#{digest := Digest}, _} = starl_sim:finish(Sim),
    Digest.

%% A night of an idle run, and of a busy one: what is kept has a limit.
a_page_left_open(Config) ->
    Hub = ?config(hub, Config),
    Page = page(Config),
    Reader = spawn_link(fun() -> reads_on(Page) end),
    ok = gen_tcp:controlling_process(Page, Reader),
    tell_many(1, 500, Config),
    Before = memory(Hub),
    %% a tick for each second of 12 hours
    tell_many(501, 43200, Config),
    ?assert(memory(Hub) < Before + 3000000),
    true = unlink(Reader),
    true = exit(Reader, kill).

%% One line says it; nobody writes a report beside it. A server that ends gives its port back.
a_port_that_is_taken(Config) ->
    Port = ?config(port, Config),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => self()}),
    {error, Reason} = starl_view:start(#{port => Port}),
    ok = logger:remove_handler(?MODULE),
    Line = lists:flatten(io_lib:format("~ts", [starl_view:format_error(Reason)])),
    ?assertMatch({match, _}, re:run(Line, "^--view-port [0-9]+: another program has this port")),
    receive
        {logged, Event} -> ct:fail(Event)
    after 0 -> ok
    end,
    {ok, View} = starl_view:start(#{port => 0}),
    #{port := Own} = uri_string:parse(binary_to_list(starl_view:address(View))),
    ok = starl_view:stop(View),
    {ok, Again} = starl_view:start(#{port => Own}),
    ok = starl_view:stop(Again).

%% Sends what is logged to the test.
log(Event, #{config := Test}) -> Test ! {logged, Event}.

%% -- helpers --------------------------------------------------------------------------------

page(Config) ->
    {Port, _} = Door = ?config(door, Config),
    {101, Socket} = ?C:connect(Door, [{"Origin", "http://127.0.0.1:" ++ integer_to_list(Port)}]),
    Socket.

tell(N, Config) -> tell_many(N, N, Config).

%% Ticks of a run in which a robot moves and talks, each handled before the next.
tell_many(From, To, Config) ->
    Hub = ?config(hub, Config),
    Observer = starl_view_hub:observer(Hub, 0),
    [
        begin
            T = N * 1000000,
            Piece = starl_trajectory:piece(T, {1.0, 2.0}, 0.0, 100.0, 0.0),
            ok = Observer({judged, [{T, N rem 7 + 1, chassis, {motion, Piece}}], []}),
            ok = starl_view_hub:clock(Hub, #{now_us => T, speed => 1})
        end
     || N <- lists:seq(From, To)
    ],
    ok.

memory(Pid) ->
    true = erlang:garbage_collect(Pid),
    {_, Bytes} = erlang:process_info(Pid, memory),
    {_, Binaries} = erlang:process_info(Pid, binary),
    Bytes + lists:sum([Size || {_, Size, _} <- Binaries]).

reads_on(Socket) ->
    case ?C:next(Socket, 20000) of
        {rows, _} ->
            ok = ?C:send("k", Socket),
            reads_on(Socket);
        _ ->
            ok
    end.

%% The hub hears of the end of each page by itself.
gone(Hub) ->
    case starl_view_hub:pages(Hub) of
        0 ->
            ok;
        _ ->
            erlang:yield(),
            gone(Hub)
    end.
