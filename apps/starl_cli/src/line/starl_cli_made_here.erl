%% @doc Checks whether this user put the code there that lies in the results of a run.
%%
%% Results come from anywhere: from a colleague, a mailing list, a storage. Compiling and loading a
%% module executes what its author likes. So the sources that a run keeps get a list of their hashes
%% with a code (HMAC) by a key of the user's own. Commands that only read results load what such a
%% list covers, and nothing else, unless the user says `--trust'. The key lies in the user's
%% configuration, `~/.config/starl/key', and never leaves it.
-module(starl_cli_made_here).

-include_lib("kernel/include/file.hrl").

-export([stamp/1, own/2, forget/0, mark/1, is_marked/2, is_trusted/0, trusting/1]).

-define(NAME, "made_here").
-define(HEAD, "starl inputs 1").
-define(KEY_BYTES, 32).
-define(TRUST, "STARL_TRUST").
-define(PURPOSE, "code").
%% The longest list, and the longest file of one.
-define(LIST_BYTES, (1 bsl 22)).
-define(FILE_BYTES, (1 bsl 30)).
-define(CHUNK, (1 bsl 20)).

%% @doc The list for these files, to be kept beside them. Their names begin with the directory that they share.
-spec stamp([{Name :: file:filename(), binary()}]) -> [{Name :: file:filename(), binary()}].
stamp(Files) ->
    case [Name || {Name, _} <- Files, filename:extension(Name) =:= ".erl"] of
        [] ->
            [];
        [First | _] ->
            Lines = [[hex(crypto:hash(sha256, Bytes)), " ", Name, "\n"] || {Name, Bytes} <- Files],
            listed(hd(filename:split(First)), iolist_to_binary([?HEAD, "\n", Lines]))
    end.

listed(Dir, Listed) ->
    case key() of
        {ok, Key} ->
            [{filename:join(Dir, ?NAME), <<Listed/binary, (mac(Key, Listed))/binary, "\n">>}];
        none ->
            []
    end.

%% @doc The directory from which these sources of a run may be compiled and loaded, though nobody has named them:
%% a copy of what the list covers, which is gone after the command; or that of the run itself, if the user trusts it.
%% The names are relative to the directory of the run.
-spec own(Run :: file:filename(), Names :: [file:filename(), ...]) ->
    {ok, file:filename()} | {error, unicode:chardata()}.
own(Run, [Name | _] = Names) ->
    case is_trusted() orelse listed_in(Run, Name) of
        true -> {ok, Run};
        Listed -> own(Run, Names, Listed)
    end.

own(Run, Names, Listed) ->
    Strange = [Name || Name <- Names, not is_map_key(as_listed(Name), Listed)],
    case Strange =:= [] andalso copied(Run, maps:to_list(Listed)) of
        {ok, Copy} -> {ok, Copy};
        {strange, Name} -> strange(Run, Name);
        {error, _} = Error -> Error;
        false -> strange(Run, hd(Strange))
    end.

strange(Run, Name) ->
    {error, [
        filename:join(Run, Name),
        ": this is code of somebody else, or was changed; read it, then say --trust to run it"
    ]}.

%% @doc Removes the copies that this command has made.
-spec forget() -> ok.
forget() -> starl_private_dir:remove_all(?PURPOSE).

%% @doc A mark that says that this user has written these bytes; none without a key.
-spec mark(binary()) -> string() | none.
mark(Bytes) ->
    case key() of
        {ok, Key} -> binary_to_list(mac(Key, Bytes));
        none -> none
    end.

%% @doc Is this the mark of these bytes?
-spec is_marked(binary(), term()) -> boolean().
is_marked(Bytes, Mark) ->
    case {io_lib:printable_latin1_list(Mark), key()} of
        {true, {ok, Key}} -> is_equal(list_to_binary(Mark), mac(Key, Bytes));
        _ -> false
    end.

