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
        work => 50,
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
     || {Block, Seed, Ends} <- [{mutex, 2, killed} | [{Block, 1, closed} || Block <- blocks()]]
    ].

all_off_at_once_test_() ->
    [
        in_directory(atom_to_list(Block), fun(Dir) ->
            ?assertEqual({[], []}, accused(Dir, exercise(Block, N, 1, all_off), #{}))
        end)
     || {Block, N} <- [{mutex, 1}, {barrier, 1} | [{Block, 2} || Block <- blocks()]]
    ].

%% -- clocks ---------------------------------------------------------------------------------

%% One clock is 15 ms off, or more: packets that come before they are sent are no violation.
a_clock_that_is_off_accuses_nobody_test_() ->
    [
        in_directory(atom_to_list(Block), fun(Dir) ->
            ?assertEqual({[], []}, accused(Dir, exercise(Block, 3, 1, none), #{clocks => Clocks}))
        end)
     || {Block, Clocks} <- lists:zip(blocks(), [
            #{2 => 15000},
            #{1 => -25000, 3 => 25000},
            #{2 => {step, 5000000, -50000}},
            #{2 => 15000},
            #{1 => -25000, 3 => 25000},
            #{2 => {step, 5000000, -50000}}
        ])
    ].

%% A clock that drifts by 1 % and is set right all the time would be; by 50 ppm it is 3 ms off at the end.
a_clock_that_drifts_accuses_nobody_test_() ->
    in_directory("drift", fun(Dir) ->
        Clocks = #{1 => {drift, 50}, 2 => {drift, -500}},
        ?assertEqual({[], []}, accused(Dir, exercise(mutex, 3, 2, off), #{clocks => Clocks}))
    end).

%% `judge --sigma' by the advice of `merge' accuses nobody either: at most something depends on the clocks.
the_advice_of_merge_accuses_nobody_test_() ->
    [
        in_directory(Name, fun(Dir) ->
            #{violations := []} = Run = ?F:run(exercise(mutex, 3, 1, none)),
            Files = ?F:write(Dir, Run, #{clocks => #{2 => Clock}}),
            Out = filename:join(Dir, "merged.mcap"),
            {0, Said} = starl_cli_said:said(["merge" | Files] ++ ["--out", Out]),
            ?assertNotEqual(nomatch, string:find(Said, "clocks: times of robot ")),
            [_, Advice] = string:split(Said, "./starl "),
            {Status, Text} = starl_cli_said:said(string:lexemes(Advice, " \n")),
            ?assertEqual({Text, true}, {Text, lists:member(Status, [0, 6])}),
            ?assertEqual(nomatch, string:find(Text, " broken at "))
        end)
     || {Name, Clock} <- [{"constant", 15000}, {"set", {step, 5000000, 40000}}]
    ].

%% Robots count from 1970; an application whose minute begins with the run is not late then.
a_run_begins_with_its_recordings_test_() ->
    in_directory("follow", fun(Dir) ->
        Given = #{app => follow, robots => 3, seed => 4, time => 60},
        ?assertEqual({[], []}, accused(Dir, Given, #{}))
    end).

%% -- what is lost ---------------------------------------------------------------------------

%% A computer without power has not written the last second. Others have heard it, so it is known: what
%% builds on that is not judged.
a_lost_last_second_accuses_nobody_test_() ->
    [
        in_directory(atom_to_list(Block), fun(Dir) ->
            {[], [Part]} = accused(Dir, exercise(Block, 3, 1, off), #{ends => #{2 => [power]}}),
            ?assertMatch(#{why := {lost_power, 2}}, Part)
        end)
     || Block <- [mutex, registers]
    ].

%% A fleet that was killed: of each robot the end is missing.
a_fleet_that_was_killed_accuses_nobody_test_() ->
    in_directory("killed", fun(Dir) ->
        How = #{last => #{1 => power, 2 => killed, 3 => power}, clocks => #{1 => 30000}},
        {[], [Part]} = accused(Dir, exercise(mutex, 3, 3, off), How),
        ?assertMatch(#{why := no_end}, Part)
    end).

%% -- all together ---------------------------------------------------------------------------

%% Computers are off for 5 to 60 s at various times, clocks up to 50 ms apart: constant, drifting, set.
no_sound_fleet_is_accused_test_() ->
    [
        in_directory(lists:concat(["seed ", Seed]), fun(Dir) ->
            {Given, How} = drawn(Seed),
            {Accused, Unjudged} = accused(Dir, Given, How),
            ?assertEqual({Seed, Given, How, []}, {Seed, Given, How, Accused}),
            ?assertEqual({Seed, []}, {Seed, Unjudged})
        end)
     || Seed <- lists:seq(1, 20)
    ].

drawn(Seed) ->
    _ = rand:seed(exsss, Seed),
    N = lists:nth(rand:uniform(4), [1, 2, 3, 4]),
    Block = lists:nth(1 + Seed rem 6, blocks()),
    Faults = [
        {Id, From, From + 4999 + rand:uniform(55001), reboot, rand:uniform(N), #{}}
     || Id <- [a, b, c], From <- [10000 + rand:uniform(40000)]
    ],
    Robots = lists:seq(1, N),
    {
        (exercise(Block, N, Seed, none))#{faults => Faults},
        #{
            clocks => maps:from_list([{R, clock(rand:uniform(3))} || R <- Robots]),
            ends => maps:from_list([
                {R, [one_of([closed, killed]) || _ <- [1, 2, 3]]}
             || R <- Robots
            ])
        }
    }.

clock(1) -> rand:uniform(50001) - 25001;
clock(2) -> {drift, rand:uniform(401) - 201};
clock(3) -> {step, rand:uniform(50000000), rand:uniform(50001) - 25001}.

one_of(List) -> lists:nth(rand:uniform(length(List)), List).

%% -- broken runs ----------------------------------------------------------------------------

%% What is broken is found all the same: with clocks 50 ms apart, of robots that restart.
a_planted_bug_is_found_test_() ->
    [
        in_directory(atom_to_list(Bug), fun(Dir) ->
            #{violations := [#{contract := C, what := W} | _]} =
                Run = ?F:run(starl_planted:scenario(Bug, Seed)),
            {Found, _} = judged(Dir, Run, #{clocks => #{1 => -25000, 2 => 25000}}),
            ?assertEqual({Bug, true, Found}, {Bug, lists:member({C, W}, Found), Found})
        end)
     || {Bug, Seed} <- planted()
    ].

%% Each with a seed by which it shows soon.
planted() ->
    [
        {sap_claims, 3},
        {sap_late, 1},
        {election_incomplete, 1},
        {election_deaf, 2},
        {bully_early, 1},
        {registers_last_heard, 1},
        {counter_adds, 1}
    ].
