%% @doc Writes the tables of the guides that follow from the code: guarantees, kinds of faults, and the
%% tests that hold promises.
%%
%% A guide has such a table between two lines:
%% ```
%%   <!-- made from the code: guarantees -->
%%   ...
%%   <!-- end -->
%% '''
%% `./starl doc --tables' writes what stands between them.
-module(starl_dev_doc_tables).

-export([pages/0, update/1]).

%% Each part of the page of guarantees: its title, its own page, and who gives the guarantees.
-define(PARTS, [
    {"Reliable messages (SAP)", "../apps/starl_platform/doc/sap.md", starl_sap_block},
    {"Election by randomized ballots", "../apps/starl_blocks/doc/election.md", starl_election},
    {"Election, bully", "../apps/starl_blocks/doc/election.md#bully", starl_bully},
    {"Mutual exclusion", "../apps/starl_blocks/doc/mutex.md", starl_mutex},
    {"Barrier", "../apps/starl_blocks/doc/barrier.md", starl_barrier},
    {"Geocast", "../apps/starl_blocks/doc/geocast.md", starl_geocast},
    {"Registers", "../apps/starl_blocks/doc/registers.md", starl_registers},
    {"Counter that only grows", "../apps/starl_blocks/doc/counter.md", starl_counter},
    {"Motion", "../apps/starl_platform/doc/motion.md", starl_motion_block},
    {"Actuators", "../apps/starl_platform/doc/motion.md", starl_actuator},
    {"Path planning (DPP)", "../apps/starl_blocks/doc/dpp.md", starl_dpp},
    {"Painting", "../apps/starl_apps/doc/painting.md", starl_painting},
    {"Search", "../apps/starl_apps/doc/search.md", starl_search},
    {"Formation", "../apps/starl_apps/doc/teams.md", starl_formation},
    {"Follow the leader", "../apps/starl_apps/doc/teams.md", starl_follow},
    {"Swarm", "../apps/starl_apps/doc/teams.md", starl_swarm},
    {"Intersection", "../apps/starl_apps/doc/teams.md", starl_crossing},
    {"Convoy", "../apps/starl_apps/doc/teams.md", starl_convoy}
]).

%% @doc The guides with tables that follow from the code, relative to the root of the checkout.
-spec pages() -> [file:filename()].
pages() -> ["doc/guarantees.md", "doc/faults.md", "doc/evidence.md"].

%% @doc A guide's text with its tables made anew.
-spec update(Text :: string()) -> string().
update(Text) ->
    lists:flatten(tables(string:split(Text, "<!-- made from the code: "))).

tables([Before]) ->
    Before;
tables([Before, From]) ->
    [Name, Rest] = string:split(From, " -->"),
    [_Old, After] = string:split(Rest, "<!-- end -->"),
    [
        [Before, "<!-- made from the code: ", Name, " -->\n\n"],
        [table(Name), "\n<!-- end -->"],
        tables(string:split(After, "<!-- made from the code: "))
    ].

table("conditions") ->
    [
        "| condition | broken by |\n| --- | --- |\n"
        | [
            row([Says, breakers(Condition)])
         || {Condition, Says} <- starl_guarantee:conditions()
        ]
    ];
table("guarantees") ->
    lists:join("\n", [part(Part) || Part <- ?PARTS]);
table("faults") ->
    lists:join("\n", [class(Class) || Class <- starl_run_fault:classes()]);
table("evidence") ->
    starl_dev_doc_evidence:table().

breakers(Condition) ->
    lists:join(", ", [
        code(Kind)
     || Kind <- starl_run_condition:breakers(Condition, [
            Kind
         || {Kind, _, _, _, _} <- starl_run_fault:kinds()
        ])
    ]).

%% -- guarantees -------------------------------------------------------------------------------

part({Title, Page, Module}) ->
    {ok, Guarantees} = starl_block:guarantees(Module),
    [
        ["## ", Title, "\n\n[Its page](", Page, ").\n\n"],
        "| | guarantee | as long as |\n| --- | --- | --- |\n",
        [
            row([kind(Kind), escaped(Says), needs(Needs)])
         || Wanted <- [safety, progress], {_, Kind, Says, Needs} <- Guarantees, Kind =:= Wanted
        ]
    ].

kind(safety) -> "always";
kind(progress) -> "in the end".

needs([]) -> "under every fault";
needs(Needs) -> escaped(lists:join("; ", [need(Need) || Need <- Needs])).

need({Block, Guarantee}) when Block =/= any ->
    io_lib:format("~ts: *~ts*", [Block, says(Guarantee, element(2, guaranteed(Block)))]);
need(Condition) ->
    starl_guarantee:text(Condition).

guaranteed(Block) ->
    {Block, Module} = lists:keyfind(Block, 1, starl_block_catalogue:known()),
    starl_block:guarantees(Module).

says(Guarantee, Guarantees) ->
    {Guarantee, _, Says, _} = lists:keyfind(Guarantee, 1, Guarantees),
    Says.

%% -- faults -----------------------------------------------------------------------------------

class(Class) ->
    [
        ["## ", atom_to_list(Class), "\n\n"],
        "| kind | hits | parameters | what happens | in real time |\n| --- | --- | --- | --- | --- |\n",
        [fault(Kind) || Kind <- starl_run_fault:kinds_of(Class)]
    ].

fault({Kind, _Class, Target, Params, Doc}) ->
    row([
        code(Kind),
        atom_to_list(Target),
        escaped(lists:join(", ", [parameter(Key, Type) || {Key, Type, _} <- Params])),
        escaped(Doc),
        starl_cli_faults:worlds(Kind)
    ]).

parameter(Key, Type) -> [code(Key), " ", starl_cli_faults:values(Key, Type)].

%% -- Markdown -----------------------------------------------------------------------------------

row(Cells) -> ["| ", lists:join(" | ", Cells), " |\n"].

code(Name) -> ["`", atom_to_list(Name), "`"].

escaped(Text) -> string:replace(lists:flatten(Text), "|", "\\|", all).
