%% @doc Finds building blocks by their names. An application of OTP lists its blocks in its `.app' file ({@link
%% starl_catalogue}): to add a block, add one line there and a folder with its modules ({@link starl_block}).
-module(starl_block_catalogue).

-export([known/0, find/1, name/1, able/1, models/0, histories/0, histories/1]).

%% @doc The blocks with the names that they have on the command line, in the order of lists.
-spec known() -> [{Name :: atom(), module()}].
known() -> starl_catalogue:listed(starl_blocks).

%% @doc The block of a name: one that an application lists, or a user's own module that is loaded.
-spec find(atom()) -> {ok, module()} | error.
find(Name) ->
    case lists:keyfind(Name, 1, known()) of
        {Name, Block} -> {ok, Block};
        false -> own(Name, starl_block:is_block(Name))
    end.

own(Block, true) -> {ok, Block};
own(_Name, false) -> error.

%% @doc The name of a block; that of a user's own is its module's.
-spec name(module()) -> atom().
name(Block) ->
    case lists:keyfind(Block, 2, known()) of
        {Name, Block} -> Name;
        false -> Block
    end.

%% @doc The names of the blocks that can be exercised, checked, or measured.
-spec able(starl_block:capability()) -> [atom()].
able(What) -> [Name || {Name, Block} <- known(), starl_block:can(What, Block)].

%% @doc The models of all blocks, for the checker.
-spec models() -> [starl_block:model_entry()].
models() ->
    lists:append([Block:models() || {_, Block} <- known(), starl_block:can(check, Block)]).

%% @doc What the blocks promise their callers, for histories ({@link starl_history_model}).
-spec histories() -> [module()].
histories() -> [Block:history() || {_, Block} <- known(), starl_block:can(history, Block)].

%% @doc The same, with what those of these modules promise that are a user's own blocks.
-spec histories([module()]) -> [module()].
histories(Modules) ->
    Own = [Block || Block <- lists:usort(Modules), {ok, Block} =:= find(Block)],
    histories() ++ [Block:history() || Block <- Own, starl_block:can(history, Block)].
