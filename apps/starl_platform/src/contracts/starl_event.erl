%% @doc The events that may be traced: those of the platform itself, and the vocabulary against
%% which a run's trace is checked.
%%
%% Each machine exports the type `event()' of the events that it traces. The monitor of its contract
%% lists the same events in its `vocabulary/0' ({@link starl_monitor}), those that it does not judge
%% included. An event that is in no vocabulary of its machine breaks the contract: otherwise a
%% renamed event, for which no monitor waits, would switch the contract off.
%%
%% Every runner knows the platform's events: those of `robot', `supervisor', `chassis' and `radio',
%% those that the platform traces in the name of any machine, and those of the services that trace
%% nothing of their own. A machine without a monitor, such as a user's application, may trace any
%% event.
-module(starl_event).

-export([platform/0, machines/0, known/1, is_known/3, tags/2, tell/3, violation/1]).

-export_type([robot/0, supervisor/0, chassis/0, radio/0, machine/0, app/0]).
-export_type([name/0, vocabulary/0, known/0]).

%% Machine `robot': `down' and `up' apply to the robot with all of its machines, which start anew; a
%% robot that has `died' does not come back; `store_set_back': a fault has put the store of an earlier life
%% in the place of the robot's. `late': a timer of a live robot was due at the first of
%% these times, and was handled at the second: its computer stood still so long, or had too much else to do.
-type robot() ::
    down
    | up
    | {died, gave_up | killed}
    | store_set_back
    | {late, FromUs :: integer(), ToUs :: integer()}.

%% Machine `supervisor': a machine has crashed by itself; a machine has crashed too often and is not
%% started again.
-type supervisor() ::
    {crashed, starl_machine:name(), starl_crash:cause()}
    | {given_up, starl_machine:name()}.

%% Machine `chassis': the robot's motion from now on (mm, radians, µs); the new state of an
%% actuator.
-type chassis() ::
    {motion, starl_trajectory:piece()}
    %% a script of another chassis, which is not carried out
    | {not_understood, starl_chassis:commands()}
    | {actuated, Device :: atom(), Value :: term()}
    %% what its body feels: a bump, a button, the charge of its battery
    | {sensed, Sense :: term()}.

%% Machine `radio'': a packet of the sender is lost. `N' counts the packets to that robot, `{all, N}'
%% the packets to all in range.
-type radio() :: {lost, To :: starl:robot_id(), N :: pos_integer() | {all, pos_integer()}}.

%% Any machine: it is gone, by its own fault or another; its stored term is unreadable; actions of it
%% were not carried out, since their latest moment had passed; an event that it does not know; a message whose body it does not accept; the robot has no machine of this
%% name, and another machine called it or sent it something; the outcome of a reload.
-type machine() ::
    crashed
    | store_damaged
    | late
    | {unknown_event, starl_machine:event_type(), Content :: term()}
    | {malformed, From :: starl:robot_id(), starl_packet:type(), Body :: term()}
    | {unknown_machine, starl_machine:name()}
    | {reloaded, starl_reload:count(), starl_reload:outcome()}.

%% Machine `app', beside the events that the application traces: it listens to a type; it has read a
%% message, with the hash of its body (`erlang:phash2/1'); it had no room for a message; new code could not take its
%% state over; a call, or its answer, of which a history is kept; it is done.
-type app() ::
    {listens, starl_packet:type()}
    | {read, From :: starl:robot_id(), starl_packet:type(), Hash :: non_neg_integer()}
    | {inbox_full, From :: starl:robot_id(), starl_packet:type()}
    | {code_change_failed, starl_crash:cause()}
    | starl_history:event()
    | {measure, Key :: atom(), Value :: number()}
    | {draw, starl_drawing:t()}
    | {done, Result :: term()}.

%% An event as `{Tag, Size}': its first element, and how many elements follow. `{up, 0}' stands for
%% the atom `up', `{died, 1}' for `{died, Reason}'.
-type name() :: {Tag :: atom(), Size :: non_neg_integer()}.

%% All events of some machines.
-type vocabulary() :: #{starl_machine:name() => [name()]}.

%% The vocabularies by machine, with the sizes of events as tuples, 0 for an atom. Events of other
%% machines are not checked.
-opaque known() :: #{starl_machine:name() => #{Tag :: term() => [TupleSize :: non_neg_integer()]}}.

