%% @doc Serves the files of the page. All are read when the server starts, so a request names one of
%% them or none. The page loads nothing from elsewhere, and its policy says so to the browser.
-module(starl_view_page).
-behaviour(cowboy_handler).

-export([files/0, init/2]).

-export_type([files/0]).

%% Type and content by path.
-type files() :: #{Path :: binary() => {Type :: binary(), Content :: binary()}}.

%% @doc The files of the page.
-spec files() -> files().
files() ->
    Dir = filename:join(code:priv_dir(starl_lab), "page"),
    {ok, Names} = file:list_dir(Dir),
    Files = maps:from_list([file(Name, Dir) || Name <- Names]),
    #{<<"/index.html">> := Index} = Files,
    Files#{<<"/">> => Index}.

file(Name, Dir) ->
    {ok, Content} = file:read_file(filename:join(Dir, Name)),
    {unicode:characters_to_binary(["/", Name]), {type(filename:extension(Name)), Content}}.

type(".html") -> <<"text/html; charset=utf-8">>;
type(".css") -> <<"text/css; charset=utf-8">>;
type(".js") -> <<"text/javascript; charset=utf-8">>;
type(".svg") -> <<"image/svg+xml">>;
type(_) -> <<"text/plain; charset=utf-8">>.

-spec init(cowboy_req:req(), #{files := files(), guard := starl_view_guard:t(), _ => _}) ->
    {ok | starl_view_foxglove, cowboy_req:req(), map()}.
init(Request, #{files := Files, guard := Guard} = State) ->
    case cowboy_req:header(<<"sec-websocket-protocol">>, Request) of
        undefined ->
            Named = starl_view_guard:named(cowboy_req:host(Request), Guard),
            {ok, answer(Named, Request, Files), State};
        _ ->
            %% a viewer that speaks another protocol
            {starl_view_foxglove, Request, State}
    end.

answer(false, Request, _Files) ->
    say(403, <<"this server is for its own computer: open it as http://127.0.0.1\n">>, Request);
answer(true, Request, Files) ->
    case {cowboy_req:method(Request), Files} of
        {Method, _} when Method =/= <<"GET">>, Method =/= <<"HEAD">> ->
            say(405, <<"GET, please\n">>, Request);
        {_, _} ->
            found(maps:find(cowboy_req:path(Request), Files), Request)
    end.

found({ok, {Type, Content}}, Request) ->
    cowboy_req:reply(200, (safe())#{<<"content-type">> => Type}, Content, Request);
found(error, Request) ->
    say(404, <<"there is no such file; the page is at /\n">>, Request).

say(Status, Text, Request) ->
    Plain = (safe())#{<<"content-type">> => <<"text/plain; charset=utf-8">>},
    cowboy_req:reply(Status, Plain, Text, Request).

safe() ->
    #{
        <<"content-security-policy">> =>
            <<"default-src 'self'; style-src 'self'; img-src 'self' data:; frame-ancestors 'none'">>,
        <<"x-content-type-options">> => <<"nosniff">>,
        <<"referrer-policy">> => <<"no-referrer">>,
        <<"cache-control">> => <<"no-cache">>
    }.
