%% @doc The moments of a run: its events and the beginnings of its faults, ordered by time, then by
%% robot. Moment I lies just after the I-th of them, moment 0 before all. Each moment is a
%% consistent cut: what a robot does reaches no other robot at the same time.
%%
%% Faults that drop single packets begin at no moment, because they stand for random loss.
-module(starl_sim_moments).

-export([new/2, last/1, at/2, events_at/3, entry/2, time_us/2, before/2, following/4]).

-export_type([t/0, moment/0, entry/0, past/0]).

-type moment() :: non_neg_integer().

%% What happened: a fault began, or a robot had an event.
-type entry() ::
    {starl_sim_queue:time(), fault, starl_run_fault:t()}
    | {starl_sim_queue:time(), starl:robot_id(), starl_sim_ledger:event()}.

%% What lies before a moment: for each robot with events the number of the last one and its digest
%% chain then, and the faults that have begun.
-type past() :: #{
    robots := #{starl:robot_id() => {N :: pos_integer(), Chain :: non_neg_integer()}},
    faults := [starl_run_fault:t()]
}.

-opaque t() :: tuple().

%% @doc The moments of a run with these events and faults.
-spec new(#{starl:robot_id() => [starl_sim_ledger:event()]}, [starl_run_fault:t()]) -> t().
new(Events, Faults) ->
    Begun = [
        {{1000 * From, 0, N}, {1000 * From, fault, Fault}}
     || {N, {_, From, _, Kind, _, _} = Fault} <- lists:enumerate(Faults), Kind =/= drop
    ],
    Had = [
        {{At, Robot, N}, {At, Robot, Event}}
     || {Robot, List} <- maps:to_list(Events), #{at_us := At, n := N} = Event <- List
    ],
    list_to_tuple([Entry || {_, Entry} <- lists:keysort(1, Begun ++ Had)]).

%% @doc The last moment.
-spec last(t()) -> moment().
last(Moments) -> tuple_size(Moments).

%% @doc The last moment at or before a time.
-spec at(starl_sim_queue:time(), t()) -> moment().
at(Us, Moments) -> at(Us, 0, tuple_size(Moments), Moments).

%% The moment lies between Low and High.
at(_Us, Same, Same, _Moments) ->
    Same;
at(Us, Low, High, Moments) ->
    Middle = (Low + High + 1) div 2,
    case time_us(Middle, Moments) =< Us of
        true -> at(Us, Middle, High, Moments);
        false -> at(Us, Low, Middle - 1, Moments)
    end.

%% @doc The events of these robots at this very time, each with the moment just after it.
-spec events_at(starl_sim_queue:time(), [starl:robot_id()], t()) -> [{moment(), entry()}].
events_at(Us, Robots, Moments) -> events_at(at(Us, Moments), Us, Robots, Moments, []).

events_at(0, _Us, _Robots, _Moments, Events) ->
    Events;
events_at(Moment, Us, Robots, Moments, Events) ->
    case element(Moment, Moments) of
        {Us, Robot, #{n := _}} = Entry ->
            Own = [{Moment, Entry} || lists:member(Robot, Robots)],
            events_at(Moment - 1, Us, Robots, Moments, Own ++ Events);
        {Us, fault, _} ->
            events_at(Moment - 1, Us, Robots, Moments, Events);
        {_Earlier, _, _} ->
            Events
    end.

%% @doc What happened just before a moment; `start' at the first one.
-spec entry(moment(), t()) -> entry() | start.
entry(0, _Moments) -> start;
entry(Moment, Moments) -> element(Moment, Moments).

%% @doc The time of a moment.
-spec time_us(moment(), t()) -> starl_sim_queue:time().
time_us(0, _Moments) -> 0;
time_us(Moment, Moments) -> element(1, element(Moment, Moments)).

%% @doc The first `Most' events after a moment, of these robots; of all if none is named.
-spec following(moment(), [starl:robot_id()], Most :: non_neg_integer(), t()) -> [entry()].
following(Moment, _Robots, Most, Moments) when Most =:= 0; Moment >= tuple_size(Moments) ->
    [];
following(Moment, Robots, Most, Moments) ->
    case element(Moment + 1, Moments) of
        {_, Robot, #{n := _}} = Entry ->
            case Robots =:= [] orelse lists:member(Robot, Robots) of
                true -> [Entry | following(Moment + 1, Robots, Most - 1, Moments)];
                false -> following(Moment + 1, Robots, Most, Moments)
            end;
        {_, fault, _} ->
            following(Moment + 1, Robots, Most, Moments)
    end.

%% @doc What lies before a moment.
-spec before(moment(), t()) -> past().
before(Moment, Moments) -> before(Moment, Moments, #{robots => #{}, faults => []}).

before(0, _Moments, Past) ->
    Past;
before(Moment, Moments, #{robots := Robots, faults := Faults} = Past) ->
    Next =
        case element(Moment, Moments) of
            {_, fault, Fault} -> Past#{faults := [Fault | Faults]};
            {_, Robot, _} when is_map_key(Robot, Robots) -> Past;
            {_, Robot, #{n := N, chain := Chain}} -> Past#{robots := Robots#{Robot => {N, Chain}}}
        end,
    before(Moment - 1, Moments, Next).
