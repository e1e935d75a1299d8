%% @doc `./starl keys': makes the keys of a fleet of real robots.
-module(starl_fleet_keys_command).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, subject/2, run/1]).

-spec name() -> string().
name() -> "keys".

-spec synopsis() -> string().
synopsis() -> "make the keys of a fleet of real robots".

-spec argument() -> starl_cli_command:argument().
argument() -> {required, "FLEET.term", {example, "fleet.term"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Makes the key that the robots of a fleet share and, for transport dist, a certificate authority "
        "of the fleet's own with a certificate for each robot (with openssl), in the directory that the "
        "fleet file names as keys. Files that are there are kept: a new robot gets its certificate "
        "by the same command. Keep ca.key on this computer; ./starl deploy copies the others."
    ].

-spec subject(string(), [string()]) -> {ok, file:filename(), [string()]}.
subject(File, Args) -> {ok, File, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := File}) ->
    case starl_fleet_target:read(File) of
        {ok, #{fleet := Fleet}} -> made(starl_fleet_keys:make(Fleet));
        {error, _} = Error -> Error
    end.

made({ok, Lines}) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- Lines]),
    0;
made({error, _} = Error) ->
    Error.
