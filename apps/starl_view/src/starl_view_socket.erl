%% @doc The WebSocket of a page. It asks the hub for rows one question at a time, and only while the
%% page has handled almost all that was sent: a page that reads nothing gets nothing more. A page
%% that sends what is no command is told so, and shut out when it goes on.
-module(starl_view_socket).
-behaviour(cowboy_websocket).

-export([init/2, websocket_init/1, websocket_handle/2, websocket_info/2]).

%% The messages that the page has not handled yet.
-define(MOST_SENT, 4).
-define(MOST_BAD, 20).
-define(MOST_BYTES, 16384).
-define(IDLE_MS, 120000).
%% Commands within a second.
-define(MOST_COMMANDS, 100).

-record(page, {
    hub :: pid(),
    place = {0, 0} :: starl_view_hub:place(),
    sent = 0 :: non_neg_integer(),
    asks = false :: boolean(),
    bad = 0 :: non_neg_integer(),
    commands = {0, 0} :: {Second :: integer(), non_neg_integer()}
}).

-type answer() :: {[cow_ws:frame()], #page{}}.

-spec init(cowboy_req:req(), map()) ->
    {cowboy_websocket | ok, cowboy_req:req(), term()}
    | {cowboy_websocket, cowboy_req:req(), term(), cowboy_websocket:opts()}.
init(Request, #{hub := Hub, guard := Guard} = State) ->
    case starl_view_guard:admitted(asked(Request), Guard) of
        true ->
            Options = #{
                max_frame_size => ?MOST_BYTES,
                idle_timeout => ?IDLE_MS,
                compress => false
            },
            {cowboy_websocket, Request, #page{hub = Hub}, Options};
        false ->
            Text = <<"open the page at the address that ./starl has printed\n">>,
            {ok, cowboy_req:reply(403, #{}, Text, Request), State}
    end.

asked(Request) ->
    #{
        host => cowboy_req:host(Request),
        authority => cowboy_req:header(<<"host">>, Request, <<>>),
        origin => cowboy_req:header(<<"origin">>, Request, none),
        token => proplists:get_value(<<"token">>, cowboy_req:parse_qs(Request), none)
    }.

-spec websocket_init(#page{}) -> answer().
websocket_init(#page{hub = Hub} = Page) ->
    case starl_view_hub:join(Hub) of
        {ok, Head, Place} ->
            sent(Head, ask(Page#page{place = Place}));
        full ->
            {[{close, 1013, <<"too many pages are open">>}], Page}
    end.

-spec websocket_handle(cow_ws:frame() | term(), #page{}) -> answer().
websocket_handle({text, <<"k">>}, #page{sent = Sent} = Page) ->
    {[], ask(Page#page{sent = max(0, Sent - 1)})};
websocket_handle({text, Text}, Page) ->
    case starl_view_json:decode(Text) of
        {ok, #{<<"do">> := Do} = Command} when is_binary(Do) -> pass_on(Command, Page);
        _ -> bad(Page)
    end;
websocket_handle({binary, _}, Page) ->
    bad(Page);
websocket_handle(_PingOrPong, Page) ->
    {[], Page}.

-spec websocket_info(term(), #page{}) -> answer().
websocket_info({frames, Rows, Place}, Page) ->
    sent(Rows, ask(Page#page{place = Place, asks = false}));
websocket_info({tell, Row}, Page) ->
    {[{text, [$[, starl_view_json:encode(Row), $]]}], Page};
websocket_info(_, Page) ->
    {[], Page}.

sent(Rows, #page{sent = Sent} = Page) -> {[{text, [$[, Rows, $]]}], Page#page{sent = Sent + 1}}.

ask(#page{asks = false, sent = Sent, hub = Hub, place = Place} = Page) when Sent < ?MOST_SENT ->
    ok = starl_view_hub:want(Hub, Place),
    Page#page{asks = true};
ask(Page) ->
    Page.

pass_on(Command, #page{hub = Hub, commands = {Second, N}} = Page) ->
    case erlang:monotonic_time(second) of
        Second when N >= ?MOST_COMMANDS ->
            bad(Page);
        Second ->
            ok = starl_view_hub:command(Hub, Command),
            {[], Page#page{commands = {Second, N + 1}}};
        Later ->
            ok = starl_view_hub:command(Hub, Command),
            {[], Page#page{commands = {Later, 1}}}
    end.

bad(#page{bad = Bad} = Page) when Bad >= ?MOST_BAD ->
    {[{close, 1008, <<"no commands">>}], Page};
bad(#page{bad = Bad} = Page) ->
    Row = starl_view_json:encode([<<"no">>, <<"this is no command">>]),
    {[{text, [$[, Row, $]]}], Page#page{bad = Bad + 1}}.