-define(EVERY_MACHINE, [
    {crashed, 0},
    {store_damaged, 0},
    {late, 0},
    {unknown_event, 2},
    {malformed, 3},
    {unknown_machine, 1},
    {reloaded, 2}
]).
-define(EVERY_APP, [
    {listens, 1},
    {read, 3},
    {inbox_full, 2},
    {code_change_failed, 1},
    {history, 1},
    {measure, 2},
    {draw, 1},
    {done, 1}
]).

%% @doc The vocabulary that every runner knows.
-spec platform() -> vocabulary().
platform() ->
    #{
        robot => [{down, 0}, {up, 0}, {died, 1}, {store_set_back, 0}, {late, 2}],
        supervisor => [{crashed, 2}, {given_up, 1}],
        chassis => [{motion, 1}, {actuated, 2}, {not_understood, 1}, {sensed, 1}],
        radio => [{lost, 2}],
        location => [{felt, 1} | ?EVERY_MACHINE],
        motion => [
            {velocity, 2}, {velocity_over, 1}, {goal, 2}, {line, 1}, {goal_over, 1} | ?EVERY_MACHINE
        ],
        actuator => ?EVERY_MACHINE
    }.

%% @doc The machines that every robot has, with those that stand for the robot itself.
-spec machines() -> [starl_machine:name()].
machines() -> [app, sap | maps:keys(platform())].

%% @doc The platform's vocabulary together with these.
-spec known([vocabulary()]) -> known().
known(Vocabularies) ->
    Whole = [maps:map(fun whole/2, Vocabulary) || Vocabulary <- Vocabularies],
    lists:foldl(fun add/2, #{}, lists:append([maps:to_list(V) || V <- [platform() | Whole]])).

%% The events that the platform traces in a machine's name are added to the machine's own.
whole(app, Names) -> ?EVERY_APP ++ ?EVERY_MACHINE ++ Names;
whole(_Machine, Names) -> ?EVERY_MACHINE ++ Names.

add({Machine, Names}, Known) ->
    Before = maps:get(Machine, Known, #{}),
    Known#{Machine => lists:foldl(fun add_name/2, Before, Names)}.

add_name({Tag, 0}, Names) -> add_size(Tag, 0, Names);
add_name({Tag, Size}, Names) -> add_size(Tag, Size + 1, Names).

add_size(Tag, Size, Names) -> Names#{Tag => [Size | maps:get(Tag, Names, [])]}.

%% @doc May the machine trace this event? Asked of every event of a run.
-spec is_known(starl_machine:name(), Event :: term(), known()) -> boolean().
is_known(Machine, Event, Known) when tuple_size(Event) > 0 ->
    is_known(Machine, element(1, Event), tuple_size(Event), Known);
is_known(Machine, Event, Known) ->
    is_known(Machine, Event, 0, Known).

is_known(Machine, Tag, Size, Known) ->
    case Known of
        #{Machine := #{Tag := [First | Others]}} ->
            Size =:= First orelse lists:member(Size, Others);
        #{Machine := _} ->
            false;
        #{} ->
            true
    end.

%% @doc The first elements of the events that the machine may trace.
-spec tags(starl_machine:name(), known()) -> [atom()] | any.
tags(Machine, Known) ->
    case Known of
        #{Machine := Names} -> lists:sort([Tag || Tag <- maps:keys(Names), is_atom(Tag)]);
        #{} -> any
    end.

%% @doc Makes the event known from now on, so that its violation is reported once.
-spec tell(starl_machine:name(), Event :: term(), known()) -> known().
tell(Machine, Event, Known) ->
    #{Machine := Names} = Known,
    Known#{Machine := tell(Event, Names)}.

tell(Event, Names) when tuple_size(Event) > 0 ->
    add_size(element(1, Event), tuple_size(Event), Names);
tell(Event, Names) ->
    add_size(Event, 0, Names).

%% @doc The violation for an unknown event: the contract is that of the machine.
-spec violation(starl_monitor:trace_event()) -> starl_monitor:violation().
violation({T, Robot, Machine, Event}) ->
    starl_violation:new(Machine, unknown_event, T, [Robot], #{event => Event}).
