%% @doc `./starl man': prints a manual page of all commands, made from their own declarations.
-module(starl_cli_man).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "man",
        synopsis => "print the manual page",
        about => [
            "Prints a manual page with the help of all commands, to be read by man:",
            {lines, "  ./starl man > starl.1; man ./starl.1"}
        ],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(_Call) ->
    starl_cli_terminal:raw(page(starl_cli_command:all())),
    0.

page(Groups) ->
    [
        %% Left aligned: no path is so long that a line cannot be filled with blanks.
        ".TH STARL 1\n.ad l\n",
        ".SH NAME\nstarl \\- programs for teams of robots\n",
        ".SH SYNOPSIS\n.B starl\n.I COMMAND\n[\\fIARGUMENTS\\fR]\n",
        ".SH DESCRIPTION\n",
        text(
            "Runs programs of a team of robots in a deterministic simulator, which injects faults and "
            "holds every run to the contracts of its building blocks."
        ),
        [
            [".SH ", string:uppercase(Title), "\n", [command(C) || C <- Commands]]
         || {Title, Commands} <- Groups
        ],
        ".SH EXIT STATUS\n",
        [item(integer_to_list(Status), Doc) || {Status, Doc} <- statuses()],
        ".SH FILES\n",
        item("out/", "the results of runs, in the working directory"),
        ".SH EXAMPLES\n",
        [[".PP\n.B ", escaped(Example), "\n"] || Example <- examples()]
    ].

statuses() ->
    [
        {0, "done"},
        {1, "internal error, or a result that could not be written"},
        {2, "bad usage or input"},
        {3, "a contract was violated, or digests differ"},
        {4, "ended before the work was complete"},
        {5, "not judged to the end"},
        {130, "interrupted"}
    ].

examples() ->
    [
        "starl run painting",
        "starl run painting --robots 8 --picture my.svg --seed 7 --loss 0.2",
        "starl run my_app.erl --robots 5",
        "starl replay out/painting-1"
    ].

command(#{synopsis := Synopsis} = Command) ->
    [
        [".SS ", escaped(starl_cli_usage:line(Command)), "\n"],
        text([Synopsis, "."]),
        [paragraph(Paragraph) || Paragraph <- starl_cli_command:about(Command, none)],
        [group(Group) || Group <- starl_cli_command:flags(Command, none)],
        [
            [".PP\nExit status:\n", [item(integer_to_list(S), Doc) || {S, Doc} <- Own]]
         || Own <- own(Command)
        ]
    ].

own(Command) -> [Own || [_ | _] = Own <- [starl_cli_command:statuses(Command)]].

paragraph({lines, Lines}) -> [".PP\n.nf\n", escaped(Lines), "\n.fi\n"];
paragraph({list, Title, Items}) -> [text([Title, ":"]), [item(Name, Doc) || {Name, Doc} <- Items]];
paragraph(Text) -> text(Text).

group({hidden, _}) -> [];
group({shown, Title, Flags}) -> group({Title, Flags});
group({Title, Flags}) -> [text([Title, ":"]), [flag(Flag) || Flag <- Flags]].

flag(Flag) ->
    {Usage, Doc} = starl_cli_flags:described(Flag),
    item(Usage, Doc).

item(Name, Doc) -> [".TP\n.B ", escaped(Name), "\n", escaped(Doc), "\n"].

text(Text) -> [".PP\n", escaped(Text), "\n"].

%% A backslash and a hyphen have a meaning, and a line that begins with a dot or an apostrophe. A
%% path may be broken after a slash.
escaped(Text) ->
    Plain = re:replace(Text, "[\\\\]", "\\\\e", [global, unicode]),
    Hyphens = re:replace(Plain, "-", "\\\\-", [global, unicode]),
    Paths = re:replace(Hyphens, "/", "/\\\\:", [global, unicode]),
    re:replace(Paths, "^([.'])", "\\\\\\&\\1", [global, multiline, unicode]).
