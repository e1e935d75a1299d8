%% What every command has from the behaviour: a help, a place in the list, an answer to what it does
%% not know; and that every one that there is, is offered.
-module(starl_cli_command_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_said, [said/1]).

commands() -> [Command || {_, Commands} <- starl_cli_command:all(), Command <- Commands].

of_each(Test) -> [{Name, fun() -> Test(Command) end} || #{name := Name} = Command <- commands()].

contains(Part, Text) ->
    ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text}).

%% The word that a command begins with.
word(Command) ->
    case starl_cli_command:argument(Command) of
        {required, _, {example, _}} -> ["painting"];
        {required, _, [{Name, _} | _]} -> [atom_to_list(Name)];
        _ -> []
    end.

in_its_place(Width, Test) ->
    Before = os:getenv("COLUMNS", ""),
    true = os:putenv("COLUMNS", integer_to_list(Width)),
    try
        Test()
    after
        os:putenv("COLUMNS", Before)
    end.

help_test_() ->
    of_each(fun(#{name := Name} = Command) ->
        {0, Text} = said([Name, "--help"]),
        contains("Usage: ./starl " ++ Name, Text),
        contains("--help", Text),
        ?assertEqual({0, Text}, said([Name, "-h"])),
        ?assertEqual({0, Text}, said(["help", Name])),
        {0, _} = said([Name | word(Command) ++ ["--nonsense", "-h"]])
    end).

%% Help, tables and lists fit a terminal, and most of it a narrow one.
help_fits_the_width_test_() -> of_each(fun(#{name := Name}) -> fits([Name, "--help"]) end).

help_on_a_target_fits_the_width_test_() ->
    of_each(fun(#{name := Name} = Command) -> fits([Name | word(Command) ++ ["--help"]]) end).

lists_fit_the_width_test_() ->
    [
        {Name, fun() -> fits([Name]) end}
     || Name <- ["help", "apps", "blocks", "scenarios", "faults"]
    ].

fits(Args) ->
    [?assertEqual([], wider(Args, Width)) || Width <- [80, 60, 40]].

%% A line of one word, a flag or name in front of its explanation, and an example stay as they are.
wider(Args, Width) ->
    in_its_place(Width, fun() ->
        {0, Text} = said(Args),
        [
            Line
         || Line <- string:split(Text, "\n", all),
            string:length(Line) > Width,
            Width =:= 80 orelse not is_verbatim(Line)
        ]
    end).

is_verbatim(Line) ->
    lists:any(fun(Begin) -> string:prefix(Line, Begin) =/= nomatch end, [
        "  faults =>",
        "             {",
        "  bash ",
        "  zsh ",
        "  fish ",
        "        ./starl",
        "Usage: "
    ]) orelse length(string:lexemes(Line, " ")) =:= 1 orelse
        re:run(Line, "^  [a-z_]+ +(link|robots?|group|machine|two) ", [{capture, none}]) =:= match.

an_unknown_flag_is_refused_with_a_suggestion_test_() ->
    of_each(fun(#{name := Name} = Command) ->
        {Status, Text} = said([Name | word(Command) ++ ["--helpp"]]),
        ?assertEqual({2, Text}, {Status, Text}),
        contains(
            "starl: " ++ Name ++ ": unknown flag --helpp (did you mean --help?)", Text
        )
    end).

an_unknown_flag_of_its_own_is_known_by_its_neighbour_test_() ->
    [
        {Name, fun() ->
            [Flag | _] = starl_cli_usage:flag_names(Command, none),
            {2, Text} = said([Name | word(Command) ++ [Flag ++ "x"]]),
            contains("unknown flag " ++ Flag ++ "x (did you mean --", Text)
        end}
     || #{name := Name} = Command <- commands()
    ].

a_missing_word_is_named_test_() ->
    [
        {Name, fun() ->
            {2, Text} = said([Name]),
            {required, Placeholder, _} = starl_cli_command:argument(Command),
            Word =
                case string:trim(string:lowercase(Placeholder), trailing, ".") of
                    "files" -> "files";
                    "action" -> "an action";
                    Other -> "a " ++ Other
                end,
            contains("starl: " ++ Name ++ ": name " ++ Word ++ " first", Text)
        end}
     || #{name := Name} = Command <- commands(),
        {required, _, _} <- [starl_cli_command:argument(Command)]
    ].

a_mistyped_choice_is_known_by_its_neighbour_test_() ->
    [
        {Name, fun() ->
            {2, Text} = said([Name, atom_to_list(Choice) ++ "x"]),
            contains("(did you mean ", Text),
            {2, Unknown} = said([Name, "xyzzyxyzzy"]),
            contains("; there are ", Unknown)
        end}
     || #{name := Name} = Command <- commands(),
        {_, _, [{Choice, _} | _]} <- [starl_cli_command:argument(Command)]
    ].

every_command_is_listed_test() ->
    {0, Text} = said([]),
    [
        begin
            contains("\n  " ++ Name ++ " ", Text),
            length(Synopsis) < 40 andalso contains(Synopsis, Text)
        end
     || #{name := Name, synopsis := Synopsis} <- commands()
    ],
    {0, Names} = said(["help", "--names"]),
    ?assertEqual(starl_cli_command:names(), string:lexemes(Names, "\n")),
    ?assertEqual(length(commands()), length(lists:usort(string:lexemes(Names, "\n")))).

%% The word may stand behind flags.
a_choice_behind_flags_test() ->
    {ok, #{subject := Block, values := Values}} =
        starl_cli_dispatch:read(starl_lab_check:command(), [
            "--robots", "2", "mutex", "--depth", "3"
        ]),
    ?assertEqual(mutex, Block),
    ?assertMatch(#{robots := 2, depth := 3, quiet := false}, Values).

%% A command or an application that nobody lists would be there for nobody.
all_that_there_are_are_offered_test_() ->
    %% it reads all code, on a busy computer from the disk
    {timeout, 60, fun all_that_there_are_are_offered/0}.

all_that_there_are_are_offered() ->
    Apps = [Module || {_, Module} <- starl_cli_target:apps()],
    Commands = lists:append([Some || {_, Some} <- starl_catalogue:listed(starl_commands)]),
    ?assertEqual([], implementing(starl_cli_command) -- Commands),
    ?assertEqual([], implementing(starl_app) -- Apps).

implementing(Behaviour) ->
    lists:usort([
        list_to_atom(filename:rootname(Beam))
     || File <- lists:append([filelib:wildcard("starl_*.app", Dir) || Dir <- code:get_path()]),
        Dir <- [filename:dirname(code:where_is_file(File))],
        Beam <- filelib:wildcard("*.beam", Dir),
        {ok, {_, [{attributes, Attributes}]}} <- [
            beam_lib:chunks(filename:join(Dir, Beam), [attributes])
        ],
        lists:member(Behaviour, proplists:append_values(behaviour, Attributes))
    ]).

%% A lower layer comes first.
layers_in_their_order_test() ->
    [{First, _} | _] = All = starl_cli_command:all(),
    ?assertEqual("Run and look", First),
    ?assertEqual("To work on StarL", element(1, lists:last(All))).

%% The directory of a run without a recording is told from one that is not there.
no_recording_test_() ->
    Run = filename:dirname(code:which(?MODULE)),
    [
        {Name, fun() ->
            {2, Here} = said([Name, Run]),
            ?assertNotEqual(nomatch, string:find(Here, " holds no recording; ./starl ")),
            {2, Nowhere} = said([Name, Run ++ "/nowhere"]),
            ?assertNotEqual(nomatch, string:find(Nowhere, "there is no such file"))
        end}
     || Name <- ["judge", "info", "view"]
    ].

%% One line on an internal error names the function, also where the exception has the arguments in its text.
an_internal_error_names_its_function_test() ->
    Brief = fun(Fun) ->
        try Fun() of
            _ -> none
        catch
            Class:Reason:Stack ->
                starl_cli:brief(erl_error:format_exception(Class, Reason, Stack))
        end
    end,
    Long = maps:from_list([{N, lists:seq(1, 9)} || N <- lists:seq(1, 9)]),
    [
        ?assertNotEqual({Line, nomatch}, {Line, string:find(Line, Part)})
     || {Line, Part} <- [
            {Brief(fun() -> lists:nth(Long, [1]) end), "in function lists:nth/2"},
            {Brief(fun() -> lists:nth(1, Long) end), "matching lists:nth(1,"},
            {
                Brief(fun() -> starl_cli_no_such:name() end),
                "undefined function starl_cli_no_such:name/0"
            }
        ]
    ],
    ?assertEqual("exception exit: normal", starl_cli:brief("exception exit: normal")).
