%% @doc `./starl completion SHELL': prints a script with which a shell completes command lines of
%% `./starl'. It is made from the tables of the commands.
-module(starl_cli_completion).
-behaviour(starl_cli_command).

-export([command/0]).

%% A command, its purpose, the words that may follow it, and its flags; `targets': those flags for
%% each word for which they are others.
-type row() :: #{
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

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "completion",
        synopsis => "complete command lines in bash, zsh or fish",
        argument => {required, "SHELL", [{bash, ""}, {zsh, ""}, {fish, ""}]},
        about => [
            "Prints a script for a shell, which then completes commands, their flags and the values of "
            "these: applications, scenarios, pictures, blocks, kinds of faults. To use it at once, and "
            "from now on:",
            {lines,
                "  bash  source <(./starl completion bash)\n"
                "        ./starl completion bash >> ~/.bashrc\n"
                "  zsh   source <(./starl completion zsh)\n"
                "        ./starl completion zsh > DIR/_starl    (DIR is in $fpath)\n"
                "  fish  ./starl completion fish | source\n"
                "        ./starl completion fish > ~/.config/fish/completions/starl.fish"}
        ],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Shell}) ->
    starl_cli_terminal:raw(script(Shell, table())),
    0.

script(fish, Table) -> fish(Table);
script(bash, Table) -> [tables(Table), bash()];
script(zsh, Table) -> ["#compdef starl\n", tables(Table), zsh()].

%% -- bash and zsh ---------------------------------------------------------------------------

%% The tables as functions that print words: what follows a command, its flags with a target, the
%% flags without a value, and the values of a flag. An answer `FILES' asks for files, too.
tables(Table) ->
    [
        "# Completion of starl, made by ./starl completion.\n",
        function("_starl_words", "$1", [{"''", words(names(Table))} | rows(Table, fun after_it/1)]),
        function("_starl_flags", "$1:$2", lists:append([flag_rows(C) || C <- Table])),
        function("_starl_values", "$1:$2", lists:append([value_rows(C) || C <- Table])),
        function("_starl_switch", "$1:$2", lists:append([switch_rows(C) || C <- Table]))
    ].

function(Name, Of, Rows) ->
    Lines = [["        ", Case, ") echo \"", Text, "\" ;;\n"] || {Case, Text} <- Rows],
    [Name, "() {\n    case \"", Of, "\" in\n", Lines, "    esac\n}\n"].

