%% @doc A robot that is held up: paused, or slow. Its events are handled later than they came; the
%% faults themselves strike when they do.
-module(starl_sim_hold).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([part/2]).

-export_type([t/0]).

%% Nothing is handled before a time, and nothing sooner than so long after it came.
-type t() :: {UntilUs :: starl_sim_queue:time(), LagUs :: non_neg_integer()}.

%% @doc Parts events into those that are put off, at their new times, and those that are not.
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
