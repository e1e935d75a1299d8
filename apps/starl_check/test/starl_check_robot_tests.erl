%% What a checked robot keeps over a crash.
-module(starl_check_robot_tests).
-include_lib("eunit/include/eunit.hrl").

-define(CRASH, {crash, election}).
-define(KEEP, {fire, {election, keep}}).

%% A machine that crashes is given back what it stored, and nothing before it has.
stored_test() ->
    {_, Booted, Robot} = starl_check_robot:boot(1, model()),
    {_, Before, Bare} = starl_check_robot:event(?CRASH, Robot, model()),
    {_, [], Kept} = starl_check_robot:event(?KEEP, Bare, model()),
    {_, After, _} = starl_check_robot:event(?CRASH, Kept, model()),
    Term = {starl_check_term:id(1), starl_check_term:now(1)},
    ?assertEqual([none, none, {stored, Term}], found(Booted ++ Before ++ After)).

%% Robots and times in the store are known as those in a machine's data are.
stored_is_renamed_and_shifted_test() ->
    {_, _, Robot} = starl_check_robot:boot(1, model()),
    {_, _, Kept} = starl_check_robot:event(?KEEP, Robot, model()),
    {_, Renamed, _} =
        starl_check_robot:event(?CRASH, starl_check_robot:rename(Kept, {2, 1, 3}), model()),
    ?assertEqual([{stored, {starl_check_term:id(2), starl_check_term:now(2)}}], found(Renamed)),
    {_, Shifted, _} =
        starl_check_robot:event(?CRASH, starl_check_robot:shift(1, Kept, model()), model()),
    [{stored, {_, At}}] = found(Shifted),
    ?assert(At < starl_check_term:now(1)).

found(Traces) -> [Stored || {_, _, election, {found, Stored}} <- Traces].

model() ->
    Machine = {starl_check_keeper, #{}},
    (starl_check_model:new(election, #{robots => 3, machine => Machine}))#{past_us := 1000000}.
