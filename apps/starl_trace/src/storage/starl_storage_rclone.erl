%% @doc Accesses the files of a storage through the program rclone. Each call runs the program once.
%%
%% rclone cannot resume a file, and a file that was cut off would stand under its final name. So a
%% file is sent under another name, and renamed when it is whole.
-module(starl_storage_rclone).

-export([find/0, list/2, put/3, get/3, format_error/1]).

-export_type([path/0, reason/0]).

%% A place as rclone names it: `lab:runs', or a directory.
-type path() :: string().

%% `lost': not reached this time, another try may do; `refused': no try will.
-type reason() :: no_rclone | {refused | lost, path(), Line :: unicode:chardata()}.

-define(FLAGS, [
    "--retries",
    "1",
    "--low-level-retries",
    "1",
    "--contimeout",
    "5s",
    "--timeout",
    "20s",
    "--transfers",
    "1",
    "--log-level",
    "ERROR",
    "--ask-password=false"
]).
-define(NOT_FOUND, 3).
%% What no further try mends.
-define(REFUSED,
    "didn't find section|401 |403 |[Uu]nauthori|[Pp]ermission denied|unknown|not supported|"
    "doesn't exist|invalid"
).

%% @doc The program.
-spec find() -> {ok, file:filename()} | {error, no_rclone}.
find() ->
    case os:find_executable("rclone") of
        false -> {error, no_rclone};
        Program -> {ok, Program}
    end.

%% @doc The files below a directory, with their sizes; none if it is not there.
-spec list(path(), Dir :: string()) ->
    {ok, [{string(), non_neg_integer()}]} | {error, reason()}.
list(Remote, Dir) ->
    case rclone(Remote, ["lsf", "-R", "--files-only", "--format", "sp", at(Remote, Dir)]) of
        {ok, Text} -> {ok, lists:append([sized(Line) || Line <- string:lexemes(Text, "\n")])};
        {?NOT_FOUND, _} -> {ok, []};
        {error, _} = Error -> Error
    end.

%% Between them may stand what rclone wants to say.
sized(Line) ->
    case re:run(Line, "^([0-9]+);(.+)$", [{capture, [1, 2], list}, unicode]) of
        {match, [Size, Name]} -> [{Name, list_to_integer(Size)}];
        nomatch -> []
    end.

%% @doc Sends a file. It has its name only when it is whole.
-spec put(file:filename(), path(), Name :: string()) -> ok | {error, reason()}.
put(File, Remote, Name) ->
    Part = at(Remote, Name ++ ".part"),
    case rclone(Remote, ["copyto", "--ignore-times", File, Part]) of
        {ok, _} -> done(rclone(Remote, ["moveto", Part, at(Remote, Name)]), Remote);
        Other -> done(Other, Remote)
    end.

%% @doc Fetches a file.
-spec get(path(), Name :: string(), file:filename()) -> ok | {error, reason()}.
get(Remote, Name, File) ->
    done(rclone(Remote, ["copyto", "--ignore-times", at(Remote, Name), File]), Remote).

done({ok, _}, _Remote) -> ok;
done({error, _} = Error, _Remote) -> Error;
done({?NOT_FOUND, Line}, Remote) -> {error, {lost, Remote, Line}}.

at(Remote, Name) ->
    case lists:last(Remote) of
        C when C =:= $:; C =:= $/ -> Remote ++ Name;
        _ -> Remote ++ "/" ++ Name
    end.

%% -- the program ------------------------------------------------------------------------------

rclone(Remote, Args) ->
    case find() of
        {ok, Program} -> ended(run(Program, Args ++ ?FLAGS), Remote);
        {error, _} = Error -> Error
    end.

ended({0, Text}, _Remote) ->
    {ok, Text};
ended({?NOT_FOUND, Text}, _Remote) ->
    {?NOT_FOUND, said(Text)};
ended({_Status, Text}, Remote) ->
    How =
        case re:run(Text, ?REFUSED) of
            {match, _} -> refused;
            nomatch -> lost
        end,
    {error, {How, Remote, said(Text)}}.

%% It gives way to what else the computer does.
run(Program, Args) ->
    {Path, All} =
        case os:find_executable("nice") of
            false -> {Program, Args};
            Nice -> {Nice, [Program | Args]}
        end,
    Port = open_port({spawn_executable, Path}, [
        {args, All}, exit_status, stderr_to_stdout, binary, hide
    ]),
    output(Port, <<>>).

output(Port, Text) ->
    receive
        {Port, {data, More}} -> output(Port, <<Text/binary, More/binary>>);
        {Port, {exit_status, Status}} -> {Status, unicode:characters_to_list(Text)}
    end.

%% Its last line, without the time.
said(Text) ->
    case string:lexemes(Text, "\n") of
        [] ->
            "rclone says nothing of it";
        Lines ->
            Line = re:replace(lists:last(Lines), "^[0-9/]+ [0-9:]+ [A-Z]+ *: *", "", [
                {return, list}, unicode
            ]),
            string:trim(Line)
    end.

%% @doc One line on a problem.
-spec format_error(reason()) -> unicode:chardata().
format_error(no_rclone) ->
    "the program rclone is needed; apt install rclone, or see rclone.org";
format_error({refused, Remote, Line}) ->
    [Remote, ": ", Line, " (rclone listremotes lists what it knows, rclone config adds one)"];
format_error({lost, Remote, Line}) ->
    [Remote, ": not reached: ", Line, "; start again later, what is there stays"].
