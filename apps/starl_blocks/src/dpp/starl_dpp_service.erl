%% @doc The behaviour of a coordinator's service, which serves the robots. The coordinator
%% ({@link starl_dpp_coordinator}) decides whether it may assign at all. The configuration names the
%% service under the key `serve'; the default is {@link starl_dpp_dispatcher}. The exhaustive
%% checker uses a smaller one.
-module(starl_dpp_service).

-export_type([t/0, turn/0]).

%% The coordinator's view of its robots, private to the module.
-type t() :: term().
%% What a call changes, and what the coordinator does then.
-type turn() :: {t(), [starl_machine:action()]}.

%% Prepares what is the same in all terms; this takes time.
-callback prepare(starl_dpp_settings:t()) -> Blank :: term().
-callback new(Blank :: term(), starl_dpp:term_id()) -> t().
-callback lead(t()) -> turn().
-callback unknown(t()) -> [starl:robot_id()].
-callback knows(starl:robot_id(), t()) -> boolean().
-callback silent(starl:robot_id(), t()) -> boolean().
-callback requested(starl:robot_id(), starl_dpp:request_id(), {At, [Edge]}, t()) ->
    turn()
when
    At :: starl_geometry:point(), Edge :: starl_dpp_graph:edge_id().
-callback reported(starl:robot_id(), starl_dpp:request_id(), {Place, [Edge]}, t()) ->
    turn()
when
    Place :: starl_dpp:place(), Edge :: starl_dpp_graph:edge_id().
-callback passed(starl:robot_id(), starl_dpp:request_id(), N :: pos_integer(), t()) -> turn().
-callback rests(starl:robot_id(), starl_geometry:point(), t()) -> turn().
-callback serve(t()) -> turn().
-callback give_up(t()) -> turn().
-callback answered(starl:robot_id(), ok | lost, t()) -> t().
%% On a floor with walls: a robot at a point could not go on towards another; what is closed is looked
%% after.
-callback blocked(At, Towards, t()) -> turn() when
    At :: starl_geometry:point(), Towards :: starl_geometry:point().
-callback reopen(t()) -> turn().
-optional_callbacks([blocked/3, reopen/1]).
