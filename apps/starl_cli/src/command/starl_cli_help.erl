%% @doc `./starl help': explains all commands or one, and gives their names to scripts.
-module(starl_cli_help).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "help",
        synopsis => "this list, or the help of a command",
        argument => fun argument/0,
        about => [
            "Lists all commands; ./starl help COMMAND is ./starl COMMAND --help.",
            "./starl completion makes a shell complete them; ./starl man prints them as a manual page."
        ],
        flags => [
            {"Flags", [
                {names, switch, false, "only the names: of the commands, or of COMMAND's flags"}
            ]}
        ],
        run => fun run/1
    }.

argument() ->
    %% These few atoms are the names of the project's own commands.
    {optional, "COMMAND", [{list_to_atom(Name), ""} || Name <- starl_cli_command:names()]}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Name, values := #{names := Names}}) ->
    starl_cli_terminal:help(text(Name, Names)),
    0.

text(none, false) -> starl_cli_usage:general();
text(none, true) -> lines(starl_cli_command:names());
text(Name, false) -> starl_cli_usage:command(named(Name), none, none);
text(Name, true) -> lines(starl_cli_usage:flag_names(named(Name), none)).

named(Name) ->
    {ok, Command} = starl_cli_command:find(atom_to_list(Name)),
    Command.

lines(Words) -> [[Word, "\n"] || Word <- Words].
