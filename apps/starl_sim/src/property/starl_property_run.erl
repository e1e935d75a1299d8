%% @doc Runs the scenario of a property, judges the run, and writes a failing scenario to a file.
-module(starl_property_run).

-export([verdict/2, tell/3]).

-export_type([verdict/0]).

%% A run that is not judged to its end, or that fails itself, does not hold.
-type verdict() ::
    holds
    | {broken, starl_monitor:violation()}
    | {crashed, starl_crash_monitor:excused()}
    | incomplete
    | refused
    | {failed, starl_sim_trial:reason()}.

%% The most runs that shrinking may take.
-define(RUNS, 2000).

%% @doc Runs a scenario and judges the run.
-spec verdict(#{app := module(), atom() => term()}, starl_property:demand()) -> verdict().
verdict(Scenario, Demand) ->
    case starl_sim_trial:run(Scenario) of
        {ok, #{violations := [First | _]}} -> {broken, First};
        {ok, Outcome} -> sound(crash(Outcome), Outcome, Demand);
        {error, Reason} -> {failed, Reason}
    end.

%% The first crash of an application that no fault has caused.
crash(#{monitors := #{starl_crash_monitor := #{first_crash := Crash}}}) -> Crash;
crash(_Outcome) -> none.

sound({_, _, _, _} = Crash, _Outcome, Demand) when not is_map_key(crashes, Demand) ->
    {crashed, Crash};
sound(_Crash, Outcome, Demand) ->
    demanded(Outcome, Demand).

demanded(#{ending := Ending}, #{complete := true}) when Ending =/= done -> incomplete;
demanded(Outcome, #{outcome := Holds}) ->
    case Holds(Outcome) of
        true -> holds;
        false -> refused
    end;
demanded(_Outcome, _Demand) ->
    holds.

%% @doc Says why a run does not hold, shrinks it where a contract is broken, and leaves it in a file.
-spec tell(#{app := module(), atom() => term()}, starl_property:demand(), verdict()) -> ok.
tell(Scenario, Demand, {broken, Violation}) ->
    {Small, Broken} = shrunk(Scenario, Violation),
    io:format("~n~ts~n", [starl_violation:format(Broken)]),
    left(Small, Demand);
tell(Scenario, Demand, Verdict) ->
    io:format("~n~ts~n", [words(Verdict)]),
    left(Scenario, Demand).

words({crashed, {AtUs, Robot, _, Cause}}) ->
    io_lib:format("~ts (robot ~b, ~.6f s)", [starl_crash:format(Cause), Robot, AtUs / 1000000]);
words(incomplete) ->
    "the applications are not done when the run ends";
words(refused) ->
    "the run's outcome is not what the property demands";
words({failed, {start, Reason}}) ->
    starl_sim:format_error(Reason);
words({failed, {unjudged, Parts}}) ->
    lists:join("; ", [starl_unjudged:format(Part) || Part <- Parts]);
words({failed, {failed, {hung, Hang}}}) ->
    starl_sim_watchdog:format_hang(Hang);
words({failed, {failed, Reason}}) ->
    io_lib:format("the simulation failed: ~0tP", [Reason, 30]).

shrunk(Scenario, Violation) ->
    {ok, Checked} = starl_run_scenario:check(Scenario, starl_app:options(maps:get(app, Scenario))),
    Run = fun starl_sim_trial:run/1,
    case starl_sim_shrink:shrink(Checked, #{run => Run, watch => fun watch/1}) of
        {ok, #{scenario := Small, violation := Broken}} ->
            {Small, Broken};
        %% A run that is not the same twice is told by itself.
        {error, Reason} ->
            io:format("~n~ts~n", [starl_sim_shrink:format_error(Reason)]),
            {Checked, Violation}
    end.

watch(#{runs := Runs}) when Runs >= ?RUNS -> {stop, fun watch/1};
watch(_Figures) -> {continue, fun watch/1}.

left(#{app := App, seed := Seed} = Scenario, Demand) ->
    Dir = maps:get(dir, Demand, "out"),
    File = filename:join(Dir, lists:concat([App, "-", Seed, ".term"])),
    Written =
        case filelib:ensure_dir(File) of
            ok -> file:write_file(File, text(App, Scenario));
            {error, _} = Error -> Error
        end,
    case Written of
        ok -> io:format("replay: starl run ~ts~ts~n", [File, digest(Scenario)]);
        {error, Posix} -> io:format("~ts: ~ts~n", [File, file:format_error(Posix)])
    end.

%% The digest that the replay must have, too.
digest(Scenario) ->
    case starl_sim_trial:run(Scenario) of
        {ok, #{digest := Digest}} ->
            ["  (digest ", string:lowercase(binary:encode_hex(Digest)), ")"];
        {error, _} ->
            ""
    end.

%% The application, and the values that differ from the defaults.
text(App, Scenario) ->
    Values = [
        [atom_to_list(Key), io_lib:format(" => ~0tp", [Value])]
     || {Key, _, Default, _} <- starl_run_scenario:options(App),
        {ok, Value} <- [maps:find(Key, Scenario)],
        Value =/= Default orelse lists:member(Key, [robots, seed])
    ],
    Lines = [io_lib:format("app => ~0tp", [App]) | Values],
    unicode:characters_to_binary([
        "%% A run that does not hold, of the code ",
        starl_build:code([Beam || {_, Beam, _} <- [code:get_object_code(App)]]),
        "; starl run with the name of this file repeats it.\n"
        "#{\n    ",
        lists:join(",\n    ", Lines),
        "\n}.\n"
    ]).
