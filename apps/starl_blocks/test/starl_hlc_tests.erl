%% The hybrid logical clock: stamps that a message can hold, each later than all seen.
-module(starl_hlc_tests).
-include_lib("eunit/include/eunit.hrl").

-define(C, starl_hlc).
-define(MOST, 16#FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF).
-define(S, 1000000).

%% After the largest counter there is a later stamp, again and again, that others take.
after_the_largest_counter_test() ->
    Observed = ?C:observe({9 * ?S, ?MOST, 2}, 0, ?C:new(1, 10 * ?S)),
    {Stamps, _} = lists:mapfoldl(
        fun(_, Clock) ->
            {Stamp, Next} = ?C:stamp(0, Clock),
            {Stamp, ?C:observe({element(1, Stamp), ?MOST, 2}, 0, Next)}
        end,
        Observed,
        lists:seq(1, 1000)
    ),
    ?assertEqual(Stamps, lists:usort([{9 * ?S, ?MOST, 2} | Stamps]) -- [{9 * ?S, ?MOST, 2}]),
    Shape = {write, name, value, lists:last(Stamps)},
    ?assert(starl_registers_lww:accepts(registers, Shape)),
    ?assert(?C:admits(lists:last(Stamps), 0, ?C:new(3, 10 * ?S))).

%% One less is counted as ever.
before_the_largest_counter_test() ->
    Observed = ?C:observe({9 * ?S, ?MOST - 1, 2}, 0, ?C:new(1, 10 * ?S)),
    ?assertMatch({{9000000, ?MOST, 1}, _}, ?C:stamp(0, Observed)).
