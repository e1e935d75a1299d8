%% @doc A counter that only grows, by gossip: each robot has an entry for every robot, and tells its
%% entries to the others in turn; of two numbers for one entry the larger is the later one.
%% ```
%%   robot                                     the next of the others
%%     | entries [{Robot, Life, Count}] ------------>|   takes the larger of each
%%     |            (after gossip_ms: to the one after that)
%% '''
%% A restarted machine has forgotten its count. It counts in a new entry, that of its life, so no
%% entry ever goes back and nothing need be stored.
%%
%% Calls: `increment' and `value', answered with the value. Trace: `{incremented, Value}',
%% `{holds, Value}' when others are heard to have counted, `{read, Value}'.
-module(starl_counter_gossip).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

-type value() :: non_neg_integer().
-type event() :: {incremented, value()} | {holds, value()} | {read, value()}.

-record(counter, {
    %% this machine's entry: its robot, and which life of the robot it is
    own :: entry(),
    entries = #{} :: #{entry() => pos_integer()},
    %% the others, the next to be told first
    others :: [starl:robot_id()],
    gossip_us :: pos_integer()
}).

-type entry() :: {starl:robot_id(), Life :: pos_integer()}.

-define(GOSSIP_MS, 1000).

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) -> {ready, #counter{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Life} = Config) ->
    Counter = #counter{
        own = {Self, Life},
        others = starl_team:others(Self, Team),
        gossip_us = 1000 * maps:get(gossip_ms, Config, ?GOSSIP_MS)
    },
    {ready, Counter, [starl_sap:listen(counter, counter), gossip(Counter)]}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #counter{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, increment, ready, #counter{own = Own, entries = Entries} = C, _Meta) ->
    Counted = C#counter{entries = maps:update_with(Own, fun(N) -> N + 1 end, 1, Entries)},
    Value = value(Counted),
    {keep_state, Counted, [{trace, {incremented, Value}}, {reply, From, Value}]};
handle_event({call, From}, value, ready, Counter, _Meta) ->
    Value = value(Counter),
    {keep_state_and_data, [{trace, {read, Value}}, {reply, From, Value}]};
handle_event({timeout, gossip}, _, ready, Counter, _Meta) ->
    {Told, Actions} = tell(Counter),
    {keep_state, Told, Actions ++ [gossip(Told)]};
handle_event(cast, {message, _From, counter, {entries, List}}, ready, Counter, _Meta) ->
    heard(lists:foldl(fun larger/2, Counter#counter.entries, List), Counter);
handle_event(info, {restarted, sap}, ready, _Counter, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(counter, counter)]};
handle_event(info, {restarted, _}, ready, _Counter, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(counter, {entries, List}) -> starl_shape:is({list, [count, count, count]}, List);
accepts(_, _) -> false.

value(#counter{entries = Entries}) -> lists:sum(maps:values(Entries)).

gossip(#counter{gossip_us = Us}) -> {{timeout, gossip}, Us, gossip}.

%% A robot without entries has nothing to tell.
tell(#counter{others = [To | Others], entries = Entries} = Counter) when map_size(Entries) > 0 ->
    List = [{Robot, Life, N} || {{Robot, Life}, N} <- lists:sort(maps:to_list(Entries))],
    {Counter#counter{others = Others ++ [To]}, [starl_sap:post(To, counter, {entries, List})]};
tell(Counter) ->
    {Counter, []}.

larger({Robot, Life, N}, Entries) ->
    maps:update_with({Robot, Life}, fun(Known) -> max(Known, N) end, N, Entries).

heard(Entries, #counter{entries = Entries}) ->
    keep_state_and_data;
heard(Entries, Counter) ->
    More = Counter#counter{entries = Entries},
    {keep_state, More, [{trace, {holds, value(More)}}]}.
