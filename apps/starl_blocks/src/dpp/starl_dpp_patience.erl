%% @doc What a robot that asks for work leaves to others while those are on their way: what it could
%% reach by a long way around them only, and what another will be at first. It waits for what is
%% better.
%%
%% All functions are pure; equal inputs give equal answers. Lengths are millimetres.
-module(starl_dpp_patience).

-export([reach/2, waits/3]).

-type robot_id() :: pos_integer().
-type plan() :: starl_dpp_plan:t().

%% Up to this far away a robot gets work even if another will be there first,
-define(FAR, 2000.0).
%% which counts when it is so much nearer.
-define(LEAD, 1000.0).
%% More than the rounding errors of a way's length.
-define(HAIR, 1.0e-3).
%% Farther than any way.
-define(EVER, 1.0e300).
%% So many free edges are looked at to see how far a robot would go.
-define(FEW, 200).
%% So much more than what is driven may a way cost: its turns, and corners that are cut.
-define(ROUND_ABOUT, 2000.0).

%% @doc What the way to work may cost for a robot that would take it; `none' if it would take no
%% work. What it refuses is far: no need to search there. (What is near, but found by a way round
%% about only, it may miss; it asks again when others have moved.)
-spec reach(robot_id(), plan()) -> starl_dpp_search:within() | none.
reach(Robot, Plan) ->
    case starl_dpp_plan:config(Plan) of
        #{patience := infinity} ->
            infinity;
        #{patience := Patience} ->
            {P, _} = starl_dpp_plan:stands(Robot, Plan),
            Rivals = rivals(Robot, Plan),
            Few = starl_dpp_free:count(starl_dpp_plan:free(Plan)) =< ?FEW,
            Most = fun(Begin, Acc) -> acceptable(Begin, P, Patience, Rivals, Few, Acc) end,
            case starl_dpp_choice:fold_begins(Most, none, starl_dpp_plan:view(Robot, Plan)) of
                none -> none;
                Mm -> Mm + ?ROUND_ABOUT
            end
    end.

%% @doc Does the robot rather wait than do this job?
-spec waits(robot_id(), starl_dpp_choice:job(), plan()) -> boolean().
waits(Robot, Job, Plan) -> detour(Robot, Job, Plan) orelse better_placed(Robot, Job, Plan).

%%% Internals

%% The most that the robot would drive to any of some points. Where there are many, one is near.
acceptable(Begin, P, {Factor, Mm}, Rivals, Few, Most) ->
    Straight = starl_geometry:distance(P, Begin),
    case Factor * Straight + Mm of
        Far when is_float(Most), Far =< Most ->
            {continue, Most};
        Far ->
            case others_first(Begin, Straight - ?HAIR, Rivals) of
                true -> {continue, Most};
                false when not Few -> {stop, ?EVER};
                false -> {continue, farther(min(Far, first(Begin, Rivals)), Most)}
            end
    end.

farther(Mm, none) -> Mm;
farther(Mm, Most) -> max(Mm, Most).

%% How far the robot may drive to a point if none of these others is to be there first.
first(Begin, Rivals) ->
    Before = [Left + starl_geometry:distance(End, Begin) + ?LEAD || {Left, End} <- Rivals],
    max(?FAR, lists:min([?EVER | Before])).

%% A long way around robots that will soon have moved on is not worth its ink, and closes much to
%% others: better wait.
detour(Robot, #{path := Path, travel_mm := Driven}, Plan) ->
    {P, _} = starl_dpp_plan:stands(Robot, Plan),
    Straight = case [Q || {Q, up} <- Path] of
        [] -> 0.0;
        Points -> starl_geometry:distance(P, lists:last(Points))
    end,
    case starl_dpp_plan:config(Plan) of
        #{patience := infinity} -> false;
        #{patience := {Factor, Mm}} -> Driven > Factor * Straight + Mm
    end.

%% Another will be there before this one, counting what it has to drive until then.
better_placed(Robot, #{path := Path, travel_mm := Driven}, Plan) ->
    #{patience := Patience} = starl_dpp_plan:config(Plan),
    Patience =/= infinity andalso Driven > ?FAR
        andalso others_first(lists:last([Q || {Q, up} <- Path]), Driven, rivals(Robot, Plan)).

others_first(Begin, Driven, Rivals) ->
    Driven > ?FAR andalso lists:any(fun({Left, End}) ->
        Left + starl_geometry:distance(End, Begin) + ?LEAD < Driven
    end, Rivals).

%% What the others have left to drive, and where they will be then. Those that say nothing, because
%% they are dead, do no work.
rivals(Robot, Plan) ->
    [starl_dpp_plan:rest(Id, Plan) || Id <- starl_dpp_plan:at_work(Plan), Id =/= Robot].
