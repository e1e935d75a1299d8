%% @doc Recordings in a storage, where the robots of many runs leave them.
%% ```
%%   pieces/9f86d081...              a piece of a file, by its hash (SHA-256)
%%   runs/painting-1f2e3d4c/robot-3.mcap-9f86d081   what a file of that run consists of
%% '''
%% The list of pieces is sent last, so what is listed is there. A piece that is already there is not
%% sent again. After an interruption only the rest is sent, and of a file that has grown only the
%% new part.
-module(starl_storage).

-export([upload/3, ahead/4, list/1, download/4, format_error/1]).

-export_type([options/0, entry/0, reason/0]).

%% `piece_bytes'; `tries': after so many failures one after the other it ends; `pause_ms': after the
%% first of them, then twice as long each time; `sent': told of each
%% try to send a piece.
-type options() :: #{
    piece_bytes => pos_integer(),
    tries => pos_integer(),
    pause_ms => non_neg_integer(),
    sent => fun((Bytes :: non_neg_integer()) -> term())
}.

%% A file of a run, and the place of its list.
-type entry() :: #{run := string(), name := string(), list := string()}.

-type reason() ::
    starl_storage_rclone:reason()
    | starl_trace_reader:reason()
    | {file, file:filename(), file:posix()}
    | {no_scenario, file:filename()}
    | {damaged, string()}.

%% A file is read in parts of this size.
-define(PART, 1048576).
%% A piece is read at once.
-define(MOST_PIECE, 67108864).
%% More than the list of a recording of a terabyte.
-define(MOST_LIST, 16777216).
-define(PIECE_BYTES, 1048576).
-define(TRIES, 5).
-define(PAUSE_MS, 200).
-define(SAME, [app, kind, scenario, epoch_us, run]).
-define(HEAD, "starl recording 1").

