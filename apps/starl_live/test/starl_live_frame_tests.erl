%% Frames between processes: who may read one.
-module(starl_live_frame_tests).
-include_lib("eunit/include/eunit.hrl").

%% A frame for one robot is refused by another one, if it should come there.
address_test() ->
    Packet = starl_packet:shout(1, dpp, x),
    {ok, ForTwo, [2], _} = starl_live_frame:write(2, Packet, ends(1)),
    ?assertMatch({[Packet], _}, starl_live_frame:read(ForTwo, ends(2))),
    {[], Refused} = starl_live_frame:read(ForTwo, ends(3)),
    ?assertEqual(#{address => 1}, starl_live_frame:figures(Refused)).

all_test() ->
    Packet = starl_packet:shout(1, dpp, x),
    {ok, ForAll, [2, 3], _} = starl_live_frame:write(all, Packet, ends(1)),
    [?assertMatch({[Packet], _}, starl_live_frame:read(ForAll, ends(R))) || R <- [2, 3]].

ends(Robot) ->
    starl_live_frame:new(#{robot => Robot, participants => [1, 2, 3], fleet => "tests", run => 1}).
