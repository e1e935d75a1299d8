%% @doc Judges that messages are delivered where packets get through, for {@link starl_sap_monitor}.
%% Chance alone does not lose all transmissions of message after message between the same two
%% robots.
%%
%% A message that its source reports lost after its last transmission was unlucky with a known
%% probability: that a packet or its acknowledgement is lost each time. The probabilities of
%% consecutive losses between two robots are multiplied. A series ends when a message that was sent
%% after its last one is acknowledged. The time of sending counts: of many messages under way at
%% once, those without luck are all reported last. A series that is rarer than 10^-9 breaks the
%% contract.
%%
%% Before the first message between two robots is acknowledged, and again after a restart of one of
%% them, the receiver first asks the source about its boot. Then five packets must all get through:
%% a message, the question, its answer, the message again and the acknowledgement. So such a loss is
%% more probable.
%%
%% A loss does not count if a fault met one of the two robots while the message was under way, if
%% one of them was down or restarted, or if the receiver had no room for a message of the source.
%% Pure.
-module(starl_sap_monitor_delivery).

-export([new/1, broken/2, begins/3, goes/2, refuses/4, acknowledged/4, lost/5, unjudged/2]).

-export_type([t/0]).

-record(delivery, {
    %% the probability that all transmissions of one message are lost, or why nothing is judged
    unlucky :: float() | {off, [starl_unjudged:clause()]},
    %% the same where the receiver asks first
    first :: float() | {off, [starl_unjudged:clause()]},
    %% the pairs of which a message was acknowledged since both began
    known = #{} :: #{{Source :: starl:robot_id(), Dest :: starl:robot_id()} => true},
    %% the time that all transmissions take
    whole_us :: non_neg_integer(),
    faults :: starl_assumption:t(),
    down = #{} :: #{starl:robot_id() => true},
    began = #{} :: #{starl:robot_id() => integer()},
    refused = #{} :: #{{Source :: starl:robot_id(), Dest :: starl:robot_id()} => integer()},
    %% when the latest message that was acknowledged was sent
    arrived = #{} :: #{{Source :: starl:robot_id(), Dest :: starl:robot_id()} => integer()},
    %% the probability of the series, and when its last message was sent
    rows = #{} :: #{{Source :: starl:robot_id(), Dest :: starl:robot_id()} => {float(), integer()}}
}).

-opaque t() :: #delivery{}.

-define(CLAUSE, "delivered, where packets get through").
-define(DRIFT_PPM, 10000).

%% @doc `unlucky': see above; without it nothing is judged. `whole_us': the time of all transmissions. `faults': the
%% windows of all faults.
-spec new(#{
    unlucky => float() | {off, [starl_unjudged:clause()]},
    first => float(),
    whole_us => non_neg_integer(),
    faults => [starl_assumption:window()],
    _ => _
}) -> t().
new(Config) ->
    Unlucky = maps:get(unlucky, Config, {off, []}),
    #delivery{
        unlucky = Unlucky,
        first = maps:get(first, Config, Unlucky),
        whole_us = maps:get(whole_us, Config, 0),
        faults = starl_assumption:new(maps:get(faults, Config, []), ?DRIFT_PPM)
    }.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #delivery{faults = Faults} = D) ->
    D#delivery{faults = starl_assumption:broken(Window, Faults)}.

%% @doc Handles a start or restart of the robot's SAP.
-spec begins(Us :: integer(), starl:robot_id(), t()) -> t().
begins(T, Robot, #delivery{down = Down, began = Began, known = Known} = D) ->
    D#delivery{
        down = maps:remove(Robot, Down),
        began = Began#{Robot => T},
        known = maps:filter(fun({A, B}, _) -> A =/= Robot andalso B =/= Robot end, Known)
    }.

%% @doc The robot is down, or dead.
-spec goes(starl:robot_id(), t()) -> t().
goes(Robot, #delivery{down = Down} = D) -> D#delivery{down = Down#{Robot => true}}.

%% @doc The receiver did not take a packet of the source.
-spec refuses(Us :: integer(), Dest :: starl:robot_id(), Source :: starl:robot_id(), t()) -> t().
refuses(T, Dest, Source, #delivery{refused = Refused} = D) ->
    D#delivery{refused = Refused#{{Source, Dest} => T}}.

%% @doc A message that was sent at `SentUs' was acknowledged.
-spec acknowledged(SentUs :: integer(), Source :: starl:robot_id(), Dest :: starl:robot_id(), t()) ->
    t().
acknowledged(_SentUs, _Source, _Dest, #delivery{unlucky = {off, _}} = D) ->
    D;
acknowledged(SentUs, Source, Dest, #delivery{arrived = Arrived, known = Known} = D) ->
    Pair = {Source, Dest},
    Latest = max(SentUs, maps:get(Pair, Arrived, SentUs)),
    D#delivery{arrived = Arrived#{Pair => Latest}, known = Known#{Pair => true}}.

%% @doc A message that was sent at `SentUs' was reported lost. `in_vain': no chance explains it any more; each row is
%% reported once.
-spec lost(
    Us :: integer(), SentUs :: integer(), Source :: starl:robot_id(), Dest :: starl:robot_id(), t()
) ->
    {ok | in_vain, t()}.
lost(T, SentUs, Source, Dest, #delivery{unlucky = Unlucky, rows = Rows} = D) when
    is_float(Unlucky)
->
    case counts(T, SentUs, Source, Dest, D) of
        true ->
            Row = chance(Source, Dest, D) * series({Source, Dest}, D),
            case starl_sap_schedule:is_rare(Row) of
                true -> {in_vain, D#delivery{rows = maps:remove({Source, Dest}, Rows)}};
                false -> {ok, D#delivery{rows = Rows#{{Source, Dest} => {Row, SentUs}}}}
            end;
        false ->
            {ok, D}
    end;
lost(_T, _SentUs, _Source, _Dest, D) ->
    {ok, D}.

series(Pair, #delivery{rows = Rows, arrived = Arrived}) ->
    case Rows of
        #{Pair := {Row, LastUs}} ->
            case maps:get(Pair, Arrived, LastUs) of
                Us when Us > LastUs -> 1.0;
                _ -> Row
            end;
        #{} ->
            1.0
    end.

chance(Source, Dest, #delivery{unlucky = Unlucky, first = First, known = Known}) ->
    case Known of
        #{{Source, Dest} := true} -> Unlucky;
        #{} -> First
    end.

counts(T, SentUs, Source, Dest, #delivery{whole_us = Whole, faults = Faults} = D) ->
    T - SentUs >= Whole andalso
        is_up(SentUs, Source, D) andalso
        is_up(SentUs, Dest, D) andalso
        maps:get({Source, Dest}, D#delivery.refused, SentUs - 1) < SentUs andalso
        starl_assumption:is_kept(
            [Source, Dest], SentUs - starl_sap_schedule:settled_us(), T, Faults
        ).

is_up(SentUs, Robot, #delivery{down = Down, began = Began}) ->
    not is_map_key(Robot, Down) andalso
        case Began of
            #{Robot := At} -> At + starl_sap_schedule:settled_us() < SentUs;
            #{} -> true
        end.

%% @doc Is the clause not judged in this run, and why not?
-spec unjudged(EndUs :: integer(), t()) -> [starl_unjudged:clause()].
unjudged(_EndUs, #delivery{unlucky = {off, Why}}) ->
    Why;
unjudged(EndUs, #delivery{whole_us = Whole, faults = Faults}) ->
    starl_unjudged:excused(?CLAUSE, Whole, EndUs, Faults).
