%% @doc Loads a user's building block, given as Erlang source on the command line.
-module(starl_cli_block).

-export([own/2]).

-type answer() ::
    {ok, module(), [starl_cli_target:code(), ...]} | {error, [unicode:chardata(), ...]}.

%% @doc Loads the block in a file, which must have this capability (`list': no capability needed).
-spec own(file:filename(), starl_block:capability() | list) -> answer().
own(File, What) -> loaded(File, starl_cli_source:modules(File), What).

loaded(File, {ok, Module, Codes}, What) ->
    case {starl_block:is_block(Module), What =:= list orelse starl_block:can(What, Module)} of
        {true, true} ->
            {ok, Module, Codes};
        {true, false} ->
            {error, [
                [File, ": this block does not say how: it exports no ", callback(What), "/0"]
            ]};
        {false, _} ->
            {error, [[File, ": this is no building block: a block has the behaviour starl_block"]]}
    end;
loaded(_File, {error, _} = Error, _What) ->
    Error.

callback(exercise) -> "exercise";
callback(check) -> "models";
callback(bench) -> "benchmark".
