%% @doc Geocast by flooding: every robot offers what it holds until the message's lifetime is
%% over, gives it to those that ask, and delivers it when it is inside the area.
%% ```
%%   source                  relay                     robot inside
%%     | offer {Id, left} ---->| (unknown)               |
%%     |<---- ask {Id, Asked} -|                         |
%%     | give {message, left,  |                         |
%%     |       [relay, Asked]}>| held until Asked + left |
%%     |                       | offer {Id, left} ------>| asks, is given it, and where am I?
%%     | offer (50 ms later) ->| known: nothing          | inside: delivered
%%     |                       |<----------- offer {Id}--| (all repeat: 0, 50, 150, 350, … ms)
%% '''
%% No absolute time leaves a robot, and no delay is taken for granted. What is left of the
%% lifetime counts from when the receiver asked, by its own clock ({@link
%% starl_geocast_lifetime}): so however long packets are under way, whatever a robot holds has a
%% deadline that is not after the end of the window, and nothing is delivered later. A packet
%% that carried the message at once would save the question, but could lie in the air, or in a
%% robot that stands still, beyond every bound. What is left also bounds the message's age from
%% above, which a restarted robot needs: it does not know what it delivered before, so it
%% delivers only what was surely sent after its restart.
%%
%% An id is remembered until its window is surely over everywhere (its whole lifetime from when
%% it was first held: after that nobody gives it), its body no longer than it lives. At most
%% `limit' messages are held; beyond that new ones are not taken.
%%
%% Calls: `{send, Area, Type, Body, LifetimeUs, Hops}', answer `ok' or `{error, full}'. Casts:
%% `{listen, Type, Machine}'; a listener gets the cast `{message, From, Type, Body}'.
%% Trace: `{sent, Id, Area, LifetimeUs}', `{delivered, Id}', `{full, Id}'.
-module(starl_geocast_flood).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-export_type([config/0, id/0]).

%% `drift_ppm': the greatest drift of a clock; `position_error_mm': how far a position told may
%% be from the true one; `first_ms', `longest_ms': the first wait before an offer is repeated,
%% doubled each time up to the longest; `jitter_ms': a relay waits up to so long before its
%% first; `ask_ms': how long to wait for what was asked for before asking again; `gather_ms':
%% how long to wait for others that ask for the same; `check_ms': how often a robot looks whether
%% it has come into an area; `listeners': from the start on, also after a restart.
-type config() :: #{
    drift_ppm => non_neg_integer(),
    position_error_mm => float(),
    first_ms => pos_integer(),
    longest_ms => pos_integer(),
    jitter_ms => non_neg_integer(),
    ask_ms => pos_integer(),
    gather_ms => non_neg_integer(),
    check_ms => pos_integer(),
    limit => pos_integer(),
    listeners => #{Type :: atom() => starl_machine:name()}
}.

%% Who sent it, in which incarnation, its how many-eth.
-type id() :: {starl:robot_id(), Incarnation :: pos_integer(), N :: pos_integer()}.

%% What is given: the content, the whole lifetime and what is left of it, the hops left.
-type parcel() :: {
    id(), starl_geocast:area(), Type :: atom(), Body :: term(), LifetimeUs :: pos_integer(),
    LeftUs :: integer(), Hops :: non_neg_integer()
}.

%% When a question was asked, by the asker's clock and in which life of its machine.
-type asked() :: {Incarnation :: pos_integer(), Us :: integer()}.

%% A position that took longer to come is that of another place.
-define(FRESH_US, 100000).
%% A question is asked so often; then another offer has to come.
-define(QUESTIONS, 4).
%% An offer is better than what is held if it has more left by this part of the lifetime.
-define(BETTER, 8).
%% So many are given a message with one packet.
-define(AT_ONCE, 50).

%% A message that is alive, until a time of the own clock; who has asked for it.
-record(held, {
    area :: starl_geocast:area(),
    type :: atom(),
    body :: term(),
    lifetime_us :: pos_integer(),
    until :: integer(),
    hops :: non_neg_integer(),
    wait_us :: pos_integer(),
    deliverable :: boolean(),
    askers = [] :: [{starl:robot_id(), asked()}]
}).

-record(flood, {
    self :: starl:robot_id(),
    incarnation :: pos_integer(),
    started :: integer(),
    random :: rand:state(),
    config :: map(),
    next = 1 :: pos_integer(),
    %% the ids held or held once
    known = #{} :: #{id() => #held{} | over},
    %% what was asked for, of whom, how often
    wanted = #{} :: #{id() => {starl:robot_id(), pos_integer()}},
    listeners :: #{atom() => starl_machine:name()},
    asked = {0, 0} :: {N :: non_neg_integer(), AtUs :: integer()},
    checking = false :: boolean()
}).

