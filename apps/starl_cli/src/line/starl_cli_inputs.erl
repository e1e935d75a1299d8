%% @doc Copies the input files of a run into the run's own directory. These are the sources of a
%% user's application and of its reloads, and the files that options name, such as a picture. They
%% are read before the run, so the run can be repeated after they were moved or changed.
-module(starl_cli_inputs).

-export([
    read/2,
    read/3,
    files/1,
    app/1,
    local/2,
    absolute/2,
    resolved/3,
    reloaded/1,
    moved/2,
    source/2,
    sources_beside/1
]).

-export_type([t/0]).

%% `app' and `values' are the application and the files of options as they are named in the
%% directory of the run.
-opaque t() :: #{
    app := atom() | file:filename(),
    values := #{atom() => file:filename() | [starl_run_reloads:given()]},
    files := [{Name :: file:filename(), binary()}]
}.

-include_lib("kernel/include/file.hrl").

-define(DIR, "inputs").
%% Deeper directories hold no sources of a run.
-define(DEPTH, 30).
%% The number of a reload follows.
-define(RELOAD, "reload-").

%% @doc Reads the files that a scenario of this target names.
-spec read(starl_cli_target:t(), starl_run_scenario:t()) -> t().
read(Target, Scenario) -> read(?DIR, Target, Scenario).