%% @doc Has the user said `--trust'?
-spec is_trusted() -> boolean().
is_trusted() -> os:getenv(?TRUST) =:= "1".

%% @doc Does something while all code is trusted: the user has said so. Programs that it starts trust it, too.
-spec trusting(fun(() -> Result)) -> Result.
trusting(Do) ->
    true = os:putenv(?TRUST, "1"),
    try
        Do()
    after
        os:unsetenv(?TRUST)
    end.

%% The files of the list, with their hashes; none without one of this user.
listed_in(Run, Name) ->
    List = filename:join([Run, hd(filename:split(Name)), ?NAME]),
    case {read(List), key()} of
        {{ok, Text}, {ok, Key}} ->
            entries(lists:reverse(binary:split(Text, <<"\n">>, [global, trim])), Key);
        _ ->
            #{}
    end.

entries([Mac, _ | _] = Lines, Key) ->
    [Head | Entries] = Listed = lists:reverse(tl(Lines)),
    Signed = iolist_to_binary([[Line, "\n"] || Line <- Listed]),
    case Head =:= <<?HEAD>> andalso is_equal(Mac, mac(Key, Signed)) of
        true -> maps:from_list([{Name, Hash} || <<Hash:64/binary, " ", Name/binary>> <- Entries]);
        false -> #{}
    end;
entries(_Lines, _Key) ->
    #{}.

as_listed(Name) -> unicode:characters_to_binary(Name).

read(File) ->
    case is_file(File, ?LIST_BYTES) of
        true -> file:read_file(File);
        false -> none
    end.

%% Pipes and devices are not opened: they may never end.
is_file(File, Most) ->
    case file:read_file_info(File) of
        {ok, #file_info{type = regular, size = Size}} -> Size =< Most;
        _ -> false
    end.

copied(Run, Listed) ->
    ok = starl_private_dir:clean(?PURPOSE),
    case starl_private_dir:new(?PURPOSE) of
        {ok, Copy} ->
            Wrong = [Name || {Name, Hash} <- Listed, not is_copied(Name, Hash, Run, Copy)],
            case Wrong of
                [] -> {ok, Copy};
                [Name | _] -> {strange, unicode:characters_to_list(Name)}
            end;
        {error, Reason} ->
            {error, starl_private_dir:format_error(Reason)}
    end.

is_copied(Name, Hash, Run, Copy) ->
    From = filename:join(Run, unicode:characters_to_list(Name)),
    To = filename:join(Copy, unicode:characters_to_list(Name)),
    _ = filelib:ensure_dir(To),
    case is_file(From, ?FILE_BYTES) andalso file:open(From, [read, raw, binary]) of
        {ok, Device} ->
            Copied = copy(Device, To),
            _ = file:close(Device),
            Copied =:= Hash;
        _ ->
            false
    end.

%% The hash of what was copied.
copy(From, File) ->
    case file:open(File, [write, exclusive, raw, binary]) of
        {ok, To} ->
            Hash = copy(From, To, crypto:hash_init(sha256), ?FILE_BYTES),
            _ = file:close(To),
            Hash;
        {error, _} ->
            none
    end.

copy(From, To, Hash, Left) when Left >= 0 ->
    case file:read(From, ?CHUNK) of
        {ok, Bytes} ->
            case file:write(To, Bytes) of
                ok -> copy(From, To, crypto:hash_update(Hash, Bytes), Left - byte_size(Bytes));
                {error, _} -> none
            end;
        eof ->
            hex(crypto:hash_final(Hash));
        {error, _} ->
            none
    end;
copy(_From, _To, _Hash, _Left) ->
    none.

mac(Key, Bytes) -> hex(crypto:mac(hmac, sha256, Key, Bytes)).

is_equal(A, B) when byte_size(A) =:= byte_size(B) -> crypto:hash_equals(A, B);
is_equal(_A, _B) -> false.

hex(Bytes) -> string:lowercase(binary:encode_hex(Bytes)).

%% The user's key, made when it is asked for first. One that others can read, or may have put there, is none.
key() ->
    Dir = filename:basedir(user_config, "starl"),
    File = filename:join(Dir, "key"),
    _ = filelib:ensure_dir(Dir),
    case {starl_private_dir:own(Dir), file:read_link_info(File)} of
        {{ok, _}, {error, enoent}} -> made(File);
        {{ok, _}, {ok, Info}} -> key(Info, file:read_link_info(Dir), File);
        {_, _} -> none
    end.

key(
    #file_info{type = regular, uid = Uid, mode = Mode, size = ?KEY_BYTES},
    {ok, #file_info{uid = Uid}},
    File
) when Mode band 8#077 =:= 0 ->
    kept(file:read_file(File));
key(_Info, _OfDir, _File) ->
    none.

kept({ok, <<Key:?KEY_BYTES/binary>>}) -> {ok, Key};
kept(_) -> none.

made(File) ->
    Key = crypto:strong_rand_bytes(?KEY_BYTES),
    Part = File ++ "." ++ binary_to_list(hex(crypto:strong_rand_bytes(8))),
    case file:open(Part, [write, exclusive, raw, binary]) of
        {ok, Device} ->
            Written = [file:change_mode(Part, 8#600), file:write(Device, Key), file:close(Device)],
            kept(lists:usort(Written) =:= [ok] andalso file:make_link(Part, File), Part, File);
        {error, _} ->
            none
    end.

%% Another command may have made it in the meantime.
kept(false, Part, _File) ->
    _ = file:delete(Part),
    none;
kept(_Linked, Part, File) ->
    _ = file:delete(Part),
    kept(file:read_file(File)).
