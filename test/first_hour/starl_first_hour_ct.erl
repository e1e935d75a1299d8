%% A terminal for the tests: shell lines that call ./starl from a directory of their own.
-module(starl_first_hour_ct).

-export([sh/2, sh/3, until/3, root/0, path/0, contains/2, write/2, repository/1]).

%% Runs a line of sh in a directory; $starl is the script of the checkout. Gives the exit status and
%% what both outputs said.
sh(Line, Dir) -> sh(Line, Dir, []).

sh(Line, Dir, Env) -> rest(shell(Line, Dir, Env), "").

%% Runs a line of sh until both outputs have said what matches, and reads no more of it then.
until(Line, Pattern, Dir) ->
    Port = shell(Line, Dir, []),
    Answer = matched(Port, Pattern, ""),
    catch port_close(Port),
    Answer.

matched(Port, Pattern, Text) ->
    receive
        {Port, {data, More}} ->
            case re:run(Text ++ More, Pattern) of
                {match, _} -> {ok, Text ++ More};
                nomatch -> matched(Port, Pattern, Text ++ More)
            end;
        {Port, {exit_status, Status}} ->
            {ended, Status, Text}
    end.

shell(Line, Dir, Env) ->
    Root = root(),
    ok = filelib:ensure_path(Dir),
    open_port({spawn_executable, os:find_executable("sh")}, [
        {args, ["-c", Line]},
        {cd, Dir},
        exit_status,
        stderr_to_stdout,
        hide,
        {env, [
            {"starl", filename:join(Root, "starl")},
            {"ERL_AFLAGS", false},
            {"ERL_LIBS", libraries(Root)},
            {"PATH", path()}
            | Env
        ]}
    ]).

rest(Port, Text) ->
    receive
        {Port, {data, More}} -> rest(Port, Text ++ More);
        {Port, {exit_status, Status}} -> {Status, Text}
    end.

%% Fails with the whole text if a part is not in it.
contains(Part, Text) ->
    case string:find(Text, Part) of
        nomatch -> error({not_in_text, Part, Text});
        _ -> ok
    end.

write(File, Text) ->
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, Text).

%% Makes a directory a repository with the sources that are tested here, for projects to depend on.
repository(Dir) ->
    {0, _} = sh(
        "git -C '" ++ root() ++
            "' ls-files -co --exclude-standard | tar -C '" ++ root() ++
            "' -cf - --ignore-failed-read -T - | tar -xf - && git init -q -b main . && git add -A"
            " && git -c user.name=test -c user.email=test@localhost commit -qm sources",
        Dir,
        [{"ERL_LIBS", false}]
    ),
    Dir.

%% The checkout.
root() -> root(filename:dirname(code:which(?MODULE))).

root(Dir) ->
    case filelib:is_regular(filename:join(Dir, "starl")) of
        true -> Dir;
        false when Dir =/= "/" -> root(filename:dirname(Dir))
    end.

%% An Erlang VM puts two folders of its own before the others.
path() ->
    Dirs = string:lexemes(os:getenv("PATH"), ":"),
    Own = [os:getenv("BINDIR", ""), filename:join(code:root_dir(), "bin")],
    lists:append(lists:join(":", Dirs -- Own)).

%% rebar3 adds the libraries in .deps, which ./starl adds by itself.
libraries(Root) ->
    Own = filename:join(Root, ".deps"),
    case [Dir || Dir <- string:lexemes(os:getenv("ERL_LIBS", ""), ":"), Dir =/= Own] of
        [] -> false;
        Dirs -> lists:append(lists:join(":", Dirs))
    end.
