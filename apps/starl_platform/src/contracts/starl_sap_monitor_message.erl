%% @doc A message in the monitor of the SAP: its type and content, and its progress at each
%% destination. Pure; a part of {@link starl_sap_monitor}.
-module(starl_sap_monitor_message).

-export([
    new/4, compare/3, progress/2, put_progress/3, phase/1, give_up/1, open/1, lost/1, sent_us/1
]).
-export([called/2, failed/3, due/1, answered/1]).

-export_type([t/0, progress/0, how/0]).

%% What is known about one destination: nothing, delivered, outcome known, or both.
-type progress() :: waiting | delivered | lost | done.

%% A call of a message to one robot or to all.
-type how() :: one | all.

%% An open call, with the destinations at which its message was lost, and why.
-type call() :: none | {how(), [{starl_monitor:robot_id(), lost | restarted}]}.

-opaque t() :: {
    Type :: term(),
    Hash :: integer(),
    SentUs :: integer(),
    [{starl_monitor:robot_id(), progress()}],
    call()
}.

%% @doc A message that has just been sent; `none': it has no destination.
-spec new(Type :: term(), Hash :: integer(), SentUs :: integer(), [starl_monitor:robot_id()]) ->
    t() | none.
new(_Type, _Hash, _T, []) -> none;
new(Type, Hash, T, Dests) -> {Type, Hash, T, [{Dest, waiting} || Dest <- Dests], none}.

%% @doc Are these the type and the content that were sent?
-spec compare(Type :: term(), Hash :: integer(), t()) ->
    ok | corrupted | {wrong_type, Sent :: term()}.
compare(Type, Hash, {Type, Hash, _, _, _}) -> ok;
compare(Type, _Hash, {Type, _Other, _, _, _}) -> corrupted;
compare(_Type, _Hash, {Sent, _, _, _, _}) -> {wrong_type, Sent}.

%% @doc The progress at a robot; `stranger': the robot is none of the destinations.
-spec progress(starl_monitor:robot_id(), t()) -> progress() | stranger.
progress(Robot, {_, _, _, Dests, _}) ->
    case lists:keyfind(Robot, 1, Dests) of
        {_, Progress} -> Progress;
        false -> stranger
    end.

%% @doc Sets the progress at a destination.
-spec put_progress(starl_monitor:robot_id(), progress(), t()) -> t().
put_progress(Dest, Progress, {Type, Hash, SentUs, Dests, Call}) ->
    {Type, Hash, SentUs, lists:keyreplace(Dest, 1, Dests, {Dest, Progress}), Call}.

%% @doc `open': an outcome or the answer is still to come; `lost': only a lost message may still be
%% delivered; `done': nothing more can come.
-spec phase(t()) -> open | lost | done.
phase({_, _, _, Dests, none}) -> phase(Dests, done);
phase({_, _, _, _, _Called}) -> open.

phase([], Phase) -> Phase;
phase([{_, done} | Dests], Phase) -> phase(Dests, Phase);
phase([{_, lost} | Dests], _Phase) -> phase(Dests, lost);
phase([_Open | _Dests], _Phase) -> open.

%% @doc Gives up the open outcomes and the answer: they will never be reported.
-spec give_up(t()) -> t().
give_up({Type, Hash, SentUs, Dests, _Call}) ->
    {Type, Hash, SentUs, [{Dest, given_up(Progress)} || {Dest, Progress} <- Dests], none}.

given_up(waiting) -> lost;
given_up(delivered) -> done;
given_up(Known) -> Known.

%% @doc The destinations whose outcome is open.
-spec open(t()) -> [starl_monitor:robot_id()].
open({_, _, _, Dests, _}) -> [Dest || {Dest, P} <- Dests, P =:= waiting orelse P =:= delivered].

%% @doc The destinations where it was reported lost and has not been delivered so far.
-spec lost(t()) -> [starl_monitor:robot_id()].
lost({_, _, _, Dests, _}) -> [Dest || {Dest, lost} <- Dests].

%% @doc When it was sent (us).
-spec sent_us(t()) -> integer().
sent_us({_, _, SentUs, _, _}) -> SentUs.

%% @doc A caller waits for the answer.
-spec called(how(), t()) -> t().
called(How, {Type, Hash, SentUs, Dests, none}) -> {Type, Hash, SentUs, Dests, {How, []}}.

%% @doc The message was lost at this destination; a caller must learn of it.
-spec failed(starl_monitor:robot_id(), lost | restarted, t()) -> t().
failed(_Dest, _Why, {_, _, _, _, none} = Message) ->
    Message;
failed(Dest, Why, {Type, Hash, SentUs, Dests, {How, Failed}}) ->
    {Type, Hash, SentUs, Dests, {How, [{Dest, Why} | Failed]}}.

%% @doc The answer that the caller must get, unless nobody has called or an outcome is still open.
-spec due(t()) -> {answer, starl_sap:answer()} | not_called | too_early.
due({_, _, _, _, none}) ->
    not_called;
due({_, _, _, _, {How, Failed}} = Message) ->
    case open(Message) of
        [] -> {answer, answer(How, lists:sort(Failed))};
        _ -> too_early
    end.

answer(_How, []) -> ok;
answer(one, [{_, Why}]) -> {error, Why};
answer(_All, Failed) -> {error, {lost, [Dest || {Dest, _} <- Failed]}}.

%% @doc The caller has its answer.
-spec answered(t()) -> t().
answered({Type, Hash, SentUs, Dests, _Call}) -> {Type, Hash, SentUs, Dests, none}.
