%% @doc `./starl help': explains all commands or one, and gives their names to scripts.
-module(starl_cli_help).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, flags/1, run/1]).

-spec name() -> string().
name() -> "help".

-spec synopsis() -> string().
synopsis() -> "this list, or the help of a command".

-spec argument() -> starl_cli_command:argument().
argument() ->
    %% These few atoms are the names of the project's own commands.
    {optional, "COMMAND", [{list_to_atom(Name), ""} || Name <- starl_cli_usage:names()]}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Lists all commands; ./starl help COMMAND is ./starl COMMAND --help.",
        "./starl completion makes a shell complete them; ./starl man prints them as a manual page."
    ].

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) ->
    [{"Flags", [{names, switch, false, "only the names: of the commands, or of COMMAND's flags"}]}].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Name, values := #{names := Names}}) ->
    starl_cli_terminal:help(text(Name, Names)),
    0.

text(none, false) -> starl_cli_usage:general();
text(none, true) -> lines(starl_cli_usage:names());
text(Name, false) -> starl_cli_usage:command(module(Name), none, none);
text(Name, true) -> lines(starl_cli_usage:flag_names(module(Name), none)).

module(Name) ->
    {ok, Command} = starl_cli_command:find(atom_to_list(Name)),
    Command.

lines(Words) -> [[Word, "\n"] || Word <- Words].
