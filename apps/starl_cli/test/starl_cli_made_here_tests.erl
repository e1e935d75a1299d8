%% Results of a run come from anywhere: code in them is loaded if this user has put it there, or trusts it.
-module(starl_cli_made_here_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FILES, [{"inputs/a.erl", <<"-module(a).\n">>}, {"inputs/sub/b.hrl", <<"-define(B, 1).\n">>}]).

%% What was kept here may be loaded, also after it was moved as a whole.
code_of_ones_own_test() ->
    in_results(?FILES, fun(Dir) ->
        ?assertEqual(ok, check(Dir)),
        ok = file:rename(Dir, Dir ++ "-moved"),
        ?assertEqual(ok, check(Dir ++ "-moved")),
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
        ?assertMatch({error, _}, starl_cli_made_here:check(Further)),
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

check(Dir) -> starl_cli_made_here:check(filename:join([Dir, "inputs", "a.erl"])).

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
