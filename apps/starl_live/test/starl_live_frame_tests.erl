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

%% Of another fleet, of another run, of nobody of the team, or in the robot's own name: refused, by its reason.
a_frame_of_others_is_refused_test_() ->
    Frame = fun(From, Ends) ->
        {ok, Written, _, _} = starl_live_frame:write(all, starl_packet:shout(From, dpp, x), Ends),
        setelement(3, Written, From)
    end,
    Others = [
        {fleet, Frame(1, ends(1, #{fleet => "others"}))},
        {fleet, Frame(1, ends(1, #{fleet => "others", run => 2}))},
        {run, Frame(1, ends(1, #{run => 2}))},
        {stranger, Frame(4, ends(1))},
        {stranger, Frame(2, ends(1))},
        {stranger, setelement(3, Frame(1, ends(1)), none)},
        {stranger, setelement(3, Frame(1, ends(1)), 1.5)},
        {sender, setelement(3, Frame(1, ends(1)), 3)}
    ],
    [
        ?_test(begin
            {[], Refused} = starl_live_frame:read(Other, ends(2)),
            ?assertEqual(#{Why => 1}, starl_live_frame:figures(Refused))
        end)
     || {Why, Other} <- Others
    ].

%% What is no frame is not counted: it may be meant for somebody else.
what_is_no_frame_is_unknown_test() ->
    ?assertEqual(unknown, starl_live_frame:read(hello, ends(2))),
    ?assertEqual(unknown, starl_live_frame:read({starl_frame, air, 1, 2, no_bytes}, ends(2))).

ends(Robot) -> ends(Robot, #{}).

ends(Robot, Given) ->
    Usual = #{
        robot => Robot, participants => starl_team:new([1, 2, 3]), fleet => "tests", run => 1
    },
    starl_live_frame:new(maps:merge(Usual, Given)).
