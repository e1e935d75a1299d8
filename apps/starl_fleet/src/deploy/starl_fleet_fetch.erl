%% @doc Copies the recordings of a fleet's robots to this computer. Whatever a robot sends is data:
%% the names and sizes of its recordings, and their bytes.
%%
%% - A name is a plain file name that ends in `.mcap'. It never leads elsewhere; other names are
%% skipped and reported.
%% - No archive is unpacked, and no link or directory can come.
%% - A file is as long as its robot has announced, and all of them together are at most
%% 64 GiB.
%% - Files arrive in a new directory that only the user may read (0700). They are moved from there
%% when they are complete.
%%
%% A running robot continues to write. Its last file is copied up to its length when the robot was
%% asked.
-module(starl_fleet_fetch).

-include_lib("kernel/include/file.hrl").

-export([fetch/2, listing/1]).

-export_type([listing/0, fetched/0]).

%% The recordings that a robot says it has, with their sizes, and the names that are passed over.
-type listing() :: #{files := [{Name :: string(), Bytes :: non_neg_integer()}], odd := [string()]}.

%% The files of a robot, and what else is to be said of it.
-type fetched() ::
    {ok, [file:filename()], Notes :: [unicode:chardata()]} | {error, unicode:chardata()}.

-define(ASK_MS, 60_000).
-define(COPY_MS, 1_800_000).
-define(NAME, "^[A-Za-z0-9][A-Za-z0-9._-]{0,199}[.]mcap$").
%% The most bytes and recordings that are taken from one robot.
-define(MOST_BYTES, (64 bsl 30)).
-define(MOST_FILES, 10000).

%% @doc Copies what the robots have recorded into directories `robot-N' of their own below this one.
-spec fetch(file:filename(), starl_fleet_file:t()) -> [{starl:robot_id(), fetched()}].
fetch(Dir, #{robots := Robots} = Fleet) ->
    Asked = starl_fleet_shell:run(starl_fleet_steps:recorded(Fleet), ?ASK_MS),
    Places = [{N, place(N, Dir, said(N, Robots, Result))} || {N, Result} <- Asked],
    Steps = [
        {N, starl_fleet_steps:copied(N, Fleet, Scratch, Files)}
     || {N, {ok, #{scratch := Scratch, files := [_ | _] = Files}}} <- Places
    ],
    Copied = maps:from_list(starl_fleet_shell:run(Steps, ?COPY_MS)),
    [{N, ended(N, Place, Copied, Robots)} || {N, Place} <- Places].

said(_N, _Robots, {0, Said}) -> listing(Said);
said(N, Robots, Result) -> {error, starl_fleet_failure:line(robot, N, maps:get(N, Robots), Result)}.

%% @doc What the robot says of its recordings: lines of a size and a name.
-spec listing(string()) -> {ok, listing()} | {error, unicode:chardata()}.
listing(Said) ->
    Lines = [string:trim(Line) || Line <- string:lexemes(Said, [$\n, "\r\n"])],
    {Files, Odd} = lists:partition(fun is_tuple/1, [entry(Line) || Line <- Lines]),
    Bytes = lists:sum([Size || {_, Size} <- Files]),
    if
        length(Files) > ?MOST_FILES ->
            {error, io_lib:format("it names more than ~b recordings", [?MOST_FILES])};
        Bytes > ?MOST_BYTES ->
            Format =
                "its recordings are ~.1f GB, more than the ~b GB that are taken; copy them by hand",
            {error, io_lib:format(Format, [Bytes / 1.0e9, ?MOST_BYTES div (1 bsl 30)])};
        true ->
            {ok, #{
                files => oldest_first(lists:ukeysort(1, Files)),
                odd => [Name || Name <- Odd, Name =/= ""]
            }}
    end.

%% robot-1.mcap, robot-1.2.mcap, ..., robot-1.10.mcap: so the times of the copies have the order of the recordings.
oldest_first(Files) ->
    lists:sort(fun({A, _}, {B, _}) -> {length(A), A} =< {length(B), B} end, Files).

%% The last line of wc is the total of several files.
entry(Line) ->
    {Digits, Rest} = lists:splitwith(fun(C) -> C >= $0 andalso C =< $9 end, Line),
    Name = string:trim(Rest),
    IsName =
        length(Digits) < 16 andalso
            re:run(Name, ?NAME, [{capture, none}, dollar_endonly]) =:= match,
    case Digits =/= "" andalso IsName of
        true -> {Name, list_to_integer(Digits)};
        false when Name =:= "total" -> "";
        false -> Name
    end.

%% A new directory beside that of the robot's recordings, so that files can be moved.
place(_N, _Dir, {error, _} = Error) ->
    Error;
place(N, Dir, {ok, Listing}) ->
    Own = filename:join(Dir, starl_fleet_steps:recordings(N)),
    Random = string:lowercase(binary_to_list(binary:encode_hex(crypto:strong_rand_bytes(8)))),
    Scratch = filename:join(Dir, "." ++ starl_fleet_steps:recordings(N) ++ "." ++ Random),
    case {own(Own), new(Scratch)} of
        {ok, ok} -> {ok, Listing#{own => Own, scratch => Scratch}};
        {{error, Why}, _} -> {error, [Own, ": ", Why]};
        {ok, {error, Why}} -> {error, [Scratch, ": ", file:format_error(Why)]}
    end.

%% A link in its place would lead elsewhere.
own(Dir) ->
    case file:read_link_info(Dir) of
        {ok, #file_info{type = directory}} -> ok;
        {ok, _} -> {error, "not a directory; remove it first"};
        {error, enoent} -> made(file:make_dir(Dir));
        {error, Why} -> {error, file:format_error(Why)}
    end.

made(ok) -> ok;
made({error, Why}) -> {error, file:format_error(Why)}.

new(Scratch) ->
    case file:make_dir(Scratch) of
        ok -> file:change_mode(Scratch, 8#700);
        {error, _} = Error -> Error
    end.

ended(_N, {error, _} = Error, _Copied, _Robots) ->
    Error;
ended(_N, {ok, #{files := [], scratch := Scratch, odd := Odd}}, _Copied, _Robots) ->
    ok = file:del_dir(Scratch),
    {ok, [], notes(Odd)};
ended(N, {ok, #{scratch := Scratch, own := Own, files := Files, odd := Odd}}, Copied, Robots) ->
    Short = [Name || {Name, Bytes} <- Files, length_of(filename:join(Scratch, Name)) =/= Bytes],
    Moved = [moved(Name, Scratch, Own) || {Name, _} <- Files, not lists:member(Name, Short)],
    lists:foreach(fun(Name) -> file:delete(filename:join(Scratch, Name)) end, Short),
    _ = file:del_dir(Scratch),
    case {Short, [Why || {error, Why} <- Moved], maps:get(N, Copied)} of
        {[], [], _} -> {ok, [File || {ok, File} <- Moved], notes(Odd)};
        {[], [Why | _], _} -> {error, Why};
        {[Name | _], _, Result} -> {error, cut(N, Name, Result, maps:get(N, Robots))}
    end.

length_of(File) ->
    case file:read_link_info(File) of
        {ok, #file_info{type = regular, size = Bytes}} -> Bytes;
        {ok, _} -> none;
        {error, _} -> none
    end.

moved(Name, Scratch, Own) ->
    To = filename:join(Own, Name),
    case file:rename(filename:join(Scratch, Name), To) of
        ok -> {ok, To};
        {error, Why} -> {error, [To, ": ", file:format_error(Why)]}
    end.

cut(N, Name, {0, _Said}, Robot) ->
    Why = Name ++ " came shorter than its robot had said",
    starl_fleet_failure:line(robot, N, Robot, {1, Why});
cut(N, _Name, Result, Robot) ->
    starl_fleet_failure:line(robot, N, Robot, Result).

notes([]) ->
    [];
notes(Odd) ->
    [
        io_lib:format("~b file~ts passed over, whose names are not those of recordings", [
            length(Odd), [$s || length(Odd) > 1]
        ])
    ].
