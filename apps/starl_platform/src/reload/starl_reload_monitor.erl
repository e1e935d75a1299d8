%% @doc Collects the results of a run's reloads for its report. It judges nothing.
-module(starl_reload_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, format/1, is_back/1]).

-export_type([reload/0]).

%% A reload: the machines that it concerns; the robots that have taken the new code; those that have
%% gone back, or could not take it; and the first failure, with its time.
-type reload() :: #{
    number := starl_reload:count(),
    machines := [starl_machine:name(), ...],
    taken := [starl:robot_id()],
    back := [starl:robot_id()],
    why :=
        {
            AtUs :: integer(), starl:robot_id(), starl_machine:name(), starl_reload:outcome()
        }
        | none
}.

%% The reports on each reload, the latest first.
-type state() :: #{starl_reload:count() => [report(), ...]}.

-type report() :: {
    AtUs :: integer(), starl:robot_id(), starl_machine:name(), starl_reload:outcome()
}.

%% The number of robots that a line names.
-define(NAMED, 5).

%% @doc Nothing has been reloaded yet.
-spec init(#{}) -> state().
init(#{}) -> #{}.

%% @doc Records the reports on reloads.
-spec step(starl_monitor:trace_event(), state()) -> {ok, state()}.
step({At, Robot, Name, {reloaded, N, Outcome}}, Reports) ->
    {ok, Reports#{N => [{At, Robot, Name, Outcome} | maps:get(N, Reports, [])]}};
step(_Event, Reports) ->
    {ok, Reports}.

%% @doc The reloads, in their order.
-spec finish(integer(), state()) -> {ok, #{reloads := [reload()]}}.
finish(_EndUs, Reports) ->
    {ok, #{
        reloads => [reload(N, lists:reverse(All)) || {N, All} <- lists:sort(maps:to_list(Reports))]
    }}.

reload(N, All) ->
    Last = maps:from_list([{{Robot, Name}, Outcome} || {_, Robot, Name, Outcome} <- All]),
    Failures = [One || {_, _, _, Outcome} = One <- All, starl_reload:is_failure(Outcome)],
    #{
        number => N,
        machines => lists:usort([Name || {_, _, Name, _} <- All]),
        taken => lists:usort([Robot || {_, Robot, _, taken} <- All]),
        back => lists:usort([Robot || {{Robot, _}, O} <- maps:to_list(Last), is_way_back(O)]),
        why => hd(Failures ++ [none])
    }.

is_way_back(taken) -> false;
is_way_back(done) -> false;
is_way_back(_) -> true.

%% @doc Was it rolled back?
-spec is_back(reload()) -> boolean().
is_back(#{back := Back}) -> Back =/= [].

%% @doc One line on a reload.
-spec format(reload()) -> unicode:chardata().
format(#{number := N, machines := Machines, taken := Taken, back := Back, why := Why}) ->
    Names = lists:join(", ", [atom_to_list(Name) || Name <- Machines]),
    [io_lib:format("reload ~b (~ts): ", [N, Names]), taken(Taken), back(Back), why(Why)].

taken([]) -> "taken by no robot";
taken(Robots) -> ["taken by ", robots(Robots)].

back([]) -> "";
back(Robots) -> ["; ROLLED BACK on ", robots(Robots)].

robots([Robot]) ->
    io_lib:format("robot ~b", [Robot]);
robots(Robots) when length(Robots) > ?NAMED ->
    {Named, Others} = lists:split(?NAMED, Robots),
    [robots(Named), io_lib:format(" and ~b more", [length(Others)])];
robots(Robots) ->
    ["robots ", lists:join(", ", [integer_to_list(Robot) || Robot <- Robots])].

why(none) ->
    "";
why({At, Robot, Name, Outcome}) ->
    Reason = starl_reload:reason(Outcome),
    io_lib:format("; first on robot ~b (~ts) at ~.3f s: ~ts", [Robot, Name, At / 1.0e6, Reason]).
