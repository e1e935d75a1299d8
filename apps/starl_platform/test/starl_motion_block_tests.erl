%% What motion guarantees as a block, and its exercise: what a robot asks of motion, and what it is promised.
-module(starl_motion_block_tests).
-include_lib("eunit/include/eunit.hrl").

-define(B, starl_motion_block).
-define(PLACE, {100.0, 200.0}).

%% That it stops rests on nothing; where it drives, on what it sees and on its wheels; that it arrives, on
%% all that moves it or may hold it up.
what_each_guarantee_rests_on_test() ->
    ?assertEqual(
        [
            {line, [positions, grip]},
            {ends, [positions, grip]},
            {stops, []},
            {arrives, [positions, grip, devices, ways, prompt, clock_rate, no_restart]}
        ],
        [{Name, Needs} || {Name, _, _, Needs} <- ?B:guarantees()]
    ).

%% A drive that has not obeyed may refuse a velocity; everything else ends well.
only_a_velocity_may_be_refused_test() ->
    Keeps = fun(What) ->
        {never, IsKept} = ?B:promise(#{what => What}, #{}, none),
        [IsKept(Outcome) || Outcome <- [ok, {error, stalled}, {error, unknown}]]
    end,
    ?assertEqual([true, true, false], Keeps(velocity)),
    [?assertEqual([true, false, false], Keeps(What)) || What <- [go_to, face, go_along, stop]].

%% It drives to a point, or along a line from its place, to which it turns before, or with velocities, which
%% may end by a stop: each of these is exercised, and nothing else.
every_command_of_motion_is_exercised_test() ->
    Turns = [turn(Seed) || Seed <- lists:seq(1, 40)],
    ?assertEqual(
        [[face, go_along], [go_to], [velocity], [velocity, stop], [velocity, velocity]],
        lists:usort([[name(Command) || Command <- lists:sublist(Turn, 2)] || Turn <- Turns])
    ),
    Lines = [Turn || [{face, _} | _] = Turn <- Turns],
    [?assertMatch([{face, {?PLACE, To}}, {go_along, {?PLACE, To}}], Line) || Line <- Lines].

%% To and fro, at most at the limit of speed.
velocities_have_every_direction_test() ->
    Velocities = [V || Seed <- lists:seq(1, 40), {velocity, V, _} <- turn(Seed)],
    [
        begin
            ?assert(lists:min(Speeds) >= -600.0 andalso lists:min(Speeds) < -300.0),
            ?assert(lists:max(Speeds) =< 600.0 andalso lists:max(Speeds) > 300.0)
        end
     || Speeds <- tuple_to_list(lists:unzip(Velocities))
    ].

%% What a turn commands motion.
turn(Seed) ->
    Answer = fun
        (location, {pose, 1}) -> {reply, {ok, erlang:append_element(?PLACE, 0.0)}};
        (motion, _Command) -> {reply, ok}
    end,
    Work = fun(Robot) -> ?B:work(Robot, 1, #{}) end,
    {_, Actions} = starl_platform_ct:application(Work, Answer, Seed),
    [Command || {call, motion, Command, _} <- Actions].

name(stop) -> stop;
name(Command) -> element(1, Command).
