%% What `merge' and `judge' say of the recordings of a fleet whose robots keep all contracts, though their computers
%% are switched off for a while: nobody is accused. Of a fleet with a planted bug they find the violation on the same
%% path.
-module(starl_debug_fleet_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PATIENCE_S, 60).
-define(F, starl_debug_fleet).

in_directory(Name, Test) ->
    {Name,
        {timeout, ?PATIENCE_S, fun() ->
            Dir = filename:join("/tmp", "starl-fleet-tests-" ++ os:getpid()),
            ok = filelib:ensure_path(Dir),
            try
                Test(Dir)
            after
                ok = file:del_dir_r(Dir)
            end
        end}}.

%% The violations of the merged recordings of a sound run.
accused(Dir, Given, How) ->
    #{violations := []} = Run = ?F:run(Given),
    judged(Dir, Run, How).

judged(Dir, Run, How) ->
    Out = filename:join(Dir, "merged.mcap"),
    {ok, _} = starl_trace_merge:files(?F:write(Dir, Run, How), Out),
    {ok, #{violations := Violations, unjudged := Unjudged}} = starl_trace_judge:file(Out),
    {[{C, W} || #{contract := C, what := W} <- Violations], Unjudged}.

exercise(Block, Robots, Seed, Faults) ->
    #{
        app => exercise,
        block => Block,
        robots => Robots,
        seed => Seed,
        work => 60,
        faults => [{f1, 20000, 55000, reboot, 2, #{}} || Faults =:= off] ++
            [{id(R), 20000, 45000, reboot, R, #{}} || R <- lists:seq(1, Robots), Faults =:= all_off]
    }.

id(R) -> lists:nth(R, [off1, off2, off3]).

blocks() -> [mutex, barrier, election, bully, registers, counter].

%% Half a minute without power explains that a token lies idle, that nobody agrees, that no round is passed.
a_computer_that_was_off_is_an_excuse_test_() ->
    [
        in_directory(atom_to_list(Block), fun(Dir) ->
            How = #{ends => #{2 => [Ends]}},
            ?assertEqual({[], []}, accused(Dir, exercise(Block, 3, Seed, off), How))
        end)
     || Block <- blocks(), {Seed, Ends} <- [{1, closed}, {2, killed}]
    ].

all_off_at_once_test_() ->
    [
        in_directory(atom_to_list(Block), fun(Dir) ->
            ?assertEqual({[], []}, accused(Dir, exercise(Block, N, 1, all_off), #{}))
        end)
     || Block <- blocks(), N <- [1, 2]
    ].
