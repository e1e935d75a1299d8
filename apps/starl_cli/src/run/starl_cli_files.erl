%% @doc Writes the files of a run's directory.
-module(starl_cli_files).

-export([write/4, write_failure/3, put_all/2, scenario/1, app/1]).

-type answer() :: ok | {error, unicode:chardata()}.

%% @doc Writes the reports, the scenario, the record of the run, the log unless it is empty, and the
%% application's own files.
-spec write(file:filename(), starl_cli_setup:t(), {Report, Record}, Own) -> answer() when
    Report :: starl_cli_report:t(),
    Record :: starl_cli_record:t(),
    Own :: fun((file:filename()) -> {ok, [file:filename()]} | {error, unicode:chardata()}).
write(Dir, Setup, {Report, Record}, Own) ->
    Files =
        [
            {"report.txt", starl_cli_report:text(Report)},
            {"report.json", starl_cli_report:json(Report)},
            {"scenario.term", scenario(Setup)},
            {"run.term", starl_cli_record:text(Record)}
        ] ++ log(starl_cli_log:lines()),
    case put_all(Dir, Files) of
        ok -> own(Own(Dir));
        {error, _} = Error -> Error
    end.

own({ok, _Files}) -> ok;
own({error, Why}) -> {error, Why}.

%% @doc Writes the scenario, the reason and the log of a failed simulation.
-spec write_failure(file:filename(), starl_cli_setup:t(), Reason :: term()) -> answer().
write_failure(Dir, Setup, Reason) ->
    put_all(Dir, [
        {"scenario.term", scenario(Setup)},
        {"run.log", [starl_cli_log:lines(), io_lib:format("~tp~n", [Reason])]}
    ]).

log([]) -> [];
log(Lines) -> [{"run.log", Lines}].

%% @doc Writes files with these texts into a directory.
-spec put_all(file:filename(), [{Name :: string(), unicode:chardata()}]) -> answer().
put_all(_Dir, []) ->
    ok;
put_all(Dir, [{Name, Text} | Files]) ->
    case file:write_file(filename:join(Dir, Name), unicode:characters_to_binary(Text)) of
        ok -> put_all(Dir, Files);
        {error, Posix} -> {error, [Name, ": ", file:format_error(Posix)]}
    end.

%% @doc The text of a scenario file that replays a run: all keys, in the order of the tables.
-spec scenario(starl_cli_setup:t()) -> unicode:chardata().
scenario(#{target := #{app := App, name := Name} = Target, scenario := Scenario}) ->
    Keys = [Key || {Key, _, _, _} <- starl_sim_scenario:options() ++ starl_app:options(App)],
    Lines = [io_lib:format("    ~tp => ~0tp", [Key, maps:get(Key, Scenario)]) || Key <- Keys],
    AppLine = io_lib:format("    app => ~0tp", [app(Target)]),
    [
        "%% ",
        Name,
        ", replayed by ./starl run with the name of this file\n",
        "#{\n",
        lists:join(",\n", [AppLine | Lines]),
        "\n}.\n"
    ].

%% @doc The application of a target as written in a scenario file: a user's application is named by
%% its source file.
-spec app(starl_cli_target:t()) -> atom() | file:filename_all().
app(#{name := Name, replay := Word}) ->
    case filename:extension(Word) of
        ".erl" -> filename:absname(Word);
        _ -> list_to_atom(Name)
    end.
