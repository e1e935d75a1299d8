%% @doc Finds the commands and the applications for teams on the code path. Every OTP application
%% declares its own in the environment of its `.app' file: `{starl_commands, [{Title, [Module]}]}'
%% lists commands ({@link starl_cli_command}), `{starl_apps, [{Module, Purpose}]}' lists programs for
%% teams (`starl_app'). One without a purpose, `Module', can be run and is not shown. A project that depends on StarL adds its own in the same way.
-module(starl_cli_catalogue).

-export([commands/0, apps/0, purposes/0]).

-type offer() :: {App :: atom(), Keys :: [{atom(), term()}]}.

-define(PREFIX, "starl_").

%% @doc The commands, grouped by the application that offers them, lowest layer first.
-spec commands() -> [{Title :: string(), [module(), ...]}].
commands() -> [Group || {starl_commands, Groups} <- lists:append(environments()), Group <- Groups].

%% @doc The applications for teams, by name and module.
-spec apps() -> [{Name :: string(), module()}].
apps() ->
    Modules = [module(Listed) || Listed <- listed()],
    [{short(Module), Module} || Module <- lists:sort(Modules)].

%% @doc The applications that are for users: name and purpose.
-spec purposes() -> [{Name :: string(), Purpose :: string()}].
purposes() -> lists:sort([{short(Module), Purpose} || {Module, Purpose} <- listed()]).

listed() -> [Listed || {starl_apps, Some} <- lists:append(environments()), Listed <- Some].

module({Module, _Purpose}) -> Module;
module(Module) -> Module.

short(Module) ->
    case atom_to_list(Module) of
        ?PREFIX ++ Name -> Name;
        Name -> Name
    end.

%% An application depends on more applications than any application below it.
environments() ->
    Offers = offers(),
    Ranked = lists:sort([{length(below(App, Offers)), App, Keys} || {App, Keys} <- Offers]),
    [proplists:get_value(env, Keys, []) || {_, _, Keys} <- Ranked].

-spec offers() -> [offer()].
offers() ->
    Found = [
        {App, Keys}
     || Dir <- code:get_path(),
        not belongs_to_otp(Dir),
        File <- filelib:wildcard(filename:join(Dir, "*.app")),
        {ok, [{application, App, Keys}]} <- [file:consult(File)]
    ],
    lists:ukeysort(1, Found).

%% Skipping OTP saves reading fifty files. In a release all applications lie in OTP's directory.
belongs_to_otp(Dir) ->
    Otp = code:lib_dir(),
    lists:prefix(Otp, Dir) andalso not lists:prefix(Otp, filename:dirname(code:which(?MODULE))).

below(App, Offers) ->
    Direct = proplists:get_value(applications, proplists:get_value(App, Offers, []), []),
    lists:usort([App | lists:flatmap(fun(Other) -> below(Other, Offers) end, Direct)]).
