%% A mutex with a planted bug, for teams of two: robot 1 passes its token on, and takes itself for its holder
%% until 30 ms after robot 2 has got it. So both hold it for 30 ms, by clocks that agree.
-module(starl_lingering_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-define(REAL, starl_mutex_tokens).
-define(BOTH_US, 30000).

%% Beside the data of the sound one: the releases that are not told yet, by their tokens.
init(Config) ->
    {State, Data, Actions} = ?REAL:init(Config),
    {State, {#{}, Data}, Actions}.

%% Robot 2 has got the token, at this time of the clock that both have.
handle_event(cast, {message, _, mutex, {followed, Token, At}}, ready, _Data, #{now := Now}) ->
    {keep_state_and_data, [{{timeout, {lingers, Token}}, max(0, At + ?BOTH_US - Now), told}]};
handle_event({timeout, {lingers, Token}}, told, ready, {Kept, Data}, _Meta) ->
    {keep_state, {maps:remove(Token, Kept), Data}, released(Token, Kept)};
handle_event(Type, Content, ready, {Kept, Data}, Meta) ->
    case ?REAL:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, New, Actions} ->
            {Lingering, Now} = lists:mapfoldl(fun(A, K) -> linger(A, K, Meta) end, Kept, Actions),
            {keep_state, {Now, New}, lists:append(Lingering)};
        unknown_event ->
            unknown_event
    end.

released(Token, Kept) -> [{trace, Release} || #{Token := Release} <- [Kept]].

%% What passes the token on leaves as ever; only the word of the release is kept.
linger({trace, {released, Token, _} = Release}, Kept, #{robot := 1}) ->
    {[], Kept#{Token => Release}};
linger({trace, {acquired, Token, _}} = Acquired, Kept, #{robot := 1}) ->
    {released(Token, Kept) ++ [Acquired], maps:remove(Token, Kept)};
linger({trace, {acquired, Token, _}} = Acquired, Kept, #{robot := 2, now := Now}) ->
    {[Acquired, starl_sap:post(1, mutex, {followed, Token, Now})], Kept};
linger({until, Us, Actions, Mark}, Kept, Meta) ->
    {Lingering, Now} = lists:mapfoldl(fun(A, K) -> linger(A, K, Meta) end, Kept, Actions),
    {[{until, Us, lists:append(Lingering), Mark}], Now};
linger(Action, Kept, _Meta) ->
    {[Action], Kept}.
