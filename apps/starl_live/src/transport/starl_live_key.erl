%% @doc The key that the robots of a fleet share, in a file that only its owner may read.
%%
%% The file holds 32 random bytes as 64 hexadecimal digits. In the program the key is a function, so
%% that it appears in no log and no crash report.
-module(starl_live_key).

-export([new/0, generate/1, load/1]).

-export_type([t/0]).

-include_lib("kernel/include/file.hrl").

-define(BYTES, 32).

-type t() :: fun(() -> <<_:256>>).

%% @doc A new key, in memory only: for the nodes of one run on one computer.
-spec new() -> t().
new() ->
    Key = crypto:strong_rand_bytes(?BYTES),
    fun() -> Key end.

%% @doc Writes a new key; never over another file.
-spec generate(file:filename()) -> ok | {error, unicode:chardata()}.
generate(File) ->
    case file:open(File, [write, exclusive, raw]) of
        {ok, Device} ->
            Written = write(File, Device),
            _ = file:close(Device),
            written(File, Written);
        {error, eexist} ->
            {error, [File, ": stands there already; remove it first if the key is not needed"]};
        {error, Why} ->
            {error, text(File, Why)}
    end.

%% Others may not read the file from the moment on at which it holds the key.
write(File, Device) ->
    case file:change_mode(File, 8#600) of
        ok -> file:write(Device, [hex(crypto:strong_rand_bytes(?BYTES)), $\n]);
        {error, _} = Error -> Error
    end.

written(_File, ok) -> ok;
written(File, {error, Why}) -> {error, text(File, Why)}.

text(File, Why) -> [File, ": ", file:format_error(Why)].

hex(Bytes) -> [io_lib:format("~2.16.0b", [Byte]) || <<Byte>> <= Bytes].

%% @doc Reads a key.
-spec load(file:filename()) -> {ok, t()} | {error, unicode:chardata()}.
load(File) ->
    case file:read_file_info(File) of
        {ok, #file_info{type = regular, mode = Mode}} when Mode band 8#077 =:= 0 ->
            key(File, first(File));
        {ok, #file_info{type = regular}} ->
            {error, [File, ": others may read this key; say: chmod 600 ", File]};
        {ok, #file_info{}} ->
            {error, [File, ": a file expected that holds the fleet's key"]};
        {error, enoent} ->
            {error, [File, ": no such file; the fleet's key is made by: ./starl keys"]};
        {error, Why} ->
            {error, text(File, Why)}
    end.

%% The file's first bytes, more than a key.
first(File) ->
    case file:open(File, [read, binary, raw]) of
        {ok, Device} ->
            Read = file:read(Device, 1000),
            _ = file:close(Device),
            Read;
        {error, _} = Error ->
            Error
    end.

key(File, {ok, Text}) -> digits(File, string:trim(Text, both, "\s\t\r\n"));
key(File, eof) -> digits(File, <<>>);
key(File, {error, Why}) -> {error, text(File, Why)}.

digits(File, Text) when byte_size(Text) =:= 2 * ?BYTES ->
    key_of(File, Text);
digits(File, Text) ->
    Line =
        "~ts: ~b characters, not the 64 hexadecimal digits of a key; make a new one: ./starl keys",
    {error, io_lib:format(Line, [File, byte_size(Text)])}.

key_of(File, Text) ->
    try
        Key = <<<<(binary_to_integer(Digit, 16)):4>> || <<Digit:1/binary>> <= Text>>,
        {ok, fun() -> Key end}
    catch
        error:badarg ->
            {error, [File, ": not hexadecimal digits only; make a new key: ./starl keys"]}
    end.
