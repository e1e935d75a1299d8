%% A name in a stranger's file may be that of anything.
-module(starl_small_file_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ENDLESS, ["mkfifo", "ln -s /dev/zero", "truncate -s 5T"]).

a_file_is_read_to_its_bound_test() ->
    in_directory(fun(Dir) ->
        File = filename:join(Dir, "file"),
        [
            begin
                ok = file:write_file(File, Bytes),
                ?assertEqual(Answer, starl_small_file:read(File, 3))
            end
         || {Bytes, Answer} <- [
                {<<>>, {ok, <<>>}},
                {<<"ab">>, {ok, <<"ab">>}},
                {<<"abc">>, {ok, <<"abc">>}},
                {<<"abcd">>, {error, efbig}}
            ]
        ],
        ?assertEqual({error, eisdir}, starl_small_file:read(Dir, 3)),
        ?assertEqual({error, enoent}, starl_small_file:read(File ++ "x", 3))
    end).

what_does_not_end_is_refused_test() ->
    endless(".bin", fun(File) -> starl_small_file:read(File, 1000) end).

%% A floor, and the image of one: no command hangs, or takes all memory.
floors_test() ->
    endless(".floor", fun(File) -> starl_floor_file:read(File, none) end),
    endless(".svg", fun(File) -> starl_floor_file:read(File, none) end),
    endless(".pgm", fun(File) ->
        Yaml = filename:rootname(File) ++ ".yaml",
        ok = file:write_file(Yaml, [
            "image: ",
            File,
            "\nresolution: 0.05\norigin: [0, 0, 0]\n"
            "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
        ]),
        starl_floor_file:read(Yaml, none)
    end).

endless(Extension, Read) ->
    [
        in_directory(fun(Dir) ->
            File = filename:join(Dir, "endless" ++ Extension),
            "" = os:cmd(Make ++ " " ++ File),
            Self = self(),
            {Pid, Monitor} = spawn_opt(fun() -> Self ! {read, Read(File)} end, [
                monitor, {max_heap_size, #{size => 10000000, kill => true, error_logger => false}}
            ]),
            receive
                {read, Answer} -> ?assertMatch({Make, {error, _}}, {Make, Answer});
                {'DOWN', Monitor, process, Pid, Why} -> ?assertEqual({Make, normal}, {Make, Why})
            after 10000 ->
                exit(Pid, kill),
                ?assertEqual(answered, {Make, Extension, hangs})
            end
        end)
     || Make <- ?ENDLESS
    ].

in_directory(Test) ->
    Dir = string:trim(os:cmd("mktemp -d")),
    try
        Test(Dir)
    after
        file:del_dir_r(Dir)
    end.
