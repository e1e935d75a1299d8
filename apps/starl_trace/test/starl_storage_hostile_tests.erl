%% What a storage says is data: `rclone' is a program of the test's, which plays a storage that lies.
-module(starl_storage_hostile_tests).
-include_lib("eunit/include/eunit.hrl").

-define(HASH, "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef").

%% A run is the name of a directory: none that leads elsewhere, or is hidden.
runs_that_lead_elsewhere_are_none_test() ->
    Names = ["..", ".", ".ssh", "a", "a.b"],
    Lines = [["printf '3;", N, "/x-0123456789abcdef\\n'\n"] || N <- Names],
    with_storage(Lines, fun(_Dir) ->
        {ok, Entries} = starl_storage:list("far:"),
        ?assertEqual(["a", "a.b"], lists:sort([Run || #{run := Run} <- Entries]))
    end).

%% A piece is as long as the list says, and no longer than a piece may be.
a_piece_that_is_too_long_is_not_read_test() ->
    fetched("piece " ++ ?HASH ++ " 3\n", {damaged, "pieces/" ++ ?HASH}),
    fetched("piece " ++ ?HASH ++ " 99999999999\n", {damaged, "runs/r/x-0123456789abcdef"}),
    fetched("piece ../../x 3\n", {damaged, "runs/r/x-0123456789abcdef"}).

%% Nor is a list that is longer than that of any recording: no piece of it is asked for.
a_list_that_is_too_long_is_not_read_test_() ->
    Piece = ["piece ", ?HASH, " 3\n"],
    Pieces = lists:flatten(lists:duplicate(240000, Piece)),
    {timeout, 60, fun() -> fetched(Pieces, {damaged, "runs/r/x-0123456789abcdef"}) end}.

fetched(Pieces, Reason) ->
    Text = "starl recording 1\nfile x\nhash " ++ ?HASH ++ "\n" ++ Pieces,
    %% copyto ... REMOTE FILE comes with flags behind; a list is text, a piece is a megabyte
    Script = [
        "case \"$*\" in\n*runs/*) cat >\"$4\" <<'EOD'\n",
        Text,
        "EOD\n;;\n",
        "*) head -c 1048576 /dev/zero >\"$4\";;\nesac\n"
    ],
    with_storage(Script, fun(Dir) ->
        Entry = #{run => "r", name => "x", list => "runs/r/x-0123456789abcdef"},
        ?assertEqual(
            {error, Reason},
            starl_storage:download(Entry, "far:", filename:join(Dir, "x"), #{tries => 1})
        ),
        ?assertNot(filelib:is_regular(filename:join(Dir, "x")))
    end).

with_storage(Script, Test) ->
    Base = string:trim(os:cmd("mktemp -d")),
    Rclone = filename:join(Base, "rclone"),
    ok = file:write_file(Rclone, ["#!/bin/sh\n", Script]),
    ok = file:change_mode(Rclone, 8#755),
    Path = os:getenv("PATH"),
    true = os:putenv("PATH", Base ++ ":" ++ Path),
    try
        Test(Base)
    after
        os:putenv("PATH", Path),
        file:del_dir_r(Base)
    end.
