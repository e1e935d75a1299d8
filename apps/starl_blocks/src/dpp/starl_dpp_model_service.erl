%% @doc A small service of the coordinator ({@link starl_dpp_coordinator}) that replaces the planner
%% in the exhaustive checker ({@link starl_dpp}). The check is about which robot leads and may
%% assign, not about paths. As for the planner, each robot's place is known or unknown. A robot that
%% asks for a path gets the answer that there is nothing to do. Whenever the coordinator leads it
%% may act, which the trace shows as `{acts, Term}'. Once all robots are known, it also traces
%% `{assigned, Robot, Id, Segments}'.
-module(starl_dpp_model_service).
-behaviour(starl_dpp_service).

-export([prepare/1, new/2, lead/1, unknown/1, knows/2, silent/2]).
-export([requested/4, reported/4, passed/4, rests/3, serve/1, give_up/1, answered/3]).

-export_type([t/0, event/0]).

%% The trace of the service, in the name of the coordinator.
-type event() ::
    {acts, starl_dpp:term_id()}
    | {coordinator, starl_dpp:term_id()}
    | {assigned, starl:robot_id(), starl_dpp:request_id(), [starl_geometry:segment()]}
    | {silent, starl:robot_id()}.

-record(service, {
    term :: starl_dpp:term_id(),
    unknown :: [starl:robot_id()],
    silent = [] :: [starl:robot_id()],
    leads = false :: boolean(),
    open = false :: boolean(),
    %% the requests that wait
    waiting = [] :: [{starl:robot_id(), starl_dpp:request_id()}]
}).

-opaque t() :: #service{}.
-type turn() :: {t(), [starl_machine:action()]}.

%% @doc The team.
-spec prepare(#{robots := [starl:robot_id()], atom() => term()}) -> [starl:robot_id()].
prepare(#{robots := Team}) -> Team.

%% @doc No robot is known.
-spec new([starl:robot_id()], starl_dpp:term_id()) -> t().
new(Team, Term) -> #service{term = Term, unknown = Team}.

%% @doc The coordinator leads from now on, and may act at any time.
-spec lead(t()) -> turn().
lead(S) ->
    {Opened, Actions} = open(S#service{leads = true}),
    {Opened, Actions ++ [{{timeout, serve}, 0, serve}]}.

%% @doc The robots that are not known.
-spec unknown(t()) -> [starl:robot_id()].
unknown(#service{unknown = Unknown}) -> Unknown.

%% @doc Is the robot known?
-spec knows(starl:robot_id(), t()) -> boolean().
knows(Robot, #service{unknown = Unknown}) -> not lists:member(Robot, Unknown).

%% @doc Was the robot silent until its lease had ended?
-spec silent(starl:robot_id(), t()) -> boolean().
silent(Robot, #service{silent = Silent}) -> lists:member(Robot, Silent).

%% @doc The robot asks for a path.
-spec requested(starl:robot_id(), starl_dpp:request_id(), {starl_geometry:point(), list()}, t()) ->
    turn().
requested(Robot, Id, {_At, _Painted}, #service{waiting = Waiting} = S) ->
    {Known, Actions} = open(
        alive(Robot, S#service{
            waiting = lists:keystore(Robot, 1, Waiting, {Robot, Id})
        })
    ),
    {Told, More} = answer(Known),
    {Told, Actions ++ More}.

%% @doc The robot says where it is.
-spec reported(starl:robot_id(), starl_dpp:request_id(), {starl_dpp:place(), list()}, t()) ->
    turn().
reported(Robot, _Id, {_Place, _Painted}, S) -> opened(alive(Robot, S)).

%% @doc There are no paths to be passed.
-spec passed(starl:robot_id(), starl_dpp:request_id(), pos_integer(), t()) -> turn().
passed(_Robot, _Id, _N, S) -> {S, []}.

%% @doc The robot is silent, and stands.
-spec rests(starl:robot_id(), starl_geometry:point(), t()) -> turn().
rests(Robot, _At, #service{silent = Silent, waiting = Waiting} = S) ->
    Known = known(Robot, S#service{
        silent = lists:usort([Robot | Silent]), waiting = lists:keydelete(Robot, 1, Waiting)
    }),
    {Opened, Actions} = opened(Known),
    {Opened, [{trace, {silent, Robot}} | Actions]}.

%% @doc The coordinator acts.
-spec serve(t()) -> turn().
serve(#service{term = {_, Self, _} = Term, open = Open} = S) ->
    %% a place that no other robot has
    At = {1000.0 * Self, 0.0},
    {S,
        [{trace, {acts, Term}}] ++
            [{trace, {assigned, Self, {1, 1}, [{At, At}]}} || Open] ++
            [{{timeout, serve}, 0, serve}]}.

%% @doc No robot is given up.
-spec give_up(t()) -> turn().
give_up(S) -> {S, []}.

%% @doc The outcome of an answer changes nothing.
-spec answered(starl:robot_id(), ok | lost, t()) -> t().
answered(_Robot, _Outcome, S) -> S.

known(Robot, #service{unknown = Unknown} = S) ->
    S#service{unknown = lists:delete(Robot, Unknown)}.

alive(Robot, #service{silent = Silent} = S) ->
    known(Robot, S#service{silent = lists:delete(Robot, Silent)}).

opened(S) ->
    {Open, Actions} = open(S),
    {Told, More} = answer(Open),
    {Told, Actions ++ More}.

open(#service{leads = true, open = false, unknown = [], term = Term} = S) ->
    {S#service{open = true}, [{trace, {coordinator, Term}}]};
open(S) ->
    {S, []}.

answer(#service{open = true, waiting = Waiting, term = Term} = S) ->
    {S#service{waiting = []}, [
        starl_sap:send(Robot, dpp_answer, {Term, Id, complete, []}, {answered, Term, Robot})
     || {Robot, Id} <- Waiting
    ]};
answer(S) ->
    {S, []}.