%% @doc The same, to be kept in another directory than `inputs'.
-spec read(Dir :: file:filename(), starl_cli_target:t(), starl_run_scenario:t()) -> t().
read(Dir, #{name := Name} = Target, Scenario) ->
    Code = maps:get(code, Target, []),
    Sources = sources(Code),
    Root = root(Sources),
    Codes = [{inside(Dir, Root, File), File} || File <- Sources],
    Options = [
        {named(Dir, Key, File, Codes), Key, File}
     || {Key, File} <- options(Target, Scenario)
    ],
    {Reloads, Reloaded} = reloads(Dir, Scenario),
    #{
        app =>
            case Code of
                [] -> list_to_atom(Name);
                [{_, Source, _} | _] -> inside(Dir, Root, filename:absname(Source))
            end,
        values => maps:from_list([{Key, Inside} || {Inside, Key, _} <- Options] ++ Reloads),
        files => contents(Codes ++ [{Inside, File} || {Inside, _, File} <- Options] ++ Reloaded)
    }.

contents(Named) -> [{Name, Bytes} || {Name, File} <- Named, {ok, Bytes} <- [file:read_file(File)]].

%% @doc The files with their names in the directory of the run, and a list that says that this user has put them there.
-spec files(t()) -> [{Name :: file:filename(), binary()}].
files(#{files := Files}) -> Files ++ starl_cli_made_here:stamp(Files).

%% @doc The application as it is named in the directory of the run.
-spec app(t()) -> atom() | file:filename().
app(#{app := App}) -> App.

%% @doc A scenario with the files as they are named in the directory of the run.
-spec local(t(), starl_run_scenario:t()) -> starl_run_scenario:t().
local(#{values := Values}, Scenario) -> maps:merge(Scenario, Values).

%% @doc A scenario whose files are found from any directory.
-spec absolute(starl_cli_target:t(), starl_run_scenario:t()) -> starl_run_scenario:t().
absolute(Target, Given) ->
    Scenario = moved(Target, Given),
    Files = [{Key, filename:absname(File)} || {Key, File} <- options(Target, Scenario)],
    maps:merge(
        by_sources(fun(_N, File) -> filename:absname(File) end, Scenario), maps:from_list(Files)
    ).

%% @doc The values of a scenario file, whose paths are relative to it. A word without a dot or a
%% slash may also be a name, such as that of a picture that ships.
-spec resolved(module(), file:filename(), #{atom() => term()}) -> #{atom() => term()}.
resolved(App, Scenario, Given) ->
    Keys = [Key || {Key, Type, _, _} <- starl_run_scenario:options(App), is_file(Type)],
    Resolve = fun(_Key, Value) -> beside(Scenario, Value) end,
    Reloads = by_sources(fun(_N, File) -> beside(Scenario, File) end, Given),
    maps:merge(Reloads, maps:map(Resolve, maps:with(Keys, Given))).

beside(Scenario, Value) ->
    case io_lib:char_list(Value) andalso filename:dirname(Scenario) of
        false -> Value;
        "." -> Value;
        Dir -> joined(filename:join(Dir, Value), Value)
    end.

joined(Path, Value) ->
    case filelib:is_regular(Path) orelse lists:any(fun(C) -> lists:member(C, "./") end, Value) of
        true -> Path;
        false -> Value
    end.

%% @doc The source of a module that is kept beside a file of a run, if this user has put it there.
-spec source(module(), file:filename()) ->
    {ok, file:filename()} | none | {error, unicode:chardata()}.
source(Module, File) ->
    Name = atom_to_list(Module) ++ ".erl",
    case [Path || Path <- at_first(File), filename:basename(Path) =:= Name] of
        [Path | _] -> first(own(File, [Path]));
        [] -> none
    end.

first({ok, [Source | _]}) -> {ok, Source};
first({error, _} = Error) -> Error.

own(File, Names) ->
    case starl_cli_made_here:own(filename:dirname(File), Names) of
        {ok, Dir} -> {ok, [filename:join(Dir, Name) || Name <- Names]};
        {error, _} = Error -> Error
    end.

%% @doc The sources that are kept beside a file of a run, if this user has put them there.
-spec sources_beside(file:filename()) -> {ok, [file:filename()]} | {error, unicode:chardata()}.
sources_beside(File) ->
    case at_first(File) of
        [] -> {ok, []};
        Names -> own(File, Names)
    end.

%% The sources of the code with which the run begins, as they are named in its directory.
at_first(File) ->
    [
        Name
     || Name <- found(filename:dirname(File), ?DIR, 0),
        filename:extension(Name) =:= ".erl",
        not lists:prefix(filename:join(?DIR, ?RELOAD), Name)
    ].

%% No link is followed: it may lead round in circles.
found(_Run, _Name, ?DEPTH) ->
    [];
found(Run, Name, Depth) ->
    Path = filename:join(Run, Name),
    case file:read_link_info(Path) of
        {ok, #file_info{type = directory}} ->
            {_, Names} = file:list_dir(Path),
            lists:append([found(Run, filename:join(Name, N), Depth + 1) || N <- in_order(Names)]);
        {ok, _} ->
            [Name];
        {error, _} ->
            []
    end.

in_order(Names) when is_list(Names) -> lists:sort(Names);
in_order(_Posix) -> [].

%% @doc The same names of files in another directory, for what is said or kept of a scenario.
-spec moved(starl_cli_target:t(), starl_run_scenario:t()) -> starl_run_scenario:t().
moved(#{copied := {Copy, Dir}} = Target, Scenario) ->
    Move = fun(File) -> back(Copy, Dir, File) end,
    Files = [{Key, Move(File)} || {Key, File} <- options(Target, Scenario)],
    maps:merge(by_sources(fun(_N, File) -> Move(File) end, Scenario), maps:from_list(Files));
moved(_Target, Scenario) ->
    Scenario.

back(Copy, Dir, File) ->
    case string:prefix(File, Copy ++ "/") of
        nomatch -> File;
        Rest -> filename:join(Dir, Rest)
    end.

%% -- options --------------------------------------------------------------------------------

%% The options that name a file.
options(#{app := App}, Scenario) ->
    [
        {Key, File}
     || {Key, Type, _, _} <- starl_run_scenario:options(App),
        is_file(Type),
        File <- [maps:get(Key, Scenario, none)],
        io_lib:char_list(File),
        filelib:is_regular(File)
    ].

is_file(Type) -> Type =:= file orelse Type =:= {optional, file}.

%% Two files of one name are told apart by their options.
named(Dir, Key, File, Codes) ->
    Name = filename:join(Dir, filename:basename(File)),
    case lists:keymember(Name, 1, Codes) of
        true -> filename:join([Dir, atom_to_list(Key), filename:basename(File)]);
        false -> Name
    end.

%% -- reloads --------------------------------------------------------------------------------

%% @doc What the new code of a scenario is made from: its sources, as they are now, and modules in the path.
-spec reloaded(starl_run_scenario:t()) -> [binary()].
reloaded(Scenario) ->
    [Bytes || {_, File} <- reload_files(Scenario), {ok, Bytes} <- [file:read_file(File)]] ++
        [
            Beam
         || Entry <- maps:get(reloads, Scenario, []),
            Module <- starl_run_reloads:sources(element(3, Entry)),
            is_atom(Module),
            {_, Beam, _} <- [code:get_object_code(Module)]
        ].

%% The reloads as they are named in the directory of the run, and their sources with the names there.
reloads(Dir, Scenario) ->
    Files = reload_files(Scenario),
    Roots = maps:from_list([
        {N, root([File || {M, File} <- Files, M =:= N])}
     || {N, _} <- Files
    ]),
    Name = fun(N, File) ->
        Own = filename:join(Dir, ?RELOAD ++ integer_to_list(N)),
        inside(Own, maps:get(N, Roots, []), filename:absname(File))
    end,
    #{reloads := Named} = by_sources(Name, maps:merge(#{reloads => []}, Scenario)),
    {[{reloads, Named} || Files =/= []], [{Name(N, File), File} || {N, File} <- Files]}.

%% The sources, and their own headers, with the numbers of their reloads.
reload_files(Scenario) ->
    lists:usort([
        {N, filename:absname(File)}
     || {N, Entry} <- numbered(maps:get(reloads, Scenario, [])),
        [C | _] = Source <- starl_run_reloads:sources(element(3, Entry)),
        is_integer(C),
        File <- [Source | headers(Source)]
    ]).

headers(Source) ->
    case epp:parse_file(Source, [{includes, [filename:dirname(Source)]}]) of
        {ok, Forms} -> own_headers(Source, Forms);
        {error, _} -> []
    end.

numbered(Entries) -> lists:zip(lists:seq(1, length(Entries)), Entries).

%% A scenario, or the values of a file, whose reloads have other sources.
by_sources(Change, #{reloads := Reloads} = Values) ->
    case starl_run_reloads:are_entries(Reloads) of
        true ->
            Changed = [
                setelement(3, Entry, changed(fun(File) -> Change(N, File) end, element(3, Entry)))
             || {N, Entry} <- numbered(Reloads)
            ],
            Values#{reloads := Changed};
        false ->
            Values
    end;
by_sources(_Change, Values) ->
    Values.

changed(Change, [C | _] = File) when is_integer(C) -> Change(File);
changed(Change, Sources) when is_list(Sources) -> [changed(Change, S) || S <- Sources];
changed(_Change, Compiled) -> Compiled.

%% -- sources --------------------------------------------------------------------------------

%% The sources and the headers of their own, which come with no library.
sources(Codes) ->
    lists:usort([
        filename:absname(File)
     || {_, Source, Beam} <- Codes, File <- of_code(Source, Beam)
    ]).

of_code(Source, Beam) ->
    case beam_lib:chunks(Beam, [abstract_code]) of
        {ok, {_, [{abstract_code, {_, Forms}}]}} ->
            [Source | own_headers(Source, Forms)];
        _ ->
            [Source]
    end.

own_headers(Source, Forms) ->
    Headers = lists:usort([File || {attribute, _, file, {File, _}} <- Forms]),
    [direct(Header) || Header <- Headers, Header =/= Source, is_own(Header)].

%% A path without steps upwards: in the directory of the run they would lead out of it.
direct(File) ->
    Step = fun
        ("..", [_, Up | Above]) -> [Up | Above];
        (Part, Above) -> [Part | Above]
    end,
    filename:join(lists:reverse(lists:foldl(Step, [], filename:split(filename:absname(File))))).

is_own(Header) ->
    Path = filename:absname(Header),
    Libraries = [code:lib_dir() | [filename:dirname(Dir) || Dir <- code:get_path(), Dir =/= "."]],
    filelib:is_regular(Path) andalso
        not lists:any(fun(Dir) -> lists:prefix(Dir ++ "/", Path) end, Libraries).

%% The lowest directory that holds all sources: headers keep their places relative to them.
root([]) ->
    [];
root(Files) ->
    Parts = [filename:split(filename:dirname(File)) || File <- Files],
    lists:foldl(fun common/2, hd(Parts), tl(Parts)).

common([Part | As], [Part | Bs]) -> [Part | common(As, Bs)];
common(_, _) -> [].

%% A source outside, as that of an application that is named by a folder above, keeps its name.
inside(Dir, Root, File) ->
    Parts = filename:split(File),
    case lists:prefix(Root, Parts) of
        true -> filename:join([Dir | lists:nthtail(length(Root), Parts)]);
        false -> filename:join(Dir, filename:basename(File))
    end.
