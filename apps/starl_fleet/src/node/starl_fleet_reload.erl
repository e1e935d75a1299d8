%% @doc Reloads a running robot with the code of another release, like every reload
%% ({@link starl_reload}). New versions of the application's own modules, and of the modules that it
%% brought along, are loaded beside the former versions. They are on trial. StarL's modules change
%% with a deployment only. The robots of a fleet do not hear of each other's failures by themselves:
%% whoever has ordered the reload reports them, over ssh.
-module(starl_fleet_reload).

-export([answer/1, changed/2, sources/3]).

-define(LAYERS, [
    "starl_blocks", "starl_run", "starl_live", "starl_trace", "starl_create", "starl_fleet"
]).

%% @doc Answers `bin/robot'. `check RELEASE' makes the versions. `switch RELEASE TRIAL_MS' has the
%% robot take them. `back RELEASE ROBOT' has it return to the former code, that of `RELEASE', since
%% the new code has failed on robot `ROBOT'.
-spec answer([string()]) -> ok | {error, string()}.
answer(["check", Release]) ->
    case order(Release, starl_reload:trial_ms()) of
        {error, _} = Error -> Error;
        _ -> ok
    end;
answer(["switch", Release, TrialMs]) ->
    case order(Release, list_to_integer(TrialMs)) of
        {ok, Order, Code} -> taken(starl_version:load(Code), Order, Release);
        same -> starl_fleet_node:runs(Release);
        {error, _} = Error -> Error
    end;
answer(["back", Release, Failed]) ->
    starl_fleet_node:leaves(Release, list_to_integer(Failed)).

taken(ok, Order, Release) -> starl_fleet_node:takes(Order, Release);
taken({error, Why}, _Order, _Release) -> {error, flat(Why)}.

order(Release, TrialMs) ->
    #{number := N, parts := Parts, versions := Known} = starl_fleet_node:code(),
    case {own(changed(Release, loaded())), Known} of
        {{ok, []}, []} ->
            same;
        {{ok, Files}, _} ->
            Sources = sources([module(File) || File <- Files], Known, own_code(Release)),
            ordered(starl_reload:order(N, Sources, Parts, TrialMs));
        {{error, _} = Error, _} ->
            Error
    end.

ordered({ok, _, _} = Order) -> Order;
ordered({error, Reason}) -> {error, flat(lists:join("; ", starl_reload:format_error(Reason)))}.

flat(Text) -> lists:flatten(unicode:characters_to_list(Text)).

loaded() ->
    maps:from_list([{M, M:module_info(md5)} || {M, File} <- code:all_loaded(), is_list(File)]).

%% @doc The files of a release whose code differs from the loaded code.
-spec changed(Release :: file:filename(), #{module() => Md5 :: binary()}) -> [file:filename()].
changed(Release, Loaded) -> [File || File <- beams(Release), is_changed(File, Loaded)].

beams(Release) -> filelib:wildcard(filename:join([Release, "lib", "*", "ebin", "*.beam"])).

is_changed(File, Loaded) ->
    {ok, {Module, Md5}} = beam_lib:md5(File),
    case Loaded of
        #{Module := Same} -> Same =/= Md5;
        #{} -> of_application(File)
    end.

%% StarL's services talk to those of the other robots: they change by a new start of all.
own(Files) ->
    case [File || File <- Files, not of_application(File)] of
        [] ->
            {ok, Files};
        [File | _] ->
            Line = "more than the application has changed (~ts); say: ./starl deploy fleet.term",
            {error, lists:flatten(io_lib:format(Line, [filename:basename(File, ".beam")]))}
    end.

%% An application for robots stands on the platform, as only it and StarL's own layers do.
of_application(File) ->
    Ebin = filename:dirname(File),
    Name = hd(string:split(filename:basename(filename:dirname(Ebin)), "-")),
    case file:consult(filename:join(Ebin, Name ++ ".app")) of
        {ok, [{application, _, Keys}]} ->
            lists:member(starl_platform, proplists:get_value(applications, Keys, [])) andalso
                not lists:member(Name, ?LAYERS);
        {error, _} ->
            false
    end.

own_code(Release) ->
    [{module(File), File, beam(File)} || File <- beams(Release), of_application(File)].

module(File) -> list_to_atom(filename:basename(File, ".beam")).

beam(File) ->
    {ok, Beam} = file:read_file(File),
    Beam.

%% @doc The modules that get new versions: those that have changed since the node started, those
%% that it already runs in versions, and those that call one of these. A version is called by
%% versions only.
-spec sources(Changed :: [module()], Known :: [module()], Own :: [starl_version:code()]) ->
    [starl_version:code()].
sources(Changed, Known, Own) ->
    Calls = [{Module, called(Beam)} || {Module, _, Beam} <- Own],
    Wanted = with_callers(lists:usort(Changed ++ Known), Calls),
    [Code || {Module, _, _} = Code <- Own, lists:member(Module, Wanted)].

called(Beam) ->
    {ok, {_, [{imports, Imports}]}} = beam_lib:chunks(Beam, [imports]),
    lists:usort([Module || {Module, _, _} <- Imports]).

with_callers(Wanted, Calls) ->
    More = [
        Module
     || {Module, Called} <- Calls,
        not lists:member(Module, Wanted),
        Called -- Wanted =/= Called
    ],
    case More of
        [] -> Wanted;
        _ -> with_callers(Wanted ++ More, Calls)
    end.