%% @doc Sends a recording; the number of pieces, and of those that were sent now.
-spec upload(file:filename(), starl_storage_rclone:path(), options()) ->
    {ok, #{run := string(), pieces := pos_integer(), sent := non_neg_integer()}}
    | {error, reason()}.
upload(File, Remote, Options) ->
    stepwise(fun() ->
        Run = must(execution(File)),
        There = maps:from_list(
            must(tried(fun() -> starl_storage_rclone:list(Remote, "pieces") end, Options))
        ),
        in_temporary(fun(Temporary) ->
            {Pieces, Hash, Sent} = pieces(File, Remote, There, Temporary, Options),
            List = listed(File, Hash, Pieces),
            ok = must(file_written(Temporary, List)),
            Name = lists:concat(["runs/", Run, "/", filename:basename(File), "-", short(Hash)]),
            ok = must(
                tried(fun() -> starl_storage_rclone:put(Temporary, Remote, Name) end, Options)
            ),
            {ok, #{run => Run, pieces => length(Pieces), sent => Sent}}
        end)
    end).

%% @doc Sends one piece of a file that is still being written, if there is a whole one more: the number of
%% pieces that are there then. {@link upload/3} sends the rest.
-spec ahead(file:filename(), Pieces :: non_neg_integer(), starl_storage_rclone:path(), options()) ->
    {ok, Pieces :: non_neg_integer()} | {error, reason()}.
ahead(File, Before, Remote, Options) ->
    Bytes = maps:get(piece_bytes, Options, ?PIECE_BYTES),
    stepwise(fun() ->
        case must(named_error(read_at(File, Before * Bytes, Bytes), File)) of
            Piece when byte_size(Piece) =:= Bytes ->
                Name = "pieces/" ++ hash(Piece),
                in_temporary(fun(Temporary) ->
                    1 = sent(Piece, Name, Remote, Temporary, Options),
                    {ok, Before + 1}
                end);
            _ ->
                {ok, Before}
        end
    end).

read_at(File, At, Bytes) ->
    case file:open(File, [read, raw, binary]) of
        {ok, Device} ->
            Read = file:pread(Device, At, Bytes),
            ok = file:close(Device),
            case Read of
                eof -> {ok, <<>>};
                Other -> Other
            end;
        {error, _} = Error ->
            Error
    end.

%% The run that a recording is of, as a name: the same for all robots of it.
-spec execution(file:filename()) -> {ok, string()} | {error, reason()}.
execution(File) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} ->
            Next = starl_trace_reader:next(Cursor),
            ok = starl_trace_reader:stop(Cursor),
            named(Next, File);
        {error, _} = Error ->
            Error
    end.

named({ok, [{scenario, _, #{app := App} = Facts} | _], _}, _File) ->
    Same = term_to_binary(lists:sort(maps:to_list(maps:with(?SAME, Facts))), [deterministic]),
    {ok, lists:concat([App, "-", short(hash(Same))])};
named({error, _} = Error, _File) ->
    Error;
named(_Other, File) ->
    {error, {no_scenario, File}}.

pieces(File, Remote, There, Temporary, Options) ->
    Bytes = maps:get(piece_bytes, Options, ?PIECE_BYTES),
    Device = must(named_error(file:open(File, [read, raw, binary]), File)),
    try
        pieces(Device, Bytes, {Remote, There, Temporary, Options}, [], crypto:hash_init(sha256), 0)
    after
        file:close(Device)
    end.

pieces(Device, Bytes, {Remote, There, Temporary, Options} = To, Before, Whole, Sent) ->
    case file:read(Device, Bytes) of
        {ok, Piece} ->
            Hash = hash(Piece),
            Size = byte_size(Piece),
            Now =
                case There of
                    #{Hash := Size} -> 0;
                    #{} -> sent(Piece, "pieces/" ++ Hash, Remote, Temporary, Options)
                end,
            Next = crypto:hash_update(Whole, Piece),
            pieces(
                Device,
                Bytes,
                setelement(2, To, There#{Hash => Size}),
                [{Hash, Size} | Before],
                Next,
                Sent + Now
            );
        eof ->
            {lists:reverse(Before), hex(crypto:hash_final(Whole)), Sent}
    end.

sent(Piece, Name, Remote, Temporary, Options) ->
    ok = must(file_written(Temporary, Piece)),
    Told = maps:get(sent, Options, fun(_) -> ok end),
    Send = fun() ->
        _ = Told(byte_size(Piece)),
        starl_storage_rclone:put(Temporary, Remote, Name)
    end,
    ok = must(tried(Send, Options)),
    1.

%% -- back -------------------------------------------------------------------------------------

%% @doc What a storage has, by run.
-spec list(starl_storage_rclone:path()) -> {ok, [entry()]} | {error, reason()}.
list(Remote) ->
    case tried(fun() -> starl_storage_rclone:list(Remote, "runs") end, #{}) of
        {ok, Files} ->
            {ok, [E || {Path, _} <- lists:sort(Files), E <- entry(string:split(Path, "/"))]};
        {error, _} = Error ->
            Error
    end.

%% What somebody else has put there, or what is being sent, is none. A run becomes the name of a directory.
entry([[$. | _], _File]) ->
    [];
entry([Run, File]) ->
    case
        re:run(Run ++ "/" ++ File, "^[\\w.@-]+/([\\w@-][\\w.@ -]*)-[0-9a-f]{16}$", [
            {capture, [1], list}, unicode, dollar_endonly
        ])
    of
        {match, [Name]} -> [#{run => Run, name => Name, list => "runs/" ++ Run ++ "/" ++ File}];
        nomatch -> []
    end;
entry(_Other) ->
    [].

%% @doc Fetches a file, checks it, and puts it under that name. What an earlier try has fetched is
%% not fetched again.
-spec download(entry(), starl_storage_rclone:path(), file:filename(), options()) ->
    {ok, fetched | is_there} | {error, reason()}.
download(#{list := List}, Remote, File, Options) ->
    stepwise(fun() ->
        ok = must(named_error(filelib:ensure_dir(File), File)),
        in_temporary(fun(Temporary) ->
            ok = must(
                tried(fun() -> starl_storage_rclone:get(Remote, List, Temporary) end, Options)
            ),
            {Hash, Pieces} = must(read_list(small_file(Temporary), List)),
            case hash_of(File) of
                {ok, Hash} -> {ok, is_there};
                {ok, _Other} -> {error, {file, File, eexist}};
                {error, _} -> joined(Pieces, Hash, Remote, File, Options)
            end
        end)
    end).

%% A list that is longer than any of a recording is not read, and damaged.
small_file(File) ->
    case filelib:file_size(File) =< ?MOST_LIST of
        true -> file:read_file(File);
        false -> {ok, <<>>}
    end.

joined(Pieces, Hash, Remote, File, Options) ->
    Dir = File ++ ".pieces",
    ok = must(named_error(filelib:ensure_path(Dir), Dir)),
    Part = filename:join(Dir, "whole"),
    _ = file:delete(Part),
    Device = must(named_error(file:open(Part, [write, exclusive, raw, binary]), Part)),
    Whole =
        try
            appended(Pieces, Device, {Part, Dir, Remote, Options}, crypto:hash_init(sha256))
        after
            file:close(Device)
        end,
    case Whole of
        Hash ->
            ok = must(named_error(file:rename(Part, File), File)),
            _ = file:del_dir_r(Dir),
            {ok, fetched};
        _ ->
            {error, {damaged, File}}
    end.

%% One piece after the other: a recording may be larger than the memory.
appended([], _Device, _Where, Whole) ->
    hex(crypto:hash_final(Whole));
appended([Piece | Pieces], Device, {Part, Dir, Remote, Options} = Where, Whole) ->
    Bytes = fetched(Piece, Dir, Remote, Options),
    ok = must(named_error(file:write(Device, Bytes), Part)),
    appended(Pieces, Device, Where, crypto:hash_update(Whole, Bytes)).

fetched({Hash, Size}, Dir, Remote, Options) ->
    File = filename:join(Dir, Hash),
    case file:read_file(File) of
        {ok, Bytes} when byte_size(Bytes) =:= Size ->
            case hash(Bytes) of
                Hash -> Bytes;
                _ -> fetch({Hash, Size}, File, Remote, Options)
            end;
        _ ->
            fetch({Hash, Size}, File, Remote, Options)
    end.

%% A piece that is larger than the list says is not read.
fetch({Hash, Size}, File, Remote, Options) ->
    Name = "pieces/" ++ Hash,
    ok = must(tried(fun() -> starl_storage_rclone:get(Remote, Name, File) end, Options)),
    Bytes = [must(named_error(file:read_file(File), File)) || filelib:file_size(File) =:= Size],
    case hash(Bytes) of
        Hash ->
            hd(Bytes);
        _ ->
            _ = file:delete(File),
            throw({?MODULE, {error, {damaged, Name}}})
    end.

%% -- the list ---------------------------------------------------------------------------------

listed(File, Hash, Pieces) ->
    [
        [?HEAD, "\nfile ", filename:basename(File), "\nhash ", Hash, "\n"],
        [["piece ", H, " ", integer_to_list(Size), "\n"] || {H, Size} <- Pieces]
    ].

read_list({ok, Text}, List) ->
    case string:lexemes(unicode:characters_to_list(Text), "\n") of
        [?HEAD, "file " ++ _, "hash " ++ Hash | Lines] ->
            Read = [
                re:run(L, "^piece ([0-9a-f]{64}) ([0-9]{1,12})$", [
                    {capture, [1, 2], list}, dollar_endonly
                ])
             || L <- Lines
            ],
            Pieces = [{H, list_to_integer(Size)} || {match, [H, Size]} <- Read],
            case length(Pieces) =:= length(Read) andalso lists:all(fun is_piece/1, Pieces) of
                true -> {ok, {Hash, Pieces}};
                false -> {error, {damaged, List}}
            end;
        _ ->
            {error, {damaged, List}}
    end;
read_list({error, _}, List) ->
    {error, {damaged, List}}.

is_piece({_Hash, Size}) -> Size =< ?MOST_PIECE.

%% -- steps ------------------------------------------------------------------------------------

-spec stepwise(fun(() -> Result)) -> Result | {error, reason()}.
stepwise(Steps) ->
    try
        Steps()
    catch
        throw:{?MODULE, {error, _} = Error} -> Error
    end.

must(ok) -> ok;
must({ok, Value}) -> Value;
must({error, _} = Error) -> throw({?MODULE, Error}).

named_error({error, Posix}, File) when is_atom(Posix) -> {error, {file, File, Posix}};
named_error(Done, _File) -> Done.

file_written(File, Bytes) -> named_error(file:write_file(File, Bytes), File).

tried(Step, Options) ->
    tried(Step, maps:get(tries, Options, ?TRIES), maps:get(pause_ms, Options, ?PAUSE_MS)).

tried(Step, Left, Pause) ->
    case Step() of
        {error, {lost, _, _}} when Left > 1 ->
            timer:sleep(Pause),
            tried(Step, Left - 1, 2 * Pause);
        Answer ->
            Answer
    end.

%% The hash of a file, which is read in parts.
hash_of(File) ->
    case file:open(File, [read, raw, binary]) of
        {ok, Device} ->
            try
                hash_on(Device, crypto:hash_init(sha256))
            after
                file:close(Device)
            end;
        {error, _} = Error ->
            Error
    end.

hash_on(Device, Whole) ->
    case file:read(Device, ?PART) of
        {ok, Bytes} -> hash_on(Device, crypto:hash_update(Whole, Bytes));
        eof -> {ok, hex(crypto:hash_final(Whole))};
        {error, _} = Error -> Error
    end.

-spec in_temporary(fun((file:filename()) -> Result)) -> Result | {error, reason()}.
in_temporary(Use) ->
    starl_private_dir:with("piece", fun(Dir) -> Use(filename:join(Dir, "piece")) end).

hash(Bytes) -> hex(crypto:hash(sha256, Bytes)).

hex(Bytes) -> string:lowercase(binary_to_list(binary:encode_hex(Bytes))).

short(Hash) -> lists:sublist(Hash, 16).

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({file, File, eexist}) ->
    [File, ": is there already, and is another file"];
format_error({file, File, Posix}) ->
    [File, ": ", file:format_error(Posix)];
format_error({no_scenario, File}) ->
    [File, ": the recording does not begin with its scenario"];
format_error({damaged, Name}) ->
    [Name, ": is damaged in the storage; upload the recording again"];
format_error(Reason) when
    Reason =:= no_rclone; element(1, Reason) =:= lost; element(1, Reason) =:= refused
->
    starl_storage_rclone:format_error(Reason);
format_error(Reason) ->
    starl_trace_reader:format_error(Reason).