rows(Table, Text) -> [{Name, Text(Command)} || #{name := Name} = Command <- Table].

names(Table) -> [Name || #{name := Name} <- Table].

after_it(#{words := Words, files := Files}) -> words(Words ++ ["FILES" || Files]).

flag_rows(#{name := Name, flags := Flags, targets := Targets}) ->
    [
        {lists:join("|", [[Name, ":", Word] || Word <- Group]), words(known(Some))}
     || {Group, Some} <- Targets
    ] ++ [{[Name, ":*"], words(known(Flags))}].

known(Flags) -> [Flag || {Flag, _, _} <- Flags].

%% The flags of all targets of a command together: values do not depend on the target.
value_rows(#{name := Name, flags := Flags, targets := Targets}) ->
    All = lists:usort([
        F
     || {Flag, _, V} <- lists:append([Flags | [S || {_, S} <- Targets]]), F <- [{Flag, V}]
    ]),
    [{[Name, ":", Flag], words(Words)} || {Flag, V} <- All, [_ | _] = Words <- [said(V)]].

said({words, Words}) -> Words;
said({files, Words}) -> Words ++ ["FILES"];
said(_) -> [].

%% A flag that is a switch of one command may have a value with another.
switch_rows(#{name := Name, flags := Flags, targets := Targets}) ->
    All = lists:append([Flags | [Some || {_, Some} <- Targets]]),
    case lists:usort([[Name, ":", Flag] || {Flag, _, switch} <- All]) of
        [] -> [];
        Switches -> [{lists:join("|", Switches), "yes"}]
    end.

words(Words) -> lists:join(" ", Words).

bash() ->
    "_starl() {\n"
    "    local cur=${COMP_WORDS[COMP_CWORD]} prev= cmd= target= word skip= words= i\n"
    "    for ((i = 1; i < COMP_CWORD; i++)); do\n"
    "        word=${COMP_WORDS[i]}\n"
    "        case $word in\n"
    "            =) ;;\n"
    "            --*) [ -n \"$(_starl_switch \"$cmd\" \"$word\")\" ] && skip= || skip=$word ;;\n"
    "            *) if [ -n \"$skip\" ]; then skip=\n"
    "               elif [ -z \"$cmd\" ]; then cmd=$word\n"
    "               elif [ -z \"$target\" ]; then target=$word; fi ;;\n"
    "        esac\n"
    "    done\n"
    "    [ \"$cur\" != = ] || cur=\n"
    "    if [ -n \"$skip\" ]; then words=$(_starl_values \"$cmd\" \"$skip\")\n"
    "    elif [[ $cur == -* ]]; then words=$(_starl_flags \"$cmd\" \"$target\")\n"
    "    elif [ -z \"$target\" ]; then words=$(_starl_words \"$cmd\"); fi\n"
    "    # Of a list of values the last is completed.\n"
    "    local last=${cur##*[\\[,]}\n"
    "    local before=${cur%\"$last\"}\n"
    "    COMPREPLY=($(compgen -P \"$before\" -W \"${words//FILES/}\" -- \"$last\"))\n"
    "    case $words in *FILES) COMPREPLY+=($(compgen -f -- \"$cur\")) ;; esac\n"
    "}\n"
    "complete -o filenames -F _starl starl\n".

zsh() ->
    "_starl() {\n"
    "    local cur=${words[CURRENT]} cmd= target= word skip= list= i\n"
    "    for ((i = 2; i < CURRENT; i++)); do\n"
    "        word=${words[i]}\n"
    "        case $word in\n"
    "            --*=*) skip= ;;\n"
    "            --*) [[ -n $(_starl_switch \"$cmd\" $word) ]] && skip= || skip=$word ;;\n"
    "            *) if [[ -n $skip ]]; then skip=\n"
    "               elif [[ -z $cmd ]]; then cmd=$word\n"
    "               elif [[ -z $target ]]; then target=$word; fi ;;\n"
    "        esac\n"
    "    done\n"
    "    if [[ -n $skip ]]; then list=$(_starl_values \"$cmd\" \"$skip\"); compset -P '*[\\[,]'\n"
    "    elif [[ $cur == -* ]]; then list=$(_starl_flags \"$cmd\" \"$target\")\n"
    "    elif [[ -z $target ]]; then list=$(_starl_words \"$cmd\"); fi\n"
    "    compadd -- ${=list//FILES/}\n"
    "    [[ $list == *FILES ]] && _files\n"
    "}\n"
    "compdef _starl starl\n".

%% -- fish -----------------------------------------------------------------------------------

fish(Table) ->
    [
        "# Completion of starl, made by ./starl completion.\n",
        "complete -c starl -f\n",
        [fish_command(Command) || Command <- Table]
    ].

fish_command(#{name := Name, about := About, words := Words, files := Files} = Command) ->
    #{flags := Flags, targets := Targets} = Command,
    Seen = ["complete -c starl -n '__fish_seen_subcommand_from ", Name, "'"],
    Every = lists:ukeysort(1, lists:append([Flags | [Some || {_, Some} <- Targets]])),
    [
        ["complete -c starl -n __fish_use_subcommand -a ", Name, " -d ", quoted(About), "\n"],
        [[Seen, " -a ", quoted(words(Words)), "\n"] || Words =/= []],
        [[Seen, " -F\n"] || Files],
        [
            [Seen, " -l ", tl(tl(Flag)), fish_values(V), " -d ", quoted(Doc), "\n"]
         || {Flag, Doc, V} <- Every
        ]
    ].

fish_values(switch) -> "";
fish_values(any) -> " -x";
fish_values({words, Words}) -> [" -x -a ", quoted(words(Words))];
fish_values({files, Words}) -> [" -r -F -a ", quoted(words(Words))].

quoted(Text) ->
    ["'", string:replace(string:replace(Text, "\\", "\\\\", all), "'", "\\'", all), "'"].

%% -- the words -----------------------------------------------------------------------------

%% All commands, with what may follow them: from the tables that the help and the parser come from.
-spec table() -> [row()].
table() -> [row(Command) || {_, Some} <- starl_cli_command:all(), Command <- Some].

row(#{name := Name, synopsis := Synopsis} = Command) ->
    Targets = targets(Command),
    #{
        name => Name,
        about => Synopsis,
        words => follow(starl_cli_command:argument(Command), Targets),
        files => Targets =/= [] orelse is_map_key(subject, Command),
        flags => flags(Command, none),
        targets => grouped([{Word, flags(Command, Target)} || {Word, Target} <- Targets])
    }.

%% The words that may follow a command.
follow({_, "PICTURE", _}, _Targets) -> pictures();
follow({_, _, [_ | _] = Choices}, _Targets) -> [atom_to_list(Name) || {Name, _} <- Choices];
follow(_, Targets) -> [Word || {Word, _} <- Targets].

%% The applications and scenarios that ship, if the command takes such.
targets(#{subject := Subject} = Command) ->
    Names =
        case starl_cli_command:argument(Command) of
            {required, Word, {example, _}} when Word =/= "PICTURE" ->
                [Name || {Name, _} <- starl_cli_target:apps()] ++
                    [Name || {Name, _, _} <- starl_cli_target:scenarios()];
            _ ->
                []
        end,
    [{Name, Target} || Name <- Names, {ok, #{app := _} = Target, _} <- [Subject(Name, [])]];
targets(#{}) ->
    [].

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
values(Key, {Of, Type}) when Of =:= list; Of =:= first; Of =:= optional -> values(Key, Type);
values(_Key, {one_of, Atoms}) ->
    {words, texts(Atoms)};
values(_Key, boolean) ->
    {words, ["true", "false"]};
values(block, {term, _, _}) ->
    {words, texts([Name || {Name, _} <- starl_block_catalogue:known()])};
values(random_faults, _) ->
    {words, texts([all | starl_run_fault:classes()] ++ kinds())};
values(faults, _) ->
    {words, texts(kinds())};
values(chassis, _) ->
    {files, texts(starl_chassis_choice:names())};
values(Key, _) when Key =:= picture; Key =:= pictures -> {files, pictures()};
values(floor, _) ->
    {files, starl_floor_file:shipped()};
values(start, _) ->
    {files, ["grid", "line", "circle", "random"]};
values(Key, Type) when Key =:= out; Type =:= file ->
    {files, []};
values(_Key, _Type) ->
    any.

kinds() -> [element(1, Spec) || Spec <- starl_run_fault:kinds()].

pictures() ->
    Files = filelib:wildcard("*.svg", filename:join(code:priv_dir(starl_apps), "pictures")),
    [filename:rootname(File) || File <- lists:sort(Files)].

texts(Atoms) -> [atom_to_list(Atom) || Atom <- Atoms].
