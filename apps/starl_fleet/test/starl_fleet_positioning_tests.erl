%% Who may tell a robot where it is.
%%
%% Holds: Positions are taken only under the fleet's key
%% Red: 961f67c9: unsealed ones
-module(starl_fleet_positioning_tests).
-include_lib("eunit/include/eunit.hrl").

-define(KEY, fun() -> <<"0123456789abcdef0123456789abcdef">> end).

%% A broadcast of somebody without the fleet's key moves no robot's belief, unless the fleet file says so.
a_broadcast_is_sealed_by_default_test() ->
    ?assertEqual({unsealed, known}, {hears(#{}, none), hears(#{}, sealed)}),
    ?assertEqual({known, known}, {hears(#{key => none}, none), hears(#{key => none}, plain)}).

hears(Own, How) ->
    Fleet = #{positioning => {broadcast, Own}},
    {starl_live_broadcast, Options} = starl_fleet_adapters:positioning(1, ?KEY, Fleet),
    Seal = maps:from_list([{seal_key, starl_live_broadcast:seal_key(K)} || #{key := K} <- [Options]]),
    Sent = maps:with([seal_key || How =:= sealed], Seal),
    Datagram = starl_live_broadcast:encode(1, 0, [{1, {0.0, 0.0, 0.0}}], Sent),
    case starl_live_broadcast:decode(iolist_to_binary(Datagram), Seal) of
        {ok, _} -> known;
        {error, Why} -> Why
    end.
