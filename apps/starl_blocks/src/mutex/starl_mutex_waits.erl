%% @doc Records why robots wait for tokens in vain. There are three reasons. An application has
%% ended with a token that it holds; its robot keeps the token for as long as the robot lives. A
%% running application holds a token for longer than the patience of those that ask for it. Or
%% robots wait for each other's tokens, until the patience of one of them is over. The module judges
%% nothing: all three are the application's own doing.
%%
%% A list of tokens that is acquired in one call never leads to a circle of waiting robots
%% ({@link starl_mutex}).
-module(starl_mutex_waits).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-export_type([kept/0, circle/0]).

-type token() :: starl_mutex:token().

%% A robot whose application has ended, a token that it holds, and those who have asked for it in
%% vain. `since_us': its application lives, and has held it since then.
-type kept() :: #{
    robot := starl:robot_id(), token := token(), asked := [starl:robot_id()], since_us => integer()
}.

%% Robots that wait in a circle, since when: what each holds that the one before it in the list asks
%% for (the first one's is asked for by the last).
-type circle() :: #{at_us := integer(), waits := [{starl:robot_id(), Holds :: token()}, ...]}.

-record(state, {
    holds = #{} :: #{token() => starl:robot_id()},
    since = #{} :: #{token() => AtUs :: integer()},
    asks = #{} :: #{starl:robot_id() => [token()]},
    failed = #{} :: #{{starl:robot_id(), token()} => AtUs :: integer()},
    ended = #{} :: #{starl:robot_id() => true},
    %% the first circle of each set of robots
    circles = #{} :: #{[starl:robot_id()] => circle()}
}).

%% @doc Nothing has happened yet.
-spec init(#{}) -> #state{}.
init(#{}) -> #state{}.

%% @doc The mutex machines' events, and the ends of applications and robots.
-spec interests() -> [atom()].
interests() -> [mutex, app, robot].

%% @doc Follows one event.
-spec step(starl_monitor:trace_event(), #state{}) -> {ok, #state{}}.
step({T, Robot, mutex, {requested, Token}}, State) ->
    {ok, in_circle(T, Robot, Token, asks(Robot, Token, State))};
step({T, Robot, mutex, {acquired, Token, _}}, #state{holds = Holds, failed = Failed} = State) ->
    Held = State#state{
        since = (State#state.since)#{Token => T},
        holds = Holds#{Token => Robot},
        failed = maps:remove({Robot, Token}, Failed)
    },
    {ok, asks_no_more(Robot, Token, Held)};
step({_T, Robot, mutex, {Ends, Token, _}}, #state{holds = Holds} = State) when
    Ends =:= released; Ends =:= lease_lost
->
    case Holds of
        #{Token := Robot} -> {ok, State#state{holds = maps:remove(Token, Holds)}};
        #{} -> {ok, State}
    end;
step({T, Robot, mutex, {failed, Token, _Why}}, #state{failed = Failed} = State) ->
    {ok, asks_no_more(Robot, Token, State#state{failed = Failed#{{Robot, Token} => T}})};
step({_T, Robot, mutex, crashed}, State) ->
    {ok, forgotten(Robot, State)};
step({_T, Robot, robot, {died, _}}, State) ->
    {ok, forgotten(Robot, State)};
step({_T, Robot, app, {done, _}}, #state{ended = Ended} = State) ->
    {ok, State#state{ended = Ended#{Robot => true}}};
step(_Event, State) ->
    {ok, State}.

%% @doc The tokens that robots have kept, and the robots that have waited in a circle.
-spec finish(integer(), #state{}) -> {ok, #{kept := [kept()], circles := [circle()]}}.
finish(_EndUs, #state{holds = Holds, ended = Ended, circles = Circles, since = Since} = State) ->
    Kept = [
        #{robot => Robot, token => Token, asked => asked(Token, State)}
     || {Token, Robot} <- lists:sort(maps:to_list(Holds)), is_map_key(Robot, Ended)
    ],
    Held = [
        #{robot => Robot, token => Token, asked => Asked, since_us => map_get(Token, Since)}
     || {Token, Robot} <- lists:sort(maps:to_list(Holds)),
        not is_map_key(Robot, Ended),
        [_ | _] = Asked <- [vain(Robot, Token, State)]
    ],
    {ok, #{
        kept => Kept ++ Held,
        circles => [Circle || {_, Circle} <- lists:sort(maps:to_list(Circles))]
    }}.

%% The robots whose patience has ended during the hold.
vain(Holder, Token, #state{failed = Failed, since = Since}) ->
    #{Token := From} = Since,
    lists:sort([
        Robot
     || {{Robot, Asked}, At} <- maps:to_list(Failed), Asked =:= Token, At >= From, Robot =/= Holder
    ]).

asked(Token, #state{asks = Asks, failed = Failed}) ->
    Open = [Robot || {Robot, Tokens} <- maps:to_list(Asks), lists:member(Token, Tokens)],
    lists:usort(Open ++ [Robot || {Robot, Asked} <- maps:keys(Failed), Asked =:= Token]).

asks(Robot, Token, #state{asks = Asks} = State) ->
    Others = lists:delete(Token, maps:get(Robot, Asks, [])),
    State#state{asks = Asks#{Robot => [Token | Others]}}.

asks_no_more(Robot, Token, #state{asks = Asks} = State) ->
    Left = lists:delete(Token, maps:get(Robot, Asks, [])),
    State#state{asks = Asks#{Robot => Left}}.

%% The leases of its holds run out.
forgotten(Robot, #state{holds = Holds, asks = Asks} = State) ->
    State#state{
        holds = maps:filter(fun(_Token, Holder) -> Holder =/= Robot end, Holds),
        asks = maps:remove(Robot, Asks)
    }.

%% Does somebody wait for this robot, for whom it waits from now on?
in_circle(T, Robot, Token, #state{circles = Circles} = State) ->
    case chain(Token, Robot, [], State) of
        none ->
            State;
        Waits ->
            Robots = lists:sort([Holder || {Holder, _} <- Waits]),
            New = #{Robots => #{at_us => T, waits => Waits}},
            State#state{circles = maps:merge(New, Circles)}
    end.

%% From holder to holder, until the one who asks.
chain(Token, Robot, Before, #state{holds = Holds, asks = Asks} = State) ->
    case Holds of
        #{Token := Robot} ->
            lists:reverse(Before, [{Robot, Token}]);
        #{Token := Holder} ->
            Next =
                case lists:keymember(Holder, 1, Before) of
                    true -> [];
                    false -> maps:get(Holder, Asks, [])
                end,
            first_chain(Next, Robot, [{Holder, Token} | Before], State);
        #{} ->
            none
    end.

first_chain([], _Robot, _Before, _State) ->
    none;
first_chain([Token | Tokens], Robot, Before, State) ->
    case chain(Token, Robot, Before, State) of
        none -> first_chain(Tokens, Robot, Before, State);
        Waits -> Waits
    end.
