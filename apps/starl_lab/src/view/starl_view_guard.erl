%% @doc Decides who may watch a run through the window, and apply faults. A page of another site
%% must not reach the window through the user's browser, neither by a name of its own for this
%% computer (DNS rebinding) nor directly. So a request must name this computer, and a WebSocket must
%% come from a page of this server. Other users of this computer, and other computers, must not
%% reach it either. So each request for a WebSocket carries a token, which stands behind the # of
%% the printed address. The token has 130 bits where only this computer can reach the server.
%% Elsewhere it is short enough to be typed on a telephone (60 bits), and wrong tokens are answered
%% slowly.
-module(starl_view_guard).

-export([new/1, is_near/1, asked/1, named/2, admitted/2, viewer/2, token/1]).

-export_type([t/0, asked/0]).

-record(guard, {token :: binary(), is_near :: boolean()}).

-opaque t() :: #guard{}.

%% Who asks for a WebSocket: `origin' is the page that asks, as browsers say it; `authority' is the host
%% with its port as the request names it.
-type asked() :: #{
    host := binary(),
    authority := binary(),
    origin := binary() | none,
    token := binary() | none
}.

%% Letters of a token that is clicked, and of one that is typed.
-define(CLICKED, 26).
-define(TYPED, 12).
%% After a wrong token.
-define(WRONG_MS, 500).

%% @doc The guard of a server at an address.
-spec new(inet:ip_address()) -> t().
new(Ip) ->
    IsNear = is_near(Ip),
    #guard{token = secret(letters(IsNear)), is_near = IsNear}.

letters(true) -> ?CLICKED;
letters(false) -> ?TYPED.

secret(Letters) -> <<<<(letter(Byte))>> || <<Byte>> <= crypto:strong_rand_bytes(Letters)>>.

%% None of them looks like another one.
letter(Byte) -> binary:at(<<"abcdefghijkmnpqrstuvwxyz23456789">>, Byte rem 32).

%% @doc Can only this computer reach the address?
-spec is_near(inet:ip_address()) -> boolean().
is_near({127, _, _, _}) -> true;
is_near({0, 0, 0, 0, 0, 0, 0, 1}) -> true;
is_near(_) -> false.

%% @doc The token that the address of the page carries.
-spec token(t()) -> binary().
token(#guard{token = Token}) -> Token.

%% @doc Does a request name this computer? A server that others can reach has names that nobody here knows.
-spec named(Host :: binary(), t()) -> boolean().
named(_Host, #guard{is_near = false}) ->
    true;
named(Host, #guard{is_near = true}) ->
    lists:member(Host, [<<"localhost">>, <<"127.0.0.1">>, <<"[::1]">>, <<"::1">>]).

%% @doc The parts of a request that decide its admission: host, origin and token.
-spec asked(cowboy_req:req()) -> asked().
asked(Request) ->
    #{
        host => cowboy_req:host(Request),
        authority => cowboy_req:header(<<"host">>, Request, <<>>),
        origin => cowboy_req:header(<<"origin">>, Request, none),
        token => given(cowboy_req:qs(Request))
    }.

%% @private The token of a query. Anybody may ask anything: only what looks like one is looked at.
-spec given(Query :: binary()) -> binary() | none.
given(Query) ->
    case
        re:run(Query, "(?:^|&)token=([a-z0-9]{1,99})(?:&|$)", [
            dollar_endonly, {capture, [1], binary}
        ])
    of
        {match, [Token]} when is_binary(Token) -> Token;
        nomatch -> none
    end.

%% @doc May this WebSocket be opened?
-spec admitted(asked(), t()) -> boolean().
admitted(#{host := Host, authority := Authority, origin := Origin, token := Given}, Guard) ->
    named(Host, Guard) andalso
        Origin =:= <<"http://", Authority/binary>> andalso
        has_token(Given, Guard).

%% @doc May a viewer that speaks Foxglove's protocol look? It has no hands. It is a program, which names
%% no page; or a page of this computer or of Foxglove.
-spec viewer(asked(), t()) -> boolean().
viewer(#{host := Host, origin := Origin, token := Given}, Guard) ->
    named(Host, Guard) andalso is_viewers(Origin) andalso has_token(Given, Guard).

is_viewers(none) ->
    true;
is_viewers(<<"https://app.foxglove.dev">>) ->
    true;
is_viewers(<<"file://", _/binary>>) ->
    true;
is_viewers(Origin) ->
    Here = "^https?://(localhost|127[.]0[.]0[.]1|\\[::1\\])(:[0-9]{1,5})?$",
    re:run(Origin, Here, [dollar_endonly, {capture, none}]) =:= match.

has_token(none, #guard{}) ->
    false;
has_token(Given, #guard{token = Token}) ->
    %% of equal length, so the time of the comparison tells nothing
    crypto:hash_equals(crypto:hash(sha256, Given), crypto:hash(sha256, Token)) orelse wrong().

%% Each connection is a process of its own, and there are few of them at a time.
wrong() ->
    receive
    after ?WRONG_MS -> false
    end.
