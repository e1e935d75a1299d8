%% @doc The messages of Foxglove's WebSocket protocol. A viewer may speak one of two versions,
%% `foxglove.sdk.v1' and the older `foxglove.websocket.v1', which are the same here. Channels and
%% schemas are those of recordings ({@link starl_trace_schema}). A pure module.
-module(starl_view_foxglove_words).

-export([chosen/1, server_info/2, advertise/0, unadvertise/0, status/2]).
-export([message/3, time/1, command/1, control/1, playback/1]).

-export_type([command/0, level/0, control/0, playback/0]).

-type level() :: info | warning | error.

%% What a viewer wants of the run's time: `seek' is a time of the run.
-type control() :: #{
    play := boolean(), speed := float(), seek := Us :: non_neg_integer() | none, id := binary()
}.

%% How the run goes; `id' is that of the request that this answers, or empty.
-type playback() :: #{
    status := playing | paused | ended,
    now_us := integer(),
    speed := number(),
    seeked := boolean(),
    id := binary()
}.

-type id() :: 0..16#ffffffff.

%% What a viewer asks for. `other': what this server has not declared. Of a list, what makes no sense
%% is told apart.
-type command() ::
    {subscribe, [{id(), starl_trace_schema:channel()}], Bad :: [term()]}
    | {unsubscribe, [id()], Bad :: [term()]}
    | {other, binary()}
    | garbage.

%% Millionths of a unit are enough for all that is shown.
-define(DECIMALS, 6).

%% @doc The version that is spoken, of those that a viewer offers.
-spec chosen([binary()]) -> {ok, binary()} | none.
chosen(Offered) ->
    Known = [<<"foxglove.sdk.v1">>, <<"foxglove.websocket.v1">>],
    case [Version || Version <- Known, lists:member(Version, Offered)] of
        [Version | _] -> {ok, Version};
        [] -> none
    end.

%% @doc The first word of a session; its name is another one for each run. A run that can be paused and
%% taken to another time comes with its end.
-spec server_info(binary(), UntilUs :: non_neg_integer() | none) -> iodata().
server_info(Session, Until) ->
    json(
        [
            {op, <<"serverInfo">>},
            {name, <<"starl">>},
            {capabilities, [<<"time">>] ++ [<<"playbackControl">> || Until =/= none]},
            {supportedEncodings, [<<"json">>]},
            {metadata, {[]}},
            {sessionId, Session}
        ] ++ [Time || Until =/= none, Time <- [{dataStartTime, at(0)}, {dataEndTime, at(Until)}]]
    ).

at(Us) -> {[{sec, Us div 1000000}, {nsec, Us rem 1000000 * 1000}]}.

%% The channels that viewers can see. The exact terms of a recording are for nobody here.
-spec channels() -> [{id(), starl_trace_schema:channel()}].
channels() ->
    Names = [
        scenario, tf, scene, log, trace, packets, faults, verdicts, metrics, measures, drawings
    ],
    [{starl_trace_schema:id(Name), Name} || Name <- Names].

%% @doc The offer of all channels.
-spec advertise() -> iodata().
advertise() ->
    All = starl_trace_schema:channels(),
    Schemas = maps:from_list([{Id, {Name, Text}} || {schema, Id, Name, _, Text} <- All]),
    Channels = [
        channel(Id, Topic, maps:get(Schema, Schemas))
     || {channel, Id, Schema, Topic, _, _} <- All, lists:keymember(Id, 1, channels())
    ],
    json([{op, <<"advertise">>}, {channels, Channels}]).

channel(Id, Topic, {Name, Schema}) ->
    {[
        {id, Id},
        {topic, unicode:characters_to_binary(Topic)},
        {encoding, <<"json">>},
        {schemaName, unicode:characters_to_binary(Name)},
        {schema, iolist_to_binary(Schema)},
        {schemaEncoding, <<"jsonschema">>}
    ]}.

%% @doc The end of that offer: subscriptions end with it.
-spec unadvertise() -> iodata().
unadvertise() -> json([{op, <<"unadvertise">>}, {channelIds, [Id || {Id, _} <- channels()]}]).

%% @doc A line for the viewer's user.
-spec status(level(), unicode:chardata()) -> iodata().
status(Level, Text) ->
    json([
        {op, <<"status">>},
        {level, maps:get(Level, #{info => 0, warning => 1, error => 2})},
        {message, unicode:characters_to_binary(Text)}
    ]).

json(Pairs) -> starl_json:encode({Pairs}, ?DECIMALS).

%% @doc A message of a subscription.
-spec message(id(), AtUs :: integer(), iodata()) -> iolist().
message(Subscription, At, Text) ->
    [<<1, Subscription:32/little, (1000 * max(0, At)):64/little>>, Text].

%% @doc The time of the run.
-spec time(NowUs :: integer()) -> binary().
time(Now) -> <<2, (1000 * max(0, Now)):64/little>>.

%% @doc What a viewer's bytes say.
-spec control(binary()) -> {ok, control()} | garbage.
control(<<3, Play, Speed:32/float-little, Seeks, Ns:64/little, N:32/little, Id:N/binary>>) when
    Play =< 1, Seeks =< 1, N =< 100
->
    Seek =
        case Seeks of
            1 -> Ns div 1000;
            0 -> none
        end,
    {ok, #{play => Play =:= 0, speed => Speed, seek => Seek, id => Id}};
control(_) ->
    garbage.

%% @doc Tells how the run goes; only for a viewer that has asked for something itself.
-spec playback(playback()) -> binary().
playback(#{status := Status, now_us := Now, speed := Speed, seeked := Seeked, id := Id}) ->
    #{Status := Number} = #{playing => 0, paused => 1, ended => 3},
    Did =
        case Seeked of
            true -> 1;
            false -> 0
        end,
    Ns = 1000 * max(0, Now),
    <<5, Number, Ns:64/little, Speed:32/float-little, Did, (byte_size(Id)):32/little, Id/binary>>.

%% @doc What a viewer's text says.
-spec command(binary()) -> command().
command(Text) ->
    case starl_json:decode(Text) of
        {ok, #{<<"op">> := <<"subscribe">>, <<"subscriptions">> := List}} when is_list(List) ->
            {Good, Bad} = parted([subscription(Each) || Each <- List]),
            {subscribe, Good, Bad};
        {ok, #{<<"op">> := <<"unsubscribe">>, <<"subscriptionIds">> := List}} when is_list(List) ->
            {Good, Bad} = lists:partition(fun is_id/1, List),
            {unsubscribe, Good, Bad};
        {ok, #{<<"op">> := Op}} when is_binary(Op) ->
            {other, Op};
        _ ->
            garbage
    end.

parted(List) -> {[Good || {ok, Good} <- List], [Bad || {bad, Bad} <- List]}.

subscription(#{<<"id">> := Id, <<"channelId">> := Channel} = Each) ->
    case is_id(Id) andalso lists:keyfind(Channel, 1, channels()) of
        {_, Name} -> {ok, {Id, Name}};
        false -> {bad, Each}
    end;
subscription(Each) ->
    {bad, Each}.

is_id(Id) -> is_integer(Id) andalso Id >= 0 andalso Id =< 16#ffffffff.
