%% @doc The record of a run, the file `run.term' in its directory. It is one map of readable Erlang
%% terms with all inputs and results of the run. `./starl replay' repeats the run and compares.
-module(starl_cli_record).

-export([make/4, results/1, text/1, write/2, read/1, format_error/1, hex/1]).

-export_type([t/0, violation/0, reason/0]).

%% A recorded run. `scenario': all values of the run with those of the application; its `faults'
%% include the drawn ones; with the application's module as `app' it can be started unchanged.
%% `options': the application's own values once more. `app': a name or a source file, as in a
%% scenario file. `digest': lower-case hexadecimal; empty if a node was lost, a step did not end, or the run passed in
%% real time. `results': a hash of each
%% robot's result, since a result may have no readable form. `code': the code that has run. A record of
%% an earlier version lacks the two.
-type t() :: #{
    app := atom() | file:filename_all(),
    scenario := #{atom() => term()},
    options := #{atom() => term()},
    digest := string(),
    ending := starl_run:ending(),
    end_us := non_neg_integer(),
    events := non_neg_integer(),
    violations := [violation()],
    results => [{starl:robot_id(), Hash :: non_neg_integer()}],
    code => starl_build:code()
}.

%% The record of a violation. Its details may have no readable form, so they are in the text only.
-type violation() :: #{
    contract := atom(),
    what := atom(),
    at_us := non_neg_integer(),
    robots := [starl:robot_id()],
    text := string()
}.

-type reason() ::
    {unreadable, starl_run_scenario:reason()}
    | {no_record, file:filename()}
    | {missing, file:filename(), [Key :: atom(), ...]}
    | {unsound, file:filename(), [Key :: atom(), ...]}
    | {unwritable, file:filename(), file:posix() | badarg | terminated | system_limit}.

-define(NAME, "run.term").
-define(HASHES, 1 bsl 32).
-define(KEYS, [app, scenario, options, digest, ending, end_us, events, violations]).
%% Those that a record may lack.
-define(MORE, [results, code]).
-define(ENDINGS, [done, time, violation, stopped, quiet, lost, hung]).

%% @doc Makes the record of a run from the application (as in a scenario file), the scenario that
%% has run, the end of the run and the results, and the code.
-spec make(App, starl_run_scenario:t(), {starl_run:ending(), Outcome}, starl_build:code()) ->
    t()
when
    App :: atom() | file:filename_all(),
    Outcome :: starl_run:outcome().
make(Name, #{app := App} = Scenario, {Ending, Outcome}, Code) ->
    #{digest := Digest, end_us := EndUs, events := Events, violations := Violations} = Outcome,
    #{
        app => Name,
        scenario => maps:remove(app, Scenario),
        options => maps:with([Key || {Key, _, _, _} <- starl_app:options(App)], Scenario),
        digest => hex(Digest),
        ending => Ending,
        end_us => EndUs,
        events => Events,
        violations => [violation(V) || V <- Violations],
        results => results(Outcome),
        code => Code
    }.

