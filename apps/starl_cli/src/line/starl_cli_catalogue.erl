%% @doc Finds the commands and the applications for teams on the code path. Every OTP application
%% declares its own in the environment of its `.app' file: `{starl_commands, [{Title, [Module]}]}'
%% lists commands ({@link starl_cli_command}), `{starl_apps, [Module]}' lists programs for teams
%% (`starl_app'). A project that depends on StarL adds its own in the same way.
-module(starl_cli_catalogue).

-export([commands/0, apps/0]).

-type offer() :: {App :: atom(), Keys :: [{atom(), term()}]}.

-define(PREFIX, "starl_").

%% @doc The commands, grouped by the application that offers them, lowest layer first.
-spec commands() -> [{Title :: string(), [module(), ...]}].
commands() -> [Group || {starl_commands, Groups} <- lists:append(environments()), Group <- Groups].

%% @doc The applications for teams, by name and module.
-spec apps() -> [{Name :: string(), module()}].
apps() ->
    Modules = [Module || {starl_apps, Some} <- lists:append(environments()), Module <- Some],
    [{short(atom_to_list(Module)), Module} || Module <- lists:sort(Modules)].

short(?PREFIX ++ Name) -> Name;
short(Name) -> Name.

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
