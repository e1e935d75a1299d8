%% @doc Makes the help text of all commands or of one command from the commands' own declarations,
%% and wraps it to the width of the terminal.
-module(starl_cli_usage).

-export([general/0, command/3, items/1, line/1, flag_names/2]).

%% The largest width of the column of names, if the terminal has room for it.
-define(WIDEST_NAME, 18).
%% In a narrower terminal the explanation of a name goes to the next line.
-define(NARROW, 60).
%% A line never breaks between a number and its meaning.
-define(NO_BREAK, 16#A0).

%% @doc The help of all commands.
-spec general() -> unicode:chardata().
general() ->
    Groups = [
        {Title, [{line(C), Synopsis} || #{synopsis := Synopsis} = C <- Commands]}
     || {Title, Commands} <- starl_cli_command:all()
    ],
    Column = column(lists:append([Items || {_, Items} <- Groups])),
    [
        "StarL: programs for teams of robots.\n\nUsage: ./starl COMMAND [ARGUMENTS]\n",
        [section(Title, Items, Column) || {Title, Items} <- Groups],
        "\n",
        prose("./starl COMMAND --help tells more; ./starl --version tells which StarL this is."),
        prose("To begin with: ./starl run painting")
    ].

%% @doc A command with its argument, as it is typed.
-spec line(starl_cli_command:command()) -> string().
line(Command) -> lists:flatten(usage(Command, none)).

%% @doc The flags of a command, for completion.
-spec flag_names(starl_cli_command:command(), starl_cli_command:subject()) -> [string()].
flag_names(Command, Subject) ->
    [
        starl_cli_flags:flag(Key)
     || {_, Flags} <- starl_cli_command:flags(Command, Subject), {Key, _, _, _} <- Flags
    ].

%% @doc The help of a command, for the word with which help was asked.
-spec command(starl_cli_command:command(), Word :: string() | none, starl_cli_command:subject()) ->
    unicode:chardata().
command(Command, Word, Subject) ->
    [
        "Usage: ./starl ",
        usage(Command, Word),
        " [FLAGS]\n",
        [paragraph(Paragraph) || Paragraph <- starl_cli_command:about(Command, Subject)],
        [group(Group) || Group <- starl_cli_command:flags(Command, Subject)],
        statuses(starl_cli_command:statuses(Command))
    ].

usage(#{name := Name} = Command, none) -> [Name, placeholder(starl_cli_command:argument(Command))];
usage(#{name := Name}, Word) -> [Name, " ", starl_cli_terminal:quoted(Word)].

placeholder(none) -> "";
placeholder({required, Placeholder, _}) -> [" ", Placeholder];
placeholder({optional, Placeholder, _}) -> [" [", Placeholder, "]"].

paragraph({lines, Lines}) -> ["\n", Lines, "\n"];
paragraph({list, Title, Items}) -> section(Title, Items, column(Items));
paragraph(Text) -> ["\n", prose(Text)].

group({hidden, _}) -> [];
group({shown, Title, Flags}) -> group({Title, Flags});
group({Title, Flags}) -> ["\n", prose([Title, ":"]), starl_cli_flags:help(Flags, width())].

statuses([]) ->
    [];
statuses(Statuses) ->
    Texts = [[integer_to_list(Status), ?NO_BREAK, Text] || {Status, Text} <- Statuses],
    ["\n", prose(["Exit status: ", lists:join("; ", Texts), "."])].

prose(Text) ->
    Lines = starl_cli_terminal:wrap(Text, 0, width()),
    [string:replace(Lines, [?NO_BREAK], " ", all), "\n"].

%% @doc Names with explanations, one below the other.
-spec items([{Name :: unicode:chardata(), Doc :: unicode:chardata()}]) -> unicode:chardata().
items(Items) -> [item(Item, column(Items), width()) || Item <- Items].

section(Title, Items, Column) ->
    ["\n", Title, ":\n", [item(Item, Column, width()) || Item <- Items]].

column(Items) ->
    Widths = [string:length(Name) || {Name, _} <- Items],
    lists:max([0 | [Width || Width <- Widths, Width =< ?WIDEST_NAME]]).

item({Name, Doc}, Column, Width) ->
    Indent = Column + 4,
    case string:length(Name) =< Column andalso Width >= ?NARROW of
        true -> ["  ", string:pad(Name, Column + 2), wrapped(Doc, Indent, Width)];
        false -> ["  ", Name, "\n      ", wrapped(Doc, 6, Width)]
    end.

wrapped(Doc, Indent, Width) -> [starl_cli_terminal:wrap(Doc, Indent, Width), "\n"].

width() -> starl_cli_terminal:columns().
