%% @doc Changes the code of a running robot to that of another release: only modules of the
%% application and what it brought along, never those of StarL. The application uses the new code
%% from its next step on.
-module(starl_fleet_reload).

-export([answer/1, changed/2]).

-define(LAYERS, ["starl_blocks", "starl_run", "starl_live", "starl_fleet"]).
-define(TRIES, 50).
-define(PAUSE_MS, 100).

%% @doc Answers `bin/robot': `check RELEASE' looks whether its code can be loaded, `switch RELEASE' loads it.
-spec answer([string()]) -> ok | {error, string()}.
answer(["check", Release]) ->
    case own(changed(Release, modules())) of
        {ok, Files} -> first_error([check(File) || File <- Files]);
        {error, _} = Error -> Error
    end;
answer(["switch", Release]) ->
    case own(changed(Release, modules())) of
        {ok, Files} ->
            Loaded = first_error([load(File, ?TRIES) || File <- Files]),
            ok = loaded(Loaded, Release),
            Loaded;
        {error, _} = Error ->
            Error
    end.

loaded(ok, Release) -> starl_fleet_node:runs(Release);
loaded({error, _}, _Release) -> ok.

modules() ->
    maps:from_list([{M, M:module_info(md5)} || {M, File} <- code:all_loaded(), is_list(File)]).

%% @doc The files of a release whose code is another than that which is loaded.
-spec changed(Release :: file:filename(), #{module() => Md5 :: binary()}) -> [file:filename()].
changed(Release, Loaded) ->
    [
        File
     || File <- filelib:wildcard(filename:join([Release, "lib", "*", "ebin", "*.beam"])),
        is_changed(File, Loaded)
    ].

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

check(File) -> said(starl_code:check(module(File), File, beam(File))).

%% Code of the version before last may still be in the middle of a step.
load(File, Tries) ->
    case starl_code:load(module(File), File, beam(File)) of
        waits when Tries > 0 ->
            receive
            after ?PAUSE_MS -> load(File, Tries - 1)
            end;
        waits ->
            {error, "a step of the application is still in the code before the last; try later"};
        Answer ->
            said(Answer)
    end.

module(File) -> list_to_atom(filename:basename(File, ".beam")).

beam(File) ->
    {ok, Beam} = file:read_file(File),
    Beam.

said(ok) -> ok;
said({error, Reason}) -> {error, lists:flatten(starl_code:format_error(Reason))}.

first_error(Answers) ->
    case [Error || {error, _} = Error <- Answers] of
        [] -> ok;
        [Error | _] -> Error
    end.
