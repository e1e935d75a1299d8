%% @doc Finds what a command should run. A target is a shipped application, a scenario file, the
%% Erlang source of a user's application, or a directory with such sources. It may also be the name
%% of a module in `src' of the working directory, an application module on the code path, or a
%% recorded run, named by its directory or its `run.term'.
-module(starl_cli_target).

-export([names_code/1, beams/1, given/2, scenario/2, place/3, replay/2, command_line/3]).
-export([apps/0, purposes/0, scenarios/0, resolve/1, subject/2, seeded/2, looks_like_one/1, root/0]).

-export_type([t/0, code/0]).

%% `given': the values of a scenario file; `replay': the word for the target on a command line;
%% `file': the source of the values; `code': the user's own modules, which exist only in memory;
%% `record': that of a recorded run; `copied': its sources are read from a copy.
-type t() :: #{
    app := module(),
    name := string(),
    replay := string(),
    file := string(),
    given := #{atom() => term()},
    code => [code(), ...],
    copied => {Copy :: file:filename(), Run :: file:filename()},
    record => starl_cli_record:t()
}.

-type code() :: {module(), Source :: file:filename(), Beam :: binary()}.

-define(PREFIX, "starl_").
%% The longest source or scenario that is looked into for its purpose.
-define(SOURCE_BYTES, 10000000).
%% Directories whose sources are not one application.
-define(NO_TEAM, ["src", "test", "examples"]).

-type answer() :: {ok, t()} | {error, [unicode:chardata(), ...]}.

%% @doc The applications for teams that are offered ({@link starl_catalogue}), by name and module.
-spec apps() -> [{Name :: string(), module()}].
apps() -> [{short(Module), Module} || Module <- lists:sort([module(App) || App <- offered()])].

offered() -> starl_catalogue:listed(starl_apps).

module({Module, _Purpose}) -> Module;
module(Module) -> Module.

short(Module) ->
    case atom_to_list(Module) of
        ?PREFIX ++ Name -> Name;
        Name -> Name
    end.

%% @doc The applications that are for users: their own in the working directory, by the words for
%% them; those that ship; and the examples of the checkout by their files.
-spec purposes() -> [{Target :: string(), Purpose :: unicode:chardata()}].
purposes() -> own() ++ shown() ++ examples().

shown() -> lists:sort([{short(Module), Purpose} || {Module, Purpose} <- offered()]).

%% In a project's `src' its modules go by their names ({@link resolve/1}); a directory with several
%% sources is one application.
own() ->
    Here = [{File, doc(File)} || File <- sources("*.erl", ".")],
    Directories = [{filename:dirname(File), doc(File)} || File <- sources("*/*.erl", ".")],
    Modules = [{filename:basename(File, ".erl"), doc(File)} || File <- sources("src/*.erl", ".")],
    Here ++ Modules ++ [Own || {Dir, _} = Own <- Directories, not lists:member(Dir, ?NO_TEAM)].

examples() ->
    [
        {File, doc(filename:join(root(), File))}
     || Pattern <- ["examples/*.erl", "examples/*/*.erl"], File <- sources(Pattern, root())
    ].

%% The sources of applications in a directory.
sources(Pattern, Dir) ->
    [
        File
     || File <- filelib:wildcard(Pattern, Dir),
        {ok, Text} <- [starl_small_file:read(filename:join(Dir, File), ?SOURCE_BYTES)],
        nomatch =/= re:run(Text, "^-behaviou?r[(]starl_app[)]", [multiline])
    ].

%% @doc The shipped scenario files: name, file and first comment line.
-spec scenarios() -> [{Name :: string(), file:filename(), Doc :: unicode:chardata()}].
scenarios() ->
    Files = filelib:wildcard(filename:join(scenario_dir(), "*.{term,config}")),
    [{filename:basename(filename:rootname(File)), File, doc(File)} || File <- lists:sort(Files)].

