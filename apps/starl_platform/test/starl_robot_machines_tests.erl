%% The numbers of starts of a robot's machines, in all of its lives.
-module(starl_robot_machines_tests).
-include_lib("eunit/include/eunit.hrl").

%% 2026, in milliseconds; a number of a life has 16 bits below its time.
-define(MS, 1800000000000).
-define(BITS, 16).

new() -> starl_robot_machines:new(#{m => {?MODULE, #{}}}).

number(Machines) -> starl_robot_machines:incarnation(m, Machines).

life(Machines) -> starl_robot_machines:life(m, Machines).

restarted(Machines) ->
    {ok, Next} = starl_robot_machines:restart(m, infinity, Machines),
    Next.

reboot(Moment, Machines) -> starl_robot_machines:up(Moment, starl_robot_machines:down(Machines)).

%% In the first life the starts are counted.
first_life_test() ->
    ?assertEqual([1, 2], [number(M) || M <- [new(), restarted(new())]]),
    ?assertEqual([{0, 1}, {0, 1}], [life(M) || M <- [new(), restarted(new())]]).

%% A later life begins with the time; within it the starts are counted.
%% Holds: No incarnation is that of an earlier life, whatever is left on disk
%% Red: e32dfbb, run (`starl_sap_peers_tests`)
later_life_test() ->
    First = (?MS bsl ?BITS) + 7,
    Up = reboot({?MS, 7}, restarted(new())),
    ?assertEqual([First, First + 1], [number(M) || M <- [Up, restarted(Up)]]),
    ?assertEqual([{2, First}, {2, First}], [life(M) || M <- [Up, restarted(Up)]]).

%% A clock that is behind the numbers of the store, or before its epoch, does not set them back.
clock_set_back_test() ->
    Up = reboot({?MS, 7}, new()),
    [
        ?assertEqual(number(Up) + 1 + 9, number(reboot({Ms, 9}, Up)))
     || Ms <- [?MS - 1, 0, -1000000]
    ].

%% A store without numbers: nothing is between the life before and this one, nobody knows that one.
lost_numbers_test() ->
    Lost = starl_robot_machines:starts(#{}, starl_robot_machines:down(new())),
    First = (?MS bsl ?BITS) + 7,
    ?assertEqual({First - 1, First}, life(starl_robot_machines:up({?MS, 7}, Lost))).

%% All numbers are small enough for a packet until the year 2248.
small_enough_test() ->
    Ms2248 = 8772800000000,
    Up = reboot({Ms2248, starl_robot_machines:lots() - 1}, new()),
    ?assertEqual(2, starl_packet:source(starl_packet:hello(2, number(Up)))).

%% Others can raise the number of a life to a bound. However often they do, there are later ones, all
%% small enough for a packet; and a robot that has lost its store since learns of the raised one.
raised_again_and_again_test() ->
    Moment = fun(N) -> {?MS + N, N rem starl_robot_machines:lots()} end,
    Raised = lists:foldl(
        fun(N, Machines) ->
            Latest = starl_robot_machines:latest_life(Machines),
            Down = starl_robot_machines:starts(#{m => max(Latest, number(Machines))}, Machines),
            Up = reboot(Moment(N), Down),
            ?assert(number(Up) > number(Machines)),
            Up
        end,
        reboot(Moment(0), new()),
        lists:seq(1, 70000)
    ),
    ?assertEqual(2, starl_packet:source(starl_packet:hello(2, number(Raised)))),
    Lost = reboot(Moment(70001), starl_robot_machines:starts(#{}, new())),
    ?assert(number(Lost) < number(Raised)),
    ?assert(starl_robot_machines:latest_life(Lost) >= number(Raised)).

%% A life that has been is never beyond the bound, for a clock that has forgotten the time, too.
latest_life_test() ->
    Lots = starl_robot_machines:lots(),
    [
        ?assert(starl_robot_machines:latest_life(Now) >= number(reboot({?MS, Lots - 1}, new())))
     || Now <- [new(), reboot({0, 0}, new()), reboot({-5, 0}, new()), reboot({?MS, 0}, new())]
    ].
