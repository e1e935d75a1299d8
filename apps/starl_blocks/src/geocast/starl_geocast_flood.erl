%% @doc Geocast by flooding: every robot repeats what it has heard until the message's lifetime
%% is over, and delivers it when it is inside the area.
%% ```
%%   source                  relay                     robot inside
%%     | shout {Id, left} ---->| (new: held)                |
%%     |                       | shout {Id, less left} ---->| new: where am I? inside: delivered
%%     | shout (50 ms later) ->| known: nothing             |
%%     |                       |<---------- shout {Id, …} --| (all repeat: 0, 50, 150, 350, … ms)
%% '''
%% No absolute time leaves a robot. A packet carries how much of the lifetime is surely left:
%% each robot deducts the time that the message lay with it, by its own clock and with the
%% clock's greatest drift added, and each hop is charged the longest delay of a packet. So what
%% is left is never too much, and a message whose lifetime is over here cannot be delivered
%% after its window; of several copies the one with the most left counts. What is left also
%% bounds the message's age from above, which a restarted robot needs: it does not know what it
%% delivered before, so it delivers only what was surely sent after its restart.
%%
%% An id is remembered until its window is surely over everywhere (its whole lifetime from when
%% it was first heard, and `keep_ms' for packets slower than allowed), its body no longer than
%% it lives. At most `limit' messages are held; beyond that new ones are not taken.
%%
%% Calls: `{send, Area, Type, Body, LifetimeUs, Hops}', answer `ok' or `{error, full}'. Casts:
%% `{listen, Type, Machine}'; a listener gets the cast `{message, From, Type, Body}'.
%% Trace: `{sent, Id, Area, LifetimeUs}', `{delivered, Id}', `{full, Id}'.
-module(starl_geocast_flood).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-export_type([config/0, id/0]).