%% @doc A hash of each robot's result, the same in every VM.
-spec results(starl_run:outcome()) -> [{starl:robot_id(), non_neg_integer()}].
results(#{robots := Robots}) ->
    [{Id, erlang:phash2(Result, ?HASHES)} || {Id, #{result := Result}} <- Robots].

violation(#{contract := _, what := _, at_us := _, robots := _} = Violation) ->
    Known = maps:with([contract, what, at_us, robots], Violation),
    Text = unicode:characters_to_list(starl_violation:format(Violation)),
    Known#{text => lists:flatten(Text)}.

%% @doc A digest in hexadecimal.
-spec hex(binary()) -> string().
hex(Digest) -> binary_to_list(string:lowercase(binary:encode_hex(Digest))).

%% @doc The text of the file: the keys in the order of the type, one line per value of the
%% scenario.
-spec text(t()) -> unicode:chardata().
text(Record) ->
    Keys = [Key || Key <- ?KEYS ++ ?MORE, is_map_key(Key, Record)],
    Lines = [["    ", atom_to_list(Key), " => ", value(maps:get(Key, Record))] || Key <- Keys],
    [
        "%% A run, as it was; ./starl replay with the name of this file runs it again.\n",
        "#{\n",
        lists:join(",\n", Lines),
        "\n}.\n"
    ].

value(Map) when map_size(Map) =:= 0 ->
    "#{}";
value(Map) when is_map(Map) ->
    Values = lists:sort(maps:to_list(Map)),
    Lines = [[io_lib:format("~0tp => ", [Key]), term(Value)] || {Key, Value} <- Values],
    ["#{\n        ", lists:join(",\n        ", Lines), "\n    }"];
value(Value) ->
    term(Value).

%% A list of tuples or maps, such as the faults, has one line per element.
term([First | _] = List) when is_tuple(First); is_map(First) ->
    Lines = [io_lib:format("~0tp", [Element]) || Element <- List],
    ["[\n            ", lists:join(",\n            ", Lines), "\n        ]"];
term(Value) ->
    io_lib:format("~0tp", [Value]).

%% @doc Writes a record into a file, or as `run.term' into a directory.
-spec write(file:filename(), t()) -> ok | {error, reason()}.
write(Path, Record) ->
    File = file_of(Path),
    case file:write_file(File, unicode:characters_to_binary(text(Record))) of
        ok -> ok;
        {error, Posix} -> {error, {unwritable, File, Posix}}
    end.

%% @doc Reads a record from a file or from the directory of a run. A record must have a digest.
-spec read(file:filename()) -> {ok, t()} | {error, reason()}.
read(Path) ->
    File = file_of(Path),
    case starl_run_scenario:read(File) of
        {ok, #{digest := _} = Map} -> checked(File, Map);
        {ok, _} -> {error, {no_record, File}};
        {error, {file, File, enoent}} when File =/= Path -> {error, {no_record, Path}};
        {error, Reason} -> {error, {unreadable, Reason}}
    end.

file_of(Path) ->
    case filelib:is_dir(Path) of
        true -> filename:join(Path, ?NAME);
        false -> Path
    end.

checked(File, Map) ->
    Missing = [Key || Key <- ?KEYS, not is_map_key(Key, Map)],
    Unsound = [
        Key
     || Key <- ?KEYS ++ ?MORE, is_map_key(Key, Map), not is_sound(Key, maps:get(Key, Map))
    ],
    case {Missing, Unsound} of
        {[], []} -> {ok, maps:with(?KEYS ++ ?MORE, Map)};
        {[_ | _], _} -> {error, {missing, File, Missing}};
        {[], [_ | _]} -> {error, {unsound, File, Unsound}}
    end.

is_sound(app, App) -> is_atom(App) orelse is_text(App);
is_sound(scenario, Scenario) -> is_map(Scenario);
is_sound(options, Options) -> is_map(Options);
is_sound(digest, Digest) -> Digest =:= "" orelse is_text(Digest);
is_sound(ending, Ending) -> lists:member(Ending, ?ENDINGS);
is_sound(end_us, EndUs) -> is_integer(EndUs) andalso EndUs >= 0;
is_sound(events, Events) -> is_integer(Events) andalso Events >= 0;
is_sound(results, Results) -> is_list(Results) andalso lists:all(fun is_hash/1, Results);
is_sound(code, Code) -> is_text(Code);
is_sound(violations, Violations) -> is_list(Violations) andalso lists:all(fun is_map/1, Violations).

is_hash({Robot, Hash}) -> is_integer(Robot) andalso is_integer(Hash);
is_hash(_) -> false.

is_text(Text) -> Text =/= "" andalso io_lib:printable_unicode_list(Text).

%% @doc One line that states the problem, its place and the remedy.
-spec format_error(reason()) -> unicode:chardata().
format_error({unreadable, Reason}) ->
    starl_run_scenario:format_error(Reason);
format_error({no_record, Path}) ->
    [Path, ": no run is recorded here; a run's directory holds it as " ?NAME];
format_error({missing, File, Keys}) ->
    [File, ": this record of a run lacks ", names(Keys), "; take the file as the run wrote it"];
format_error({unsound, File, Keys}) ->
    [File, ": not what a run writes: ", names(Keys), "; take the file as the run wrote it"];
format_error({unwritable, File, Posix}) ->
    [File, ": ", file:format_error(Posix)].

names(Keys) -> lists:join(", ", [atom_to_list(Key) || Key <- Keys]).
