%% The report of ./starl test: a line for each module, failures with their places, the count.
-module(starl_dev_eunit_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MODULE_UNDER, starl_dev_eunit_sample).

reported(Source) ->
    {ok, Tokens, _} = erl_scan:string(Source),
    {ok, ?MODULE_UNDER, Beam} = compile:forms(forms(Tokens, [], []), [debug_info]),
    {module, _} = code:load_binary(?MODULE_UNDER, "sample", Beam),
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() ->
        true = group_leader(sink(), self()),
        Result = eunit:test(?MODULE_UNDER, [no_tty, {report, {starl_dev_eunit, []}}]),
        group_leader() ! {said, Self, Result}
    end),
    receive
        {'DOWN', Ref, process, Pid, normal} -> ok
    end,
    _ = code:purge(?MODULE_UNDER),
    _ = code:delete(?MODULE_UNDER),
    receive
        {text, Result, Text} -> {Result, lists:flatten(Text)}
    end.

forms([], [], Forms) ->
    lists:reverse(Forms);
forms([{dot, _} = Dot | Tokens], Form, Forms) ->
    {ok, Parsed} = erl_parse:parse_form(lists:reverse([Dot | Form])),
    forms(Tokens, [], [Parsed | Forms]);
forms([Token | Tokens], Form, Forms) ->
    forms(Tokens, [Token | Form], Forms).

sink() -> spawn(fun() -> sink([]) end).

sink(Said) ->
    receive
        {said, To, Result} ->
            To ! {text, Result, unicode:characters_to_list(lists:reverse(Said))};
        {io_request, From, Tag, {put_chars, unicode, Text}} ->
            From ! {io_reply, Tag, ok},
            sink([Text | Said]);
        {io_request, From, Tag, {put_chars, unicode, M, F, A}} ->
            From ! {io_reply, Tag, ok},
            sink([apply(M, F, A) | Said]);
        {io_request, From, Tag, _} ->
            From ! {io_reply, Tag, {error, enotsup}},
            sink(Said)
    end.

contains(Part, Text) -> ?assertNotEqual({nomatch, Text}, {string:find(Text, Part), Text}).

-define(HEAD, "-module(starl_dev_eunit_sample). -export([a_test/0, b_test/0]). ").

passed_test() ->
    {Result, Text} = reported(?HEAD "a_test() -> ok. b_test() -> ok."),
    ?assertEqual(ok, Result),
    contains("starl_dev_eunit_sample: 2 passed, ", Text),
    contains("2 tests, 0 failures, 0 skipped, 0 cancelled\n", Text),
    ?assertEqual(nomatch, string:find(Text, "FAILED")).

failed_test() ->
    {Result, Text} = reported(?HEAD "a_test() -> ok. b_test() -> error(wrong)."),
    ?assertEqual(error, Result),
    contains("FAILED starl_dev_eunit_sample:b_test", Text),
    contains("wrong", Text),
    contains("starl_dev_eunit_sample: 1 passed, 1 FAILED, ", Text),
    contains("2 tests, 1 failures, 0 skipped, 0 cancelled\n", Text).
