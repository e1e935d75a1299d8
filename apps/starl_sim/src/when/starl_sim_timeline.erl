%% @doc The timeline of a run: its events and the beginnings of its faults, ordered by time, then by
%% robot. Index I lies just after the I-th of them, index 0 before all. Each index is a consistent
%% cut: what a robot does reaches no other robot at the same time.
%%
%% Faults that drop single packets are not on it, because they stand for random loss.
-module(starl_sim_timeline).

-export([new/2, last/1, at/2, events_at/3, entry/2, time_us/2, before/2, following/4]).

-export_type([t/0, index/0, entry/0, past/0]).

-type index() :: non_neg_integer().

%% What happened: a fault began, or a robot had an event.
-type entry() ::
    {starl_sim_queue:time(), fault, starl_run_fault:t()}
    | {starl_sim_queue:time(), starl:robot_id(), starl_sim_ledger:event()}.

%% What lies before an index: for each robot with events the number of the last one and its digest
%% chain then, and the faults that have begun.
-type past() :: #{
    robots := #{starl:robot_id() => {N :: pos_integer(), Chain :: non_neg_integer()}},
    faults := [starl_run_fault:t()]
}.

-opaque t() :: tuple().

%% @doc The timeline of a run with these events and faults.
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

%% @doc The last index.
-spec last(t()) -> index().
last(Timeline) -> tuple_size(Timeline).

%% @doc The last index at or before a time.
-spec at(starl_sim_queue:time(), t()) -> index().
at(Us, Timeline) -> at(Us, 0, tuple_size(Timeline), Timeline).

%% The index lies between Low and High.
at(_Us, Same, Same, _Timeline) ->
    Same;
at(Us, Low, High, Timeline) ->
    Middle = (Low + High + 1) div 2,
    case time_us(Middle, Timeline) =< Us of
        true -> at(Us, Middle, High, Timeline);
        false -> at(Us, Low, Middle - 1, Timeline)
    end.

%% @doc The events of these robots at this very time, each with the index just after it.
-spec events_at(starl_sim_queue:time(), [starl:robot_id()], t()) -> [{index(), entry()}].
events_at(Us, Robots, Timeline) -> events_at(at(Us, Timeline), Us, Robots, Timeline, []).

events_at(0, _Us, _Robots, _Timeline, Events) ->
    Events;
events_at(Index, Us, Robots, Timeline, Events) ->
    case element(Index, Timeline) of
        {Us, Robot, #{n := _}} = Entry ->
            Own = [{Index, Entry} || lists:member(Robot, Robots)],
            events_at(Index - 1, Us, Robots, Timeline, Own ++ Events);
        {Us, fault, _} ->
            events_at(Index - 1, Us, Robots, Timeline, Events);
        {_Earlier, _, _} ->
            Events
    end.

%% @doc What happened just before an index; `start' at the first one.
-spec entry(index(), t()) -> entry() | start.
entry(0, _Timeline) -> start;
entry(Index, Timeline) -> element(Index, Timeline).

%% @doc The time of an index.
-spec time_us(index(), t()) -> starl_sim_queue:time().
time_us(0, _Timeline) -> 0;
time_us(Index, Timeline) -> element(1, element(Index, Timeline)).

%% @doc The first `Most' events after an index, of these robots; of all if none is named.
-spec following(index(), [starl:robot_id()], Most :: non_neg_integer(), t()) -> [entry()].
following(Index, _Robots, Most, Timeline) when Most =:= 0; Index >= tuple_size(Timeline) ->
    [];
following(Index, Robots, Most, Timeline) ->
    case element(Index + 1, Timeline) of
        {_, Robot, #{n := _}} = Entry ->
            case Robots =:= [] orelse lists:member(Robot, Robots) of
                true -> [Entry | following(Index + 1, Robots, Most - 1, Timeline)];
                false -> following(Index + 1, Robots, Most, Timeline)
            end;
        {_, fault, _} ->
            following(Index + 1, Robots, Most, Timeline)
    end.

%% @doc What lies before an index.
-spec before(index(), t()) -> past().
before(Index, Timeline) -> before(Index, Timeline, #{robots => #{}, faults => []}).

before(0, _Timeline, Past) ->
    Past;
before(Index, Timeline, #{robots := Robots, faults := Faults} = Past) ->
    Next =
        case element(Index, Timeline) of
            {_, fault, Fault} -> Past#{faults := [Fault | Faults]};
            {_, Robot, _} when is_map_key(Robot, Robots) -> Past;
            {_, Robot, #{n := N, chain := Chain}} -> Past#{robots := Robots#{Robot => {N, Chain}}}
        end,
    before(Index - 1, Timeline, Next).
