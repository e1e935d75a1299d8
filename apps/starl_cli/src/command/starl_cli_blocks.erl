%% @doc `./starl blocks': lists the building blocks with their guarantees, capabilities and options.
-module(starl_cli_blocks).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "blocks",
        synopsis => "list the building blocks",
        argument => fun argument/0,
        subject => fun subject/2,
        about => [
            "Lists the building blocks, or tells of one, which may be in a FILE.erl of your own: what it "
            "guarantees, the contracts that judge every run with it, what it can, and its options with "
            "their defaults.",
            {list, "What a block can", [
                {"exercise", "./starl run exercise --block BLOCK, ./starl soak BLOCK"},
                {"check", "./starl check BLOCK"},
                {"bench", "./starl bench blocks"}
            ]},
            "A guarantee is always there, or as long as what it assumes holds: conditions of the world, or "
            "guarantees of other blocks. --compose tells what an application may rely on; with --faults, what "
            "is left while such faults happen.",
            {lines,
                "  ./starl blocks --compose painting \\\n"
                "      --faults clock,loss"}
        ],
        flags => fun flags/1,
        run => fun run/1
    }.

argument() -> {optional, "BLOCK", [{Name, ""} || {Name, _} <- starl_block_catalogue:known()]}.

flags(_Subject) ->
    Names =
        [all | starl_run_fault:classes()] ++
            [Kind || {Kind, _, _, _, _} <- starl_run_fault:kinds()],
    [
        {"Flags", [
            {compose, string, none, "an application: what it may rely on"},
            {faults, {list, {one_of, Names}}, [],
                "with --compose: classes and kinds that may happen; ./starl faults lists them"}
        ]}
    ].

-spec subject(string(), [string()]) ->
    {ok, {own, module()}, [string()]} | {error, [unicode:chardata(), ...]}.
subject(File, Args) ->
    case starl_cli_source:block(File, list) of
        {ok, Block, _} -> {ok, {own, Block}, Args};
        {error, _} = Error -> Error
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := none, values := #{compose := Word, faults := What}}) when Word =/= none ->
    Kinds = lists:usort([Kind || W <- What, {Kind, _, _, _, _} <- starl_run_fault:kinds_of(W)]),
    case starl_cli_target:resolve(Word) of
        {ok, Target} ->
            composed(starl_cli_compose:told(Target, Kinds, starl_cli_terminal:columns()));
        {error, _} = Error ->
            Error
    end;
run(#{values := #{compose := Word}}) when Word =/= none ->
    {error, ["--compose: is for an application, not beside a block"]};
run(#{given := #{faults := _}}) ->
    {error, ["--faults: is for --compose APP"]};
run(#{subject := Subject}) ->
    Width = starl_cli_terminal:columns(),
    starl_cli_terminal:out(lists:join("\n", [shown(Block, Width) || Block <- blocks(Subject)])),
    0.

composed({ok, Text}) ->
    starl_cli_terminal:out(Text),
    0;
composed({error, _} = Error) ->
    Error.

blocks(none) -> starl_block_catalogue:known();
blocks({own, Block}) -> [{Block, Block}];
blocks(Name) -> [lists:keyfind(Name, 1, starl_block_catalogue:known())].

shown({Name, Block}, Width) ->
    Can = [atom_to_list(What) || What <- [exercise, check, bench], starl_block:can(What, Block)],
    Judges = [starl_monitor:name(Monitor) || Monitor <- starl_block:monitors(Block)],
    [
        wrapped(
            "", [atom_to_list(Name), " (", atom_to_list(Block), "): ", Block:contract()], Width
        ),
        [wrapped("  ", ["contracts: ", lists:join(", ", Judges)], Width) || Judges =/= []],
        [guarantee(Guarantee, Width) || Guarantee <- guarantees(Block)],
        [["  can: ", lists:join(", ", Can), "\n"] || Can =/= []],
        [option(Option, Width) || Option <- Block:options()]
    ].

guarantees(Block) ->
    case starl_block:guarantees(Block) of
        {ok, Guarantees} -> Guarantees;
        {error, _} -> []
    end.

guarantee({_, Kind, Says, Assumed}, Width) ->
    Needs = [
        ["; assumes: ", lists:join("; ", [starl_guarantee:text(Need) || Need <- Assumed])]
     || Assumed =/= []
    ],
    wrapped("  ", [atom_to_list(Kind), ": ", Says, Needs], Width).

option({Key, Type, Default, Doc}, Width) ->
    Text = io_lib:format("~ts => ~0tp: ~ts; ~ts", [
        Key, Default, Doc, starl_options:type_text(Type)
    ]),
    wrapped("  ", Text, Width).

%% Later lines are indented more than the first.
wrapped(Indent, Text, Width) ->
    [Indent, starl_cli_terminal:wrap(Text, 6, Width), "\n"].
