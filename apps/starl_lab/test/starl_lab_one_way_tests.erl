%% A cut of a scenario that lasts, in one direction, on a cluster by UDP: a leader whom nobody hears, and one who hears
%% nobody. The same file runs in the simulator.
-module(starl_lab_one_way_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [start/1, rest/2, in_directory/1]).

-define(PATIENCE_S, 600).

%% The others hear each other: they go on to the end, and nobody is accused.
the_others_go_on_without_a_leader_who_is_cut_off_in_one_direction_test_() ->
    [
        {Name,
            {timeout, ?PATIENCE_S, fun() ->
                in_directory(fun(Dir) ->
                    Cut = {cut, 20000, 3600000, one_way_partition, Group, #{}},
                    File = filename:join(Dir, "one_way.term"),
                    Scenario = #{
                        app => painting, robots => 4, seed => 1, picture => "house", faults => [Cut]
                    },
                    ok = file:write_file(File, io_lib:format("~p.~n", [Scenario])),
                    Out = filename:join(Dir, "out"),
                    Flags = ["--transport", "udp", "--speed", "4", "--out", Out],
                    {Status, Text} = rest(start(["cluster", File | Flags]), ""),
                    %% lines below the robot that is not heard nobody else can paint
                    Ends = #{0 => "painting: complete, 100 %", 4 => "no robot could do more"},
                    ?assert(is_map_key(Status, Ends), Text),
                    ?assertNotEqual(nomatch, string:find(Text, maps:get(Status, Ends)), Text),
                    {ok, [Played]} = file:consult(filename:join(Out, "faults.term")),
                    ?assertMatch([{cut, _, _, one_way_partition, Group, #{}}], Played)
                end)
            end}}
     || {Name, Group} <- [{"mute", [2]}, {"deaf", [1, 3, 4]}]
    ].
