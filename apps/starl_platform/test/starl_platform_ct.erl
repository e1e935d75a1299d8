%% Helpers of the test suites of all applications: properties that run inside Common Test, and
%% runs without a log, violations and the names of faults.
%%
%% A random test prints its seed and takes it back from the environment variable STARL_SEED; the number of
%% its cases is that of the variable STARL_CASES, where it is set.
-module(starl_platform_ct).
-include_lib("proper/include/proper.hrl").

-export([property/2, safely/1, seed/0, within/2, work/1]).
-export([without_log/1, with_log/1, quietly/1, forget/0, tell/1, fault_id/2]).
-export([application/3, init/2, step/2, two_wheels/0]).

%% Checks a property in so many cases; fails the test case with the seed and the shrunk case.
property(Prop, Cases) ->
    Seed = seed(),
    %% PropEr has no option for the seed; the set-up runs after it has seeded itself.
    Seeded = ?SETUP(
        fun() ->
            _ = rand:seed(exsss, Seed),
            fun() -> ok end
        end,
        Prop
    ),
    Options = [{numtests, cases(Cases)}, {max_shrinks, 60}, nocolors, {on_output, fun io:format/2}],
    case proper:quickcheck(Seeded, Options) of
        true ->
            ok;
        Other ->
            error(
                {property_failed, [
                    {seed, Seed},
                    {answer, Other},
                    {counterexample, proper:counterexample()}
                ]}
            )
    end.

%% `./starl test --cases N' asks for other cases than a test does by itself.
cases(Own) -> list_to_integer(os:getenv("STARL_CASES", integer_to_list(Own))).

%% PropEr 1.2 cannot report an exception on OTP 25: it is printed here and counts as false.
safely(Fun) ->
    try
        Fun()
    catch
        Class:Reason:Stack ->
            io:format("~p: ~p~n~p~n", [Class, Reason, Stack]),
            false
    end.

%% The seed of this run, printed.
seed() ->
    Seed =
        case os:getenv("STARL_SEED") of
            false -> erlang:phash2({os:timestamp(), make_ref()}, 1 bsl 32);
            Text -> list_to_integer(Text)
        end,
    io:format("seed ~b; the same again with STARL_SEED=~b~n", [Seed, Seed]),
    Seed.

%% What a function answers, or an error if that takes longer than so many ms of wall time: for
%% what would otherwise wait for ever. The function runs in a process of its own.
within(Ms, Fun) ->
    {Pid, Ref} = spawn_monitor(fun() -> exit({answer, Fun()}) end),
    receive
        {'DOWN', Ref, process, Pid, {answer, Answer}} -> Answer;
        {'DOWN', Ref, process, Pid, Reason} -> error(Reason)
    after Ms ->
        exit(Pid, kill),
        receive
            {'DOWN', Ref, process, Pid, _} -> error({no_answer_within_ms, Ms})
        end
    end.

%% How much work a function makes, in reductions, and what it answers: the same on a fast machine, a
%% slow one and a busy one. It runs in a process of its own, so that only it is counted.
work(Fun) ->
    Count = fun() ->
        {reductions, Before} = process_info(self(), reductions),
        Answer = Fun(),
        {reductions, After} = process_info(self(), reductions),
        exit({work, After - Before, Answer})
    end,
    {Pid, Ref} = spawn_monitor(Count),
    receive
        {'DOWN', Ref, process, Pid, {work, Work, Answer}} -> {Work, Answer};
        {'DOWN', Ref, process, Pid, Reason} -> error(Reason)
    end.

%% For init_per_suite/1 and end_per_suite/1 of suites in which crashes are planned: their reports
%% are not.
without_log(Config) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    [{level, Level} | Config].

with_log(Config) -> logger:set_primary_config(level, proplists:get_value(level, Config)).

%% What a function answers that makes no reports meanwhile.
quietly(Fun) ->
    Config = without_log([]),
    try
        Fun()
    after
        with_log(Config)
    end.

%% Modules of EUnit share a process: those that come later find no message of this one.
forget() ->
    receive
        _ -> forget()
    after 0 -> ok
    end.

%% What a function of a robot answers in an application, and its actions until then. `Answer' is a function of
%% the machine and the request of each call: what the machine replies, or that it was restarted. Times are
%% over at once.
application(Fun, Answer, Seed) ->
    Spec = #{robot => 1, handle => starl:robot(1, [1]), module => ?MODULE, args => Fun},
    {ok, Pid} = starl_app_proc:start_link(Spec#{driver => self()}),
    receive
        {starl_attach, 1, app, Pid} -> ok
    end,
    Random = rand:seed_s(exsss, Seed),
    Pid ! {starl_boot, #{now => 0, random => Random, incarnation => 1, stored => none}},
    played(Pid, [], Answer).

init(_Robot, Fun) -> Fun.

step(Robot, Fun) -> {done, Fun(Robot)}.

played(Pid, Before, Answer) ->
    Actions =
        receive
            {starl_done, 1, Pid, Some} -> Some
        end,
    case awaited(lists:last(Actions), Answer) of
        {done, Result} ->
            true = unlink(Pid),
            true = exit(Pid, kill),
            {Result, Before ++ lists:droplast(Actions)};
        {Type, Content} ->
            Pid ! {starl_step, Type, Content, #{now => 0, robot => 1}},
            played(Pid, Before ++ Actions, Answer)
    end.

awaited({done, Result}, _Answer) ->
    {done, Result};
awaited({{timeout, Tag}, _Us, call}, _Answer) ->
    {{timeout, Tag}, call};
awaited({call, Machine, Request, Tag}, Answer) ->
    case Answer(Machine, Request) of
        {reply, Reply} -> {{reply, Tag}, Reply};
        restarted -> {info, {restarted, Machine}}
    end.

%% Violations, into the log of the test case.
tell(Violations) ->
    _ = [ct:log("~ts", [starl_violation:format(V)]) || V <- Violations],
    ok.

%% The name of the N-th fault of a schedule: no more atoms than the longest schedule has faults.
fault_id(Prefix, N) -> list_to_atom(lists:concat([Prefix, N])).

%% The profile of a chassis with two wheels, in round numbers: a last leg is 100 mm long.
two_wheels() ->
    starl_chassis_differential:profile(#{
        speed => 100.0,
        near_speed => 50.0,
        turn_rate => 1.0,
        near_turn_rate => 0.5,
        leg_s => 1.0,
        axle_mm => 200.0,
        turn_from => 0.01,
        look_from => 0.1,
        heading_error => 0.02,
        distance_error => 0.05,
        position_error_mm => 2.0
    }).
