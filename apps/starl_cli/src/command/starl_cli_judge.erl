%% @doc `./starl judge': judges a recording by all contracts of its run.
-module(starl_cli_judge).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, statuses/0, subject/2, run/1]).

-spec name() -> string().
name() -> "judge".

-spec synopsis() -> string().
synopsis() -> "judge a recording by all contracts of its run".

-spec argument() -> starl_cli_command:argument().
argument() -> {required, "FILE", {example, "out/painting-1/run.mcap"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "FILE is a recording, or the directory of a run that holds one. The monitors of the run "
        "read its events again; the verdicts are those of the run. A recording that was cut off is "
        "judged to its last whole second, one with a hole up to that. Of recordings of the robots themselves, merged, the "
        "contracts are judged that do not need the true motions; which are not judged is said. A "
        "contract of your own is taken from the directory inputs beside the recording, where a run "
        "keeps its source."
    ].

-spec statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses() ->
    [
        {0, "no contract is broken"},
        {3, "a contract is broken"},
        {5, "a part of the run is not judged, and in the rest no contract is broken"}
    ].

-spec subject(string(), [string()]) ->
    {ok, file:filename(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    case starl_cli_recording:found(Word, "./starl run TARGET --record makes one") of
        {ok, File} -> {ok, File, Args};
        {error, _} = Error -> Error
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := File}) -> judged(starl_trace_judge:file(File), File, []).

judged({ok, Judged}, File, _Loaded) ->
    told(File, Judged);
judged({error, {no_monitor, _, Module} = Reason}, File, Loaded) ->
    case lists:member(Module, Loaded) orelse starl_cli_inputs:source(Module, File) of
        {ok, Source} -> loaded(starl_cli_source:modules(Source), Module, File, Loaded);
        _ -> {error, [starl_trace_judge:format_error(Reason)]}
    end;
judged({error, Reason}, _File, _Loaded) ->
    {error, [starl_trace_judge:format_error(Reason)]}.

loaded({ok, _, _}, Module, File, Loaded) ->
    judged(starl_trace_judge:file(File), File, [Module | Loaded]);
loaded({error, _} = Error, _Module, _File, _Loaded) ->
    Error.

told(File, #{violations := Violations, scenario := #{app := App} = Scenario} = Judged) ->
    #{until_us := Until, events := Events, ended := Ended, unjudged := Unjudged} = Judged,
    Us = Until - maps:get(begun_us, Scenario, 0),
    starl_cli_terminal:out([
        io_lib:format("~ts: ~ts, ~.1f s, ~b events judged", [File, App, Us / 1.0e6, Events]),
        ["; " || Ended =/= closed],
        cut(Ended),
        "\n",
        [[starl_monitor:format_violation(V), "\n"] || V <- Violations],
        not_judged(Judged),
        [[starl_unjudged:format(Part), "\n"] || Part <- Unjudged],
        verdict(Violations, Unjudged),
        same(Judged)
    ]),
    status(Violations, Unjudged).

cut(closed) -> "";
cut(cut_off) -> "the file is cut off after that";
cut({damaged, At}) -> io_lib:format("the file is damaged after that, at byte ~b", [At]).

not_judged(#{not_judged := NotJudged}) ->
    [
        ["not judged: ", lists:join(", ", Names), ": ", Why, "\n"]
     || {Needs, Why} <- [
            {motions, "they need the true motions, which the world's run.mcap has; merge it, too"},
            {robots, "they need the recordings of all robots of the run"}
        ],
        Names <- [[starl_monitor:name(Module) || {Module, N} <- NotJudged, N =:= Needs]],
        Names =/= []
    ].

verdict([], []) ->
    "no contract is broken\n";
verdict([], _Unjudged) ->
    "NOT JUDGED TO THE END; until there no contract is broken\n";
verdict([_], _Unjudged) ->
    "a contract is broken\n";
verdict(Violations, _Unjudged) ->
    io_lib:format("contracts are broken ~b times\n", [length(Violations)]).

same(#{found := unknown}) ->
    "";
same(#{found := Found, violations := Violations}) ->
    case lists:sort(Found) =:= lists:sort(Violations) of
        true -> "";
        false -> io_lib:format("the run itself had found ~b violations\n", [length(Found)])
    end.

status([], []) -> 0;
status([], _Unjudged) -> 5;
status(_Violations, _Unjudged) -> 3.
