%% Other users of the computer exchange directories, make them first, and guess names.
%%
%% Holds: Other users of the computer exchange no directory, guess no name, and lose no file
%% Red: 961f67c9: `/tmp/starl-live-PID`
-module(starl_private_dir_tests).
-include_lib("eunit/include/eunit.hrl").
-include_lib("kernel/include/file.hrl").

%% A directory is new, of the user alone, and in one that is the user's alone.
a_directory_is_private_test() ->
    in_cache(fun(Cache) ->
        {ok, Dir} = starl_private_dir:new("live"),
        {ok, Other} = starl_private_dir:new("live"),
        ?assertNotEqual(Dir, Other),
        [
            ?assertMatch({_, 8#700}, {D, mode(D)})
         || D <- [Dir, Other, filename:join(Cache, "starl")]
        ],
        ok = file:write_file(filename:join(Dir, "store"), "x"),
        ok = starl_private_dir:remove(Dir),
        ?assertEqual({error, enoent}, file:list_dir(Dir))
    end).

%% One that was open to others is closed.
an_open_directory_is_closed_test() ->
    in_cache(fun(Cache) ->
        Base = filename:join(Cache, "starl"),
        ok = file:make_dir(Base),
        ok = file:change_mode(Base, 8#777),
        {ok, _} = starl_private_dir:new("live"),
        ?assertEqual(8#700, mode(Base))
    end).

%% Somebody has laid a link in its place, or made it first.
a_foreign_directory_is_refused_test() ->
    in_cache(fun(Cache) ->
        Elsewhere = filename:join(Cache, "elsewhere"),
        ok = file:make_dir(Elsewhere),
        ok = file:make_symlink(Elsewhere, filename:join(Cache, "starl")),
        {error, {file, _, eperm} = Reason} = starl_private_dir:new("live"),
        ?assertMatch({match, _}, re:run(starl_private_dir:format_error(Reason), "XDG_CACHE_HOME")),
        ?assertEqual({ok, []}, file:list_dir(Elsewhere))
    end).

a_directory_of_another_user_is_refused_test() ->
    in_cache(fun(Cache) ->
        Base = filename:join(Cache, "starl"),
        ok = file:make_dir(Base),
        case file:change_owner(Base, 65534) of
            ok -> ?assertMatch({error, {file, Base, eperm}}, starl_private_dir:new("live"));
            %% only root can give a directory away
            {error, eperm} -> ok
        end
    end).

%% What dead runs have left goes, and nothing else: no run that lives, no other name, nothing behind a link.
clean_test() ->
    in_cache(fun(Cache) ->
        {ok, Own} = starl_private_dir:new("live"),
        Base = filename:join(Cache, "starl"),
        Mine = filename:join(Cache, "mine"),
        ok = file:make_dir(Mine),
        ok = file:write_file(filename:join(Mine, "thesis"), "x"),
        Dead = "live-4194305-0123456789abcdef",
        Link = "live-4194306-0123456789abcdef",
        Odd = "live-4194305-../../x",
        ok = file:make_dir(filename:join(Base, Dead)),
        ok = file:make_symlink(Mine, filename:join(Base, Link)),
        ok = filelib:ensure_path(filename:join(Base, "live-4194305")),
        ok = starl_private_dir:clean("live"),
        ?assertEqual(
            lists:sort([filename:basename(Own), Link, "live-4194305"]),
            [Name || Name <- lists:sort(element(2, file:list_dir(Base))), Name =/= Odd]
        ),
        ?assertEqual({ok, ["thesis"]}, file:list_dir(Mine))
    end).

%% Without a home it is still a directory of the user's own.
without_a_home_test() ->
    in_cache(fun(Cache) ->
        Home = os:getenv("HOME"),
        true = os:unsetenv("XDG_CACHE_HOME"),
        true = os:putenv("HOME", ""),
        true = os:putenv("TMPDIR", Cache),
        try
            {ok, Dir} = starl_private_dir:new("live"),
            ?assertEqual(8#700, mode(filename:dirname(Dir)))
        after
            os:putenv("HOME", Home),
            os:unsetenv("TMPDIR")
        end
    end).

mode(Dir) ->
    {ok, #file_info{mode = Mode}} = file:read_link_info(Dir),
    Mode band 8#777.

in_cache(Test) ->
    Cache = string:trim(os:cmd("mktemp -d")),
    Before = os:getenv("XDG_CACHE_HOME"),
    true = os:putenv("XDG_CACHE_HOME", Cache),
    try
        Test(Cache)
    after
        case Before of
            false -> os:unsetenv("XDG_CACHE_HOME");
            _ -> os:putenv("XDG_CACHE_HOME", Before)
        end,
        file:del_dir_r(Cache)
    end.
