%% @doc An application of the user's own: compiled in memory, with one line for each error.
-module(starl_cli_source).

-export([load/1]).

%% @doc Compiles and loads a source file.
-spec load(file:filename()) ->
    {ok, starl_cli_target:t()} | {error, [unicode:chardata(), ...]}.
load(File) ->
    case filelib:is_regular(File) of
        true -> compiled(File, compile:file(File, [binary, return, debug_info]));
        false -> {error, [[File, ": there is no such file"]]}
    end.

compiled(File, {ok, Module, Code, Warnings}) ->
    _ = [starl_cli_terminal:warn(["warning: ", Line]) || Line <- lines(Warnings)],
    case code:which(Module) of
        non_existing ->
            {module, Module} = code:load_binary(Module, File, Code),
            check(File, Module, Code);
        _ ->
            {error, [
                io_lib:format("~ts: there is a module ~ts already; give yours another name", [
                    File, Module
                ])
            ]}
    end;
compiled(_File, {error, Errors, _Warnings}) ->
    {error, lines(Errors)}.

check(File, Module, Code) ->
    Runs = lists:any(fun({F, A}) -> erlang:function_exported(Module, F, A) end, [
        {step, 2}, {scene, 1}
    ]),
    case Runs of
        true ->
            {ok, #{
                app => Module, name => atom_to_list(Module), replay => File, file => File,
                given => #{}, code => {Module, File, Code}
            }};
        false ->
            {error, [[File, ": this is no application: it exports neither step/2 nor scene/1"]]}
    end.

lines(Found) -> [line(File, Info) || {File, Infos} <- Found, Info <- Infos].

line(File, {none, Module, What}) ->
    [File, ": ", Module:format_error(What)];
line(File, {{Line, _Column}, Module, What}) ->
    line(File, {Line, Module, What});
line(File, {Line, Module, What}) ->
    io_lib:format("~ts:~b: ~ts", [File, Line, Module:format_error(What)]).
