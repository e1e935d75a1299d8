%% @doc Writes the files of a run's directory.
-module(starl_lab_files).

-export([write/4, write_failure/3, put_all/2, scenario/1]).

%% `partly': the files are there but one that is not needed.
-type answer() :: ok | {partly, unicode:chardata()} | {error, unicode:chardata()}.

%% Further files of a run: texts by name, and a function that writes others.
-type own() :: #{
    texts := [{Name :: string(), unicode:chardata()}],
    write := fun((file:filename()) -> starl_scene:written())
}.

%% @doc Writes the reports, the scenario, the record of the run, the log unless it is empty, and
%% further files.
-spec write(file:filename(), starl_lab_setup:t(), {Report, Record}, Own) -> answer() when
    Report :: starl_lab_report:t(),
    Record :: starl_cli_record:t(),
    Own :: own().
write(Dir, Setup, {Report, Record}, #{texts := Texts, write := Write}) ->
    Files =
        [
            {"report.txt", starl_lab_report:text(Report)},
            {"report.json", starl_lab_report:json(Report)},
            {"scenario.term", own_scenario(Setup)},
            {"run.term", starl_cli_record:text(Record)}
        ] ++ Texts ++ log(starl_cli_log:lines()) ++ inputs(Setup),
    case put_all(Dir, Files) of
        ok -> own(Write(Dir));
        {error, _} = Error -> Error
    end.

own({ok, _Files}) -> ok;
own({partly, _Files, Why}) -> {partly, Why};
own({error, Why}) -> {error, Why}.

%% @doc Writes the scenario, the reason and the log of a failed simulation.
-spec write_failure(file:filename(), starl_lab_setup:t(), Reason :: term()) ->
    ok | {error, unicode:chardata()}.
write_failure(Dir, Setup, Reason) ->
    put_all(Dir, [
        {"scenario.term", own_scenario(Setup)},
        {"run.log", [starl_cli_log:lines(), io_lib:format("~tp~n", [Reason])]}
        | inputs(Setup)
    ]).

inputs(#{inputs := Inputs}) -> starl_cli_inputs:files(Inputs).

log([]) -> [];
log(Lines) -> [{"run.log", Lines}].

%% @doc Writes files with these texts into a directory.
-spec put_all(file:filename(), [{Name :: string(), unicode:chardata()}]) ->
    ok | {error, unicode:chardata()}.
put_all(_Dir, []) ->
    ok;
put_all(Dir, [{Name, Text} | Files]) ->
    File = filename:join(Dir, Name),
    _ = filelib:ensure_dir(File),
    case file:write_file(File, bytes(Text)) of
        ok -> put_all(Dir, Files);
        {error, Posix} -> {error, [Name, ": ", file:format_error(Posix)]}
    end.

%% The inputs of a run are copied byte by byte.
bytes(Text) when is_binary(Text) -> Text;
bytes(Text) -> unicode:characters_to_binary(Text).

%% @doc The text of a scenario file that replays a run from anywhere on this machine.
-spec scenario(starl_lab_setup:t()) -> unicode:chardata().
scenario(#{target := Target, scenario := Scenario}) ->
    text(Target, app(Target), starl_cli_inputs:absolute(Target, Scenario)).

%% The scenario in the directory of a run names the files there.
own_scenario(#{target := Target, scenario := Scenario, inputs := Inputs}) ->
    text(Target, starl_cli_inputs:app(Inputs), starl_cli_inputs:local(Inputs, Scenario)).

%% All keys, in the order of the tables.
text(#{app := App, name := Name}, Word, Scenario) ->
    Keys = [Key || {Key, _, _, _} <- starl_run_scenario:options(App)],
    Lines = [io_lib:format("    ~tp => ~0tp", [Key, maps:get(Key, Scenario)]) || Key <- Keys],
    AppLine = io_lib:format("    app => ~0tp", [Word]),
    [
        "%% ",
        Name,
        ", replayed by ./starl run with the name of this file\n",
        "#{\n",
        lists:join(",\n", [AppLine | Lines]),
        "\n}.\n"
    ].

%% The application of a target as written in a scenario file: a user's application is named by
%% its source file.
-spec app(starl_cli_target:t()) -> atom() | file:filename_all().
app(#{name := Name, replay := Word}) ->
    case filename:extension(Word) of
        ".erl" -> filename:absname(Word);
        _ -> list_to_atom(Name)
    end.
