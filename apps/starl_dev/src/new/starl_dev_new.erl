%% @doc The command `./starl new': creates a project that uses StarL from the templates in
%% `priv/new'. For a building block or a chassis it uses the example.
-module(starl_dev_new).
-behaviour(starl_cli_command).

-export([command/0]).
-export([make/3]).

-export_type([kind/0]).

-type kind() :: app | block | chassis | elixir.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "new",
        synopsis => "begin a project of your own",
        argument => {required, "PROJECT", {example, "patrol"}},
        subject => fun subject/2,
        about => [
            "Makes the directory PROJECT with a program for a team of robots, its contract, a scenario, a "
            "test, properties under random faults and a workflow for continuous integration. It depends "
            "on this StarL by one line: on the repository that it was cloned from, at this commit.",
            {lines, "  ./starl new patrol\n  cd patrol\n  rebar3 eunit"}
        ],
        flags => [
            {"Flags", [
                {block, switch, false,
                    "a building block of your own, with its contract and its exercise"},
                {chassis, switch, false,
                    "a robot with two wheels of your own, with the test of its contract"},
                {elixir, switch, false, "a mix project, with the program in Elixir"}
            ]}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) ->
    {ok, string(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Name, Args) ->
    case check_name(Name) of
        ok -> {ok, Name, Args};
        {error, Why} -> {error, [Why]}
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Name, values := Values}) ->
    case [Kind || Kind <- [block, chassis, elixir], maps:get(Kind, Values)] of
        [] -> project(Name, app);
        [Kind] -> project(Name, Kind);
        Kinds -> {error, [several(Kinds)]}
    end.

several(Kinds) ->
    [
        lists:join(" ", ["--" ++ atom_to_list(Kind) || Kind <- Kinds]),
        ": a project begins with one of them"
    ].

project(Name, Kind) ->
    case make(Name, Kind, starl_cli_target:root()) of
        {ok, Files} -> made(Name, Kind, Files);
        {error, Why} -> {error, [Why]}
    end.

made(Name, Kind, Files) ->
    [starl_cli_terminal:out(["* ", File, "\n"]) || File <- Files],
    starl_cli_terminal:out(["next: cd ", Name, " && ", first(Kind), "\n"]),
    0.

first(elixir) -> "mix deps.get && mix test";
first(_Erlang) -> "rebar3 eunit".

%% -- the project ----------------------------------------------------------------------------

%% Can a project have this name? It is one of an Erlang module that does not exist yet.
-spec check_name(string()) -> ok | {error, unicode:chardata()}.
check_name(Name) ->
    case re:run(Name, "^[a-z][a-z0-9_]{0,39}$", [{capture, none}, dollar_endonly]) of
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
-spec make(string(), kind(), Root :: file:filename()) ->
    {ok, [file:filename()]} | {error, unicode:chardata()}.
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
