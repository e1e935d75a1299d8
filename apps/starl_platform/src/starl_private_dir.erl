%% @doc Private directories for the time of a run: stores of live robots, parts of recordings,
%% frames of films.
%%
%% Other users of the computer can neither read nor replace their content. Each directory is new,
%% with a name that nobody can guess, in a directory of the user's own (mode 0700), never in `/tmp'
%% itself.
%% ```
%%   {ok, Dir} = starl_private_dir:new("live"),      % ~/.cache/starl/live-4711-1f6b0c22d4e59a07
%%   ...
%%   ok = starl_private_dir:remove(Dir).
%% '''
%% {@link clean/1} removes what a killed run has left: only directories of this user, and it follows
%% no link.
-module(starl_private_dir).

-include_lib("kernel/include/file.hrl").

-export([new/1, own/1, remove/1, remove_all/1, clean/1, with/2, format_error/1]).

-export_type([reason/0]).

%% No directory can be made there. `eperm': another user has made the one in which they lie.
-type reason() :: {file, file:filename(), file:posix() | badarg}.

%% @doc A new directory. The purpose, some letters, begins its name.
-spec new(Purpose :: string()) -> {ok, file:filename()} | {error, reason()}.
new(Purpose) ->
    case own(base()) of
        {ok, Base} -> made(filename:join(Base, Purpose ++ "-" ++ os:getpid() ++ "-" ++ random()));
        {error, _} = Error -> Error
    end.

%% @doc Does something with a new directory, which is gone afterwards.
-spec with(Purpose :: string(), fun((file:filename()) -> Result)) -> Result | {error, reason()}.
with(Purpose, Do) ->
    case new(Purpose) of
        {ok, Dir} ->
            try
                Do(Dir)
            after
                remove(Dir)
            end;
        {error, _} = Error ->
            Error
    end.

%% @doc Removes a directory that `new/1' has made.
-spec remove(file:filename()) -> ok.
remove(Dir) ->
    _ = file:del_dir_r(Dir),
    ok.

%% @doc Removes all directories of this purpose that this VM has made.
-spec remove_all(Purpose :: string()) -> ok.
remove_all(Purpose) ->
    Made = [
        filename:join(base(), Name)
     || {ok, Names} <- [file:list_dir(base())],
        Name <- Names,
        pid_in(Purpose, Name) =:= {ok, os:getpid()}
    ],
    lists:foreach(fun remove/1, [Dir || Dir <- Made, is_own(Dir)]).

%% @doc Removes the directories of this purpose whose runs have ended without removing them, as when they were killed.
%% Only Linux knows which have.
-spec clean(Purpose :: string()) -> ok.
clean(Purpose) ->
    Left = [
        filename:join(base(), Name)
     || filelib:is_dir("/proc/self"),
        {ok, Base} <- [own(base())],
        {ok, Names} <- [file:list_dir(Base)],
        Name <- Names,
        is_abandoned(Purpose, Name)
    ],
    lists:foreach(fun remove/1, [Dir || Dir <- Left, is_own(Dir)]).

is_abandoned(Purpose, Name) ->
    case pid_in(Purpose, Name) of
        {ok, Pid} -> not filelib:is_dir("/proc/" ++ Pid);
        none -> false
    end.

%% The process that has made a directory, by its name.
pid_in(Purpose, Name) ->
    Pattern = "^" ++ Purpose ++ "-([0-9]{1,10})-[0-9a-f]{16}$",
    case re:run(Name, Pattern, [{capture, all_but_first, list}, dollar_endonly]) of
        {match, [Pid]} -> {ok, Pid};
        nomatch -> none
    end.

%% The directory in which they lie: `starl' in the user's cache. A user without a home, as a service is, has one
%% below `TMPDIR'.
-spec base() -> file:filename().
base() ->
    case {os:getenv("XDG_CACHE_HOME"), os:getenv("HOME")} of
        {[$/ | _] = Cache, _} -> Cache ++ "/starl";
        {_, [$/, _ | _] = Home} -> Home ++ "/.cache/starl";
        _ -> os:getenv("TMPDIR", "/tmp") ++ "/starl-" ++ integer_to_list(uid())
    end.

%% @doc Makes this directory the user's alone, new if it is not there. It must be the user's own, and no link.
-spec own(file:filename()) -> {ok, file:filename()} | {error, reason()}.
own(Base) ->
    _ = filelib:ensure_dir(Base),
    case made(Base) of
        {error, {file, Base, eexist}} ->
            case is_own(Base) of
                true -> private(Base);
                false -> {error, {file, Base, eperm}}
            end;
        Answer ->
            Answer
    end.

made(Dir) ->
    case file:make_dir(Dir) of
        ok -> private(Dir);
        {error, Posix} -> {error, {file, Dir, Posix}}
    end.

private(Dir) ->
    case file:change_mode(Dir, 8#700) of
        ok -> {ok, Dir};
        {error, Posix} -> {error, {file, Dir, Posix}}
    end.

is_own(Dir) ->
    Uid = uid(),
    case file:read_link_info(Dir) of
        {ok, #file_info{type = directory, uid = Uid}} -> true;
        _ -> false
    end.

%% The user of this VM.
uid() ->
    case file:read_file_info("/proc/self") of
        {ok, #file_info{uid = Uid}} -> Uid;
        {error, _} -> by_id(string:to_integer(os:cmd("id -u")))
    end.

by_id({Uid, _Rest}) when is_integer(Uid) -> Uid;
by_id({error, _}) -> -1.

random() -> string:lowercase(binary_to_list(binary:encode_hex(crypto:strong_rand_bytes(8)))).

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({file, Dir, Posix}) ->
    [Dir, ": ", file:format_error(Posix), "; set XDG_CACHE_HOME to a directory of yours"].
