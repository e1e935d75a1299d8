%% @doc Shows a page in the user's browser, if the computer has a display, with the program of the
%% desktop. Output and failure of that program are ignored.
-module(starl_lab_browser).

-export([open/1, program/2]).

-define(PAGE, "page").

%% What the environment says, and where a program is.
-type env() :: fun((Name :: string()) -> string() | false).
-type find() :: fun((Program :: string()) -> file:filename() | false).

%% @doc Opens an address, if there is a display and a program to do so. Every user of the computer can read the
%% arguments of programs, and the address has a token: so the program gets a page of the user's own that leads there.
-spec open(Url :: binary()) -> ok.
open(Url) ->
    ok = starl_private_dir:clean(?PAGE),
    case program(fun os:getenv/1, {os:type(), fun os:find_executable/1}) of
        {ok, Program} -> led(Program, Url, starl_private_dir:new(?PAGE));
        none -> ok
    end.

led(Program, Url, {ok, Dir}) ->
    File = filename:join(Dir, "view.html"),
    case file:write_file(File, page(Url)) of
        ok ->
            _ = spawn(fun() -> launch(Program, File) end),
            ok;
        {error, _} ->
            ok
    end;
led(_Program, _Url, {error, _}) ->
    ok.

%% An address has no character that HTML would take for its own but &, which it may have.
page(Url) ->
    [
        "<!doctype html><meta charset=\"utf-8\"><title>StarL</title>"
        "<meta http-equiv=\"refresh\" content=\"0;url=",
        Url,
        "\"><a href=\"",
        Url,
        "\">StarL</a>\n"
    ].

%% @doc The program that opens addresses: of macOS, of a Linux in Windows, of a desktop with a display. A login
%% from elsewhere has none.
-spec program(env(), {OsType :: {atom(), atom()}, find()}) -> {ok, file:filename()} | none.
program(Env, {{unix, darwin}, Find}) ->
    found([Find("open") || Env("SSH_CONNECTION") =:= false]);
program(Env, {{unix, _}, Find}) ->
    found([Find(Name) || {Name, Sign} <- signs(), is_set(Env(Sign))]);
program(_Env, _Other) ->
    none.

signs() ->
    [{"wslview", "WSL_DISTRO_NAME"}, {"xdg-open", "WAYLAND_DISPLAY"}, {"xdg-open", "DISPLAY"}].

is_set(Value) -> Value =/= false andalso Value =/= "".

found(Programs) ->
    case [Program || Program <- Programs, Program =/= false] of
        [Program | _] -> {ok, Program};
        [] -> none
    end.

%% It outlives this program, and writes nothing among its lines.
launch(Program, Url) ->
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", "\"$0\" \"$1\" </dev/null >/dev/null 2>&1 &", Program, Url]}, exit_status
    ]),
    receive
        {Port, {exit_status, _}} -> ok
    end.
