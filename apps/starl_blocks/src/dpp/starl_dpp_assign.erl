%% @doc Makes the coordinator's decisions: which robot gets work, which robot makes room, and how a
%% deadlock ends. {@link starl_dpp_plan} keeps the state.
%%
%% The run is over in two cases. Either a request is answered `complete', or no robot moves, every
%% request is answered `none' and {@link resolve/2} returns `[]'. In the second case, robots that no
%% longer answer close the remaining edges.
%%
%% All functions are pure; equal inputs give equal answers. Lengths are millimetres.
-module(starl_dpp_assign).

-export([request/2, retreat/2, make_way/2, resolve/2, reachable/2]).

-type plan() :: starl_dpp_plan:t().
-type path() :: starl_dpp_plan:path().

%% @doc Finds work for a robot that stands: a path that paints at least one free edge, clear of all
%% other reservations, its own standing place included. `none' when no free edge can be reached
%% safely now, or only by a long detour around robots that move (see `patience'). `complete' when no
%% edge is free or waiting to be painted.
-spec request(starl:robot_id(), plan()) -> {{assign, path()} | none | complete, plan()}.
request(Robot, Plan) ->
    case {starl_dpp_plan:counts(Plan), is_standing(Robot, Plan), unknown(Plan)} of
        {#{free := 0, assigned := 0}, _, _} ->
            {complete, Plan};
        {#{free := Free}, true, []} when Free > 0 ->
            find_work(Robot, starl_dpp_plan:others_move(Robot, Plan), Plan);
        _ ->
            {none, Plan}
    end.

%% @doc A path to a parking spot, without painting; `none' when the robot is parked or there is no
%% safe path. The robot takes the nearest spot that it can reach, and exchanges its spot for that.
-spec retreat(starl:robot_id(), plan()) -> {{assign, path()} | none, plan()}.
retreat(Robot, Plan) ->
    case is_standing(Robot, Plan) andalso not parked(Robot, Plan) andalso unknown(Plan) =:= [] of
        true -> park(Robot, Plan);
        false -> {none, Plan}
    end.

%% @doc A path to the nearest place where the robot closes no free edge to others. `none' when it
%% closes none, or has already made room since the last assignment to paint. For idle robots.
-spec make_way(starl:robot_id(), plan()) -> {{assign, path()} | none, plan()}.
make_way(Robot, Plan) ->
    case
        is_standing(Robot, Plan) andalso starl_dpp_plan:blocking(Robot, Plan) > 0 andalso
            unknown(Plan) =:= []
    of
        true ->
            View = view(Robot, Plan),
            case step_aside(Robot, fun(V) -> starl_dpp_evasion:closes(V, View) =:= [] end, Plan) of
                {none, Plan1} -> retreat(Robot, Plan1);
                Assigned -> Assigned
            end;
        false ->
            {none, Plan}
    end.

%% @doc Resolves a deadlock among the robots that wait, when no robot moves and all requests got
%% `none'. Requests that were answered `none' out of patience are granted, so a path may paint. Else
%% one robot is nearest to a free edge, and the robots in its path get paths to move aside,
%% outermost first. `[]' when no robot can or need move. Between two assignments to paint a robot
%% makes room at most twice: once aside, once to a parking spot.
-spec resolve([starl:robot_id()], plan()) -> {[{starl:robot_id(), path()}], plan()}.
resolve(Waiting0, Plan0) ->
    Waiting = [Id || Id <- lists:usort(Waiting0), is_standing(Id, Plan0)],
    case unknown(Plan0) =:= [] andalso grant(Waiting, Plan0) of
        false -> {[], Plan0};
        {[], Plan1} -> unblock(favourite(Waiting, Plan1), Waiting, Plan1);
        {Moves, Plan1} -> {Moves, Plan1}
    end.

%% @doc Could one of the live robots reach a free edge if all of them were parked? False means that
%% robots that no longer answer close everything that is left.
-spec reachable(Live :: [starl:robot_id()], plan()) -> boolean().
reachable(Live, Plan) ->
    Graph = starl_dpp_plan:graph(Plan),
    Blocked = starl_dpp_plan:masks(Live, Plan),
    Open = fun(E) -> Blocked(E) =:= 0 end,
    Spots = [V || {Id, V} <- starl_dpp_plan:spots(Plan), lists:member(Id, Live)],
    Reached = starl_dpp_graph:reach(Spots, Open, Graph),
    lists:any(
        fun(E) ->
            {A, _} = starl_dpp_graph:ends(E, Graph),
            Open(E) andalso is_map_key(A, Reached)
        end,
        starl_dpp_free:edges(starl_dpp_plan:free(Plan))
    ).

%%% Internals: work

find_work(Robot, Patient, Plan) ->
    Reach =
        case Patient of
            true -> starl_dpp_patience:reach(Robot, Plan);
            false -> infinity
        end,
    case Reach of
        none -> {none, Plan};
        _ -> search_work(Robot, Patient, Reach, Plan)
    end.

search_work(Robot, Patient, Reach, Plan) ->
    {_, Really} = starl_dpp_plan:stands(Robot, Plan),
    Settings = maps:with([choice, horizon, overhead_mm, middle], starl_dpp_plan:config(Plan)),
    case starl_dpp_choice:best(Really, view(Robot, Plan), Settings#{reach => Reach}) of
        {ok, #{path := Path} = Job} ->
            case Patient andalso starl_dpp_patience:waits(Robot, Job, Plan) of
                true -> {none, Plan};
                false -> {{assign, Path}, starl_dpp_plan:send(Robot, Path, work, Plan)}
            end;
        none ->
            {none, Plan}
    end.

%%% Internals: getting out of the way

park(Robot, Plan) ->
    %% Spots whose owner is away, the own one included.
    Free = [
        {V, Id}
     || {Id, V} <- starl_dpp_plan:spots(Plan),
        Id =:= Robot orelse not parked(Id, Plan)
    ],
    case starl_dpp_evasion:park([V || {V, _} <- Free], view(Robot, Plan)) of
        {ok, V, Path} ->
            {V, Owner} = lists:keyfind(V, 1, Free),
            Sent = starl_dpp_plan:send(Robot, Path, retreat, Plan),
            {{assign, Path}, starl_dpp_plan:exchange(Robot, Owner, Sent)};
        none ->
            {none, Plan}
    end.

%% A robot steps aside once between two assignments to paint, and never from a parking spot.
step_aside(Robot, Good, Plan) ->
    case
        starl_dpp_plan:yielded(Robot, Plan) orelse parked(Robot, Plan) orelse
            starl_dpp_evasion:aside(Good, view(Robot, Plan))
    of
        {ok, _, Path} ->
            {{assign, Path}, starl_dpp_plan:send(Robot, Path, aside, Plan)};
        _ ->
            {none, Plan}
    end.

grant(Waiting, Plan) ->
    moves(Waiting, fun(Id, Acc) -> find_work(Id, false, Acc) end, Plan).

%% Sends all robots that can go, each with the paths of the earlier ones reserved.
moves(Robots, Send, Plan0) ->
    Step = fun(Id, {Moves, Acc0}) ->
        case Send(Id, Acc0) of
            {{assign, Path}, Acc1} -> {[{Id, Path} | Moves], Acc1};
            {none, Acc1} -> {Moves, Acc1}
        end
    end,
    {Moves, Plan1} = lists:foldl(Step, {[], Plan0}, Robots),
    {lists:reverse(Moves), Plan1}.

%% The wish of the robot that would be nearest to a free edge without the waiting robots in its way.
favourite(Waiting, Plan) ->
    Wishes = [
        {Cost, Id, Wish}
     || Id <- Waiting,
        {ok, #{cost_mm := Cost} = Wish} <-
            [starl_dpp_evasion:wish(Waiting, view(Id, Plan))]
    ],
    case lists:sort(Wishes) of
        [{_, _, Wish} | _] -> Wish;
        [] -> none
    end.

unblock(none, Waiting, Plan) ->
    first_out(outermost(Waiting, Plan), Plan);
unblock(#{robot := Robot, way := Way, blockers := Blockers}, Waiting, Plan0) ->
    case moves(outermost(Blockers, Plan0), fun(Id, Acc) -> clear(Id, Way, Acc) end, Plan0) of
        {[], Plan1} -> first_out(outermost(Waiting -- [Robot], Plan1) ++ [Robot], Plan1);
        {Moves, Plan1} -> {Moves, Plan1}
    end.

%% Sends a robot off this way: aside, or else to a parking spot.
clear(Robot, Way, Plan0) ->
    Graph = starl_dpp_plan:graph(Plan0),
    Good = fun(V) ->
        P = starl_dpp_graph:point(V, Graph),
        not starl_dpp_evasion:in_way([{P, P}], Way, Graph)
    end,
    case step_aside(Robot, Good, Plan0) of
        {none, Plan1} -> retreat(Robot, Plan1);
        Assigned -> Assigned
    end.

%% Sends the first of these robots that can park to its spot.
first_out([], Plan) ->
    {[], Plan};
first_out([Robot | Rest], Plan0) ->
    case retreat(Robot, Plan0) of
        {{assign, Path}, Plan1} -> {[{Robot, Path}], Plan1};
        {none, Plan1} -> first_out(Rest, Plan1)
    end.

outermost(Robots, Plan) ->
    Places = [{Id, P} || Id <- Robots, {P, _} <- [starl_dpp_plan:stands(Id, Plan)]],
    starl_dpp_evasion:outermost(Places, starl_dpp_plan:graph(Plan)).

is_standing(Robot, Plan) -> starl_dpp_plan:stands(Robot, Plan) =/= false.

parked(Robot, Plan) -> starl_dpp_plan:parked(Robot, Plan).

unknown(Plan) -> starl_dpp_plan:unknown(Plan).

view(Robot, Plan) -> starl_dpp_plan:view(Robot, Plan).
