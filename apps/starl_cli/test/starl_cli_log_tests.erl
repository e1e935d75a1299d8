%% What run.log holds.
-module(starl_cli_log_tests).
-include_lib("eunit/include/eunit.hrl").

%% A line of a robot's process names the robot.
a_line_names_its_robot_test() ->
    Table = ets:new(log, [set, public]),
    ok = logger:add_handler(?MODULE, starl_cli_log, #{config => Table}),
    Old = maps:get(level, logger:get_primary_config()),
    ok = logger:set_primary_config(level, notice),
    {_, Ref} = spawn_monitor(fun() ->
        logger:set_process_metadata(#{robot => 3}),
        logger:warning(#{what => create, why => <<"no cable">>})
    end),
    receive
        {'DOWN', Ref, _, _, _} -> ok
    end,
    ok = logger:remove_handler(?MODULE),
    ok = logger:set_primary_config(level, Old),
    Lines = written(Table),
    ?assertNotEqual(nomatch, string:find(Lines, "warning: robot 3: ")),
    ?assertNotEqual(nomatch, string:find(Lines, "no cable")).

%% So does a line of a robot's node, once.
a_line_of_a_node_names_its_robot_once_test() ->
    ok = logger:add_handler(starl_cli_log, starl_cli_log, #{
        config => ets:new(log, [set, public])
    }),
    ok = starl_cli_log:node(2, warning, <<"no cable">>),
    ok = starl_cli_log:node(1, warning, <<"robot 1 stands 250 mm from robot 2">>),
    Lines = starl_cli_log:lines(),
    ok = logger:remove_handler(starl_cli_log),
    ?assertEqual(
        [<<"robot 2: no cable\n">>, <<"robot 1 stands 250 mm from robot 2\n">>],
        [unicode:characters_to_binary(Line) || Line <- Lines]
    ).

%% Who stands where it must not is named at once, on the terminal: nobody waits for it in vain.
%% Holds: Live robots that stand nearer to each other than …: and a run in one VM says it on the
%% terminal at once
%% Red: without its line in `starl_cli_log`, run
who_stands_badly_is_said_at_once_test() ->
    Table = ets:new(log, [set, public]),
    Line = <<"robot 1 stands 250 mm from robot 2">>,
    Event = #{
        level => error, msg => {report, #{what => badly_placed, why => Line}}, meta => #{time => 0}
    },
    {Pid, Ref} = spawn_monitor(fun() ->
        receive
            go -> starl_cli_log:log(Event, #{config => Table})
        end
    end),
    {module, _} = code:ensure_loaded(starl_cli_progress),
    1 = erlang:trace(Pid, true, [call]),
    1 = erlang:trace_pattern({starl_cli_progress, note, 1}, true, []),
    Pid ! go,
    receive
        {'DOWN', Ref, _, _, normal} -> ok
    end,
    Delivered = erlang:trace_delivered(Pid),
    receive
        {trace_delivered, Pid, Delivered} -> ok
    end,
    _ = erlang:trace_pattern({starl_cli_progress, note, 1}, false, []),
    receive
        {trace, Pid, call, {starl_cli_progress, note, [Said]}} -> ?assertEqual(Line, Said)
    after 0 -> error(not_said)
    end,
    ?assertNotEqual(<<>>, written(Table)).

written(Table) -> iolist_to_binary([Line || {_, _, Line, _} <- ets:tab2list(Table)]).
