%% Results may be wanted where others write, such as in /tmp.
-module(starl_cli_out_tests).
-include_lib("eunit/include/eunit.hrl").

%% Who knows the process lays a link where it would make its files.
results_follow_no_link_test() ->
    Base = string:trim(os:cmd("mktemp -d")),
    Mine = filename:join(Base, "mine"),
    Dir = filename:join(Base, "shared"),
    try
        [ok = file:make_dir(D) || D <- [Mine, Dir]],
        [
            begin
                ok = file:make_symlink(Mine, filename:join(Where, Name ++ "." ++ os:getpid())),
                {ok, Plan} = starl_cli_out:plan(Out, "run"),
                {ok, Out} = starl_cli_out:write(Plan, fun(New) ->
                    file:write_file(filename:join(New, "report.txt"), "x")
                end),
                ?assertEqual({ok, <<"x">>}, file:read_file(filename:join(Out, "report.txt"))),
                ?assertEqual({ok, []}, file:list_dir(Mine))
            end
         || {Where, Name, Out} <- [
                {Dir, ".results", Dir}, {Base, ".fresh", filename:join(Base, "fresh")}
            ]
        ]
    after
        file:del_dir_r(Base)
    end.
