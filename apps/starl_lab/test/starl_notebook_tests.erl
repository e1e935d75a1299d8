%% Teams in a notebook, with a cell that takes outputs as Livebook's do, and one that refuses them.
-module(starl_notebook_tests).
-behaviour(starl_app).
-include_lib("eunit/include/eunit.hrl").

-export([init/2, step/2, measures/0]).

%% A robot drives to and fro; it measures where it was.
init(_Robot, _Options) -> 0.

measures() -> [{at_mm, "where a robot is"}].

step(Robot, 4) ->
    {done, starl:id(Robot)};
step(Robot, N) ->
    {ok, {X, Y, _}} = starl:position(Robot),
    ok = starl:measure(Robot, at_mm, 100 * N),
    _ = starl:go_to(Robot, {X + 500, Y}),
    {continue, N + 1}.

%% A group leader; what it was given goes to the test.
cell(Test) ->
    spawn_link(fun Loop() ->
        receive
            {io_request, From, Ref, {livebook_put_output, Output}} ->
                Test ! {shown, Output},
                From ! {io_reply, Ref, ok},
                Loop()
        end
    end).

%% In a process of its own, whose outputs are its alone.
in_cell(Do) ->
    {Pid, Ref} = spawn_monitor(fun() ->
        group_leader(cell(self()), self()),
        Do()
    end),
    receive
        {'DOWN', Ref, process, Pid, Why} -> ?assertEqual(normal, Why)
    end.

shown() ->
    receive
        {shown, Output} -> Output
    end.

