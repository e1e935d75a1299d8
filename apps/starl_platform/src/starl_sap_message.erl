%% @doc A message as the monitor of the SAP knows it: what was sent, and how far it has come at
%% each of its destinations. Pure; a part of {@link starl_sap_monitor}.
-module(starl_sap_message).

-export([new/4, compare/3, progress/2, put_progress/3, phase/1, give_up/1, open/1, lost/1]).

-export_type([t/0, progress/0]).

%% What is known about one destination: nothing, delivered, outcome known, or both.
-type progress() :: waiting | delivered | lost | done.

-opaque t() :: {
    Type :: atom(), Hash :: integer(), SentUs :: integer(),
    [{starl_monitor:robot_id(), progress()}]
}.

%% @doc A message that has just been sent.
-spec new(Type :: atom(), Hash :: integer(), SentUs :: integer(), [starl_monitor:robot_id()]) ->
    t().
new(Type, Hash, T, Dests) -> {Type, Hash, T, [{Dest, waiting} || Dest <- Dests]}.

%% @doc Is that what was sent?
-spec compare(Type :: atom(), Hash :: integer(), t()) -> ok | corrupted | {wrong_type, atom()}.
compare(Type, Hash, {Type, Hash, _, _}) -> ok;
compare(Type, _Hash, {Type, _Other, _, _}) -> corrupted;
compare(_Type, _Hash, {Sent, _, _, _}) -> {wrong_type, Sent}.

%% @doc What is known about a robot; a stranger is none of its destinations.
-spec progress(starl_monitor:robot_id(), t()) -> progress() | stranger.
progress(Robot, {_, _, _, Dests}) ->
    case lists:keyfind(Robot, 1, Dests) of
        {_, Progress} -> Progress;
        false -> stranger
    end.

%% @doc More is known about a destination.
-spec put_progress(starl_monitor:robot_id(), progress(), t()) -> t().
put_progress(Dest, Progress, {Type, Hash, SentUs, Dests}) ->
    {Type, Hash, SentUs, lists:keyreplace(Dest, 1, Dests, {Dest, Progress})}.

%% @doc Is an outcome open, or may something lost still be delivered, or can nothing more come?
-spec phase(t()) -> open | lost | done.
phase({_, _, _, Dests}) -> phase(Dests, done).

phase([], Phase) -> Phase;
phase([{_, done} | Dests], Phase) -> phase(Dests, Phase);
phase([{_, lost} | Dests], _Phase) -> phase(Dests, lost);
phase([_Open | _Dests], _Phase) -> open.

%% @doc The outcomes that are open will never be told.
-spec give_up(t()) -> t().
give_up({Type, Hash, SentUs, Dests}) ->
    {Type, Hash, SentUs, [{Dest, given_up(Progress)} || {Dest, Progress} <- Dests]}.

given_up(waiting) -> lost;
given_up(delivered) -> done;
given_up(Known) -> Known.

%% @doc The destinations whose outcome is open.
-spec open(t()) -> [starl_monitor:robot_id()].
open({_, _, _, Dests}) -> [Dest || {Dest, P} <- Dests, P =:= waiting orelse P =:= delivered].

%% @doc The destinations where it was reported lost and not delivered so far.
-spec lost(t()) -> [starl_monitor:robot_id()].
lost({_, _, _, Dests}) -> [Dest || {Dest, lost} <- Dests].
