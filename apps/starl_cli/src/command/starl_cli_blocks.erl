%% @doc `./starl blocks': lists the building blocks with their guarantees, capabilities and options.
-module(starl_cli_blocks).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, subject/2, run/1]).

-spec name() -> string().
name() -> "blocks".

-spec synopsis() -> string().
synopsis() -> "list the building blocks".

-spec argument() -> starl_cli_command:argument().
argument() -> {optional, "BLOCK", [{Name, ""} || {Name, _} <- starl_blocks:known()]}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Lists the building blocks, or tells of one, which may be in a FILE.erl of your own: what it "
        "guarantees, the contracts that judge every run with it, what it can, and its options with "
        "their defaults.",
        {list, "What a block can", [
            {"exercise", "./starl run exercise --block BLOCK, ./starl soak BLOCK"},
            {"check", "./starl check BLOCK"},
            {"bench", "./starl bench blocks"}
        ]}
    ].

-spec subject(string(), [string()]) ->
    {ok, {own, module()}, [string()]} | {error, [unicode:chardata(), ...]}.
subject(File, Args) ->
    case starl_cli_block:own(File, list) of
        {ok, Block, _} -> {ok, {own, Block}, Args};
        {error, _} = Error -> Error
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Subject}) ->
    Width = starl_cli_terminal:columns(),
    starl_cli_terminal:out(lists:join("\n", [shown(Block, Width) || Block <- blocks(Subject)])),
    0.

blocks(none) -> starl_blocks:known();
blocks({own, Block}) -> [{Block, Block}];
blocks(Name) -> [lists:keyfind(Name, 1, starl_blocks:known())].

shown({Name, Block}, Width) ->
    Can = [atom_to_list(What) || What <- [exercise, check, bench], starl_block:can(What, Block)],
    Judges = [starl_monitor:name(Monitor) || Monitor <- starl_block:monitors(Block)],
    [
        wrapped(
            "", [atom_to_list(Name), " (", atom_to_list(Block), "): ", Block:contract()], Width
        ),
        [wrapped("  ", ["contracts: ", lists:join(", ", Judges)], Width) || Judges =/= []],
        [["  can: ", lists:join(", ", Can), "\n"] || Can =/= []],
        [option(Option, Width) || Option <- Block:options()]
    ].

option({Key, Type, Default, Doc}, Width) ->
    Text = io_lib:format("~ts => ~0tp: ~ts; ~ts", [
        Key, Default, Doc, starl_options:type_text(Type)
    ]),
    wrapped("  ", Text, Width).

%% Later lines are indented more than the first.
wrapped(Indent, Text, Width) ->
    [Indent, starl_cli_terminal:wrap(Text, 6, Width), "\n"].
