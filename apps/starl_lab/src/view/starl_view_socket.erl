%% @doc The WebSocket of a page. It asks the hub for rows one question at a time, and only while the
%% page has handled almost all that was sent: a page that reads nothing gets nothing more. A page
%% that sends an invalid command gets an error, and is disconnected if it goes on.
-module(starl_view_socket).
-behaviour(cowboy_websocket).

-export([init/2, websocket_init/1, websocket_handle/2, websocket_info/2]).

%% The messages that the page has not handled yet.
-define(MOST_SENT, 4).
-define(MOST_BYTES, 16384).
-define(IDLE_MS, 120000).

-record(page, {
    hub :: pid(),
    door :: pid(),
    place = {0, 0} :: starl_view_hub:place(),
    credit = starl_view_credit:new(?MOST_SENT) :: starl_view_credit:t()
}).

-type answer() :: {[cow_ws:frame()], #page{}}.

-spec init(cowboy_req:req(), map()) ->
    {cowboy_websocket | ok, cowboy_req:req(), term()}
    | {cowboy_websocket, cowboy_req:req(), term(), cowboy_websocket:opts()}.
init(Request, #{hub := Hub, door := Door, guard := Guard} = State) ->
    case starl_view_guard:admitted(starl_view_guard:asked(Request), Guard) of
        true ->
            Options = #{
                max_frame_size => ?MOST_BYTES,
                idle_timeout => ?IDLE_MS,
                compress => false
            },
            {cowboy_websocket, Request, #page{hub = Hub, door = Door}, Options};
        false ->
            Text = <<"open the page at the address that ./starl has printed\n">>,
            {ok, cowboy_req:reply(403, #{}, Text, Request), State}
    end.

-spec websocket_init(#page{}) -> answer().
websocket_init(#page{hub = Hub, door = Door} = Page) ->
    ok = starl_view_door:knows(Door),
    case starl_view_hub:join(Hub) of
        {ok, Head, Place} -> sent(Head, Place, Page);
        full -> {[{close, 1013, <<"too many pages are open">>}], Page}
    end.

-spec websocket_handle(cow_ws:frame() | term(), #page{}) -> answer().
websocket_handle({text, <<"k">>}, #page{credit = Credit} = Page) ->
    {[], ask(Page#page{credit = starl_view_credit:handled(Credit)})};
websocket_handle({text, Text}, Page) ->
    case starl_json:decode(Text) of
        {ok, #{<<"do">> := Do} = Command} when is_binary(Do) -> pass_on(Command, Page);
        _ -> bad(Page)
    end;
websocket_handle({binary, _}, Page) ->
    bad(Page);
websocket_handle(_PingOrPong, Page) ->
    {[], Page}.

-spec websocket_info(term(), #page{}) -> answer().
websocket_info({frames, Rows, Place}, Page) ->
    sent(Rows, Place, Page);
websocket_info({rows, Rows}, Page) ->
    {[{text, [$[, Rows, $]]}], Page};
websocket_info({tell, Row}, Page) ->
    {[{text, [$[, starl_json:encode(Row), $]]}], Page};
websocket_info(_, Page) ->
    {[], Page}.

sent(Rows, Place, #page{credit = Credit} = Page) ->
    Told = Page#page{place = Place, credit = starl_view_credit:answered(Credit)},
    {[{text, [$[, Rows, $]]}], ask(Told)}.

ask(#page{credit = Credit, hub = Hub, place = Place} = Page) ->
    {May, Next} = starl_view_credit:may_ask(Credit),
    _ = May andalso starl_view_hub:want(Hub, Place),
    Page#page{credit = Next}.

pass_on(Command, #page{hub = Hub, credit = Credit} = Page) ->
    case starl_view_credit:command(erlang:monotonic_time(second), Credit) of
        {ok, Next} ->
            ok = starl_view_hub:command(Hub, Command),
            {[], Page#page{credit = Next}};
        too_many ->
            bad(Page)
    end.

bad(#page{credit = Credit} = Page) ->
    case starl_view_credit:mistake(Credit) of
        {ok, Next} ->
            Row = starl_json:encode([<<"no">>, <<"this is no command">>]),
            {[{text, [$[, Row, $]]}], Page#page{credit = Next}};
        shut_out ->
            {[{close, 1008, <<"no commands">>}], Page}
    end.
