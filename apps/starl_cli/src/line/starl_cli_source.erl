%% @doc Compiles a user's modules in memory and reports one line per error. A file is compiled
%% together with the files beside it whose modules it names, directly or indirectly.
-module(starl_cli_source).

-export([load/1, load_directory/1, in_directory/1, modules/1, block/2, driver/1, of_options/2]).
-export([is_name/1, runs/1, no_application/1]).

%% @doc Compiles and loads a source file: an application, or a building block to be exercised.
-spec load(file:filename()) ->
    {ok, starl_cli_target:t()} | {error, [unicode:chardata(), ...]}.
load(File) ->
    case modules(File) of
        {ok, Module, Codes} -> target(File, Module, Codes);
        {error, _} = Error -> Error
    end.

%% @doc Compiles and loads the application in a directory, or in its `src': the module that is named
%% as the directory is, else the only one that is an application.
-spec load_directory(file:filename()) ->
    {ok, starl_cli_target:t()} | {error, [unicode:chardata(), ...]}.
load_directory(Dir) ->
    Files = in_directory(Dir),
    Name = filename:basename(filename:absname(string:trim(Dir, trailing, "/"))),
    case [File || File <- Files, filename:basename(File, ".erl") =:= Name] of
        [File] -> load(File);
        [] -> load_only(Dir, Name, [File || File <- Files, is_application(File)])
    end.

load_only(_Dir, _Name, [File]) ->
    load(File);
load_only(Dir, Name, []) ->
    {error, [
        [
            Dir,
            ": no module here is an application, which exports init/2 and step/2; "
            "nor is there a file ",
            Name,
            ".erl"
        ]
    ]};
load_only(Dir, _Name, Several) ->
    Names = lists:join(", ", [filename:basename(File) || File <- Several]),
    {error, [[Dir, ": which one is to run? ", Names, "; name the file"]]}.

%% @doc The Erlang sources in a directory, or else in its `src'.
-spec in_directory(file:filename()) -> [file:filename()].
in_directory(Dir0) ->
    Dir = string:trim(Dir0, trailing, "/"),
    case sources(Dir) of
        [] -> sources(filename:join(Dir, "src"));
        Files -> Files
    end.

sources(Dir) -> lists:sort(filelib:wildcard(filename:join(Dir, "*.erl"))).

%% Only the behaviour is looked for; an error in a file is reported when it is compiled.
is_application(File) ->
    case epp:parse_file(File, []) of
        {ok, Forms} ->
            lists:any(fun is_behaviour/1, Forms);
        {error, _} ->
            false
    end.

is_behaviour({attribute, _, Word, Name}) when Word =:= behaviour; Word =:= behavior ->
    lists:member(Name, [starl_app, starl_scene]);
is_behaviour(_Form) ->
    false.

