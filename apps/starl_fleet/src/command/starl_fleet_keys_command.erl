%% @doc `./starl keys': makes the keys of a fleet of real robots.
-module(starl_fleet_keys_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "keys",
        synopsis => "make the keys of a fleet of real robots",
        argument => {required, "FLEET.term", {example, "fleet.term"}},
        subject => fun subject/2,
        about => [
            "Makes the key that the robots of a fleet share and, for transport dist, a certificate authority "
            "of the fleet's own with a certificate for each robot (with openssl), in the directory that the "
            "fleet file names as keys. Files that are there are kept: a new robot gets its certificate "
            "by the same command. Keep ca.key on this computer; ./starl deploy copies the others."
        ],
        run => fun run/1
    }.

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
