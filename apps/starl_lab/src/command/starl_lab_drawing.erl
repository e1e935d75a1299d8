%% @doc Writes the drawings of a command into the directory of its results, and prints their names.
-module(starl_lab_drawing).

-export([write/3]).

%% @doc Writes with this function of a directory; the drawings are `NAME.*'. Gives the exit status.
-spec write(starl_cli_out:t(), Name :: string(), fun((file:filename()) -> starl_scene:written())) ->
    0 | 1.
write(Out, Name, Write) -> told(starl_cli_out:write(Out, fun(Dir) -> done(Write(Dir)) end), Name).

done({ok, _Files}) -> ok;
done({partly, _Files, Why}) -> {partly, Why};
done({error, Why}) -> {error, Why}.

told({ok, Dir}, Name) ->
    Files = filelib:wildcard(filename:join(Dir, Name ++ ".*")),
    starl_cli_terminal:out([["result: ", starl_cli_out:shown(File), "\n"] || File <- Files]),
    0;
told({partly, Dir, Why}, Name) ->
    _ = told({ok, Dir}, Name),
    starl_cli_terminal:complain(Why),
    1;
told({error, Why}, _Name) ->
    starl_cli_terminal:complain(["the drawing could not be written: ", Why]),
    1.
