%% Names of pictures, options and directories reach other programs' languages as one line of text.
%%
%% Holds: Names reach gnuplot and Slurm as one line of text
%% Red: 961f67c9: a command
-module(starl_lab_sweep_script_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NAME, "house\n!touch /tmp/x\r`id`'\n#").

%% gnuplot takes a line that begins with ! for a command of sh.
a_name_with_an_end_of_line_is_no_command_of_gnuplot_test() ->
    Curve = {?NAME, [{1, 2.0, 1.0, 3.0}, {2, 2.0, 1.0, 3.0}]},
    Script = unicode:characters_to_list(
        starl_lab_sweep_plot:script(#{
            title => ?NAME, x => ?NAME, panels => [#{y => ?NAME, curves => [Curve, Curve]}]
        })
    ),
    Lines = string:split(Script, "\n", all),
    ?assertEqual([], [Line || Line <- Lines, begins(string:trim(Line, leading), "!")]),
    ?assertEqual([], [Line || Line <- Lines, begins(string:trim(Line, leading), "#'")]),
    ?assertEqual(nomatch, string:find(Script, "\r")).

%% Behind a line of #SBATCH sh takes the next line for a command.
a_name_with_an_end_of_line_is_no_command_of_slurm_test() ->
    Study = #{
        words => ["painting"], parts => 2, jobs => 1, starl => "/opt/starl", cwd => ?NAME
    },
    [
        begin
            [First | Lines] = string:split(unicode:characters_to_list(Script), "\n", all),
            ?assertEqual("#!/bin/sh", First),
            {Head, _} = lists:splitwith(fun(Line) -> begins(Line, "#SBATCH --") end, Lines),
            ?assert(length(Head) >= 3),
            ?assertEqual([], [Line || Line <- Lines, begins(Line, "!touch")])
        end
     || {_File, Script} <- starl_lab_slurm:scripts(Study, "out/house")
    ].

begins(Line, Text) -> lists:prefix(Text, Line).