%% @doc The directory of the checkout, or else the working directory.
-spec root() -> file:filename().
root() ->
    case os:getenv("STARL_ROOT") of
        false -> cwd();
        Root -> Root
    end.

%% @doc Whether a word of the command line can be a target.
-spec looks_like_one(string()) -> boolean().
looks_like_one(Word) -> hd(Word ++ "-") =/= $- andalso kind(Word) =/= unknown.

%% @doc Finds the target that a word of the command line, or the key `app' of a scenario, names.
-spec resolve(string()) -> answer().
resolve(Word) ->
    case kind(Word) of
        {app, Module} ->
            application(Word, Module);
        {source, File} ->
            starl_cli_source:load(File);
        {directory, Dir} ->
            starl_cli_source:load_directory(Dir);
        {scenario, File} ->
            scenario(File);
        unknown ->
            {error, [unknown(Word)]}
    end.

application(Word, Module) ->
    case starl_cli_source:runs(Module) of
        true ->
            {ok, #{app => Module, name => Word, replay => Word, file => Word, given => #{}}};
        false ->
            {error, [starl_cli_source:no_application(Word)]}
    end.

%% @doc The target's own modules.
-spec beams(t()) -> [binary()].
beams(#{code := Codes}) -> [Beam || {_, _, Beam} <- Codes];
beams(#{app := App}) -> [Beam || {_, Beam, _} <- [code:get_object_code(App)]].

%% @doc The target that the first word of a command names, with the other arguments.
-spec subject(Word :: string(), Args) -> {ok, t(), Args} | {error, [unicode:chardata(), ...]} when
    Args :: [string()].
subject(Word, Args) ->
    case resolve(Word) of
        {ok, Target} -> {ok, Target, Args};
        {error, _} = Error -> Error
    end.

%% @doc Translates `SEED --app TARGET' to `TARGET --seed SEED'.
-spec seeded(Word, Args) -> {Word, Args} | {error, [unicode:chardata(), ...]} when
    Word :: string(), Args :: [string()].
seeded(Word, Args) ->
    case lists:all(fun(C) -> C >= $0 andalso C =< $9 end, Word) andalso app(Args) of
        false -> {Word, Args};
        none -> {error, [["seed ", Word, " of what? Name it, as in --app painting"]]};
        {App, Others} -> {App, ["--seed", Word | Others]}
    end.

app(Args) ->
    case lists:splitwith(fun(Arg) -> not lists:prefix("--app", Arg) end, Args) of
        {Before, ["--app", App | After]} -> {App, Before ++ After};
        {Before, ["--app=" ++ App | After]} -> {App, Before ++ After};
        {_, _} -> none
    end.

%% -- its values -----------------------------------------------------------------------------

