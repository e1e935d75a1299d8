%% What a machine draws depends on the numbers of its random stream only. The state of a stream also
%% holds functions of OTP's module rand; whoever hashes or compares those has another digest in
%% every release of OTP. Here the same stream comes with other functions.
-module(starl_random_stream_tests).
-include_lib("eunit/include/eunit.hrl").

draws_by_the_numbers_test_() ->
    [{atom_to_list(Module), fun() -> draws(Case) end} || {Module, _} = Case <- cases()].

draws(Case) ->
    Drawn = run(Case, rand:seed_s(exsss, 42)),
    ?assertEqual(Drawn, run(Case, other_functions(rand:seed_s(exsss, 42)))),
    %% it does draw
    ?assertNotEqual(Drawn, run(Case, rand:seed_s(exsss, 43))).

%% Machines that make a seed of their stream, each with events at which they draw.
cases() ->
    [
        {starl_registers_lww, [{{timeout, sync}, sync}]}
    ].

run({Module, Events}, Stream) ->
    Base = #{
        robot => 1,
        participants => [1, 2, 3],
        incarnation => 2,
        name => tested,
        now => 0,
        random => Stream
    },
    {Start, Machine} = starl_machine:new(Module, #{}, Base),
    Meta = #{now => 1000, robot => 1},
    {Actions, _} = lists:mapfoldl(
        fun({Type, Content}, M) -> starl_machine:step(Type, Content, Meta, M) end, Machine, Events
    ),
    [Start | Actions].

other_functions({#{next := Next} = Algorithm, Numbers}) ->
    {Algorithm#{next := fun(State) -> Next(State) end}, Numbers}.
