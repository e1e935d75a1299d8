%% @doc Who may look through the window, and lend a hand. A page of another site must not reach it
%% through the user's browser, neither by a name of its own for this computer (DNS rebinding) nor
%% directly: a request must name this computer, and a WebSocket must come from a page of this
%% server. A server that other computers can reach wants a token, too, which its address carries.
-module(starl_view_guard).

-export([new/2, is_near/1, asked/1, named/2, admitted/2, viewer/2, token/1]).

-export_type([t/0, asked/0]).

-record(guard, {token :: binary() | none, port :: inet:port_number()}).

-opaque t() :: #guard{}.

%% Who asks for a WebSocket: `origin' is the page that asks, as browsers say it; `authority' is the host
%% with its port as the request names it.
-type asked() :: #{
    host := binary(),
    authority := binary(),
    origin := binary() | none,
    token := binary() | none
}.

-define(LETTERS, 12).

%% @doc The guard of a server at an address and a port.
-spec new(inet:ip_address(), inet:port_number()) -> t().
new(Ip, Port) ->
    Token =
        case is_near(Ip) of
            true -> none;
            false -> secret()
        end,
    #guard{token = Token, port = Port}.

%% It is too long to be guessed over a network (60 bits), and short enough to be typed on a telephone.
secret() -> <<<<(letter(Byte))>> || <<Byte>> <= crypto:strong_rand_bytes(?LETTERS)>>.

%% None of them looks like another one.
letter(Byte) -> binary:at(<<"abcdefghijkmnpqrstuvwxyz23456789">>, Byte rem 32).

%% @doc Can only this computer reach the address?
-spec is_near(inet:ip_address()) -> boolean().
is_near({127, _, _, _}) -> true;
is_near({0, 0, 0, 0, 0, 0, 0, 1}) -> true;
is_near(_) -> false.

%% @doc The token that the address of the page carries, if one is wanted.
-spec token(t()) -> binary() | none.
token(#guard{token = Token}) -> Token.

%% @doc Does a request name this computer? With a token any name will do: who knows the token was
%% given it.
-spec named(Host :: binary(), t()) -> boolean().
named(_Host, #guard{token = Token}) when Token =/= none -> true;
named(Host, #guard{}) ->
    lists:member(Host, [<<"localhost">>, <<"127.0.0.1">>, <<"[::1]">>, <<"::1">>]).

%% @doc Who asks.
-spec asked(cowboy_req:req()) -> asked().
asked(Request) ->
    #{
        host => cowboy_req:host(Request),
        authority => cowboy_req:header(<<"host">>, Request, <<>>),
        origin => cowboy_req:header(<<"origin">>, Request, none),
        token => proplists:get_value(<<"token">>, cowboy_req:parse_qs(Request), none)
    }.

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
is_viewers(Origin) ->
    case uri_string:parse(Origin) of
        #{scheme := <<"https">>, host := <<"app.foxglove.dev">>} -> true;
        #{scheme := <<"file">>} -> true;
        #{host := Host} -> lists:member(Host, [<<"localhost">>, <<"127.0.0.1">>, <<"::1">>]);
        _ -> false
    end.

has_token(_Given, #guard{token = none}) ->
    true;
has_token(none, #guard{}) ->
    false;
has_token(Given, #guard{token = Token}) ->
    %% of equal length, so the time of the comparison tells nothing
    crypto:hash(sha256, Given) =:= crypto:hash(sha256, Token).
