%% @doc The log of a robot's barriers: what its barrier machine must not forget in a crash.
%%
%% A machine of its own on the same robot, so that a crash of one of the two loses nothing. The
%% barrier machine notes how far it is before it answers its application; when it has been
%% restarted it asks for the notes. When the log has been restarted, the barrier machine tells
%% all of it again. If both are gone at once, as when the robot reboots, the notes are not
%% `complete' and the other robots have to be asked.
%%
%% Casts: `{note, Name, count()}', `{notes, #{Name => count()}}' (from now on complete). Call:
%% `recall', answer `{complete | partial, #{Name => count()}}'.
-module(starl_barrier_log).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).
-export([note/3, notes/2, recall/2]).

-export_type([count/0, notes/0]).

%% How many rounds were reached, how many of them passed.
-type count() :: {Reached :: non_neg_integer(), Passed :: non_neg_integer()}.

-type notes() :: #{starl_barrier:name() => count()}.

%% @doc The action that notes how far a barrier is; none without a log.
-spec note(starl_machine:name() | none, starl_barrier:name(), count()) ->
    [starl_machine:action()].
note(none, _Name, _Count) -> [];
note(Log, Name, Count) -> [{cast, Log, {note, Name, Count}}].

%% @doc The action that notes everything.
-spec notes(starl_machine:name() | none, notes()) -> [starl_machine:action()].
notes(none, _Notes) -> [];
notes(Log, Notes) -> [{cast, Log, {notes, Notes}}].

%% @doc The action that asks for the notes.
-spec recall(starl_machine:name(), starl_machine:tag()) -> starl_machine:action().
recall(Log, Tag) -> {call, Log, recall, Tag}.

-spec init(starl_machine:config()) -> {complete | partial, notes(), [starl_machine:action()]}.
init(#{incarnation := 1}) -> {complete, #{}, []};
init(_Config) -> {partial, #{}, []}.

-spec handle_event(
    starl_machine:event_type(), term(), complete | partial, notes(), starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {note, Name, Count}, _Extent, Notes, _Meta) ->
    {keep_state, Notes#{Name => Count}};
handle_event(cast, {notes, All}, _Extent, _Notes, _Meta) ->
    {next_state, complete, All};
handle_event({call, From}, recall, Extent, Notes, _Meta) ->
    {keep_state_and_data, [{reply, From, {Extent, Notes}}]};
handle_event(info, {restarted, _}, _Extent, _Notes, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.
