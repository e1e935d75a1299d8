%% No predicate by name accuses a sound run: each over each application that ships, without faults.
%% STARL_DEBUG_SEEDS=20 tries so many runs of each application, from seed STARL_DEBUG_SEED on.
%%
%% Holds: No predicate by name accuses a sound run, and each finds its violation; durations go by
%% the drift that is given; names that a recording cannot have are refused
%% Red: 961f67c9, run
-module(starl_debug_sound_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PATIENCE_S, 600).

targets() ->
    [
        {"painting", ["--robots", "3", "--picture", "lines"]},
        {"search", ["--robots", "3"]},
        {"convoy", ["--robots", "3"]},
        {"crossing", ["--robots", "4", "--duration", "40"]},
        {"follow", ["--robots", "3", "--duration", "30"]},
        {"formation", ["--robots", "4"]},
        {"swarm", ["--robots", "4", "--duration", "30"]}
        | [{"exercise", ["--robots", "3", "--block", Block]} || Block <- blocks()]
    ].

blocks() ->
    [
        "sap",
        "motion",
        "election",
        "bully",
        "mutex",
        "barrier",
        "geocast",
        "registers",
        "counter"
    ].

%% A distance is asked for where the run promises one.
predicates(#{monitors := Monitors}) ->
    Far = [io_lib:format("too_near(~.3f mm)", [1.0 * Mm]) || {_, #{r_s := Mm}} <- Monitors],
    Lasting = [
        io_lib:format("~s(~b s)", [Name, S])
     || {Name, duration, _, _} <- starl_debug_library:known(), S <- [2, 4, 10]
    ],
    Far ++ Lasting ++ [Name || {Name, none, _, _} <- starl_debug_library:known()].

nobody_is_accused_test_() ->
    First = number("STARL_DEBUG_SEED", erlang:system_time(second) rem 100000),
    Seeds = lists:seq(First, First + number("STARL_DEBUG_SEEDS", 1) - 1),
    [
        {
            lists:append(lists:join(" ", [App | Flags])),
            {timeout, ?PATIENCE_S, fun() ->
                Accused = [
                    {seed, Seed, Found}
                 || Seed <- Seeds, Found <- accused(App, Flags, Seed), Found =/= []
                ],
                ?assertEqual([], Accused)
            end}
        }
     || {App, Flags} <- targets()
    ].

%% -- the page -----------------------------------------------------------------------------------

%% Each predicate in doc/debug.md's table of the language is understood, and asks for nothing that a run
%% of the crossing cannot have. The names of tokens, machines and events in it are true of some robot.
the_examples_of_the_page_run_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        {ok, Page} = file:read_file(filename:join(os:getenv("STARL_ROOT", "."), "doc/debug.md")),
        Examples = examples(Page),
        ?assert(length(Examples) >= 10),
        with_run("crossing", ["--robots", "4", "--duration", "40"], 1, fun(File) ->
            [?assertEqual({Text, []}, {Text, trouble(Text, File)}) || Text <- Examples]
        end)
    end}.

%% What stands in the first column of a row, without what only shows a form.
examples(Page) ->
    Rows = [Row || <<"| `", _/binary>> = Row <- binary:split(Page, <<"\n">>, [global])],
    Spans = [
        unicode:characters_to_list(Span)
     || Row <- Rows,
        [_, Cell | _] <- [binary:split(Row, <<"|">>, [global])],
        {match, Found} <- [re:run(Cell, "`([^`]*)`", [global, {capture, [1], binary}])],
        [Span] <- Found
    ],
    [Text || Text <- lists:usort(Spans), is_example(Text)].

is_example(Text) ->
    re:run(Text, "^((dist|inside|owner|leader|coordinator|up|last|count)[(]|r1[.].* = )") =/=
        nomatch andalso
        string:find(Text, "...") =:= nomatch andalso string:find(Text, " E)") =:= nomatch.

trouble(Text, File) ->
    {Status, Said} = starl_cli_said:said([
        "debug", File, "--quiet", "--no-explain", "--sigma", "0", "--predicate", Text
    ]),
    IsNamed = re:run(Text, "^(owner|last)") =/= nomatch,
    [{Status, Said} || Status =:= 2 orelse Status =:= 1 orelse (IsNamed andalso Status =/= 3)].

number(Name, Default) -> list_to_integer(os:getenv(Name, integer_to_list(Default))).

accused(App, Flags, Seed) -> with_run(App, Flags, Seed, fun verdicts/1).

with_run(App, Flags, Seed, Fun) ->
    Dir = filename:join(
        os:getenv("TMPDIR", "/tmp"),
        lists:concat(["starl-debug-sound-", os:getpid(), "-", App, erlang:unique_integer()])
    ),
    Args = ["--seed", integer_to_list(Seed), "--record", "--quiet", "--out", Dir],
    try
        {0, _} = starl_cli_said:said(["run", App | Flags] ++ Args),
        Fun(filename:join(Dir, "run.mcap"))
    after
        file:del_dir_r(Dir)
    end.

verdicts(File) ->
    {ok, Recording} = starl_debug_recording:read([File], #{}),
    [
        {unicode:characters_to_list(Text), Verdict}
     || Text <- predicates(Recording),
        Verdict <- [verdict(Text, Recording)],
        Verdict =/= never
    ].

verdict(Text, Recording) ->
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Go = fun(_Done) -> continue end,
    maps:get(verdict, starl_debug_check:run(Formula, Recording, #{sigma => 0}, Go)).
