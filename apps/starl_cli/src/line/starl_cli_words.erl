%% @doc The words that a command line may be made of, for the completion of a shell: the commands,
%% what each may be followed by, its flags and their values. All come from the tables that the help
%% and the parser come from.
-module(starl_cli_words).

-export([table/0]).

-export_type([command/0, flag/0, values/0]).

%% A command, its purpose, the words that may follow it, and its flags; `targets': those flags for
%% each word for which they are others.
-type command() :: #{
    name := string(),
    about := string(),
    words := [string()],
    files := boolean(),
    flags := [flag()],
    targets := [{[Word :: string(), ...], [flag()]}]
}.

-type flag() :: {Flag :: string(), Doc :: string(), values()}.

%% The values of a flag: it has none, they are not known, these words, or files besides these words.
-type values() :: switch | any | {words, [string()]} | {files, [string()]}.

%% @doc All commands.
-spec table() -> [command()].
table() -> [command(Command) || {_, Some} <- starl_cli_command:all(), Command <- Some].

command(Command) ->
    Targets = targets(Command),
    #{
        name => Command:name(),
        about => Command:synopsis(),
        words => words(starl_cli_command:argument(Command), Targets),
        files => Targets =/= [] orelse erlang:function_exported(Command, subject, 2),
        flags => flags(Command, none),
        targets => grouped([{Word, flags(Command, Target)} || {Word, Target} <- Targets])
    }.

words({_, "PICTURE", _}, _Targets) -> pictures();
words({_, _, [_ | _] = Choices}, _Targets) -> [atom_to_list(Name) || {Name, _} <- Choices];
words(_, Targets) -> [Word || {Word, _} <- Targets].

%% The applications and scenarios that ship, if the command takes such.
targets(Command) ->
    Names =
        case starl_cli_command:argument(Command) of
            {required, Word, {example, _}} when Word =/= "PICTURE" ->
                [Name || {Name, _} <- starl_cli_target:apps()] ++
                    [Name || {Name, _, _} <- starl_cli_target:scenarios()];
            _ ->
                []
        end,
    [{Name, Target} || Name <- Names, {ok, #{app := _} = Target, _} <- [Command:subject(Name, [])]].

grouped(Pairs) ->
    Flags = lists:usort([F || {_, F} <- Pairs]),
    lists:sort([{[Word || {Word, F} <- Pairs, F =:= Same], Same} || Same <- Flags]).

flags(Command, Subject) ->
    Flags = lists:append([Some || {_, Some} <- starl_cli_command:flags(Command, Subject)]),
    lists:usort([
        {starl_cli_flags:flag(Key), Doc, values(Command, Key, Type)}
     || {Key, Type, _, Doc} <- Flags
    ]).

%% A command may know more of a flag than its type says.
values(Command, Key, Type) ->
    case starl_cli_command:words(Command, Key) of
        [] -> values(Key, Type);
        Words -> {words, Words}
    end.

values(_Key, switch) ->
    switch;
values(Key, {list, Type}) ->
    values(Key, Type);
values(Key, {first, Type}) ->
    values(Key, Type);
values(Key, {optional, Type}) ->
    values(Key, Type);
values(_Key, {one_of, Atoms}) ->
    {words, texts(Atoms)};
values(_Key, boolean) ->
    {words, ["true", "false"]};
values(block, {term, _, _}) ->
    {words, texts([Name || {Name, _} <- starl_block_catalogue:known()])};
values(random_faults, _) ->
    {words, texts([all | starl_sim_fault:classes()] ++ kinds())};
values(faults, _) ->
    {words, texts(kinds())};
values(chassis, _) ->
    {files, texts(starl_chassis_choice:names())};
values(Key, _) when Key =:= picture; Key =:= pictures -> {files, pictures()};
values(floor, _) ->
    {files, starl_floor_file:shipped()};
values(start, _) ->
    {files, ["grid", "line", "circle", "random"]};
values(out, _) ->
    {files, []};
values(_Key, file) ->
    {files, []};
values(_Key, _Type) ->
    any.

kinds() -> [element(1, Spec) || Spec <- starl_sim_fault:kinds()].

pictures() ->
    Files = filelib:wildcard("*.svg", filename:join(code:priv_dir(starl_apps), "pictures")),
    [filename:rootname(File) || File <- lists:sort(Files)].

texts(Atoms) -> [atom_to_list(Atom) || Atom <- Atoms].
