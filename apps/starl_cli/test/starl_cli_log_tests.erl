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

written(Table) -> iolist_to_binary([Line || {_, _, Line, _} <- ets:tab2list(Table)]).
