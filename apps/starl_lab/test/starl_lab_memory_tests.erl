%% Runs for which the machine is too small are refused, with figures and ways out.
-module(starl_lab_memory_tests).
-include_lib("eunit/include/eunit.hrl").

-define(GB, 1_000_000_000).

line(Robots, Mode, Available) ->
    line(Robots, Mode, #{jobs => 1, nodes => true}, Available).

line(Robots, Mode, Use, Available) ->
    Lines = starl_lab_memory:check(#{robots => Robots, mode => Mode}, Use, Available),
    [unicode:characters_to_list(Line) || Line <- Lines].

a_team_that_fits_is_no_problem_test() ->
    ?assertEqual([], line(10000, inline, ?GB)),
    ?assertEqual([], line(3000, process, ?GB)),
    ?assertEqual([], line(100000, inline, unknown)).

figures_and_ways_out_test() ->
    ?assertEqual(
        [
            "--robots: 100000 robots need about 7.1 GB of memory, and 500 MB are free; take up to "
            "6285 robots, or spread the run over other machines (--nodes)"
        ],
        line(100000, auto, ?GB div 2)
    ),
    ?assertEqual(
        [
            "--robots: 4000 robots need about 1.1 GB of memory, and 1.0 GB are free; take up to "
            "3760 robots, or --mode inline, or spread the run over other machines (--nodes)"
        ],
        line(4000, process, ?GB)
    ).

%% What is advised is no problem.
the_advice_is_sound_test() ->
    ?assertEqual([], line(6285, inline, ?GB div 2)),
    ?assertMatch([_], line(6286, inline, ?GB div 2)),
    ?assertEqual([], line(3760, process, ?GB)),
    ?assertMatch([_], line(3761, process, ?GB)).

%% Runs at once, each in a VM of its own, need the memory of all; fewer at once are a way out, too.
runs_at_once_test() ->
    Use = #{jobs => 4, nodes => false},
    ?assertEqual(
        [
            "--robots: 4000 robots in each of 4 runs at once need about 1.4 GB of memory, and 1.0 GB "
            "are free; take up to 2714 robots, or --jobs 2"
        ],
        line(4000, inline, Use, ?GB)
    ),
    ?assertEqual([], line(4000, inline, Use#{jobs := 2}, ?GB)),
    ?assertMatch([_], line(4000, inline, Use#{jobs := 3}, ?GB)),
    ?assertEqual([], line(2714, inline, Use, ?GB)),
    ?assertMatch([_], line(2715, inline, Use, ?GB)).

more_processes_than_the_vm_has_test() ->
    Most = erlang:system_info(process_limit) div 10,
    [Line] = line(Most + 1, process, unknown),
    ?assertNotEqual(nomatch, string:find(Line, "take --mode inline")),
    ?assertEqual([], line(Most, process, unknown)).

%% A machine has some memory, and tells it or not.
available_test() ->
    case starl_lab_memory:available() of
        unknown -> ok;
        Bytes -> ?assert(Bytes > 0)
    end.

%% The command lines ask.
-define(TOO_MANY, ["ring_shuttle", "--robots", "100000", "--mode", "process"]).

a_run_is_refused_test() ->
    refused(starl_lab_run:command(), fun starl_lab_setup:check/1, ?TOO_MANY).

a_replay_is_refused_test() ->
    refused(starl_lab_replay:command(), fun starl_lab_replay:setup/1, ?TOO_MANY).

refused(Command, Check, Args) ->
    {ok, Call} = starl_cli_dispatch:read(Command, Args),
    {error, [Line]} = Check(Call),
    ?assertMatch("--mode process: it is for up to " ++ _, unicode:characters_to_list(Line)).
