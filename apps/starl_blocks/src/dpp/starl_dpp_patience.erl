%% @doc Decides when a robot waits instead of taking work. It leaves a line to moving robots in two
%% cases: its own path there is a long detour around them, or another robot will be there first.
%%
%% All functions are pure; equal inputs give equal answers. Lengths are millimetres.
-module(starl_dpp_patience).

-export([reach/2, waits/3]).

-type plan() :: starl_dpp_plan:t().

%% The distance up to which a robot gets work even if another will be there first.
-define(FAR, 2000.0).
%% Another robot is there first if it is nearer by at least this.
-define(LEAD, 1000.0).
%% More than the rounding errors of a way's length.
-define(HAIR, 1.0e-3).
%% Farther than any way.
-define(EVER, 1.0e300).
%% The greatest number of free edges of which each is looked at, to see how far a robot would go.
-define(FEW, 200).
%% The most that a way costs beside its length: its turns, and corners that are cut.
-define(ROUND_ABOUT, 2000.0).

%% @doc The greatest cost of a path to work that the robot would take; `none' if it would take no
%% work. Refused work is far, so the search need not go there. (The search may miss work that is
%% near but reached only by a long path. The robot asks again when others have moved.)
-spec reach(starl:robot_id(), plan()) -> starl_dpp_search:within() | none.
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

%% @doc Does the robot wait rather than do this job?
-spec waits(starl:robot_id(), starl_dpp_choice:job(), plan()) -> boolean().
waits(Robot, Job, Plan) -> detour(Robot, Job, Plan) orelse better_placed(Robot, Job, Plan).

%%% Internals

%% The longest way that the robot would drive to any of these points. Of many points one is near.
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

%% The distance that the robot may drive to a point so that none of these others is there first.
first(Begin, Rivals) ->
    Before = [Left + starl_geometry:distance(End, Begin) + ?LEAD || {Left, End} <- Rivals],
    max(?FAR, lists:min([?EVER | Before])).

%% A long way around robots that will soon have moved on is not worth its ink, and closes much to
%% others: better wait.
detour(Robot, #{path := Path, travel_mm := Driven}, Plan) ->
    {P, _} = starl_dpp_plan:stands(Robot, Plan),
    Straight =
        case [Q || {Q, up} <- Path] of
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
    Patience =/= infinity andalso Driven > ?FAR andalso
        others_first(lists:last([Q || {Q, up} <- Path]), Driven, rivals(Robot, Plan)).

others_first(Begin, Driven, Rivals) ->
    Driven > ?FAR andalso
        lists:any(
            fun({Left, End}) ->
                Left + starl_geometry:distance(End, Begin) + ?LEAD < Driven
            end,
            Rivals
        ).

%% The distance that each of the others still has to drive, and the place where it will be then.
%% Silent robots, which may be dead, do no work.
rivals(Robot, Plan) ->
    [starl_dpp_plan:rest(Id, Plan) || Id <- starl_dpp_plan:at_work(Plan), Id =/= Robot].
