%% @doc Handles a robot's operations as the home of tokens: it asks {@link starl_mutex_home}, sends
%% the answers and sets the timer. Pure; a part of {@link starl_mutex_tokens}.
-module(starl_mutex_host).

-export([requested/3, asked/6, returned/5, expire/2]).

-import(starl_mutex_state, [act/2, post/3]).

-type t() :: starl_mutex_state:t().
-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type request() :: starl_mutex_home:request().

%% The home looks this much later, as timers may be rounded.
-define(MARGIN_US, 1000).

%% @doc A request looks for a token of this home.
-spec requested(token(), request(), t()) -> t().
requested(Token, Request, Robot) ->
    #{now := Now, home := Home} = as_home(Robot),
    at_home(Token, starl_mutex_home:request(Token, Request, Now, Home), Robot).

%% @doc A robot asks this home to confirm a token.
-spec asked(claim | renew, token(), fence(), starl_mutex_robot:nonce(), starl:robot_id(), t()) ->
    t().
asked(Kind, Token, Fence, Nonce, By, Robot) ->
    #{now := Now, home := Home} = as_home(Robot),
    {Answer, Next} = starl_mutex_home:Kind(Token, Fence, By, Now, Home),
    Told = told(Kind, Answer, {Token, Fence, By}, Robot),
    at_home(Token, {[{By, {Answer, Token, Fence, Nonce}}], Next}, Told).

told(claim, granted, {Token, Fence, By}, Robot) ->
    act({trace, {granted, Token, Fence, By}}, Robot);
told(_Kind, _Answer, _Hold, Robot) ->
    Robot.

%% @doc A token comes back to this home.
-spec returned(token(), fence(), [request()], starl:robot_id(), t()) -> t().
returned(Token, Fence, Queue, By, Robot) ->
    #{now := Now, home := Home} = as_home(Robot),
    at_home(Token, starl_mutex_home:return(Token, Fence, By, Queue, Now, Home), Robot).

%% @doc The lease of a token of this home may be over.
-spec expire(token(), t()) -> t().
expire(Token, Robot) ->
    #{now := Now, home := Home} = as_home(Robot),
    at_home(Token, starl_mutex_home:expire(Token, Now, Home), Robot).

as_home(Robot) ->
    #{now => starl_mutex_state:now(Robot), home => starl_mutex_state:home(Robot)}.

at_home(Token, {Messages, Home}, Robot) ->
    Kept = starl_mutex_state:put_home(Home, Robot),
    Sent = lists:foldl(fun({To, M}, R) -> post(To, M, R) end, Kept, Messages),
    case starl_mutex_home:due(Token, Home) of
        never ->
            act({{timeout, {home, Token}}, cancel}, Sent);
        Due ->
            Wait = max(0, Due - starl_mutex_state:now(Robot)) + ?MARGIN_US,
            act({{timeout, {home, Token}}, Wait, check}, Sent)
    end.
