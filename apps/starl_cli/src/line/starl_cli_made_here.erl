%% @doc Tells whether code that lies in the results of a run was put there by this user.
%%
%% Results come from anywhere: from a colleague, a mailing list, a storage. To compile and load a module runs what its
%% author likes. So the sources that a run keeps get a list of their hashes with a code (HMAC) by a key of the
%% user's own; commands that only read results load what such a list covers, and nothing else, unless the user says
%% `--trust'. The key lies in the user's configuration, `~/.config/starl/key', and never leaves it.
-module(starl_cli_made_here).

-export([stamp/1, check/1, mark/1, is_marked/2, is_trusted/0, trusting/1]).

-define(NAME, "made_here").
-define(HEAD, "starl inputs 1").
-define(KEY_BYTES, 32).
-define(TRUST, "STARL_TRUST").

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

%% @doc May this source be compiled and loaded, though nobody has named it? It may if a list that was made here covers
%% it, and all that it covers is as it was; or if the user trusts it.
-spec check(file:filename()) -> ok | {error, unicode:chardata()}.
check(File) ->
    case is_trusted() orelse is_listed(filename:absname(File)) of
        true ->
            ok;
        false ->
            {error, [
                File,
                ": this is code of somebody else, or was changed; read it, then say --trust to run it"
            ]}
    end.

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

is_listed(File) -> is_listed(filename:dirname(File), File).

is_listed(Dir, File) ->
    case {file:read_file(filename:join(Dir, ?NAME)), filename:dirname(Dir)} of
        {{ok, Text}, Parent} -> covers(Text, File, Parent);
        {{error, _}, Dir} -> false;
        {{error, _}, Parent} -> is_listed(Parent, File)
    end.

covers(Text, File, Parent) ->
    case {lists:reverse(binary:split(Text, <<"\n">>, [global, trim])), key()} of
        {[Mac | [_ | _] = Before], {ok, Key}} ->
            [Head | Entries] = Listed = lists:reverse(Before),
            Signed = iolist_to_binary([[Line, "\n"] || Line <- Listed]),
            Head =:= <<?HEAD>> andalso is_equal(Mac, mac(Key, Signed)) andalso
                lists:member(File, [filename:join(Parent, Name) || {Name, _} <- entries(Entries)]) andalso
                lists:all(fun(Entry) -> is_as_it_was(Entry, Parent) end, entries(Entries));
        _ ->
            false
    end.

entries(Lines) ->
    [{unicode:characters_to_list(Name), Hash} || <<Hash:64/binary, " ", Name/binary>> <- Lines].

is_as_it_was({Name, Hash}, Parent) ->
    case file:read_file(filename:join(Parent, Name)) of
        {ok, Bytes} -> hex(crypto:hash(sha256, Bytes)) =:= Hash;
        {error, _} -> false
    end.

mac(Key, Bytes) -> hex(crypto:mac(hmac, sha256, Key, Bytes)).

is_equal(A, B) when byte_size(A) =:= byte_size(B) -> crypto:hash_equals(A, B);
is_equal(_A, _B) -> false.

hex(Bytes) -> string:lowercase(binary:encode_hex(Bytes)).

%% The user's key, made when it is asked for first.
key() ->
    File = filename:join(filename:basedir(user_config, "starl"), "key"),
    case file:read_file(File) of
        {ok, <<Key:?KEY_BYTES/binary>>} -> {ok, Key};
        {ok, _Other} -> none;
        {error, enoent} -> made(File);
        {error, _} -> none
    end.

made(File) ->
    Key = crypto:strong_rand_bytes(?KEY_BYTES),
    Part = File ++ "." ++ binary_to_list(hex(crypto:strong_rand_bytes(8))),
    _ = filelib:ensure_dir(File),
    case file:open(Part, [write, exclusive, raw, binary]) of
        {ok, Device} ->
            Written = [file:change_mode(Part, 8#600), file:write(Device, Key), file:close(Device)],
            kept(lists:usort(Written) =:= [ok] andalso file:make_link(Part, File), Part, File);
        {error, _} ->
            none
    end.

%% Another command may have made it in the meantime.
kept(Linked, Part, File) ->
    _ = file:delete(Part),
    case {Linked, file:read_file(File)} of
        {false, _} -> none;
        {_, {ok, <<Key:?KEY_BYTES/binary>>}} -> {ok, Key};
        {_, _} -> none
    end.
