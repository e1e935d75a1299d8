%% The contract of the shared registers, clause by clause; and the hybrid logical clock.
-module(starl_registers_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

judge(Events) ->
    Config = #{robots => [1, 2], owners => #{mine => 1}, bound_us => 1000},
    M0 = starl_monitor:new([{starl_registers_monitor, Config}]),
    {Found, M} = lists:foldl(fun({T, Robot, What}, {Acc, Monitor}) ->
        Machine = case What of {died, _} -> robot; _ -> registers end,
        case starl_monitor:step({T, Robot, Machine, What}, Monitor) of
            {ok, Next} -> {Acc, Next};
            {violation, V, Next} -> {Acc ++ [V], Next}
        end
    end, {[], M0}, Events),
    {Late, _} = starl_monitor:finish(9000, M),
    [What || #{what := What} <- Found ++ Late].

s(T, Robot) -> {T, 0, Robot}.
put(T, Robot, Name) -> {T, Robot, {put, Name, T, s(T, Robot)}}.
holds(T, Robot, Name, Stamp) -> {T, Robot, {holds, Name, Stamp}}.
got(T, Robot, Name, Hash, Stamp) -> {T, Robot, {got, Name, Hash, Stamp}}.
agreed(Name, Stamp) -> [holds(900, 1, Name, Stamp), holds(900, 2, Name, Stamp)].

kept_test() ->
    ?assertEqual([], judge([put(5, 1, x), got(6, 2, x, 5, s(5, 1)) | agreed(x, s(5, 1))])).
never_written_test() ->
    ?assertEqual([never_written, never_written],
        judge([put(5, 1, x), got(6, 2, x, 4, s(5, 1)), got(7, 1, x, 5, s(6, 1))
               | agreed(x, s(5, 1))])).
read_goes_back_test() ->
    Writes = [put(5, 1, x), put(6, 2, x), got(7, 1, x, 6, s(6, 2))],
    ?assertEqual([read_goes_back], judge(Writes ++ [got(8, 1, x, 5, s(5, 1)) | agreed(x, s(6, 2))])),
    ?assertEqual([read_goes_back], judge(Writes ++ [{8, 1, {got, x, unset}} | agreed(x, s(6, 2))])),
    ?assertEqual([], judge(Writes ++ [got(8, 2, x, 5, s(5, 1)) | agreed(x, s(6, 2))])),
    ?assertEqual([], judge(Writes ++ [{8, 1, crashed}, {9, 1, {got, x, unset}} | agreed(x, s(6, 2))])).
stamp_goes_back_test() ->
    Late = {7, 1, {put, x, 7, s(4, 1)}},
    ?assertEqual([stamp_goes_back], judge([put(5, 1, x), {6, 1, crashed}, Late | agreed(x, s(5, 1))])).
stamp_of_another_test() ->
    ?assertEqual([stamp_of_another], judge([{7, 1, {put, x, 7, s(4, 2)}} | agreed(x, s(4, 2))])).
not_owner_test() -> ?assertEqual([not_owner], judge([put(5, 2, mine) | agreed(mine, s(5, 2))])).
no_agreement_test() ->
    Writes = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    ?assertEqual([no_agreement], judge(Writes)),
    ?assertEqual([no_agreement], judge(Writes ++ [holds(2000, 2, x, s(5, 1))])),
    ?assertEqual([], judge(Writes ++ [{8, 2, {died, k}}])).

%% -- the clock ------------------------------------------------------------------------------

stamps_grow_test() ->
    {A, C1} = starl_hlc:stamp(100, starl_hlc:new(1, 1000)),
    {B, C2} = starl_hlc:stamp(90, C1),
    C3 = starl_hlc:observe({500, 7, 2}, 95, C2),
    {C, C4} = starl_hlc:stamp(101, C3),
    {D, _} = starl_hlc:stamp(600, C4),
    ?assertEqual([{100, 0, 1}, {100, 1, 1}, {500, 8, 1}, {600, 0, 1}], [A, B, C, D]).

%% Whatever a clock admitted before: after a restart its stamps are later, twice in a moment, too.
restart_test() ->
    Ahead = {1100, 5, 2},
    ?assert(starl_hlc:admits(Ahead, 100, starl_hlc:new(1, 1000))),
    ?assertNot(starl_hlc:admits({1101, 0, 2}, 100, starl_hlc:new(1, 1000))),
    {A, _} = starl_hlc:stamp(100, starl_hlc:observe(Ahead, 100, starl_hlc:new(1, 1000))),
    {B, _} = starl_hlc:stamp(100, starl_hlc:after_restart(1, 1000, 100, 2)),
    {C, _} = starl_hlc:stamp(100, starl_hlc:after_restart(1, 1000, 100, 3)),
    ?assert(A < B andalso B < C).
