%% Results may be unpacked with links in them, and lie where others write: what is written follows none.
%%
%% Holds: What is written follows no link
%% Red: 4ca8e259, run
-module(starl_trace_links_tests).
-include_lib("eunit/include/eunit.hrl").

%% A link of the name that a recording has while it is made.
a_part_follows_no_link_test() ->
    with_link("out.mcap.part", fun(Dir) ->
        {ok, made} = starl_mcap_part:make(filename:join(Dir, "out.mcap"), fun(Part) ->
            _ = starl_mcap_part:write("bytes", Part),
            {ok, made}
        end),
        ?assertEqual({ok, <<"bytes">>}, file:read_file(filename:join(Dir, "out.mcap")))
    end).

%% One that an earlier recovery has left is no matter.
a_part_that_was_left_is_replaced_test() ->
    with_link("other", fun(Dir) ->
        ok = file:write_file(filename:join(Dir, "out.mcap.part"), "left, and longer"),
        {ok, made} = starl_mcap_part:make(filename:join(Dir, "out.mcap"), fun(Part) ->
            _ = starl_mcap_part:write("bytes", Part),
            {ok, made}
        end),
        ?assertEqual({ok, <<"bytes">>}, file:read_file(filename:join(Dir, "out.mcap")))
    end).

a_recorder_follows_no_link_test() ->
    with_link("painting.4711.mcap", fun(Dir) ->
        File = filename:join(Dir, "painting.4711.mcap"),
        {ok, Recorder} = starl_trace_recorder:start_link(File, simulation),
        _ = starl_trace_recorder:close(Recorder),
        ?assert(filelib:is_regular(File)),
        ?assertMatch({error, einval}, file:read_link(File))
    end).

with_link(Name, Test) ->
    Dir = string:trim(os:cmd("mktemp -d")),
    Mine = filename:join(Dir, "thesis"),
    ok = file:write_file(Mine, "years of work"),
    ok = file:make_symlink(Mine, filename:join(Dir, Name)),
    try
        Test(Dir),
        ?assertEqual({ok, <<"years of work">>}, file:read_file(Mine))
    after
        file:del_dir_r(Dir)
    end.
