%% @doc `./starl shrink': from a run that violates a contract to a small scenario file that
%% violates the same.
-module(starl_cli_shrink).

-export([command/1]).

-type source() :: {starl_cli_target:t(), Digest :: binary() | any}.

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    case starl_cli_setup:take_target(Args) of
        {none, Flags} -> without_target(Flags);
        {Word, Flags} -> named(lists:all(fun(C) -> C >= $0 andalso C =< $9 end, Word), Word, Flags)
    end.

%% `SEED --app NAME' is `NAME --seed SEED', as for ./starl replay.
named(false, Word, Flags) ->
    with_source(source(Word), Word, Flags);
named(true, Seed, Flags) ->
    case lists:splitwith(fun(Flag) -> Flag =/= "--app" end, Flags) of
        {Before, ["--app", App | After]} -> named(false, App, ["--seed", Seed] ++ Before ++ After);
        _ -> refuse([["seed ", Seed, " of what? Name it, as in --app exercise"]])
    end.

without_target([Help | _]) when Help =:= "--help"; Help =:= "-h" -> help("RUN", own_flags());
without_target(_) -> refuse(["name a run's directory, a scenario or an application first"]).

%% A run's directory, a scenario file or the name of an application. A recorded run has a digest
%% that must come out again.
-spec source(string()) -> {ok, source()} | {error, [unicode:chardata(), ...]}.
source(Word) ->
    Scenario = filename:join(Word, "scenario.term"),
    Recorded = filelib:is_regular(filename:join(Word, "run.term")),
    case filelib:is_regular(Scenario) andalso not Recorded of
        true -> with_digest(starl_cli_target:resolve(Scenario));
        false -> with_digest(starl_cli_target:resolve(Word))
    end.

with_digest({ok, #{record := #{digest := Hex}} = Target}) ->
    {ok, {Target, binary:decode_hex(list_to_binary(Hex))}};
with_digest({ok, Target}) ->
    {ok, {Target, any}};
with_digest({error, _} = Error) ->
    Error.

with_source({error, Problems}, _Word, _Flags) ->
    refuse(Problems);
with_source({ok, {#{app := App} = Target, Digest}}, Word, Flags) ->
    Known = own_flags() ++ starl_cli_setup:options(App),
    case {starl_cli_setup:help_wanted(Flags), starl_cli_flags:parse(Flags, Known)} of
        {true, _} -> help(Word, Known);
        {false, {ok, Values}} -> checked(Target, Digest, Values);
        {false, {error, Problems}} -> refuse(starl_cli_setup:flag_lines(Problems))
    end.

%% A run with other values than the recorded one has another digest.
checked(#{given := InFile} = Target, Digest, Values) ->
    Own = [Key || {Key, _, _, _} <- own_flags()],
    Chosen = maps:without(Own, Values),
    {Unsound, Scenario} = starl_cli_setup:scenario(Target, maps:merge(InFile, Chosen)),
    {Unwritable, File} = out(maps:get(out, Values, none), Target, Scenario),
    case Unsound ++ Unwritable of
        [] ->
            shrink(#{
                target => Target,
                scenario => Scenario,
                file => File,
                digest => case map_size(Chosen) of 0 -> Digest; _ -> any end,
                seconds => maps:get(seconds, Values, none),
                quiet => maps:get(quiet, Values, false)
            });
        Problems ->
            refuse(Problems)
    end.

out(none, Target, Scenario) ->
    {[], starl_cli_shrunk:file(Target, Scenario)};
out(File, _Target, _Scenario) ->
    case {filename:extension(File), filelib:is_dir(File)} of
        {".term", false} -> {[], File};
        {_, true} -> {[["--out: ", File, " is a directory; name a file as in small.term"]], none};
        {_, false} -> {[["--out: ", File, ": name a file that ends in .term"]], none}
    end.

shrink(Job) ->
    ok = starl_cli_log:install(),
    Answer = starl_cli_shrunk:shrink(Job),
    starl_cli_progress:erase(),
    case Answer of
        {ok, Lines, complete} -> told(Lines, 0);
        {ok, Lines, out_of_time} -> told(Lines, 4);
        {ok, Lines, interrupted} -> told(["interrupted; this is the smallest so far" | Lines], 130);
        {error, input, Why} -> refuse([Why]);
        {error, interrupted, Why} -> told([Why], 130);
        {error, internal, Why} -> failed(Why)
    end.

told(Lines, Status) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- Lines]),
    Status.

failed(Why) ->
    starl_cli_terminal:complain(["shrink: ", Why]),
    1.

own_flags() ->
    [
        {out, string, none, "the file for the result, FILE.term; without it one under out/"},
        {seconds, {optional, {number, 0.001, 1.0e6}}, none,
            "ends after so many seconds with the smallest so far"},
        {quiet, switch, false, "no progress line"},
        {help, switch, false, "this help"}
    ].

help(Word, Flags) ->
    Width = starl_cli_terminal:columns(),
    starl_cli_terminal:out([
        "Usage: ./starl shrink ", Word, " [FLAGS]\n\n",
        starl_cli_terminal:wrap("Takes a run that violates a contract (RUN is the directory of a "
            "run, a scenario file, an application with the flags of ./starl run, or SEED --app "
            "APPLICATION) and takes away from it whatever is not needed: time, faults, robots, "
            "chance, lost packets. The result is a scenario file that violates the same contract "
            "in the same way; it has been run. Ctrl-C writes the smallest so far.", 0, Width),
        "\n\n", starl_cli_flags:help(Flags, Width),
        "\nExit status: 0 shrunk; 1 internal error; 2 bad usage or input, also where the run "
        "violates\nnothing or is not reproducible; 4 the seconds were up; 130 interrupted.\n"
    ]),
    0.

refuse(Problems) -> starl_cli_terminal:bad_input([["shrink: ", P] || P <- Problems]).
