%% Zstandard by the program of that name, by programs that only pretend, and by a module like that of
%% OTP 28.
-module(starl_mcap_zstd_tests).
-include_lib("eunit/include/eunit.hrl").

there_and_back_test_() ->
    with_program([
        fun() ->
            Packed = compressed(Bytes),
            ?assertEqual({ok, Bytes}, starl_mcap_zstd:decompress(Packed, byte_size(Bytes)))
        end
     || Bytes <- [<<>>, <<"x">>, text(1000), text(3000000), rand:bytes(200000)]
    ]).

damaged_test_() ->
    Bytes = text(10000),
    with_program([
        fun() ->
            Packed = compressed(Bytes),
            Size = byte_size(Packed),
            Half = binary:part(Packed, 0, Size div 2),
            [
                ?assertEqual({error, damaged}, starl_mcap_zstd:decompress(Bad, byte_size(Bytes)))
             || Bad <- [Half, <<>>, <<"garbage">>, <<Packed/binary, "more">>]
            ],
            ?assertEqual({error, damaged}, starl_mcap_zstd:decompress(Packed, 10001))
        end,
        %% a bomb: it unpacks to more than it says
        fun() ->
            Bomb = compressed(binary:copy(<<0>>, 50000000)),
            ?assertEqual({error, damaged}, starl_mcap_zstd:decompress(Bomb, 1000))
        end
    ]).

compressed(Bytes) ->
    {ok, Packed} = starl_mcap_zstd:compress(Bytes),
    Packed.

text(N) -> binary:copy(<<"a text ">>, N div 7).

with_program(Tests) ->
    case starl_mcap_zstd:is_there() of
        true -> [{timeout, 60, Test} || Test <- Tests];
        false -> []
    end.

%% -- other programs -------------------------------------------------------------------------

programs_test_() ->
    {foreach, fun() -> os:getenv("PATH") end, fun(Path) -> os:putenv("PATH", Path) end, [
        fun missing/0,
        fun dies/0,
        fun fails/0,
        fun status/0,
        fun does_something_else/0,
        fun hangs/0,
        fun says_too_much/0
    ]}.

missing() ->
    pretend(none),
    ?assertNot(starl_mcap_zstd:is_there()),
    ?assertEqual({error, missing}, starl_mcap_zstd:compress(<<"x">>)),
    ?assertEqual({error, missing}, starl_mcap_zstd:decompress(<<"x">>, 1)).

dies() ->
    pretend("kill -9 $$"),
    ?assertEqual({error, died}, starl_mcap_zstd:compress(text(1000000))),
    ?assertEqual({error, died}, starl_mcap_zstd:decompress(text(1000000), 1)).

fails() ->
    pretend("exit 1"),
    ?assertEqual({error, died}, starl_mcap_zstd:compress(text(1000))),
    ?assertEqual({error, damaged}, starl_mcap_zstd:decompress(text(1000000), 1)).

%% 126 and 127 are the shell's: it could not start the program.
status() ->
    [
        begin
            pretend("exit " ++ integer_to_list(Status)),
            ?assertEqual(
                {Status, {error, Why}},
                {Status, starl_mcap_zstd:decompress(text(1000000), 1)}
            )
        end
     || {Status, Why} <- [{125, damaged}, {126, died}, {127, died}]
    ].

does_something_else() ->
    pretend("echo hello"),
    ?assertEqual({error, died}, starl_mcap_zstd:compress(text(1000))).

%% It is killed, and what it has started is: nobody holds the other end of a pipe any more.
hangs() ->
    Dir = pretend("exec 3>\"$0.pipe\"; echo here >&3; sleep 1000"),
    Program = filename:join(Dir, "zstd"),
    "" = os:cmd("/usr/bin/mkfifo " ++ Program ++ ".pipe"),
    Reader = open_port({spawn_executable, os:find_executable("cat")}, [
        {args, [Program ++ ".pipe"]}, exit_status, binary
    ]),
    %% more than a pipe takes
    ?assertEqual({error, hangs}, starl_mcap_zstd:piped([Program], text(1000000), 10, 1500)),
    receive
        {Reader, {exit_status, 0}} -> ok
    end.

%% It is killed at once. Its port ends meanwhile, before the answer or behind it: that is not what is told.
says_too_much() ->
    Dir = pretend("echo more than ten bytes; sleep 1000"),
    Program = filename:join(Dir, "zstd"),
    [
        ?assertEqual(
            {error, damaged}, starl_mcap_zstd:piped([Program], text(1000000), 10, 10000)
        )
     || _ <- lists:seq(1, 12)
    ].

%% A directory with a program zstd of these lines is the path.
pretend(Lines) ->
    {ok, Here} = file:get_cwd(),
    Dir = filename:join([Here, "_build", "test", "starl_mcap_zstd_tests"]),
    _ = file:del_dir_r(Dir),
    Program = filename:join(Dir, "zstd"),
    ok = filelib:ensure_dir(Program),
    ok = pretend(Lines, Program),
    _ = [
        ok = file:make_symlink(os:find_executable(Tool), filename:join(Dir, Tool))
     || Tool <- tools()
    ],
    os:putenv("PATH", Dir),
    Dir.

pretend(none, _Program) ->
    ok;
pretend(Lines, Program) ->
    ok = file:write_file(Program, ["#!/bin/sh\n", Lines, "\n"]),
    file:change_mode(Program, 8#755).

tools() -> ["head", "cat", "sleep"].

%% -- a module -------------------------------------------------------------------------------

%% The module comes before the program.
module_test() ->
    case code:ensure_loaded(zstd) of
        {module, zstd} -> ok;
        {error, _} -> with_module()
    end.

with_module() ->
    {ok, zstd, Code} = compile:forms([
        form("-module(zstd).", 1),
        form("-export([compress/1, decompress/1]).", 2),
        form("compress(Bytes) -> [<<16#28, 16#b5, 16#2f, 16#fd>>, [Bytes]].", 3),
        form("decompress(<<16#28, 16#b5, 16#2f, 16#fd, Bytes/binary>>) -> [[Bytes]].", 4)
    ]),
    {module, zstd} = code:load_binary(zstd, "zstd.beam", Code),
    try
        ?assert(starl_mcap_zstd:is_there()),
        ?assertEqual({ok, <<16#28, 16#b5, 16#2f, 16#fd, "x">>}, starl_mcap_zstd:compress(<<"x">>)),
        ?assertEqual(
            {ok, <<"x">>}, starl_mcap_zstd:decompress(<<16#28, 16#b5, 16#2f, 16#fd, "x">>, 1)
        ),
        ?assertEqual({error, damaged}, starl_mcap_zstd:decompress(<<"garbage">>, 1))
    after
        true = code:delete(zstd),
        code:purge(zstd)
    end.

form(Text, Line) ->
    {ok, Tokens, _} = erl_scan:string(Text, Line),
    {ok, Form} = erl_parse:parse_form(Tokens),
    Form.
