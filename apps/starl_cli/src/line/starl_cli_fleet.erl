%% @doc Reads the fleet file that a command names, with its application: a shipped one, or the Erlang
%% source of the user's own, which is compiled.
-module(starl_cli_fleet).

-export([read/1, robots/1]).

-export_type([t/0]).

%% `code': the user's own modules.
-type t() :: #{
    file := file:filename(), fleet := starl_fleet_file:t(), code := [starl_fleet_release:code()]
}.

%% @doc Reads and checks a fleet file.
-spec read(file:filename()) -> {ok, t()} | {error, [unicode:chardata(), ...]}.
read(File) ->
    case starl_fleet_file:read(File) of
        {ok, Given} -> with_app(File, Given, app(File, Given));
        {error, _} = Error -> Error
    end.

%% @doc Reads and checks a fleet file for the sake of its robots, whatever has become of its
%% application.
-spec robots(file:filename()) -> {ok, t()} | {error, [unicode:chardata(), ...]}.
robots(File) ->
    case starl_fleet_file:read(File) of
        {ok, Given} -> checked(File, starl_fleet_file:check(File, Given, unknown), []);
        {error, _} = Error -> Error
    end.

checked(File, {ok, Fleet}, Code) -> {ok, #{file => File, fleet => Fleet, code => Code}};
checked(_File, {error, _} = Error, _Code) -> Error.

%% The other problems are told even if there is no such application.
with_app(File, Given, {ok, #{app := App} = Target}) ->
    checked(File, starl_fleet_file:check(File, Given, App), maps:get(code, Target, []));
with_app(File, Given, {error, Lines}) ->
    case starl_fleet_file:check(File, Given, unknown) of
        {ok, _} -> {error, Lines};
        {error, Others} -> {error, Lines ++ Others}
    end.

app(File, #{app := App}) when is_atom(App) ->
    case lists:keyfind(App, 2, starl_cli_target:apps()) of
        {Name, _} -> resolved(File, Name);
        false -> resolved(File, atom_to_list(App))
    end;
app(File, #{app := [_ | _] = App}) ->
    Beside = filename:join(filename:dirname(File), App),
    case filename:extension(App) =:= ".erl" orelse filelib:is_dir(Beside) of
        true -> resolved(File, Beside);
        false -> resolved(File, App)
    end;
%% the check of the file tells this
app(_File, _Given) ->
    {error, []}.

resolved(File, Word) ->
    case starl_cli_target:resolve(Word) of
        {ok, Target} -> {ok, Target};
        {error, Lines} -> {error, [[File, ": app: ", Line] || Line <- Lines]}
    end.
