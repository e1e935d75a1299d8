%% @doc Finds what the OTP applications on the code path offer. Each says it in the environment of its `.app' file:
%% ```
%%   {env, [
%%       {starl_blocks, [{counter, starl_counter}]},
%%       {starl_apps, [{starl_painting, "A team paints a picture together."}]},
%%       {starl_commands, [{"Run and look", [starl_lab_run]}]}
%%   ]}
%% '''
%% These are building blocks with their names ({@link starl_block_catalogue}), programs for teams
%% (`starl_app', one without a purpose can be run and is not shown), and commands of `./starl'
%% (`starl_cli_command'). `starl_emulators' are devices of a simulated world in real time
%% (`starl_world_emulator'), `starl_programs' kinds of robots of the simulator, with the names by which a
%% scenario asks for them (`starl_sim_robot'). A project that depends on StarL adds its own in the same way.
-module(starl_catalogue).

-export([listed/1]).

-type offer() :: {App :: atom(), Keys :: [{atom(), term()}]}.

%% @doc What the applications list under a key, lowest layer first.
-spec listed(starl_apps | starl_blocks | starl_commands | starl_emulators | starl_programs) ->
    [term()].
listed(Key) -> [Entry || Env <- environments(), {Name, Some} <- Env, Name =:= Key, Entry <- Some].

%% A building block is looked up several times a run, and the files change only with the code path.
environments() ->
    Path = code:get_path(),
    case persistent_term:get(?MODULE, none) of
        {Path, Environments} ->
            Environments;
        _ ->
            Environments = ranked(offers(Path)),
            persistent_term:put(?MODULE, {Path, Environments}),
            Environments
    end.

%% An application depends on more applications than any application below it.
ranked(Offers) ->
    Ranked = lists:sort([{length(below(App, Offers)), App, Keys} || {App, Keys} <- Offers]),
    [Env || {_, _, Keys} <- Ranked, {env, [_ | _] = Env} <- Keys].

-spec offers([file:filename()]) -> [offer()].
offers(Path) ->
    Found = [
        {App, Keys}
     || Dir <- Path,
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
