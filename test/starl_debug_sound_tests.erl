%% No predicate by name accuses a sound run: each over each application that ships, without faults.
%% STARL_DEBUG_SEEDS=20 tries so many runs of each application, from seed STARL_DEBUG_SEED on.
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

number(Name, Default) -> list_to_integer(os:getenv(Name, integer_to_list(Default))).

accused(App, Flags, Seed) ->
    Dir = filename:join(
        os:getenv("TMPDIR", "/tmp"),
        lists:concat(["starl-debug-sound-", os:getpid(), "-", App, erlang:unique_integer()])
    ),
    Args = ["--seed", integer_to_list(Seed), "--record", "--quiet", "--out", Dir],
    try
        {0, _} = starl_cli_said:said(["run", App | Flags] ++ Args),
        verdicts(filename:join(Dir, "run.mcap"))
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