%% @doc The values of a simulation that a command line sets, for a command with flags of its own.
%% Flags override the values of a scenario file.
-spec given(starl_cli_command:call(), Own :: [starl_cli_flags:flag()]) -> #{atom() => term()}.
given(#{subject := #{given := InFile}, given := Given}, Own) ->
    maps:merge(InFile, maps:without([Key || {Key, _, _, _} <- Own], Given)).

%% @doc Checks the values for a target; gives the problems and the scenario.
-spec scenario(t(), #{atom() => term()}) ->
    {[unicode:chardata()], starl_run_scenario:t()}.
scenario(#{app := App} = Target, Given) ->
    Uncompiled = starl_cli_source:of_options(starl_run_scenario:options(App), Given),
    case starl_run_scenario:check(Given#{app => App}, starl_app:options(App)) of
        _ when Uncompiled =/= [] ->
            {Uncompiled, #{}};
        {ok, Scenario} ->
            {[], Scenario};
        {error, {problems, Problems}} ->
            {[problem(P, Target, Given) || P <- Problems], #{}}
    end.

%% Problems of lists of faults do not name the key themselves.
problem({fault, _} = P, Target, Given) -> problem(faults, P, Target, Given);
problem({no_controller, _} = P, Target, Given) -> problem(controller, P, Target, Given);
problem({no_such_faults, _} = P, Target, Given) -> problem(random_faults, P, Target, Given);
problem(P, #{file := File}, _Given) -> [File, ": ", starl_options:format_problem(P)].

problem(Key, P, Target, Given) ->
    [place(Key, Target, Given), ": ", starl_run_scenario:format_problem(P)].

%% @doc The place of a value: its flag, or its key in a scenario file.
-spec place(Key :: atom(), t(), #{atom() => term()}) -> unicode:chardata().
place(Key, #{file := File, given := InFile}, Given) ->
    case {maps:get(Key, Given), InFile} of
        {Value, #{Key := Value}} -> [File, ": ", atom_to_list(Key)];
        {_, _} -> starl_cli_flags:flag(Key)
    end.

%% @doc The command line that replays a run exactly.
-spec replay(t(), starl_run_scenario:t()) -> unicode:chardata().
replay(Target, Scenario) -> command_line("run", Target, Scenario).

%% @doc The command line of a command that takes a target and its values.
-spec command_line(string(), t(), starl_run_scenario:t()) -> unicode:chardata().
command_line(Command, #{app := App, replay := Word} = Target, Scenario) ->
    Options = starl_run_scenario:options(App),
    Defaults = maps:without([seed, robots], starl_cli_flags:defaults(Options)),
    Chosen = maps:filter(
        fun(Key, Value) -> maps:find(Key, Defaults) =/= {ok, Value} end,
        maps:remove(app, starl_cli_inputs:moved(Target, Scenario))
    ),
    Arguments = starl_cli_flags:arguments(Options, Chosen),
    lists:join(" ", ["./starl", Command, starl_cli_terminal:quoted(Word) | Arguments]).

%% -- words ----------------------------------------------------------------------------------

%% The examples of the checkout go by their files from everywhere.
kind(Given) ->
    Word = example(Given),
    case {lists:keyfind(Word, 1, apps()), lists:keyfind(Word, 1, scenarios())} of
        {{_, Module}, _} -> {app, Module};
        {false, {_, File, _}} -> {scenario, File};
        {false, false} -> kind_of_file(filename:extension(Word), Word)
    end.

example("examples/" ++ _ = Word) ->
    There = filename:join(root(), Word),
    case {filelib:is_file(Word), filelib:is_file(There)} of
        {false, true} -> There;
        _ -> Word
    end;
example(Word) ->
    Word.

kind_of_file(".erl", Word) ->
    {source, Word};
kind_of_file(".term", Word) ->
    {scenario, Word};
kind_of_file(".config", Word) ->
    {scenario, Word};
kind_of_file(_, Word) ->
    Record = filename:join(Word, "run.term"),
    case {filelib:is_regular(Record), filelib:is_dir(Word)} of
        {true, _} -> {scenario, Record};
        {false, true} -> kind_of_directory(Word);
        {false, false} -> in_project(Word)
    end.

%% In the directory of the user's project its modules go by their names.
in_project(Word) ->
    Source = filename:join("src", Word ++ ".erl"),
    case starl_cli_source:is_name(Word) andalso filelib:is_regular(Source) of
        true -> {source, Source};
        false -> on_the_code_path(Word)
    end.

%% A directory such as the application's ebin is no reason to overlook a module of that name.
kind_of_directory(Dir) ->
    case starl_cli_source:in_directory(Dir) of
        [_ | _] -> {directory, Dir};
        [] -> on_the_code_path(Dir)
    end.

%% A module of that name, as it was compiled with the user's own project.
on_the_code_path(Word) ->
    case starl_cli_source:is_name(Word) andalso code:where_is_file(Word ++ ".beam") of
        Beam when is_list(Beam) -> loaded(list_to_atom(Word));
        non_existing -> in_directory(filelib:is_regular(Word ++ ".beam"), Word);
        false -> unknown
    end.

%% The working directory is no place of libraries: who names a module there, adds it.
in_directory(true, Word) ->
    true = code:add_pathz("."),
    loaded(list_to_atom(Word));
in_directory(false, _Word) ->
    unknown.

loaded(Module) ->
    case code:ensure_loaded(Module) of
        {module, Module} -> {app, Module};
        {error, _} -> unknown
    end.

unknown(Word) ->
    Scenarios = [Name || {Name, _, _} <- scenarios()],
    Known = [Name || {Name, _} <- shown()] ++ Scenarios,
    Near = starl_similar:words(Word, [Name || {Name, _} <- apps()] ++ Scenarios),
    All = [
        "; there are ",
        lists:join(", ", Known),
        ", scenario files (FILE.term), applications of your own (FILE.erl, their directory, or a "
        "module on the code path) and directories of runs"
    ],
    ["there is no application or scenario ", Word, starl_similar:meant(Near, All)].

%% -- scenario files -------------------------------------------------------------------------

scenario(File) ->
    case starl_run_scenario:read(File) of
        {ok, #{digest := _}} ->
            recorded(File, starl_cli_record:read(File));
        {ok, #{app := App} = Given} ->
            case filename:basename(File) of
                "run.term" -> of_results(File, App, maps:remove(app, Given));
                _ -> with_app(name_of(App), File, maps:remove(app, Given))
            end;
        {ok, _} ->
            {error, [[File, ": the key app is missing; write #{app => painting, ...}"]]};
        {error, Reason} ->
            {error, [starl_run_scenario:format_error(Reason)]}
    end.

recorded(File, {ok, #{app := App, scenario := Scenario} = Record}) ->
    case of_results(File, App, Scenario) of
        {ok, Target} -> {ok, Target#{record => Record}};
        {error, _} = Error -> Error
    end;
recorded(_File, {error, Reason}) ->
    {error, [starl_cli_record:format_error(Reason)]}.

%% Results come from anywhere. Of the code that they name only what this user has put beside them is loaded, from a
%% copy of it, and what StarL and the user's own libraries have.
of_results(File, App, Scenario) ->
    Named = code_of_app(name_of(App)) ++ named_sources(Scenario) ++ reloaded(Scenario),
    case Named =:= [] orelse starl_cli_made_here:is_trusted() orelse in_run(File, Named) of
        true -> with_app(name_of(App), File, Scenario);
        {ok, Copy} -> of_copy(Copy, File, name_of(App), Scenario);
        {error, Line} -> {error, [Line]}
    end.

in_run(File, Named) ->
    case [Source || Source <- Named, filename:pathtype(Source) =/= relative] of
        [] ->
            starl_cli_made_here:own(filename:dirname(File), lists:usort(Named));
        [Source | _] ->
            starl_cli_made_here:own(filename:dirname(Source), [filename:basename(Source)])
    end.

%% What is said of the files names those of the results.
of_copy(Copy, File, Name, Scenario) ->
    Dir = filename:dirname(File),
    case with_app(Name, filename:join(Copy, filename:basename(File)), Scenario) of
        {ok, #{code := [_ | _]} = Target} ->
            {ok, Target#{file := File, copied => {Copy, Dir}, replay := beside(File, Name)}};
        {ok, Target} ->
            {ok, Target#{file := File, copied => {Copy, Dir}}};
        {error, _} = Error ->
            Error
    end.

%% An application that ships, or that a library has, is no code of the results; what is unknown is none at all.
code_of_app(none) ->
    [];
code_of_app(Name) ->
    [Name || names_code(Name)].

%% @doc Does this word name code that neither ships nor is a library's: a source, or a directory or a module in the
%% working directory? That may be the directory of somebody's results.
-spec names_code(string()) -> boolean().
names_code(Word) ->
    not lists:keymember(Word, 1, apps()) andalso
        (filename:extension(Word) =:= ".erl" orelse is_here(Word)).

is_here(Word) ->
    Beam = starl_cli_source:is_name(Word) andalso code:where_is_file(Word ++ ".beam"),
    (is_list(Beam) andalso filename:pathtype(Beam) =/= absolute) orelse
        filelib:is_dir(Word) orelse
        lists:any(fun filelib:is_file/1, [Word ++ ".beam", filename:join("src", Word ++ ".erl")]).

%% The texts of a scenario that name sources.
named_sources(Map) when is_map(Map) ->
    named_sources(maps:to_list(Map));
named_sources(Tuple) when is_tuple(Tuple) ->
    named_sources(tuple_to_list(Tuple));
named_sources([_ | _] = List) ->
    case io_lib:char_list(List) of
        true -> [List || filename:extension(List) =:= ".erl"];
        false -> lists:append([named_sources(One) || One <- some(List)])
    end;
named_sources(_Other) ->
    [].

some([One | Others]) -> [One | some(Others)];
some(_End) -> [].

%% The new code of reloads: files, and compiled modules that the scenario itself holds.
reloaded(#{reloads := Reloads}) ->
    case starl_run_reloads:are_entries(Reloads) of
        true ->
            Sources = [starl_run_reloads:sources(element(3, Entry)) || Entry <- Reloads],
            [Named || Source <- lists:append(Sources), Named <- named_code(Source)];
        false ->
            []
    end;
reloaded(_Scenario) ->
    [].

named_code({Module, _File, _Beam}) -> [atom_to_list(Module)];
named_code(Module) when is_atom(Module) -> [];
named_code(File) -> [File].

with_app(none, File, _Given) ->
    {error, [[File, ": app is the name of an application, or the file of one as \"my_app.erl\""]]};
with_app(Name, File, Given) ->
    case kind(Name) of
        {scenario, _} -> {error, [[File, ": app => ", Name, " names a scenario"]]};
        {app, _} -> with_target(resolve(Name), File, Given);
        _ -> with_target(resolve(beside(File, Name)), File, Given)
    end.

%% The path of an application is relative to the scenario file.
beside(File, Name) ->
    case {filename:extension(Name), filename:dirname(File)} of
        {".erl", Dir} when Dir =/= "." -> filename:join(Dir, Name);
        {_, _} -> Name
    end.

with_target({ok, #{app := App} = Target}, File, Given) ->
    {ok, Target#{file := File, given := starl_cli_inputs:resolved(App, File, Given)}};
with_target({error, Lines}, File, _Given) ->
    {error, [[File, ": ", Line] || Line <- Lines]}.

%% An application is known by its short name and by the name of its module.
name_of(App) when is_atom(App) ->
    case lists:keyfind(App, 2, apps()) of
        {Name, _} -> Name;
        false -> atom_to_list(App)
    end;
name_of(App) ->
    case io_lib:printable_unicode_list(App) andalso App =/= "" of
        true -> App;
        false -> none
    end.

scenario_dir() -> filename:join([root(), "config", "scenarios"]).

doc(File) ->
    case starl_small_file:read(File, ?SOURCE_BYTES) of
        {ok, Text} -> first_comment(string:split(Text, "\n", all));
        {error, _} -> ""
    end.

%% The first sentence of the comment that a file begins with.
first_comment(Lines) ->
    Comment = lists:takewhile(
        fun is_comment/1, lists:dropwhile(fun(L) -> not is_comment(L) end, Lines)
    ),
    Words = [string:trim(Line, both, "% \r") || Line <- Comment],
    hd(re:split(lists:join(" ", Words), "(?<=[.])(?= |$)", [{parts, 2}, unicode])).

is_comment(<<"%", _/binary>>) -> true;
is_comment(_Line) -> false.

cwd() ->
    {ok, Dir} = file:get_cwd(),
    Dir.
