%% @doc Makes the files of a new project from templates: those in `priv/new', and for a building block
%% or a chassis the example of one.
-module(starl_new).

-export([check_name/1, make/3]).

-export_type([kind/0]).

-type kind() :: app | block | chassis | elixir.

-type answer() :: {ok, [file:filename()]} | {error, unicode:chardata()}.

%% @doc Can a project have this name? It is one of an Erlang module that does not exist yet.
-spec check_name(string()) -> ok | {error, unicode:chardata()}.
check_name(Name) ->
    case re:run(Name, "^[a-z][a-z0-9_]{0,39}$", [{capture, none}]) of
        nomatch ->
            {error, [
                Name,
                ": a name begins with a small letter and goes on with small letters, "
                "digits and _, at most 40"
            ]};
        match ->
            is_free(Name, code:which(list_to_atom(Name)))
    end.

is_free(_Name, non_existing) -> ok;
is_free(Name, _) -> {error, [Name, ": there is a module of this name already; take another one"]}.

%% @doc Makes the directory of a project; gives its files. Nothing is overwritten.
-spec make(string(), kind(), Root :: file:filename()) -> answer().
make(Name, Kind, Root) ->
    case {filelib:is_file(Name), version(Root)} of
        {true, _} -> {error, [Name, ": there is such a file or directory already"]};
        {false, {error, _} = Error} -> Error;
        {false, {ok, Version}} -> written(files(Name, Kind, Root, Version), Root, Kind, Name)
    end.

files(Name, Kind, Root, Version) ->
    Values = values(Name, Root, Version) ++ more(Kind, Version),
    [
        {filename:join(Name, replaced(File, [{"NAME", Name}])), replaced(Text, Values)}
     || {File, Text} <- templates(Kind, Root)
    ] ++
        [
            {
                filename:join([Name, "src", replaced(File, [{Old, Name}])]),
                replaced(Text, [{Old, Name}])
            }
         || {Dir, Old} <- example(Kind),
            {File, Text} <- texts(filename:join(Root, Dir)),
            lists:prefix(Old, File)
        ].

%% The example that a project is made from, and the name of it there.
example(block) -> [{"examples/own_block", "my_relay"}];
example(chassis) -> [{"examples/own_body", "two_wheels"}];
example(_Kind) -> [].

%% What else it depends on: a chassis is one of live robots.
more(chassis, {Url, Ref}) ->
    Live = [
        ",\n    {starl_live, {git_subdir, \"",
        Url,
        "\", {ref, \"",
        Ref,
        "\"}, \"apps/starl_live\"}}"
    ],
    [{"@DEPS@", Live}, {"@APPLICATIONS@", ", starl_live"}];
more(_Kind, _Version) ->
    [{"@DEPS@", ""}, {"@APPLICATIONS@", ""}].

templates(elixir, _Root) -> texts(new("elixir"));
templates(Kind, _Root) -> texts(new("erlang")) ++ texts(new(atom_to_list(Kind))).

new(Dir) -> filename:join([code:priv_dir(starl_dev), "new", Dir]).

%% All files below a directory, also hidden ones.
texts(Dir) ->
    Files = filelib:fold_files(Dir, ".*", true, fun(File, Files) -> [File | Files] end, []),
    [
        {lists:nthtail(length(Dir) + 1, File), Text}
     || File <- lists:sort(Files), {ok, Text} <- [file:read_file(File)]
    ].

values(Name, Root, {Url, Ref}) ->
    Camel = [string:titlecase(Word) || Word <- string:lexemes(Name, "_")],
    [
        {"@NAME@", Name},
        {"@MODULE@", lists:append(Camel)},
        {"@URL@", Url},
        {"@VERSION@", ["{ref, \"", Ref, "\"}"]},
        {"@MIX_VERSION@", ["ref: \"", Ref, "\""]},
        {"@STARL@", filename:join(Root, "starl")}
    ].

replaced(Text, Values) ->
    lists:foldl(
        fun({From, To}, Now) -> unicode:characters_to_list(string:replace(Now, From, To, all)) end,
        Text,
        Values
    ).

%% Where this StarL comes from, and its commit; a clone of nowhere is itself where it comes from, and so
%% is one whose commit nobody else has yet.
version(Root) ->
    Shared = git(Root, "branch --remotes --contains HEAD"),
    Origin = [Url || Url <- [git(Root, "config --get remote.origin.url")], Shared =/= ""],
    case {lists:append(Origin), git(Root, "rev-parse HEAD")} of
        {_, ""} ->
            {error, [
                Root,
                ": a project depends on a commit of StarL, and git knows none here; make the "
                "project with a clone of StarL"
            ]};
        {"", Ref} ->
            {ok, {"file://" ++ Root, Ref}};
        {Url, Ref} ->
            {ok, {absolute(Url, Root), Ref}}
    end.

%% A path is one of this computer; rebar3 warns of it without a scheme.
absolute(Url, Root) ->
    Dir = filename:absname(Url, Root),
    case filelib:is_dir(Dir) of
        true -> "file://" ++ Dir;
        false -> Url
    end.

git(Root, Args) ->
    string:trim(os:cmd("git -C " ++ quoted(Root) ++ " " ++ Args ++ " 2>/dev/null")).

quoted(Word) -> "'" ++ lists:append(string:replace(Word, "'", "'\\''", all)) ++ "'".

written(Files, Root, Kind, Name) ->
    Answers = [{File, write(File, Text)} || {File, Text} <- Files],
    case [[File, ": ", file:format_error(Posix)] || {File, {error, Posix}} <- Answers] of
        [] ->
            ok = checked_out(Kind, Name, Root),
            {ok, [File || {File, ok} <- Answers]};
        [First | _] ->
            {error, First}
    end.

write(File, Text) ->
    case filelib:ensure_dir(File) of
        ok -> file:write_file(File, unicode:characters_to_binary(Text));
        {error, _} = Error -> Error
    end.

%% Where Hex cannot be reached, ./starl has taken PropEr from elsewhere: the project gets it, too.
checked_out(elixir, _Name, _Root) ->
    ok;
checked_out(_Erlang, Name, Root) ->
    _ = [
        copy(Dir, filename:join([Name, "_checkouts", "proper"]))
     || Dir <- filelib:wildcard(filename:join([Root, ".deps", "proper-*"]))
    ],
    ok.

copy(From, To) ->
    [
        begin
            Copy = filename:join(To, lists:nthtail(length(From) + 1, File)),
            ok = filelib:ensure_dir(Copy),
            {ok, _} = file:copy(File, Copy)
        end
     || File <- filelib:wildcard(filename:join([From, "{ebin,include}", "*"]))
    ].
