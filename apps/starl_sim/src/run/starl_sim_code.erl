%% @doc Compares the code of two nodes: a run over several nodes has the digest of a
%% run in one VM only if every module that takes part is the same on all nodes.
%%
%% A module is identified by the MD5 of its code, which the compiler stores in it. OTP's own modules
%% are not compared: nodes may run different releases, as long as they run the same build of StarL.
-module(starl_sim_code).

-export([modules/1, digests/1, differing/2]).

-export_type([digests/0]).

-type digests() :: [{module(), MD5 :: binary() | missing}].

%% @doc All modules that take part, given some of them: the modules of their applications, and of
%% the applications that these need, without OTP's.
-spec modules([module()]) -> [module()].
modules(Seeds) ->
    Apps = lists:usort([App || Module <- Seeds, App <- application_of(Module)]),
    Found = [M || App <- closure(Apps, []), M <- modules_of(App)],
    lists:usort(Seeds ++ Found).

%% @doc The digests of modules on this node.
-spec digests([module()]) -> digests().
digests(Modules) -> [{Module, digest(Module)} || Module <- Modules].

%% @doc The modules that differ between the two.
-spec differing(digests(), digests()) -> [module()].
differing(Ours, Theirs) -> [Module || {Module, _} <- Ours -- Theirs].

digest(Module) ->
    case code:ensure_loaded(Module) of
        {module, Module} -> Module:module_info(md5);
        {error, _} -> missing
    end.

%% The application in whose folder a module lies; a user's own application, or a module
%% that was compiled in memory, lies in none.
application_of(Module) ->
    case code:which(Module) of
        File when is_list(File), File =/= "" ->
            Files = filelib:wildcard(filename:join(filename:dirname(File), "*.app")),
            %% the folder of code that runs here: a bounded number of atoms, one per application
            [list_to_atom(filename:basename(App, ".app")) || App <- Files];
        _ ->
            []
    end.

closure([], Seen) ->
    Seen;
closure([App | Apps], Seen) ->
    case lists:member(App, Seen) orelse is_of_otp(App) of
        true -> closure(Apps, Seen);
        false -> closure(key(App, applications) ++ Apps, [App | Seen])
    end.

is_of_otp(App) ->
    case code:lib_dir(App) of
        {error, bad_name} -> true;
        Dir -> lists:prefix(code:lib_dir(), Dir)
    end.

modules_of(App) -> key(App, modules).

key(App, Key) ->
    _ = application:load(App),
    case application:get_key(App, Key) of
        {ok, Value} -> Value;
        undefined -> []
    end.