-spec init(starl_machine:config()) -> {ready, #flood{}, [starl_machine:action()]}.
init(#{robot := Self, incarnation := Incarnation, random := Random, now := Now} = Config) ->
    Flood = #flood{
        self = Self,
        incarnation = Incarnation,
        started = Now,
        random = Random,
        config = maps:merge(defaults(), maps:with(maps:keys(defaults()), Config)),
        listeners = maps:get(listeners, Config, #{})
    },
    {ready, Flood, [starl_sap:listen(geocast, geocast)]}.

defaults() ->
    #{
        drift_ppm => 10000, position_error_mm => 2.0, first_ms => 50, longest_ms => 1000,
        jitter_ms => 5, ask_ms => 100, gather_ms => 3, check_ms => 250, limit => 256
    }.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #flood{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, From, geocast, Message}, ready, Flood, #{now := Now}) ->
    message(Message, From, Now, Flood);
handle_event({timeout, {offer, Id}}, _, ready, Flood, #{now := Now}) ->
    offer(Id, Now, Flood);
handle_event({timeout, {give, Id}}, _, ready, Flood, #{now := Now}) ->
    give(Id, Now, Flood);
handle_event({timeout, {ask, Id}}, _, ready, Flood, #{now := Now}) ->
    ask_again(Id, Now, Flood);
handle_event({reply, {where, N}}, Answer, ready, Flood, #{now := Now}) ->
    located(N, Answer, Now, Flood);
handle_event({timeout, check}, _, ready, Flood, #{now := Now}) ->
    where(Now, [], Flood#flood{checking = false});
handle_event({timeout, {over, Id}}, _, ready, #flood{known = Known} = Flood, _Meta) ->
    Cancel = [{{timeout, {Timer, Id}}, cancel} || Timer <- [offer, give, ask]],
    Wanted = maps:remove(Id, Flood#flood.wanted),
    {keep_state, Flood#flood{known = Known#{Id := over}, wanted = Wanted}, Cancel};
handle_event({timeout, {forget, Id}}, _, ready, #flood{known = Known} = Flood, _Meta) ->
    {keep_state, Flood#flood{known = maps:remove(Id, Known)}};
handle_event({call, From}, {send, Area, Type, Body, Lifetime, Hops}, ready, Flood, Meta) ->
    send(From, {Area, Type, Body, Lifetime, Hops}, maps:get(now, Meta), Flood);
handle_event(cast, {listen, Type, Machine}, ready, Flood, #{now := Now}) ->
    Listeners = (Flood#flood.listeners)#{Type => Machine},
    where(Now, [], Flood#flood{listeners = Listeners});
handle_event(info, {restarted, sap}, ready, _Flood, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(geocast, geocast)]};
handle_event(info, {restarted, _}, ready, _Flood, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

message({offer, Id, Lifetime, Left, Hops}, From, Now, Flood) ->
    offered(Id, Lifetime, Left, Hops, From, Now, Flood);
message({ask, Id, Asked}, From, Now, Flood) ->
    asked(Id, {From, Asked}, Now, Flood);
message({give, Parcel, Askers}, From, Now, #flood{self = Self, incarnation = Life} = Flood) ->
    case [Us || {Robot, {Incarnation, Us}} <- Askers, Robot =:= Self, Incarnation =:= Life] of
        [] ->
            {Id, _, _, _, Lifetime, Left, Hops} = Parcel,
            offered(Id, Lifetime, Left, Hops, From, Now, Flood);
        [_ | _] = Times ->
            given(Parcel, lists:max(Times), Now, Flood)
    end;
message(_, _, _, _) ->
    unknown_event.

%% -- sending and taking ---------------------------------------------------------------------

send(From, Content, Now, #flood{next = N, self = Self, incarnation = Incarnation} = Flood) ->
    Id = {Self, Incarnation, N},
    {Area, Type, Body, Lifetime, Hops} = Content,
    case room(Flood) of
        true ->
            Traced = [{reply, From, ok}, {trace, {sent, Id, Area, Lifetime}}],
            Parcel = {Id, Area, Type, Body, Lifetime, Lifetime, Hops},
            Until = starl_geocast_lifetime:deadline(Now, Lifetime, ppm(Flood)),
            hold(Parcel, Until, true, 0, Now, Traced, Flood#flood{next = N + 1});
        false ->
            {keep_state_and_data, [{reply, From, {error, full}}]}
    end.

%% Whoever does not know the message, or only with less left or fewer hops, asks for it.
offered(Id, Lifetime, Left, Hops, From, Now, #flood{known = Known, wanted = Wanted} = Flood) ->
    case Known of
        #{Id := over} ->
            keep_state_and_data;
        #{Id := #held{hops = Own, until = Until}} when
            Hops - 1 =< Own, Left - (Until - Now) =< Lifetime div ?BETTER
        ->
            keep_state_and_data;
        #{} when Left =< 0; Hops =< 0 ->
            keep_state_and_data;
        #{} when is_map_key(Id, Wanted) ->
            %% when it asks again, it asks whoever was heard last
            #{Id := {_, N}} = Wanted,
            {keep_state, Flood#flood{wanted = Wanted#{Id := {From, N}}}};
        #{} ->
            ask(Id, From, 1, Now, Flood)
    end.

ask(Id, From, N, Now, #flood{wanted = Wanted} = Flood) ->
    case room(Flood) orelse is_map_key(Id, Flood#flood.known) of
        true ->
            #flood{self = Self, incarnation = Incarnation} = Flood,
            Question = {ask, Id, {Incarnation, Now}},
            {keep_state, Flood#flood{wanted = Wanted#{Id => {From, N}}}, [
                starl_sap:datagram(Self, From, geocast, Question),
                {{timeout, {ask, Id}}, us(ask_ms, Flood) bsl (N - 1), again}
            ]};
        false ->
            {keep_state_and_data, [{trace, {full, Id}}]}
    end.

ask_again(Id, Now, #flood{wanted = Wanted} = Flood) ->
    case Wanted of
        #{Id := {From, N}} when N < ?QUESTIONS -> ask(Id, From, N + 1, Now, Flood);
        #{} -> {keep_state, Flood#flood{wanted = maps:remove(Id, Wanted)}}
    end.

-spec given(parcel(), AskedUs :: integer(), integer(), #flood{}) -> starl_machine:result().
given({Id, Area, Type, Body, Lifetime, Told, Hops}, Asked, Now, Flood) ->
    #flood{known = Known, wanted = Wanted, started = Started, incarnation = Life} = Flood,
    Left = min(Told, Lifetime),
    Until = starl_geocast_lifetime:deadline(Asked, Left, ppm(Flood)),
    Met = Flood#flood{wanted = maps:remove(Id, Wanted)},
    case Known of
        #{Id := over} -> keep_state_and_data;
        #{Id := #held{} = Held} -> prolong(Id, Held, Until, Hops - 1, Now, Met);
        #{} when Until =< Now -> keep_state_and_data;
        #{} ->
            %% the first life of the machine has delivered nothing before
            New = Life =:= 1 orelse starl_geocast_lifetime:is_sent_after(
                Started, Asked, Lifetime, Left, ppm(Flood)
            ),
            take({Id, Area, Type, Body, Lifetime, Left, Hops - 1}, Until, New, Now, Met)
    end.

take({Id, _, _, _, _, _, _} = Parcel, Until, New, Now, Flood0) ->
    case room(Flood0) of
        true ->
            {Jitter, Flood} = jitter(Flood0),
            hold(Parcel, Until, New, Jitter, Now, [{{timeout, {ask, Id}}, cancel}], Flood);
        false ->
            {keep_state, Flood0, [{trace, {full, Id}}, {{timeout, {ask, Id}}, cancel}]}
    end.

hold({Id, Area, Type, Body, Lifetime, _, Hops}, Until, New, Jitter, Now, Actions, Flood) ->
    Held = #held{
        area = Area, type = Type, body = Body, lifetime_us = Lifetime, hops = Hops,
        until = Until, wait_us = us(first_ms, Flood), deliverable = New
    },
    Known = (Flood#flood.known)#{Id => Held},
    Timers = [
        {{timeout, {over, Id}}, Until - Now, over},
        {{timeout, {forget, Id}}, starl_geocast_lifetime:memory_us(Lifetime, ppm(Flood)), forget},
        {{timeout, {offer, Id}}, Jitter, again}
    ],
    where(Now, Actions ++ Timers, Flood#flood{known = Known}).

%% What is held is given once more: the longer deadline and the more hops count.
prolong(Id, #held{until = Until, hops = Hops} = Held, Theirs, TheirHops, Now, Flood) ->
    Better = Held#held{until = max(Until, Theirs), hops = max(Hops, TheirHops)},
    Known = (Flood#flood.known)#{Id := Better},
    {keep_state, Flood#flood{known = Known}, [
        {{timeout, {ask, Id}}, cancel},
        {{timeout, {over, Id}}, max(0, Better#held.until - Now), over}
    ]}.

room(#flood{known = Known, config = #{limit := Limit}}) -> map_size(Known) < Limit.

%% -- offering and giving --------------------------------------------------------------------

offer(Id, Now, #flood{known = Known} = Flood) ->
    case Known of
        #{Id := #held{hops = Hops, until = Until, wait_us = Wait} = Held} when
            Hops > 0, Now < Until
        ->
            Next = Held#held{wait_us = min(2 * Wait, us(longest_ms, Flood))},
            Offer = {offer, Id, Held#held.lifetime_us, left(Held, Now, Flood), Hops},
            {keep_state, Flood#flood{known = Known#{Id := Next}}, [
                starl_sap:shout(geocast, Offer), {{timeout, {offer, Id}}, Wait, again}
            ]};
        #{} ->
            keep_state_and_data
    end.

%% Others may ask for the same: one packet will do for all of them.
asked(Id, Asker, Now, #flood{known = Known} = Flood) ->
    case Known of
        #{Id := #held{hops = Hops, until = Until, askers = Askers} = Held} when
            Hops > 0, Now < Until
        ->
            Asking = Flood#flood{known = Known#{Id := Held#held{askers = Askers ++ [Asker]}}},
            First = [{{timeout, {give, Id}}, us(gather_ms, Flood), give} || Askers =:= []],
            {keep_state, Asking, First};
        #{} ->
            keep_state_and_data
    end.

give(Id, Now, #flood{known = Known} = Flood) ->
    case Known of
        #{Id := #held{askers = [_ | _] = Askers, until = Until} = Held} when Now < Until ->
            #held{area = Area, type = Type, body = Body, hops = Hops} = Held,
            Lifetime = Held#held.lifetime_us,
            Parcel = {Id, Area, Type, Body, Lifetime, left(Held, Now, Flood), Hops},
            {Some, Rest} = lists:split(min(?AT_ONCE, length(Askers)), Askers),
            More = [{{timeout, {give, Id}}, 0, give} || Rest =/= []],
            {keep_state, Flood#flood{known = Known#{Id := Held#held{askers = Rest}}}, [
                starl_sap:shout(geocast, {give, Parcel, Some}) | More
            ]};
        #{} ->
            keep_state_and_data
    end.

left(#held{until = Until}, Now, Flood) -> starl_geocast_lifetime:left(Until, Now, ppm(Flood)).

%% -- delivering -----------------------------------------------------------------------------

%% Asks for the own position if a message waits for it, now and again from time to time.
where(Now, Actions, #flood{self = Self, asked = {N, _}, checking = Checking} = Flood) ->
    case waiting(Now, Flood) of
        [] ->
            {keep_state, Flood, Actions};
        [_ | _] ->
            Ask = starl_location:pose(Self, {where, N + 1}),
            Check = [{{timeout, check}, us(check_ms, Flood), check} || not Checking],
            Asked = Flood#flood{asked = {N + 1, Now}, checking = true},
            {keep_state, Asked, Actions ++ [Ask | Check]}
    end.

located(N, {ok, {X, Y, _}}, Now, #flood{asked = {N, At}} = Flood) when Now - At =< ?FRESH_US ->
    #flood{config = #{position_error_mm := Error}, known = Known, listeners = Listeners} = Flood,
    Mine = [
        {Id, Held}
     || {Id, #held{area = Area} = Held} <- waiting(Now, Flood),
        starl_geocast_area:depth({X, Y}, Area) >= Error
    ],
    Delivered = maps:from_list([{Id, Held#held{deliverable = false}} || {Id, Held} <- Mine]),
    Actions = lists:append([deliver(Id, Held, Listeners) || {Id, Held} <- Mine]),
    {keep_state, Flood#flood{known = maps:merge(Known, Delivered)}, Actions};
located(_N, _Answer, _Now, _Flood) ->
    keep_state_and_data.

deliver({Source, _, _} = Id, #held{type = Type, body = Body}, Listeners) ->
    [
        {trace, {delivered, Id}},
        {cast, maps:get(Type, Listeners), {message, Source, Type, Body}}
    ].

%% The messages that are alive, not delivered yet, and listened to, in the order of their ids.
waiting(Now, #flood{known = Known, listeners = Listeners}) ->
    lists:sort([
        {Id, Held}
     || {Id, #held{deliverable = true, until = Until, type = Type} = Held} <- maps:to_list(Known),
        Now < Until,
        is_map_key(Type, Listeners)
    ]).

%% -- configuration --------------------------------------------------------------------------

ppm(#flood{config = #{drift_ppm := Ppm}}) -> Ppm.

us(Key, #flood{config = Config}) -> maps:get(Key, Config) * 1000.

jitter(#flood{config = #{jitter_ms := 0}} = Flood) ->
    {0, Flood};
jitter(#flood{random = Random0} = Flood) ->
    {Jitter, Random} = rand:uniform_s(us(jitter_ms, Flood), Random0),
    {Jitter, Flood#flood{random = Random}}.
