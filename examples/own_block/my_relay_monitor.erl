%% The contract of the user's own block: at no robot more greetings of another are heard than that
%% one has said.
-module(my_relay_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, timeless/1]).

init(#{robots := _}) -> {#{}, #{}}.

interests() -> [my_relay].

timeless(State) -> State.

step({_, Robot, my_relay, said}, {Said, Heard}) ->
    {ok, {counted(Robot, Said), Heard}};
step({T, Robot, my_relay, {heard, From}}, {Said, Heard0}) ->
    Heard = counted({Robot, From}, Heard0),
    case maps:get({Robot, From}, Heard) > maps:get(From, Said, 0) of
        false ->
            {ok, {Said, Heard}};
        true ->
            Violation = #{
                contract => my_relay,
                what => heard_too_often,
                at_us => T,
                robots => lists:usort([Robot, From]),
                details => #{}
            },
            {violation, Violation, {Said, Heard}}
    end;
step(_Event, State) ->
    {ok, State}.

finish(_EndUs, {Said, _}) -> {ok, #{greetings => lists:sum(maps:values(Said))}}.

counted(Key, Counts) -> maps:update_with(Key, fun(N) -> N + 1 end, 1, Counts).
