%% The examples that open the behaviours, compiled and run as they stand there.
-module(starl_header_examples_tests).
-include_lib("eunit/include/eunit.hrl").

%% The first example of a module's header.
example(Behaviour) ->
    Source = proplists:get_value(source, Behaviour:module_info(compile)),
    {ok, Text} = file:read_file(Source),
    [_, Rest] = binary:split(Text, <<"%% ```\n">>),
    [Example, _] = binary:split(Rest, <<"%% '''\n">>),
    Lines = binary:split(Example, <<"\n">>, [global, trim]),
    ?assert(length(Lines) =< 15),
    [[string:slice(Line, 4), $\n] || Line <- Lines].

loaded(Behaviour) ->
    {ok, Tokens, _} = erl_scan:string(
        lists:flatten([binary_to_list(iolist_to_binary(example(Behaviour)))])
    ),
    {ok, Module, Beam} = compile:forms(forms(Tokens, []), [warnings_as_errors]),
    {module, Module} = code:load_binary(Module, "example", Beam),
    Module.

forms([], Forms) ->
    lists:reverse(Forms);
forms(Tokens, Forms) ->
    {Form, [Dot | Rest]} = lists:splitwith(fun(T) -> element(1, T) =/= dot end, Tokens),
    {ok, Parsed} = erl_parse:parse_form(Form ++ [Dot]),
    forms(Rest, [Parsed | Forms]).

an_application_test_() ->
    {timeout, 60, fun() ->
        App = loaded(starl_app),
        {ok, Sim} = starl_sim:start(#{app => App, robots => 3}),
        _ = starl_sim:run(Sim),
        {#{robots := Robots}, _Report} = starl_sim:finish(Sim),
        ?assertEqual([{done, home}], lists:usort([Result || {_, #{result := Result}} <- Robots]))
    end}.

a_machine_test() ->
    Machine = loaded(starl_machine),
    Context = #{
        robot => 1,
        participants => [1],
        name => counter,
        incarnation => 1,
        now => 0,
        random => rand:seed_s(exsss, 1)
    },
    {[], M0} = starl_machine:new(Machine, #{}, Context),
    Meta = #{now => 5, robot => 1},
    {[{trace, {counted, 1}}], M1} = starl_machine:step(cast, increment, Meta, M0),
    ?assertMatch(
        {[{reply, {app, a}, 1}], _}, starl_machine:step({call, {app, a}}, value, Meta, M1)
    ),
    ?assertMatch({[{trace, _}], _}, starl_machine:step(cast, other, Meta, M1)).

a_monitor_test() ->
    Monitor = loaded(starl_monitor),
    Monitors = starl_monitor:new([{Monitor, #{}}]),
    {ok, M1} = starl_monitor:step({1, 1, counter, {counted, 9}}, Monitors),
    ?assertMatch(
        {violation, #{contract := counting, what := ten, at_us := 2, robots := [7]}, _},
        starl_monitor:step({2, 7, counter, {counted, 10}}, M1)
    ).

a_block_test() ->
    [Block, _, _] = [loaded(B) || B <- [starl_block, starl_machine, starl_monitor]],
    ?assert(starl_block:is_block(Block)),
    ?assertMatch(
        {ok, {[{counter, counting_machine, _}], [{counting_monitor, _}]}},
        starl_block:expand([Block], starl_block:example())
    ).
