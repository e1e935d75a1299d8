%% @doc A counter that only grows, by gossip. Each robot keeps a tally of every robot, and sends its
%% tallies to the others in turn ({@link starl_counter_tally}).
%% ```
%%   robot                                     the next of the others
%%     | tallies [{Robot, what it counted}] -------->|   merges each with its own
%%     |            (after gossip_ms: to the one after that)
%% '''
%% What does not fit into one message goes in several.
%%
%% A robot stores its own tally before it answers an increment. A restarted machine starts a new
%% life and goes on from what is stored. If the store is lost, damaged or set back, the others know
%% more of the robot's earlier lives, and the robot merges what they send.
%%
%% Memory is bounded by the robots of the team: nobody else is counted. Only the robot itself can
%% know of a count in its present life. If another robot claims such a count, the claim is false,
%% and the robot goes on in a life beyond the claimed one. There must always be room for such a
%% life. So nobody believes at once in a life that is far beyond all that robots begin. After such a
%% claim a robot believes in later lives step by step, one step each time that it sends its tallies.
%% The steps are stored, so the robots agree after restarts, too.
%%
%% Calls: `increment' and `value', answered with the value. Trace: `{incremented, Value}'; `{holds,
%% Value}' after a restart, and when others are heard to have counted; `{read, Value}'.
-module(starl_counter_gossip).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

-type value() :: non_neg_integer().
-type event() :: {incremented, value()} | {holds, value()} | {read, value()}.

-record(counter, {
    self :: starl:robot_id(),
    tallies = #{} :: #{starl:robot_id() => starl_counter_tally:t()},
    team :: starl_team:t(),
    %% the life in which this machine counts
    life :: starl_counter_tally:life(),
    %% the others: the tallies go to the first of them next
    others :: [starl:robot_id()],
    gossip_us :: pos_integer(),
    %% the latest life of a robot that is believed, where it is not ?LIFE
    believed = #{} :: #{starl:robot_id() => starl_counter_tally:life()},
    %% the robots of which a later life has been claimed since this robot last sent its tallies
    beyond = [] :: [starl:robot_id()]
}).

%% Beyond all lives that a robot begins by itself ({@link starl_robot_machines:lots/0}); and the step by which
%% the latest life that is believed rises.
-define(LIFE, (1 bsl 58)).

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) -> {ready, #counter{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    #{gossip_ms := GossipMs} = maps:merge(starl_options:defaults(starl_counter:options()), Config),
    {Own, Believed} = stored(Config),
    Counter = #counter{
        self = Self,
        tallies = maps:from_list([{Self, Own} || Own =/= starl_counter_tally:new()]),
        team = Team,
        life = max(Incarnation, starl_counter_tally:newest(Own) + 1),
        others = starl_team:others(Self, Team),
        believed = Believed,
        gossip_us = 1000 * GossipMs
    },
    Holds = [{trace, {holds, Value}} || Value <- [value(Counter)], Value > 0],
    {ready, Counter, Holds ++ [starl_sap:listen(counter, counter), gossip(Counter)]}.

stored(#{stored := {stored, Kept}}) -> Kept;
stored(#{stored := _NoneOrDamaged}) -> {starl_counter_tally:new(), #{}}.

store(#counter{self = Self, believed = Believed} = Counter) ->
    {store, {tally(Self, Counter), Believed}}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #counter{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, increment, ready, #counter{self = Self, life = Life} = C, _Meta) ->
    Counted = put_tally(Self, starl_counter_tally:add(Life, tally(Self, C)), C),
    Value = value(Counted),
    {keep_state, Counted, [{trace, {incremented, Value}}, store(Counted), {reply, From, Value}]};
handle_event({call, From}, value, ready, Counter, _Meta) ->
    Value = value(Counter),
    {keep_state_and_data, [{trace, {read, Value}}, {reply, From, Value}]};
handle_event({timeout, gossip}, _, ready, Counter, _Meta) ->
    {Wider, Store} = widen(Counter),
    {Sent, Actions} = send(Wider),
    {keep_state, Sent, Store ++ Actions ++ [gossip(Sent)]};
handle_event(cast, {message, _From, counter, {tallies, List}}, ready, Counter, _Meta) ->
    heard(lists:foldl(fun claimed/2, Counter, List), Counter);
handle_event(info, {restarted, sap}, ready, _Counter, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(counter, counter)]};
handle_event(info, {restarted, _}, ready, _Counter, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(counter, {tallies, List}) -> starl_shape:is({list, starl_counter_tally:shape()}, List);
accepts(_, _) -> false.

value(#counter{tallies = Tallies}) ->
    lists:sum([starl_counter_tally:total(Tally) || Tally <- maps:values(Tallies)]).

tally(Robot, #counter{tallies = Tallies}) ->
    maps:get(Robot, Tallies, starl_counter_tally:new()).

put_tally(Robot, Tally, #counter{tallies = Tallies} = Counter) ->
    Counter#counter{tallies = Tallies#{Robot => Tally}}.

gossip(#counter{gossip_us = Us}) -> {{timeout, gossip}, Us, gossip}.

%% A robot without tallies has nothing to send.
send(#counter{others = [To | Others], tallies = Tallies} = Counter) when map_size(Tallies) > 0 ->
    List = [
        starl_counter_tally:to_term(Robot, Tally)
     || {Robot, Tally} <- lists:sort(maps:to_list(Tallies))
    ],
    Posts = [starl_sap:post(To, counter, {tallies, Part}) || Part <- starl_payload:parts(List)],
    {Counter#counter{others = Others ++ [To]}, Posts};
send(Counter) ->
    {Counter, []}.

%% -- what others claim ----------------------------------------------------------------------

claimed(Entry, #counter{team = Team} = Counter) ->
    case starl_counter_tally:of_term(Entry) of
        {Robot, Claim} ->
            case starl_team:has(Robot, Team) of
                true -> believe(Robot, Claim, Counter);
                false -> Counter
            end;
        malformed ->
            Counter
    end.

believe(Robot, Claim, #counter{beyond = Beyond} = Counter) ->
    case starl_counter_tally:newest(Claim) > latest(Robot, Counter) of
        true ->
            Counter#counter{beyond = ordsets:add_element(Robot, Beyond)};
        false ->
            Before = tally(Robot, Counter),
            After = starl_counter_tally:merge(Claim, Before),
            go_on(Robot, Before, After, put_tally(Robot, After, Counter))
    end.

latest(Robot, #counter{believed = Believed}) -> maps:get(Robot, Believed, ?LIFE).

%% A life beyond all that are believed may be believed when it is claimed again.
widen(#counter{beyond = []} = Counter) ->
    {Counter, []};
widen(#counter{beyond = Beyond, believed = Believed} = Counter) ->
    Later = maps:from_list([{Robot, latest(Robot, Counter) + ?LIFE} || Robot <- Beyond]),
    Wider = Counter#counter{beyond = [], believed = maps:merge(Believed, Later)},
    {Wider, [store(Wider)]}.

%% A false claim about the present life of this robot ends that life.
go_on(Self, Before, After, #counter{self = Self, life = Life} = Counter) ->
    case starl_counter_tally:is_taken(Life, Before, After) of
        true -> Counter#counter{life = starl_counter_tally:newest(After) + 1};
        false -> Counter
    end;
go_on(_Other, _Before, _After, Counter) ->
    Counter.

heard(Next, Before) ->
    case {value(Next), value(Before)} of
        {Same, Same} -> {keep_state, Next};
        {More, _} -> {keep_state, Next, [{trace, {holds, More}}]}
    end.
