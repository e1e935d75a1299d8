-module(starl_dev_doc_tables_tests).
-include_lib("eunit/include/eunit.hrl").

text(Page) ->
    {ok, Text} = file:read_file(filename:join(starl_cli_target:root(), Page)),
    unicode:characters_to_list(Text).

%% If one of these fails, `./starl doc --tables' writes the page.
a_page_says_what_the_code_says_test_() ->
    [
        {Page, fun() -> ?assertEqual(Text, starl_dev_doc_tables:update(Text)) end}
     || Page <- starl_dev_doc_tables:pages(), Text <- [text(Page)]
    ].

every_block_and_application_with_guarantees_is_on_the_page_test() ->
    Page = text("doc/guarantees.md"),
    Known =
        [Module || {_, Module} <- starl_block_catalogue:known()] ++
            [App || {_, App} <- starl_cli_target:apps()],
    [
        ?assertNotEqual({Module, nomatch}, {Module, string:find(Page, "| " ++ Says ++ " |")})
     || Module <- Known,
        {ok, Guarantees} <- [starl_block:guarantees(Module)],
        {_, _, Says, _} <- Guarantees
    ].

every_kind_of_fault_is_on_the_page_test() ->
    Page = text("doc/faults.md"),
    [
        ?assertNotEqual(
            {Kind, nomatch}, {Kind, string:find(Page, "| `" ++ atom_to_list(Kind) ++ "` |")}
        )
     || {Kind, _, _, _, _} <- starl_run_fault:kinds()
    ].

an_old_table_is_replaced_and_the_text_around_it_is_kept_test() ->
    Text = "Before.\n\n<!-- made from the code: conditions -->\nold\n<!-- end -->\n\nAfter.\n",
    Made = starl_dev_doc_tables:update(Text),
    ?assertEqual(nomatch, string:find(Made, "old")),
    ?assertNotEqual(nomatch, string:find(Made, "clocks run within 1 %")),
    ?assertEqual("Before.\n\n", lists:sublist(Made, 9)),
    ?assertNotEqual(nomatch, string:find(Made, "<!-- end -->\n\nAfter.\n")),
    ?assertEqual(Made, starl_dev_doc_tables:update(Made)).

a_text_without_a_table_stays_test() ->
    ?assertEqual("Text.\n", starl_dev_doc_tables:update("Text.\n")).
