%% Results of a run come from anywhere: code in them is loaded if this user has put it there, or trusts it.
%%
%% Holds: Code in results of a run is loaded only if this user has put it there
%% Red: 961f67c9: compiled and loaded
%% Holds: Results with code of a user's own are compiled from a verified private copy; files beside
%% those of the list, pipes, links and other people's keys load nothing
%% Red: 4ca8e259, run: `-on_load` code ran
-module(starl_cli_made_here_tests).
-include_lib("eunit/include/eunit.hrl").
-include_lib("kernel/include/file.hrl").

-define(FILES, [{"inputs/a.erl", <<"-module(a).\n">>}, {"inputs/sub/b.hrl", <<"-define(B, 1).\n">>}]).

%% What was kept here may be loaded, also after it was moved as a whole.
code_of_ones_own_test() ->
    in_results(?FILES, fun(Dir) ->
        ?assertEqual(ok, check(Dir)),
        ok = file:rename(Dir, Dir ++ "-moved"),
        ?assertEqual(ok, check(Dir ++ "-moved")),
        %% from a copy, which nobody else can change, and which goes after the command
        {ok, Copy} = starl_cli_made_here:own(Dir ++ "-moved", ["inputs/a.erl"]),
        ?assertNotEqual(Dir ++ "-moved", Copy),
        {ok, #file_info{mode = Mode}} = file:read_file_info(Copy),
        ?assertEqual(8#700, Mode band 8#777),
        ok = starl_cli_made_here:forget(),
        ?assertEqual({error, enoent}, file:read_file_info(Copy)),
        ok = file:rename(Dir ++ "-moved", Dir)
    end).

%% A stranger's results have no list, or one by another key.
code_of_a_stranger_test() ->
    in_results(?FILES, fun(Dir) ->
        List = filename:join([Dir, "inputs", "made_here"]),
        {ok, Text} = file:read_file(List),
        ok = file:delete(List),
        ?assertMatch({error, _}, check(Dir)),
        ok = file:write_file(
            List, re:replace(Text, "[0-9a-f]{64}\n$", [lists:duplicate(64, $0), "\n"])
        ),
        ?assertMatch({error, _}, check(Dir)),
        ok = file:write_file(List, <<>>),
        ?assertMatch({error, _}, check(Dir))
    end).

%% A change of the source, or of a header that it includes, is seen; and so is a further source.
changed_code_test() ->
    [
        in_results(?FILES, fun(Dir) ->
            ok = file:write_file(filename:join(Dir, Name), "-on_load(x/0)."),
            ?assertMatch({Name, {error, _}}, {Name, check(Dir)})
        end)
     || {Name, _} <- ?FILES
    ],
    in_results(?FILES, fun(Dir) ->
        Further = filename:join([Dir, "inputs", "c.erl"]),
        ok = file:write_file(Further, "-module(c)."),
        ?assertMatch({error, _}, starl_cli_made_here:own(Dir, ["inputs/c.erl"])),
        ?assertMatch({error, _}, starl_cli_inputs:sources_beside(filename:join(Dir, "run.mcap")))
    end).

%% The user has read it.
trusted_code_test() ->
    in_results(?FILES, fun(Dir) ->
        ok = file:delete(filename:join([Dir, "inputs", "made_here"])),
        ?assertEqual(ok, starl_cli_made_here:trusting(fun() -> check(Dir) end)),
        ?assertMatch({error, _}, check(Dir))
    end).

%% Pictures alone need no list.
without_code_test() ->
    ?assertEqual([], starl_cli_made_here:stamp([{"inputs/a.svg", <<"<svg/>">>}])).

%% A record that names a source elsewhere loads nothing: neither from its directory nor from a path.
a_record_names_code_elsewhere_test() ->
    in_results([], fun(Dir) ->
        ok = file:make_dir(filename:join(Dir, "inputs")),
        Marker = filename:join(Dir, "ran"),
        Source = [
            "-module(starl_evil_app).\n-on_load(go/0).\n-export([init/2, step/2]).\n",
            "go() -> file:write_file(\"",
            Marker,
            "\", \"\").\n",
            "init(_, _) -> 1.\nstep(_, S) -> {done, S}.\n"
        ],
        Evil = filename:join([Dir, "inputs", "starl_evil_app.erl"]),
        ok = file:write_file(Evil, Source),
        [
            begin
                ok = starl_cli_record:write(Dir, Record),
                {error, [Line | _]} = starl_cli_target:resolve(Dir),
                ?assertMatch({match, _}, re:run(Line, "somebody else")),
                ?assertNot(filelib:is_regular(Marker))
            end
         || Record <- [
                record("inputs/starl_evil_app.erl", #{}),
                record(Evil, #{}),
                record(painting, #{choice => "inputs/starl_evil_app.erl"}),
                record(painting, #{reloads => [{1, Evil, all}]})
            ]
        ],
        %% no record at all, in the place of one
        ok = file:write_file(
            filename:join(Dir, "run.term"), io_lib:format("#{app => ~p}.~n", [Evil])
        ),
        ?assertMatch({error, _}, starl_cli_target:resolve(Dir)),
        ?assertNot(filelib:is_regular(Marker))
    end).

%% Code has other names than that of a source: a directory of sources, a module in the working directory (compiled or
%% in its `src'), a source of a reload without its extension, a compiled module in the record itself.
a_record_names_code_by_other_words_test() ->
    in_results([], fun(Dir) ->
        {ok, Before} = file:get_cwd(),
        Marker = filename:join(Dir, "ran"),
        [
            write(filename:join(Dir, Name), evil(filename:basename(Name, ".erl"), Marker))
         || Name <- [
                "inputs/one/starl_evil_one.erl", "src/starl_evil_two.erl", "starl_evil_three.erl"
            ]
        ],
        Three = filename:join(Dir, "starl_evil_three"),
        {ok, Module, Beam} = compile:file(Three, [binary, debug_info]),
        write(Three ++ ".beam", Beam),
        write(Three ++ ".ERL", "no source"),
        ok = file:set_cwd(Dir),
        try
            [
                refused(Dir, Record, Marker)
             || Record <- [
                    record(filename:join(Dir, "inputs/one"), #{}),
                    record("inputs/one", #{}),
                    record("starl_evil_two", #{}),
                    record(starl_evil_two, #{}),
                    record(starl_evil_three, #{}),
                    record(painting, #{reloads => [{1, all, Three}]}),
                    record(painting, #{reloads => [{1, all, {Module, "x", Beam}}]}),
                    record(painting, #{reloads => [{1, all, [starl_painting, {Module, "x", Beam}]}]})
                ]
            ]
        after
            ok = file:set_cwd(Before)
        end
    end).

refused(Dir, Record, Marker) ->
    ok = starl_cli_record:write(Dir, Record),
    Answer = starl_cli_target:resolve(Dir),
    ?assertMatch({_, {error, [_ | _]}}, {maps:with([app, scenario], Record), Answer}),
    {error, [Line | _]} = Answer,
    ?assertMatch({match, _}, re:run(Line, "somebody else")),
    ?assertNot(filelib:is_regular(Marker)).

%% The list covers what is on it. Nothing else is seen: neither a module of a name that a source mentions, nor a header
%% in the place of a library's.
files_beside_code_of_ones_own_test() ->
    Mine =
        <<
            "-module(starl_mine_app).\n-export([init/2, step/2]).\n-include_lib(\"kernel/include/file.hrl\").\n"
            "init(_, _) -> 1.\nstep(_, S) -> {starl_evil_word, S}.\n"
        >>,
    in_results([{"inputs/starl_mine_app.erl", Mine}], fun(Dir) ->
        Marker = filename:join(Dir, "ran"),
        write(filename:join(Dir, "inputs/starl_evil_word.erl"), evil("starl_evil_word", Marker)),
        {ok, Header} = file:read_file(filename:join(code:lib_dir(kernel, include), "file.hrl")),
        [_, OnLoad | _] = string:split(evil("x", Marker), "\n", all),
        [Go | _] = [L || "go()" ++ _ = L <- string:split(evil("x", Marker), "\n", all)],
        write(
            filename:join(Dir, "inputs/kernel/include/file.hrl"), [Header, OnLoad, "\n", Go, "\n"]
        ),
        ok = starl_cli_record:write(Dir, record("inputs/starl_mine_app.erl", #{})),
        {ok, #{app := starl_mine_app, code := [_]} = Target} = starl_cli_target:resolve(Dir),
        ?assertNot(filelib:is_regular(Marker)),
        %% what is said of it names the results
        ?assertMatch(#{replay := _}, Target),
        ?assertEqual(filename:join(Dir, "inputs/starl_mine_app.erl"), maps:get(replay, Target)),
        ?assertEqual(filename:join(Dir, "run.term"), maps:get(file, Target)),
        ok = starl_cli_made_here:forget()
    end).

%% What is no file ends no command: a pipe, a device, a circle of links.
no_files_test_() ->
    {timeout, 30, fun() ->
        [
            in_results(?FILES, fun(Dir) ->
                Path = filename:join(Dir, Name),
                ok = file:delete(Path),
                "" = os:cmd(Make ++ " " ++ Path),
                ?assertMatch({Name, Make, {error, _}}, {Name, Make, check(Dir)})
            end)
         || Name <- ["inputs/made_here", "inputs/a.erl"],
            Make <- ["mkfifo", "ln -s /dev/zero", "truncate -s 5T", "mkdir"]
        ],
        in_results(?FILES, fun(Dir) ->
            [
                ok = file:make_symlink(".", filename:join([Dir, "inputs", Name]))
             || Name <- ["x", "y", "z"]
            ],
            ?assertMatch(
                {ok, [_]}, starl_cli_inputs:sources_beside(filename:join(Dir, "run.mcap"))
            ),
            ok = starl_cli_made_here:forget()
        end)
    end}.

%% A key that others can read, or may have written, is none.
a_key_of_others_test() ->
    in_results(?FILES, fun(Dir) ->
        Key = filename:join(filename:basedir(user_config, "starl"), "key"),
        ok = file:change_mode(Key, 8#644),
        ?assertMatch({error, _}, check(Dir)),
        ok = file:change_mode(Key, 8#600),
        %% one that was open to others is closed
        ok = file:change_mode(filename:dirname(Key), 8#777),
        ?assertEqual(ok, check(Dir)),
        {ok, #file_info{mode = Mode}} = file:read_file_info(filename:dirname(Key)),
        ?assertEqual(8#700, Mode band 8#777),
        case file:change_owner(filename:dirname(Key), 65534) of
            ok -> ?assertMatch({error, _}, check(Dir));
            %% only root can give a directory away
            {error, eperm} -> ok
        end
    end).

evil(Module, Marker) ->
    lists:flatten([
        "-module(",
        Module,
        ").\n-on_load(go/0).\n-export([init/2, step/2]).\n-behaviour(starl_app).\n",
        "go() -> file:write_file(\"",
        Marker,
        "\", \"\").\n",
        "init(_, _) -> 1.\nstep(_, S) -> {done, S}.\n"
    ]).

write(File, Bytes) ->
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, Bytes).

record(App, More) ->
    #{
        app => App,
        scenario => maps:merge(#{robots => 1, seed => 1}, More),
        options => #{},
        digest => lists:duplicate(32, $0),
        ending => done,
        end_us => 0,
        events => 0,
        violations => [],
        results => []
    }.

check(Dir) ->
    case starl_cli_made_here:own(Dir, ["inputs/a.erl"]) of
        {ok, _} -> ok;
        {error, _} = Error -> Error
    end.

in_results(Files, Test) ->
    Base = string:trim(os:cmd("mktemp -d")),
    Before = os:getenv("XDG_CONFIG_HOME"),
    true = os:putenv("XDG_CONFIG_HOME", filename:join(Base, "config")),
    Dir = filename:join(Base, "run"),
    ok = file:make_dir(Dir),
    [
        begin
            ok = filelib:ensure_dir(filename:join(Dir, Name)),
            ok = file:write_file(filename:join(Dir, Name), Bytes)
        end
     || {Name, Bytes} <- Files ++ starl_cli_made_here:stamp(Files)
    ],
    try
        Test(Dir)
    after
        case Before of
            false -> os:unsetenv("XDG_CONFIG_HOME");
            _ -> os:putenv("XDG_CONFIG_HOME", Before)
        end,
        file:del_dir_r(Base)
    end.
