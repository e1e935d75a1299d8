%% @doc A robot that is held up: paused, or slow. It handles its events later than they arrive; the
%% faults themselves strike on time.
-module(starl_sim_lag).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([part/2]).

-export_type([t/0]).

%% No event is handled before `UntilUs', nor earlier than `LagUs' after its arrival.
-type t() :: {UntilUs :: starl_sim_queue:time(), LagUs :: non_neg_integer()}.

%% @doc Splits events into delayed ones, at their new times, and those that are not delayed.
-spec part([starl_sim_queue:event()], t()) ->
    {Late :: [starl_sim_queue:event()], Ready :: [starl_sim_queue:event()]}.
part(Events, Hold) ->
    {Late, Ready} = lists:partition(fun(Event) -> held(Event, Hold) =/= Event end, Events),
    {[held(Event, Hold) || Event <- Late], Ready}.

held({_, _, ?CLASS_WORLD, _, _, _} = Event, _Hold) ->
    Event;
held({Id, Time, Class, Source, Seq, {late, _} = Content}, {Until, _Lag}) ->
    {Id, max(Time, Until), Class, Source, Seq, Content};
held({Id, Time, Class, Source, Seq, Content}, {Until, 0}) ->
    {Id, max(Time, Until), Class, Source, Seq, Content};
held({Id, Time, Class, Source, Seq, Content}, {Until, Lag}) ->
    {Id, max(Time + Lag, Until), Class, Source, Seq, {late, Content}}.