%% `hop_ms': the longest delay of a packet; `drift_ppm': the greatest drift of a clock;
%% `position_error_mm': how far a position told may be from the true one; `first_ms',
%% `longest_ms': the first wait before a repetition, doubled each time up to the longest;
%% `jitter_ms': a relay waits up to so long; `check_ms': how often a robot looks whether it has
%% come into an area; `listeners': from the start on, also after a restart.
-type config() :: #{
    hop_ms => pos_integer(),
    drift_ppm => non_neg_integer(),
    position_error_mm => float(),
    first_ms => pos_integer(),
    longest_ms => pos_integer(),
    jitter_ms => non_neg_integer(),
    check_ms => pos_integer(),
    keep_ms => non_neg_integer(),
    limit => pos_integer(),
    listeners => #{Type :: atom() => starl_machine:name()}
}.

%% Who sent it, in which incarnation, its how many-eth.
-type id() :: {starl:robot_id(), Incarnation :: pos_integer(), N :: pos_integer()}.

%% What travels: the content, the whole lifetime and what is left of it, the hops left.
-type parcel() :: {
    id(), starl_geocast:area(), Type :: atom(), Body :: term(), LifetimeUs :: pos_integer(),
    LeftUs :: integer(), Hops :: non_neg_integer()
}.

-define(MILLION, 1000000).
%% A position that took longer to come is that of another place.
-define(FRESH_US, 100000).

%% A message that is alive, until a time of the own clock.
-record(held, {
    area :: starl_geocast:area(),
    type :: atom(),
    body :: term(),
    lifetime_us :: pos_integer(),
    until :: integer(),
    hops :: non_neg_integer(),
    wait_us :: pos_integer(),
    deliverable :: boolean()
}).

-record(flood, {
    self :: starl:robot_id(),
    incarnation :: pos_integer(),
    started :: integer(),
    random :: rand:state(),
    config :: map(),
    next = 1 :: pos_integer(),
    %% the ids heard of, each alive or over
    known = #{} :: #{id() => #held{} | over},
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
        hop_ms => 20, drift_ppm => 1000, position_error_mm => 2.0, first_ms => 50,
        longest_ms => 1000, jitter_ms => 5, check_ms => 250, keep_ms => 5000, limit => 256
    }.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #flood{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, _From, geocast, Parcel}, ready, Flood, #{now := Now}) ->
    hear(Parcel, Now, Flood);
handle_event({timeout, {again, Id}}, _, ready, Flood, #{now := Now}) ->
    repeat(Id, Now, Flood);
handle_event({reply, {where, N}}, Answer, ready, Flood, #{now := Now}) ->
    located(N, Answer, Now, Flood);
handle_event({timeout, check}, _, ready, Flood, #{now := Now}) ->
    where(Now, [], Flood#flood{checking = false});
handle_event({timeout, {over, Id}}, _, ready, #flood{known = Known} = Flood, _Meta) ->
    {keep_state, Flood#flood{known = Known#{Id := over}}, [{{timeout, {again, Id}}, cancel}]};
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

%% -- taking messages ------------------------------------------------------------------------

send(From, Content, Now, #flood{next = N, self = Self, incarnation = Incarnation} = Flood) ->
    Id = {Self, Incarnation, N},
    {Area, Type, Body, Lifetime, Hops} = Content,
    case room(Flood) of
        true ->
            Traced = [{reply, From, ok}, {trace, {sent, Id, Area, Lifetime}}],
            Parcel = {Id, Area, Type, Body, Lifetime, Lifetime, Hops},
            hold(Parcel, true, 0, Now, Traced, Flood#flood{next = N + 1});
        false ->
            {keep_state_and_data, [{reply, From, {error, full}}]}
    end.

-spec hear(parcel(), integer(), #flood{}) -> starl_machine:result().
hear({Id, Area, Type, Body, Lifetime, Before, Hops}, Now, #flood{known = Known} = Flood) ->
    Left = min(Before, Lifetime) - us(hop_ms, Flood),
    case Known of
        #{Id := #held{} = Held} -> prolong(Id, Held, Left, Hops - 1, Now, Flood);
        #{Id := over} -> keep_state_and_data;
        #{} when Left =< 0 -> keep_state_and_data;
        #{} -> take({Id, Area, Type, Body, Lifetime, Left, Hops - 1}, Now, Flood)
    end.

take({Id, _, _, _, Lifetime, Left, _} = Parcel, Now, Flood0) ->
    case room(Flood0) of
        true ->
            {Jitter, Flood} = jitter(Flood0),
            hold(Parcel, is_new(Lifetime - Left, Now, Flood), Jitter, Now, [], Flood);
        false ->
            {keep_state_and_data, [{trace, {full, Id}}]}
    end.

%% Was it surely sent after this machine started? The first start has delivered nothing before.
is_new(_Age, _Now, #flood{incarnation = 1}) -> true;
is_new(Age, Now, #flood{started = Started} = Flood) -> Age =< shortest(Now - Started, Flood).

hold({Id, Area, Type, Body, Lifetime, Left, Hops}, Deliverable, Jitter, Now, Actions, Flood) ->
    Held = #held{
        area = Area, type = Type, body = Body, lifetime_us = Lifetime, hops = Hops,
        until = Now + shortest(Left, Flood), wait_us = us(first_ms, Flood),
        deliverable = Deliverable
    },
    Known = (Flood#flood.known)#{Id => Held},
    Forget = longest(Lifetime, Flood) + us(keep_ms, Flood),
    Timers = [
        {{timeout, {over, Id}}, Held#held.until - Now, over},
        {{timeout, {forget, Id}}, Forget, forget},
        {{timeout, {again, Id}}, Jitter, again}
    ],
    where(Now, Actions ++ Timers, Flood#flood{known = Known}).

%% Another copy of a message that is held: the one that has more left, or more hops, is better.
prolong(Id, #held{until = Until, hops = Hops} = Held, Left, TheirHops, Now, Flood) ->
    Theirs = Now + shortest(max(0, Left), Flood),
    case Theirs > Until orelse TheirHops > Hops of
        true ->
            Better = Held#held{until = max(Until, Theirs), hops = max(Hops, TheirHops)},
            Known = (Flood#flood.known)#{Id := Better},
            Due = max(0, Better#held.until - Now),
            {keep_state, Flood#flood{known = Known}, [{{timeout, {over, Id}}, Due, over}]};
        false ->
            keep_state_and_data
    end.

room(#flood{known = Known, config = #{limit := Limit}}) -> map_size(Known) < Limit.

%% -- repeating ------------------------------------------------------------------------------

repeat(Id, Now, #flood{known = Known} = Flood) ->
    case Known of
        #{Id := #held{hops = Hops, until = Until, wait_us = Wait} = Held} when
            Hops > 0, Now < Until
        ->
            Next = Held#held{wait_us = min(2 * Wait, us(longest_ms, Flood))},
            {keep_state, Flood#flood{known = Known#{Id := Next}}, [
                starl_sap:shout(geocast, parcel(Id, Held, Now, Flood)),
                {{timeout, {again, Id}}, Wait, again}
            ]};
        #{} ->
            keep_state_and_data
    end.

parcel(Id, #held{area = Area, type = Type, body = Body} = Held, Now, Flood) ->
    #held{lifetime_us = Lifetime, until = Until, hops = Hops} = Held,
    {Id, Area, Type, Body, Lifetime, left(Until - Now, Flood), Hops}.

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

%% -- clocks ---------------------------------------------------------------------------------

us(Key, #flood{config = Config}) -> maps:get(Key, Config) * 1000.

%% What surely shows on the own clock, and what may show at most, while so much time passes.
%% (The other way round, so much on the own clock is at least shortest of it in truth.)
shortest(Us, #flood{config = #{drift_ppm := Ppm}}) -> Us * (?MILLION - Ppm) div ?MILLION.
longest(Us, #flood{config = #{drift_ppm := Ppm}}) -> Us * (?MILLION + Ppm) div ?MILLION + 1.

%% The inverse of shortest/2, rounded down.
left(Us, #flood{config = #{drift_ppm := Ppm}}) -> Us * ?MILLION div (?MILLION - Ppm).

jitter(#flood{config = #{jitter_ms := 0}} = Flood) ->
    {0, Flood};
jitter(#flood{random = Random0} = Flood) ->
    {Jitter, Random} = rand:uniform_s(us(jitter_ms, Flood), Random0),
    {Jitter, Flood#flood{random = Random}}.
