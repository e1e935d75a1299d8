%% @doc Runs teams of robots in a notebook (Livebook), or in any Elixir shell. One cell defines the
%% program, and another drives the team. A cell that redefines the program changes it while the
%% robots drive.
%% ```
%%   team =
%%     defmodule Dance do
%%       use Starl.App
%%       ...
%%     end
%%     |> :starl_notebook.team(%{robots: 20})
%%
%%   :starl_notebook.drive(team, 10)       # ten seconds on, in virtual time
%%   :starl_notebook.go(team, 60)          # a minute in real time, in the background
%% '''
%% A module that compiles with `@compile {:autoload, false}' is loaded not where it is defined, but
%% by {@link team/2} and {@link reload/2}, so that no robot ends in the middle of a step. A
%% redefined program is on trial ({@link starl_sim:reload/2}). A module that the program calls by
%% its name as a value, `group.next(...)', replaces its former definition at once: a second version
%% would have another name, and nobody would call it.
%%
%% The picture of a team is an output of the cell that has made the team, and of each cell that
%% calls {@link show/1}. Outside a notebook, nothing is shown.
-module(starl_notebook).

-export([team/2, drive/2, go/2, go/3, rest/1, reload/2, show/1, status/1, picture/1, finish/1]).
-export([study/2, table/1, plot/4]).

-export_type([defined/0, row/0]).

%% A module, or what the definition of one answers in Elixir.
-type defined() :: module() | {module, module(), Beam :: binary(), term()}.

%% A run of a study: the values that were varied, and the run's.
-type row() :: #{atom() => term()}.

%% @doc Makes a team at the beginning of its run. `Scenario' has the keys of every scenario but
%% `app'. A mistake in it raises an error with one line that explains it.
-spec team(defined(), #{atom() => term()}) -> pid().
team(Defined, Scenario) ->
    App = loaded(Defined),
    case starl_notebook_team:start(Scenario#{app => App}) of
        {ok, Team} ->
            ok = show(Team),
            Team;
        {error, Reason} ->
            error({starl_notebook, text(starl_sim:format_error(Reason))})
    end.

loaded({module, Module, Beam, _}) ->
    case starl_code:load(Module, atom_to_list(Module), Beam) of
        ok -> Module;
        waits -> error({starl_notebook, busy(Module)});
        {error, Reason} -> error({starl_notebook, text(starl_code:format_error(Reason))})
    end;
loaded(Module) when is_atom(Module) ->
    Module.

busy(Module) ->
    text([atom_to_list(Module), ": an earlier team still runs its last version; finish that team"]).

%% @doc Drives a team on for some seconds of virtual time, as fast as its pictures are drawn.
-spec drive(pid(), Seconds :: number()) -> starl_notebook_team:status().
drive(Team, Seconds) -> starl_notebook_team:drive(Team, Seconds).

%% @doc The same in real time and in the background, so that other cells can be evaluated meanwhile.
-spec go(pid(), Seconds :: number()) -> ok.
go(Team, Seconds) -> go(Team, Seconds, 1).

%% @doc The same at another speed, as a multiple of real time.
-spec go(pid(), Seconds :: number(), Speed :: number()) -> ok.
go(Team, Seconds, Speed) -> starl_notebook_team:go(Team, Seconds, Speed).

%% @doc Pauses a team that goes on in the background.
-spec rest(pid()) -> starl_notebook_team:status().
rest(Team) -> starl_notebook_team:rest(Team).

%% @doc Gives a team new code. Each robot uses it from its next step on. If it fails on one robot
%% within five seconds, all robots go back to the former code, and {@link status/1} reports that.
-spec reload(defined(), pid()) -> ok.
reload(Defined, Team) ->
    case {starl_notebook_team:reload(Team, code_of(Defined)), Defined} of
        {ok, _} ->
            ok;
        {{error, {reload, {no_part, _}}}, {module, Module, _, _}} ->
            Module = loaded(Defined),
            ok;
        {{error, Reason}, _} ->
            error({starl_notebook, text(starl_sim:format_error(Reason))})
    end.

code_of({module, Module, Beam, _}) -> {Module, atom_to_list(Module), Beam};
code_of(Module) -> Module.

%% @doc Shows a team in the cell that asks for it.
-spec show(pid()) -> ok.
show(Team) -> starl_notebook_team:show(Team, group_leader()).

%% @doc The status of a team: its time, the robots that are still at work, and what went wrong, a
%% line each.
-spec status(pid()) -> starl_notebook_team:status().
status(Team) -> starl_notebook_team:status(Team).

%% @doc The picture of a team, as SVG.
-spec picture(pid()) -> binary().
picture(Team) -> starl_notebook_team:picture(Team).

%% @doc Ends a team's run, and returns its digest, which is the same each time for the same scenario
%% and program.
-spec finish(pid()) -> starl_notebook_team:status().
finish(Team) -> starl_notebook_team:finish(Team).

%% @doc Runs a scenario with each combination of values ({@link starl_notebook_study:rows/2}).
-spec study(#{app := module(), atom() => term()}, #{atom() => [term(), ...]}) -> [row(), ...].
study(Scenario, Varied) -> starl_notebook_study:rows(Scenario, Varied).

%% @doc Shows rows as a table.
-spec table([row(), ...]) -> ok.
table(Rows) -> starl_notebook_output:markdown(starl_notebook_study:markdown(Rows), group_leader()).

%% @doc Plots medians and ranges over one of the varied values, with a curve for each value of
%% another; `none': one curve. Returns the plot as SVG.
-spec plot([row(), ...], X :: atom(), Y :: atom(), Curves :: atom()) -> binary().
plot(Rows, X, Y, Curves) ->
    Svg = starl_notebook_study:svg(Rows, X, Y, Curves),
    ok = starl_notebook_output:image(Svg, group_leader()),
    Svg.

text(Chars) -> unicode:characters_to_binary(Chars).