%% @doc Compiles and loads the source of a building block, which must have this capability (`list': no
%% capability needed).
-spec block(file:filename(), starl_block:capability() | list) ->
    {ok, module(), [starl_cli_target:code(), ...]} | {error, [unicode:chardata(), ...]}.
block(File, What) ->
    case modules(File) of
        {ok, Module, Codes} -> able(File, Module, Codes, What);
        {error, _} = Error -> Error
    end.

able(File, Module, Codes, What) ->
    case {starl_block:is_block(Module), What =:= list orelse starl_block:can(What, Module)} of
        {true, true} ->
            {ok, Module, Codes};
        {true, false} ->
            {error, [
                [File, ": this block does not say how: it exports no ", callback(What), "/0"]
            ]};
        {false, _} ->
            {error, [[File, ": this is no building block: a block has the behaviour starl_block"]]}
    end.

callback(exercise) -> "exercise";
callback(check) -> "models";
callback(bench) -> "benchmark".

%% @doc Compiles and loads a source file and those that it needs; gives its module.
-spec modules(file:filename()) ->
    {ok, module(), [starl_cli_target:code(), ...]} | {error, [unicode:chardata(), ...]}.
modules(File) -> modules(File, application).

%% @doc The same of a driver, which is no application: it may look at the computer's clock, and has processes.
-spec driver(file:filename()) ->
    {ok, module(), [starl_cli_target:code(), ...]} | {error, [unicode:chardata(), ...]}.
driver(File) -> modules(File, driver).

%% @doc Compiles and loads the sources that options name, such as a rule of a user's own; gives the problems.
-spec of_options([starl_options:option()], #{atom() => term()}) -> [unicode:chardata()].
of_options(Options, Values) ->
    [
        Problem
     || {Key, file, _, _} <- Options,
        #{Key := File} <- [Values],
        io_lib:printable_unicode_list(File),
        filename:extension(File) =:= ".erl",
        not is_loaded(File),
        {error, Problems} <- [modules(File)],
        Problem <- Problems
    ].

%% Another run here may be using it.
is_loaded(File) ->
    lists:any(fun({_, Path}) -> Path =:= File end, code:all_loaded()).

modules(File, Kind) ->
    case compiled([File], [], Kind) of
        {ok, Codes} ->
            _ = [{module, M} = code:load_binary(M, F, Code) || {M, F, Code} <- Codes],
            {ok, element(1, hd(Codes)), Codes};
        {error, _} = Error ->
            Error
    end.

compiled([], Codes, _Kind) ->
    {ok, lists:reverse(Codes)};
compiled([File | Files], Codes, Kind) ->
    case code(File, Kind) of
        {ok, {Module, _, Beam} = Code} ->
            Known = Files ++ [F || {_, F, _} <- Codes],
            compiled(Files ++ (beside(File, Module, Beam) -- Known), [Code | Codes], Kind);
        {error, _} = Error ->
            Error
    end.

code(File, Kind) ->
    case filelib:is_regular(File) of
        true -> sound(File, Kind, compile:file(File, [binary, return, debug_info]));
        false -> {error, [[File, ": there is no such file"]]}
    end.

sound(File, Kind, {ok, Module, Beam, Warnings}) ->
    Foreign = [
        starl_cli_lint:text(Call)
     || Kind =:= application, Call <- starl_cli_lint:calls(Beam)
    ],
    _ = [
        starl_cli_terminal:warn(["warning: ", Line])
     || Line <- starl_version:format_found(telling(Warnings)) ++ Foreign
    ],
    case {starl_cli_lint:named_by_text(Beam), is_free(Module, File)} of
        {[_ | _] = Named, _} ->
            {error, Named};
        {[], true} ->
            {ok, {Module, File, Beam}};
        {[], false} ->
            {error, [
                io_lib:format("~ts: there is a module ~ts already; give yours another name", [
                    File, Module
                ])
            ]}
    end;
sound(_File, _Kind, {error, Errors, Warnings}) ->
    {error, starl_version:format_found(first_causes(Errors), Warnings)}.

%% May a source take this name? It has precedence over what was once compiled from it.
is_free(Module, File) ->
    case code:which(Module) of
        non_existing -> true;
        File -> true;
        Beam -> is_own_beam(Beam, File) andalso not starl_code:is_library(Module)
    end.

%% Beside the source, or in the working directory, where erlc puts it.
is_own_beam(Beam, File) when is_list(Beam) ->
    Dirs = [filename:dirname(filename:absname(Path)) || Path <- [File, "x"]],
    filename:extension(Beam) =:= ".beam" andalso
        lists:member(filename:dirname(filename:absname(Beam)), Dirs);
is_own_beam(_Word, _File) ->
    false.

%% A function that cannot be read is reported as undefined besides.
first_causes(Errors) ->
    Unread = [{File, Info} || {File, Infos} <- Errors, {_, M, _} = Info <- Infos, M =/= erl_lint],
    case Unread of
        [] -> Errors;
        _ -> [{File, [Info]} || {File, Info} <- Unread]
    end.

%% That a callback of an application or a driver is missing is told as an error later.
telling(Warnings) ->
    [{File, [Info || Info <- Infos, not is_told_later(Info)]} || {File, Infos} <- Warnings].

is_told_later({_, erl_lint, {undefined_behaviour_func, _, Behaviour}}) ->
    lists:member(Behaviour, [starl_app, starl_live_chassis, starl_live_positioning]);
is_told_later(_) ->
    false.

%% The files in the same directory whose modules are named in this file and not loaded yet.
beside(File, Module, Beam) ->
    {ok, {Module, [{abstract_code, {raw_abstract_v1, Forms}}]}} =
        beam_lib:chunks(Beam, [abstract_code]),
    Names = [Name || Name <- lists:usort(atoms(Forms)), Name =/= Module, is_plain(Name)],
    Beside = [
        {Name, filename:join(filename:dirname(File), atom_to_list(Name) ++ ".erl")}
     || Name <- Names
    ],
    [
        path(File, Path)
     || {Name, Path} <- Beside,
        filelib:is_regular(Path),
        is_free(Name, path(File, Path))
    ].

%% The path as the user wrote it, without "./".
path(File, Path) ->
    case filename:dirname(File) of
        "." -> filename:basename(Path);
        _ -> Path
    end.

atoms({atom, _, Atom}) when is_atom(Atom) -> [Atom];
atoms(Form) when is_tuple(Form) -> atoms(tuple_to_list(Form));
atoms(Forms) when is_list(Forms) -> lists:append([atoms(Form) || Form <- some(Forms)]);
atoms(_Other) -> [].

%% Improper lists are texts and source locations, which name no modules.
some([Form | Forms]) -> [Form | some(Forms)];
some(_End) -> [].

is_plain(Atom) -> is_name(atom_to_list(Atom)).

%% @doc Can this be the name of a module?
-spec is_name(string()) -> boolean().
is_name(Word) ->
    re:run(Word, "^[a-z][a-zA-Z0-9_]{0,99}$", [{capture, none}, dollar_endonly]) =:= match.

target(File, Module, Codes) ->
    Target = #{
        app => Module,
        name => atom_to_list(Module),
        replay => File,
        file => File,
        given => #{},
        code => Codes
    },
    case {runs(Module), starl_block:is_block(Module), starl_block:can(exercise, Module)} of
        {true, _, _} ->
            sound_target(starl_run:check_app(Module), Target);
        {false, true, true} ->
            {ok, Target#{app := starl_exercise, given := #{block => Module}}};
        {false, true, false} ->
            {error, [[File, ": this block does not say how: it exports no exercise/0"]]};
        {false, false, _} ->
            {error, [no_application(File)]}
    end.

%% @doc One line: this is nothing that can be run.
-spec no_application(string()) -> unicode:chardata().
no_application(File) ->
    [
        File,
        ": this is no application: it exports neither step/2 nor scene/1; "
        "and no building block (starl_block)"
    ].

sound_target(ok, Target) -> {ok, Target};
sound_target({error, Reason}, _Target) -> {error, [starl_run:format_error(Reason)]}.

%% @doc Is this module an application? One callback is enough to mean one.
-spec runs(module()) -> boolean().
runs(Module) ->
    Exports = fun({F, A}) -> starl_callback:exported(Module, F, A) end,
    lists:any(Exports, [{step, 2}, {scene, 1}]) orelse
        (Exports({init, 2}) andalso not starl_block:is_block(Module)).
