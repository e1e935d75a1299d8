%% @doc Joins sender and receiver reports of a live run into one delivery record per packet
%% ({@link starl_observer:packet_report()}). A pure module.
%%
%% Nobody knows everything about a live packet: the sender knows when it was sent, the receiver whether
%% it came. Both reports wait until the packet's time is due. A packet that its receiver does not
%% report is `unheard' then. The network may copy a packet, and a killed node may not report what it
%% has sent: such a packet is recorded as sent when it came.
-module(starl_packet_fates).

-export([new/0, report/2, due/2, early/1]).

-export_type([t/0, event/0]).

%% A packet that has come, or was sent, with the same content between the same robots.
-type key() :: {From :: starl:robot_id(), To :: starl:robot_id(), Hash :: integer()}.

-type event() :: {AtUs :: integer(), starl:robot_id(), radio, starl_observer:packet()}.

-record(fates, {
    sent = gb_sets:new() :: gb_sets:set({integer(), pos_integer(), key(), short()}),
    %% by content, the earliest first
    came = #{} :: #{key() => [came(), ...]},
    n = 1 :: pos_integer(),
    early = #{} :: #{link() => early()}
}).

-type came() :: {AtUs :: integer(), short(), starl_observer:fate()}.

-type link() :: {From :: starl:robot_id(), To :: starl:robot_id()}.

%% Packets that came after they were sent; those that came before, and the sum of these times.
-type early() :: {non_neg_integer(), Early :: non_neg_integer(), SumUs :: non_neg_integer()}.

-type short() :: {starl_packet:brief(), Bytes :: pos_integer()}.

-opaque t() :: #fates{}.

%% Longer than a packet takes through a network, before the filter of its receiver delays it.
-define(SOON_US, 300000).

%% @doc Nothing has been sent.
-spec new() -> t().
new() -> #fates{}.

%% @doc Takes the report of one end into account.
-spec report(
    {AtUs, starl:robot_id(), radio, starl_observer:packet_report() | starl_observer:packet()}, t()
) ->
    t()
when
    AtUs :: integer().
report({At, From, radio, {packet, To, Brief, Bytes, Fate}}, #fates{came = Came, n = N} = Fates) ->
    %% it is known already
    Fates#fates{n = N + 1, came = Came#{{From, To, -N} => [{At, {Brief, Bytes}, Fate}]}};
report({At, From, radio, {sent, To, Brief, Bytes, Hash}}, #fates{sent = Sent, n = N} = Fates) ->
    Entry = {At, N, {From, To, Hash}, {Brief, Bytes}},
    Fates#fates{sent = gb_sets:add_element(Entry, Sent), n = N + 1};
report({At, To, radio, {came, From, Brief, Bytes, Hash, Fate}}, #fates{came = Came} = Fates) ->
    Key = {From, To, Hash},
    Others = maps:get(Key, Came, []),
    Fates#fates{came = Came#{Key => lists:merge(Others, [{At, {Brief, Bytes}, Fate}])}}.

%% @doc The packets whose time is due, in the order of their times.
-spec due(UntilUs :: integer() | infinity, t()) -> {[event()], t()}.
due(Until, Fates0) ->
    {Packets, Fates} = sent_until(Until, [], Fates0),
    {Strange, Left} = came_until(Until, Fates),
    {lists:keymerge(1, Packets, Strange), Left}.

%% An atom is larger than any number.
sent_until(Until, Packets, #fates{sent = Sent} = Fates) ->
    case gb_sets:is_empty(Sent) orelse gb_sets:smallest(Sent) of
        {At, _, {From, To, _} = Key, {Brief, Bytes}} when At =< Until ->
            {_, Left} = gb_sets:take_smallest(Sent),
            {Fate, Next} = fate(At, Key, Fates#fates{sent = Left}),
            Packet = {At, From, radio, {packet, To, Brief, Bytes, Fate}},
            sent_until(Until, [Packet | Packets], Next);
        _ ->
            {lists:reverse(Packets), Fates}
    end.

%% The same content may be sent again, and come again: of what came soon after this packet the
%% earliest is this one. Clocks that differ may also have it come before it was sent.
fate(At, Key, #fates{came = Came} = Fates) ->
    Known = maps:get(Key, Came, []),
    {Before, After} = lists:splitwith(fun({Then, _, _}) -> Then < At end, Known),
    case {After, Before} of
        {[{Then, _, Fate} | Others], _} when Then - At =< ?SOON_US ->
            {Fate, matched(Key, Then - At, Before ++ Others, Fates)};
        {_, [{Then, _, Fate} | Others]} ->
            {Fate, matched(Key, Then - At, Others ++ After, Fates)};
        _ ->
            {{lost, unheard}, Fates}
    end.

matched({From, To, _} = Key, Us, Left, #fates{came = Came, early = Early} = Fates) ->
    {Late, N, Sum} = maps:get({From, To}, Early, {0, 0, 0}),
    Counted =
        case Us < 0 of
            true -> {Late, N + 1, Sum - Us};
            false -> {Late + 1, N, Sum}
        end,
    Fates#fates{came = left(Key, Left, Came), early = Early#{{From, To} => Counted}}.

left(Key, [], Came) -> maps:remove(Key, Came);
left(Key, Left, Came) -> Came#{Key := Left}.

came_until(_Until, #fates{came = Came} = Fates) when map_size(Came) =:= 0 -> {[], Fates};
came_until(Until, #fates{came = Came} = Fates) ->
    Split = maps:map(
        fun(_, Entries) -> lists:splitwith(fun({At, _, _}) -> At =< Until end, Entries) end, Came
    ),
    Packets = [
        {At, From, radio, {packet, To, Brief, Bytes, Fate}}
     || {{From, To, _}, {Old, _}} <- maps:to_list(Split), {At, {Brief, Bytes}, Fate} <- Old
    ],
    Left = maps:filtermap(fun young/2, Split),
    {lists:sort(Packets), Fates#fates{came = Left}}.

young(_Key, {_Old, []}) -> false;
young(_Key, {_Old, Young}) -> {true, Young}.

%% @doc The links on which most packets came before they were sent, by so much on average: the clocks
%% of the two robots differ.
-spec early(t()) -> [{link(), Us :: pos_integer()}].
early(#fates{early = Early}) ->
    lists:sort([
        {Link, max(1, Sum div N)}
     || {Link, {Late, N, Sum}} <- maps:to_list(Early), N > Late
    ]).
