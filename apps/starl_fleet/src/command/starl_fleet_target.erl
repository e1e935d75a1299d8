%% @doc Reads the fleet file that a command names, and loads its application. The application is a
%% shipped one, or the user's own Erlang source, which is compiled.
-module(starl_fleet_target).

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
        {ok, Given} -> own(File, Given);
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

%% Drivers and sources of positions of the user's own are compiled: their modules take the place of their files.
own(File, Given) ->
    {Positioning, Sources} = driver(positioning, starl_live_positioning, File, Given),
    {Robots, Drivers} = chassis(File, Positioning),
    Built = Sources ++ Drivers,
    Code = lists:ukeysort(1, lists:append([C || {ok, C} <- Built])),
    case [[File, ": ", Why] || {error, Lines} <- Built, Why <- Lines] of
        [] -> with(Code, with_app(File, Robots, app(File, Robots)));
        Problems -> {error, Problems}
    end.

with(Own, {ok, #{code := Code} = Fleet}) -> {ok, Fleet#{code := lists:ukeysort(1, Code ++ Own)}};
with(_Own, {error, _} = Error) -> Error.

chassis(File, #{robots := #{} = Robots} = Given) ->
    All = [
        {Number, driver(chassis, starl_live_chassis, File, Robot)}
     || {Number, Robot} <- lists:sort(maps:to_list(Robots)), is_map(Robot)
    ],
    Next = maps:merge(Robots, maps:from_list([{Number, Robot} || {Number, {Robot, _}} <- All])),
    {Given#{robots := Next}, lists:append([Built || {_, {_, Built}} <- All])};
chassis(_File, Given) ->
    {Given, []}.

driver(Key, Behaviour, File, Given) ->
    case maps:get(Key, Given, none) of
        {[_ | _] = Source, #{} = Options} -> built(Key, Behaviour, File, {Source, Options}, Given);
        [_ | _] = Source -> built(Key, Behaviour, File, {Source, #{}}, Given);
        _Known -> {Given, []}
    end.

built(Key, Behaviour, File, {Source, Options}, Given) ->
    case io_lib:printable_unicode_list(Source) andalso filename:extension(Source) of
        ".erl" ->
            Beside = filename:join(filename:dirname(File), Source),
            compiled(Key, Behaviour, starl_cli_source:driver(Beside), Options, Given);
        _NoFile ->
            {Given, []}
    end.

compiled(Key, Behaviour, {ok, Module, Code}, Options, Given) ->
    case starl_live_own:check(Module, Behaviour, Options) of
        {ok, Values} -> {Given#{Key := {{module, Module}, Values}}, [{ok, Code}]};
        {error, Why} -> {Given, [{error, [Why]}]}
    end;
compiled(_Key, _Behaviour, {error, _} = Error, _Options, Given) ->
    {Given, [Error]}.

%% The other problems are reported even if there is no such application.
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
