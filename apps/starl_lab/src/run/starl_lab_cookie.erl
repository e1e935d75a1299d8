%% @doc The secret of the nodes of a run. Anyone who knows it can run anything as the user of a
%% node. So it stands on no command line, which every user of a computer can read. It is in a file
%% that only the user can read, or in `STARL_COOKIE'.
%%
%% `./starl node' makes the file, and prints where it is; the user copies it to the other computers.
-module(starl_lab_cookie).

-include_lib("kernel/include/file.hrl").

-export([flag/0, read/1, made/1]).

-define(LONGEST, 255).
-define(BYTES, 16).

%% @doc The flag of the file.
-spec flag() -> starl_cli_flags:flag().
flag() ->
    {cookie_file, string, none,
        "the file of the nodes' secret, which only you can read; without it STARL_COOKIE, or "
        "~/.config/starl/cookie, which ./starl node makes"}.

%% @doc The cookie that the nodes have that run already.
-spec read(File :: file:filename() | none) -> {ok, atom()} | {error, unicode:chardata()}.
read(File) ->
    case {File, os:getenv("STARL_COOKIE")} of
        {none, [_ | _] = Cookie} -> sound("STARL_COOKIE", Cookie);
        _ -> in_file(place(File))
    end.

%% @doc The same at a node; without a file of that name a new one is made.
-spec made(File :: file:filename() | none) -> {ok, atom()} | {error, unicode:chardata()}.
made(File) ->
    case {File, os:getenv("STARL_COOKIE")} of
        {none, [_ | _] = Cookie} ->
            sound("STARL_COOKIE", Cookie);
        _ ->
            case filelib:is_file(place(File)) of
                true -> in_file(place(File));
                false -> new(place(File))
            end
    end.

place(none) -> filename:join(filename:basedir(user_config, "starl"), "cookie");
place(File) -> File.

in_file(File) ->
    case {file:read_file_info(File), file:read_file(File)} of
        {{ok, #file_info{mode = Mode}}, _} when Mode band 8#077 =/= 0 ->
            {error, [File, ": other users can read it; say: chmod 600 ", File]};
        {{ok, _}, {ok, Text}} ->
            sound(File, string:trim(binary_to_list(Text)));
        {_, {error, enoent}} ->
            {error, [
                File, ": the nodes' secret is not there; ./starl node makes it, copy it from there"
            ]};
        {_, {error, Posix}} ->
            {error, [File, ": ", file:format_error(Posix)]}
    end.

sound(Where, Cookie) ->
    case re:run(Cookie, "^[A-Za-z0-9_.-]+$", [{capture, none}, dollar_endonly]) of
        match when length(Cookie) =< ?LONGEST ->
            {ok, list_to_atom(Cookie)};
        _ ->
            Format = "~ts: a cookie has letters and digits, at most ~b",
            {error, io_lib:format(Format, [Where, ?LONGEST])}
    end.

new(File) ->
    Cookie = binary:encode_hex(crypto:strong_rand_bytes(?BYTES)),
    _ = filelib:ensure_dir(File),
    case file:open(File, [write, exclusive, raw, binary]) of
        {ok, Device} ->
            %% closed to others before the secret is in it
            Done = [file:change_mode(File, 8#600), file:write(Device, [Cookie, "\n"])],
            ok = file:close(Device),
            case [Posix || {error, Posix} <- Done] of
                [] -> in_file(File);
                [Posix | _] -> {error, [File, ": ", file:format_error(Posix)]}
            end;
        {error, Posix} ->
            {error, [File, ": ", file:format_error(Posix)]}
    end.
