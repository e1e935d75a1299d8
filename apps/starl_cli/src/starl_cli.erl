%% @doc The entry point of the command line: finds the command, gives its exit status, and reports
%% internal errors.
-module(starl_cli).

-export([main/1, command/1, brief/1]).

%% The longest line on an internal error, but for its file.
-define(BRIEF, 150).

%% @doc Runs a command and ends the VM with its exit status.
-spec main([string()]) -> no_return().
main(Args) ->
    ok = starl_cli_signal:install(),
    _ = io:setopts(standard_io, [{encoding, unicode}]),
    _ = io:setopts(standard_error, [{encoding, unicode}]),
    erlang:halt(delivered(guarded(Args)), [{flush, true}]).

%% What was printed into a full disk is lost, and that is no success; a closed pipe (`| head') is what
%% its reader wanted.
delivered(Status) ->
    case starl_cli_terminal:lost() of
        none ->
            Status;
        epipe ->
            Status;
        Posix ->
            starl_cli_terminal:complain(["the output is lost: ", file:format_error(Posix)]),
            max(Status, 1)
    end.

guarded(Args) ->
    try
        command(Args)
    catch
        throw:{unwritable, File, Posix} ->
            starl_cli_progress:erase(),
            starl_cli_terminal:complain([File, ": ", file:format_error(Posix)]),
            1;
        Class:Reason:Stack ->
            internal_error(erl_error(Class, Reason, Stack))
    end.

erl_error(Class, Reason, Stack) ->
    io_lib:format("~ts~n~tp~n", [erl_error:format_exception(Class, Reason, Stack), Reason]).

internal_error(Text) ->
    Log = [starl_cli_log:lines(), Text],
    Where =
        case kept(unicode:characters_to_binary(Log)) of
            {ok, File} -> ["; see ", File];
            {error, _} -> ""
        end,
    starl_cli_progress:erase(),
    starl_cli_terminal:complain(["internal error: ", brief(Text), Where]),
    1.

%% @doc The text of an exception in one line: what went wrong, and in which function. A long line is
%% cut off.
-spec brief(unicode:chardata()) -> string().
brief(Text) ->
    Lines = string:split(unicode:characters_to_list(Text), "\n", all),
    Words = lists:append([string:lexemes(Line, " ") || Line <- lists:sublist(Lines, 2)]),
    case lists:append(lists:join(" ", Words)) of
        Line when length(Line) =< ?BRIEF -> Line;
        Line -> lists:sublist(Line, ?BRIEF) ++ " ..."
    end.

%% In a directory of its own, which stays.
kept(Log) ->
    case starl_private_dir:new("error") of
        {ok, Dir} ->
            File = filename:join(Dir, "starl.log"),
            case file:write_file(File, Log) of
                ok -> {ok, File};
                {error, _} = Error -> Error
            end;
        {error, _} = Error ->
            Error
    end.

%% @doc Runs a command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command([]) ->
    command(["help"]);
command([Help | _]) when Help =:= "--help"; Help =:= "-h" -> command(["help"]);
command([Version | _]) when Version =:= "--version"; Version =:= "-V"; Version =:= "version" ->
    show(["starl ", version(), ", code ", starl_build:code([]), "\n"]);
command([Name | Args]) ->
    found(starl_cli_command:find(Name), Name, Args).

found({ok, Command}, _Name, Args) ->
    starl_cli_dispatch:run(Command, Args);
found({error, Near}, Name, _Args) ->
    Meant = starl_similar:meant(Near, "; ./starl help lists all"),
    starl_cli_terminal:bad_input([["unknown command ", Name, Meant]]).

show(Text) ->
    starl_cli_terminal:out(Text),
    0.

version() ->
    case os:getenv("STARL_VERSION") of
        Set when is_list(Set), Set =/= "" -> Set;
        _ -> loaded_version(application:load(starl_cli))
    end.

loaded_version(_) ->
    {ok, Vsn} = application:get_key(starl_cli, vsn),
    Vsn.