%% Holds: A team's picture moves while no event comes; a team ends with its owner
%% Red: a film's end at the last event: 3 of 5 pictures are the same; an owner that is not watched
a_frame_follows_the_team_test() ->
    in_cell(fun() ->
        Team = starl_notebook:team(?MODULE, #{robots => 2}),
        #{type := frame, ref := Ref, outputs := [#{type := image, content := First}]} = shown(),
        ?assertMatch(<<"<svg", _/binary>>, First),
        #{time_s := 1.0, running := 2, problems := []} = starl_notebook:drive(Team, 1),
        _ = [shown() || _ <- lists:seq(1, 5)],
        %% it drives
        #{time_s := 2.0} = starl_notebook:drive(Team, 1),
        Updates = [shown() || _ <- lists:seq(1, 5)],
        Pictures = [
            Svg
         || #{type := frame_update, ref := R, update := {replace, [#{content := Svg}]}} <- Updates,
            R =:= Ref
        ],
        ?assertEqual(5, length(lists:usort(Pictures))),
        ?assertEqual(lists:last(Pictures), starl_notebook:picture(Team)),
        starl_notebook:finish(Team)
    end).

%% The pictures come while the test waits for them; the last one is of the last second.
a_team_goes_on_in_the_background_test() ->
    in_cell(fun() ->
        Team = starl_notebook:team(?MODULE, #{robots => 1, time => 2}),
        #{type := frame} = shown(),
        ok = starl_notebook:go(Team, 1, 5),
        _ = [#{type := frame_update} = shown() || _ <- lists:seq(1, 5)],
        ?assertMatch(#{time_s := 1.0}, starl_notebook:rest(Team)),
        ok = starl_notebook:go(Team, 100, 50),
        _ = [#{type := frame_update} = shown() || _ <- lists:seq(1, 5)],
        %% the run ends before
        ?assertMatch(#{time_s := 2.0}, starl_notebook:status(Team))
    end).

%% A cell like any other process: it shows nothing, and goes on.
no_notebook_shows_nothing_test() ->
    Team = starl_notebook:team(?MODULE, #{robots => 1}),
    #{digest := Digest, running := 0} = begin
        _ = starl_notebook:drive(Team, 60),
        starl_notebook:finish(Team)
    end,
    {ok, #{digest := Same}} = starl_sim_trial:run(#{app => ?MODULE, robots => 1}),
    ?assertEqual(string:lowercase(binary:encode_hex(Same)), Digest).

%% A program that is defined anew, and crashes on robot 2: all go on with the former one, and the line says why.
%% A module that is no program of the robots is loaded as it is.
a_mistaken_program_is_taken_back_test() ->
    Team = starl_notebook:team(
        defined("step(R, N) -> ok = starl:sleep(R, 100), {continue, N + 1}."), #{
            robots => 2
        }
    ),
    #{problems := []} = starl_notebook:drive(Team, 1),
    ok = starl_notebook:reload(
        defined("step(R, N) -> ok = starl:sleep(R, 100), 1 = starl:id(R), {continue, N}."), Team
    ),
    #{problems := [Line], running := 2} = starl_notebook:drive(Team, 1),
    ?assertMatch(<<"reload 1 (app): ", _/binary>>, Line),
    ?assertNotEqual(
        nomatch, string:find(Line, "ROLLED BACK on robots 1, 2; first on robot 2 (app)")
    ),
    %% a sound one is no problem
    ok = starl_notebook:reload(
        defined("step(R, N) -> ok = starl:sleep(R, 10), {continue, N}."), Team
    ),
    ?assertMatch(#{problems := [Line], running := 2}, starl_notebook:drive(Team, 1)),
    ok = starl_notebook:reload(module(starl_notebook_helper, "f() -> ok."), Team),
    ?assertEqual(ok, starl_notebook_helper:f()),
    _ = starl_notebook:finish(Team).

defined(Step) -> module(starl_notebook_defined, "init(_, _) -> 0.\n" ++ Step).

%% As a cell of Elixir answers.
module(Name, Code) ->
    Text =
        "-module(" ++ atom_to_list(Name) ++ ").\n-compile([export_all, nowarn_export_all]).\n" ++
            Code,
    Forms = [
        begin
            {ok, Tokens, _} = erl_scan:string(Form),
            {ok, Parsed} = erl_parse:parse_form(Tokens),
            Parsed
        end
     || Form <- string:split(Text, "\n", all)
    ],
    {ok, Name, Beam} = compile:forms(Forms, [debug_info]),
    {module, Name, Beam, none}.

a_mistaken_scenario_is_one_line_test() ->
    ?assertError(
        {starl_notebook, <<"robots: ", _/binary>>}, starl_notebook:team(?MODULE, #{robots => 0})
    ),
    ?assertError(
        {starl_notebook, <<"robots: ", _/binary>>},
        starl_notebook:study(#{app => ?MODULE}, #{robots => [0]})
    ).

a_team_ends_with_its_owner_test() ->
    Test = self(),
    {_, Owner} = spawn_monitor(fun() ->
        Test ! {team, starl_notebook:team(?MODULE, #{robots => 1})}
    end),
    Team =
        receive
            {team, Started} -> Started
        end,
    Ref = monitor(process, Team),
    receive
        {'DOWN', Ref, process, Team, Why} -> ?assert(lists:member(Why, [normal, noproc]))
    end,
    receive
        {'DOWN', Owner, process, _, _} -> ok
    end.

a_study_has_a_row_for_each_combination_test() ->
    Rows = starl_notebook:study(#{app => ?MODULE}, #{robots => [1, 2], seed => [1, 2, 3]}),
    ?assertEqual(
        [{R, S, true, 0, 150.0} || R <- [1, 2], S <- [1, 2, 3]],
        [
            {R, S, Complete, Violations, At}
         || #{robots := R, seed := S, complete := Complete, violations := Violations, at_mm := At} <-
                Rows
        ]
    ),
    in_cell(fun() ->
        ok = starl_notebook:table(Rows),
        #{type := markdown, text := <<"| at_mm | complete | robots |", _/binary>>} = shown(),
        Svg = starl_notebook:plot(Rows, seed, seconds, robots),
        #{type := image, content := Svg} = shown(),
        ?assertEqual(3, length(string:split(Svg, "<polyline", all))),
        ?assertEqual(3, length(string:split(Svg, "<polygon", all)))
    end).

%% mix compiles the folders of the notebooks and of films without the rest of their application.
mix_has_all_that_the_modules_call_test() ->
    _ = application:load(starl_notebook),
    _ = application:load(starl_lab),
    {ok, Needed} = application:get_key(starl_notebook, applications),
    {ok, Modules} = application:get_key(starl_lab, modules),
    Own = [
        M
     || M <- Modules,
        Folder <- ["starl_notebook", "starl_film"],
        lists:prefix(Folder, atom_to_list(M))
    ],
    ?assertEqual([], [starl_notebook, starl_film] -- Own),
    Known = lists:append([[erlang | Own] | [modules(A) || A <- Needed, A =/= starl_lab]]),
    ?assertEqual([], [{M, Called} || M <- Own, Called <- called(M) -- Known]).

modules(App) ->
    _ = application:load(App),
    {ok, Modules} = application:get_key(App, modules),
    Modules.

called(Module) ->
    {ok, {Module, [{imports, Calls}]}} = beam_lib:chunks(code:which(Module), [imports]),
    lists:usort([Called || {Called, _, _} <- Calls]).
