%% @doc A robot's own record of its place, its progress on its path and the painted edges. The
%% robot's report to a new coordinator is made from it. Pure.
-module(starl_dpp_progress).

-export([new/1, lost/1, halted/2, stands/2, at/1]).
-export([begins/2, reached/3, blocked/2, last/1, is_report_due/1, reported/1, place/2]).
-export([painted/1, request/4, answered/2]).
-export_type([t/0, where/0]).

-type edge_id() :: starl_dpp_graph:edge_id().
%% On its way on a path, or not.
-type where() ::
    standing
    | asking
    | {moving, starl_dpp:request_id(), From :: starl_geometry:point(), starl_dpp_plan:path()}.

%% The distance that the robot drives before it reports that the space behind it is free.
-define(REPORT_MM, 400.0).

-record(track, {
    %% the distance from its path within which the robot counts as on it
    slack :: float(),
    %% the place at which the robot last certified to stand, and the point of its reservation that
    %% this counts as
    at = unknown :: starl_geometry:point() | unknown,
    nominal = unknown :: starl_geometry:point() | unknown,
    %% its reservation when it was last stopped
    line = [] :: [starl_geometry:segment()],
    %% waypoints passed, the last one's place, and the distance driven since the last report
    passed = 0 :: non_neg_integer(),
    last = {0.0, 0.0} :: starl_geometry:point(),
    unreported_mm = 0.0 :: float(),
    %% the end of the line on which something was in its way, until that is told
    blocked = none :: starl_geometry:point() | none,
    %% own painted edges that no answered request has reported yet, and all other edges that are
    %% known to be painted
    fresh = [] :: [edge_id()],
    painted = [] :: [edge_id()]
}).
-opaque t() :: #track{}.

%% @doc Nothing is known yet.
-spec new(Slack :: float()) -> t().
new(Slack) -> #track{slack = Slack}.

%% @doc The robot's place has to be looked at again.
-spec lost(t()) -> t().
lost(Track) -> Track#track{at = unknown}.

%% @doc The robot is stopped.
-spec halted(where(), t()) -> t().
halted({moving, _, _, _} = Moving, Track) ->
    {moving, _, From, Path} = place(Moving, Track),
    lost(Track#track{line = segments(From, Path)});
halted(_Where, Track) ->
    lost(Track).

segments(From, []) -> [{From, From}];
segments(From, [{Point, _} | Path]) -> [{From, Point} | segments(Point, Path)].

%% @doc The robot, stopped, is seen at a point. As in the plan: near its reservation, it counts as
%% standing on it.
-spec stands(starl_geometry:point(), t()) -> t().
stands(At, #track{line = Line, slack = Slack} = Track) ->
    Nominal = starl_dpp_unsafe:nominal(At, Line, Slack),
    Track#track{at = At, nominal = Nominal, line = [{Nominal, Nominal}]}.

%% @doc The point where the robot was last seen to stand.
-spec at(t()) -> starl_geometry:point() | unknown.
at(#track{at = At}) -> At.

%% @doc It begins a path at this point.
-spec begins(starl_geometry:point(), t()) -> t().
begins(From, Track) -> Track#track{passed = 0, last = From, unreported_mm = 0.0}.

%% @doc It has reached the N-th waypoint.
-spec reached(N :: pos_integer(), starl_dpp_plan:waypoint(), t()) -> t().
reached(N, {Point, Pen}, #track{last = Last, unreported_mm = Mm} = Track) ->
    paint(Pen, Track#track{
        passed = N, last = Point, unreported_mm = Mm + starl_geometry:distance(Last, Point)
    }).

paint(up, Track) ->
    Track;
paint({down, Edge}, #track{fresh = Fresh} = Track) ->
    Track#track{fresh = lists:umerge([Edge], Fresh)}.

%% @doc The waypoint that it reached last, or where its path begins.
-spec last(t()) -> starl_geometry:point().
last(#track{last = Last}) -> Last.

%% @doc An obstacle stopped the robot on the line to this point.
-spec blocked(starl_geometry:point(), t()) -> t().
blocked(Towards, Track) -> Track#track{blocked = Towards}.

%% @doc Has it driven so far since the last report to the coordinator that it is to report again?
-spec is_report_due(t()) -> boolean().
is_report_due(#track{unreported_mm = Mm}) -> Mm >= ?REPORT_MM.

%% @doc The coordinator gets a report.
-spec reported(t()) -> t().
reported(Track) -> Track#track{unreported_mm = 0.0}.

%% @doc The robot's place for a new coordinator, with the rest of its path.
-spec place(where(), t()) -> starl_dpp:place().
place({moving, _Id, From, Path}, #track{passed = 0}) ->
    {moving, 0, From, Path};
place({moving, _Id, _, Path}, #track{passed = N, last = Last}) ->
    {moving, N, Last, lists:nthtail(N, Path)};
place(_Where, #track{nominal = Nominal}) when Nominal =/= unknown -> {standing, Nominal}.

%% @doc All edges known to be painted, sorted.
-spec painted(t()) -> [edge_id()].
painted(#track{painted = Painted, fresh = Fresh}) -> lists:umerge(Fresh, Painted).

%% @doc The request of a robot that stands at a known place. It carries its own painted edges that
%% no answered request has reported, and the obstacle that stopped it ({@link starl_dpp_message}).
-spec request(starl_dpp:term_id(), starl_dpp:request_id(), Stamp :: integer(), t()) -> tuple().
request(Term, Id, Stamp, #track{at = At, fresh = Fresh, blocked = none}) ->
    {Term, Id, At, Fresh, Stamp};
request(Term, Id, Stamp, #track{at = At, fresh = Fresh, blocked = Towards}) ->
    {Term, Id, At, Fresh, Stamp, Towards}.

%% @doc A request was answered; these edges, sorted, are painted, too.
-spec answered([edge_id()], t()) -> t().
answered(News, Track) ->
    #track{fresh = Fresh} = Known = learn(News, Track),
    learn(Fresh, Known#track{fresh = [], blocked = none}).

learn([], Track) ->
    Track;
learn(Edges, #track{painted = Painted} = Track) ->
    Track#track{painted = lists:umerge(Edges, Painted)}.
