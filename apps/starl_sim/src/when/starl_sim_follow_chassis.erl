%% @doc The chassis of a live robot that is replayed from its snapshot ({@link starl_sim_follow}).
%% It is a simulated vehicle with a list of pending steps and answers, each at its time. The
%% recording says where the vehicle is and which answers it has given.
-module(starl_sim_follow_chassis).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([new/3, until/2, drive/4, actuate/4, stop/2, answered/4, pending/1, snapshot/2]).

-export_type([t/0]).

-record(chassis, {
    vehicle :: starl_sim_vehicle:t(),
    %% by their times
    beats = [] :: [{DueUs :: integer(), tuple()}]
}).

-opaque t() :: #chassis{}.

%% @doc A chassis in this piece of motion, with nothing to do.
-spec new(starl:robot_id(), starl_trajectory:piece(), starl_sim_world:t()) -> t().
new(Id, Piece, World) ->
    Vehicle = starl_sim_vehicle:new(Id, {0.0, 0.0, 0.0}, World),
    #chassis{vehicle = starl_sim_vehicle:at(Piece, Vehicle)}.

%% @doc It has done what it had to do by this time.
-spec until(Us :: integer(), t()) -> t().
until(Until, #chassis{beats = Beats, vehicle = Vehicle} = Chassis) ->
    case [B || {Due, Content} = B <- Beats, Due =< Until, class(Content) =:= ?CLASS_WORLD] of
        [] ->
            Chassis;
        [{Due, Content} = First | _] ->
            Left = Chassis#chassis{beats = lists:delete(First, Beats)},
            until(Until, moved(Due, starl_sim_vehicle:beat(Content, Due, Vehicle), Left))
    end.

moved(Now, {_Change, Plans, Vehicle}, #chassis{beats = Beats} = Chassis) ->
    New = [{Now + Us, Content} || {Us, Content} <- Plans],
    Chassis#chassis{vehicle = Vehicle, beats = lists:keymerge(1, Beats, lists:keysort(1, New))}.

%% @doc It drives a script.
-spec drive(starl_chassis:script(), {starl_machine:name(), term()}, Us :: integer(), t()) -> t().
drive(Script, Owner, Now, #chassis{vehicle = Vehicle} = Chassis) ->
    case starl_sim_vehicle:drive(Script, Owner, Now, Vehicle) of
        not_understood -> Chassis;
        {lost, Deaf} -> Chassis#chassis{vehicle = Deaf};
        Change -> moved(Now, Change, Chassis)
    end.

%% @doc It sets an actuator. The answer has been recorded.
-spec actuate({atom(), term()}, {starl_machine:name(), term()} | none, Us :: integer(), t()) ->
    t().
actuate(What, Owner, Now, #chassis{vehicle = Vehicle} = Chassis) ->
    {_, _Plans, Next} = starl_sim_vehicle:actuate(What, Owner, Now, Vehicle),
    Chassis#chassis{vehicle = Next}.

%% @doc It stops.
-spec stop(Us :: integer(), t()) -> t().
stop(Now, #chassis{vehicle = Vehicle} = Chassis) ->
    moved(Now, starl_sim_vehicle:stop(Now, Vehicle), Chassis).

%% @doc It has said that it has driven, or that it has stalled: what it would say here is not said again.
-spec answered(driven | stalled, {starl_machine:name(), Mark :: term()}, Us :: integer(), t()) ->
    t().
answered(Word, Owner, Now, #chassis{beats = Beats} = Chassis) ->
    Said = Chassis#chassis{beats = [B || B <- Beats, not says(Owner, B)]},
    case Word of
        driven -> Said;
        stalled -> stop(Now, Said)
    end.

says({Name, Mark}, {_, {says, _, Name, {_, Mark, _}}}) -> true;
says(_Owner, _Beat) -> false.

%% @doc What it has still to do or to say: the time and the class of each event.
-spec pending(t()) -> [{DueUs :: integer(), Class :: non_neg_integer(), tuple()}].
pending(#chassis{beats = Beats}) -> [{Due, class(Content), Content} || {Due, Content} <- Beats].

class({says, _, _, _}) -> ?CLASS_TIMER;
class({_Name, info, _}) -> ?CLASS_TIMER;
class(_Beat) -> ?CLASS_WORLD.

%% @doc The vehicle as data, in this piece of motion.
-spec snapshot(starl_trajectory:piece(), t()) -> tuple().
snapshot(Piece, #chassis{vehicle = Vehicle}) ->
    starl_sim_vehicle:snapshot(starl_sim_vehicle:at(Piece, Vehicle)).
