%% @doc Geocast by flooding. Every robot offers the messages that it holds until their lifetime is
%% over, gives them to robots that ask, and delivers a message when it is inside the area.
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
%% No robot sends absolute times, and no bound on delays is assumed. The rest of the lifetime (left)
%% counts from when the receiver asked, by its own clock ({@link starl_geocast_lifetime}). So for
%% any delay of packets the deadline of a held message is not after the end of the window, and
%% nothing is delivered later. A packet that carried the message at once would save the question.
%% But it could be delayed beyond every bound, in the air or in a stalled robot. The rest of the
%% lifetime also bounds the message's age from above, which a restarted robot needs. It does not
%% know which messages it delivered before, so it delivers only those surely sent after its restart.
%%
%% A robot keeps an id until its window is surely over everywhere: its whole lifetime from when it
%% was first held. After that no robot gives the message. A robot keeps the body only while the
%% message is alive. At most `limit' messages are known; beyond that new ones are not taken.
%% Delivered messages are remembered for good ({@link starl_geocast_memory}). So no message is
%% delivered twice, even if a clock is set or stops and prolongs a message's life.
%%
%% Calls: `{send, Area, Type, Body, LifetimeUs, Hops}', answer `ok' or `{error, full}'. Casts:
%% `{listen, Type, Machine}'; a listener gets the cast `{message, From, Type, Body}'.
%% Trace: {@link event()}.
-module(starl_geocast_flood).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

-export_type([config/0, event/0]).

%% The trace of geocast; a hash is that of area, type and body.
-type event() ::
    %% at the source
    {sent, id(), starl_geocast:area(), LifetimeUs :: pos_integer(), Hash :: non_neg_integer()}
    %% the robot has the message now; its deadline comes from the named robot
    | {held, id(), From :: starl:robot_id()}
    | {delivered, id(), Hash :: non_neg_integer()}
    %% not taken: `limit' messages are known already
    | {full, id()}.

%% `drift_ppm': the greatest drift of a clock; `position_error_mm': the greatest error of a reported
%% position; `first_ms', `longest_ms': the first wait before an offer is repeated, doubled each time
%% up to the longest; `jitter_ms': the longest random wait of a relay before its first offer;
%% `ask_ms': the wait for a message before it is asked for again; `gather_ms': the wait for other
%% robots that ask for the same message; `check_ms': the time between two checks whether the robot
%% has come into an area; `listeners': machines that listen from the start on, also after a restart.
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

-type id() :: starl_geocast_store:id().

%% The number of times that a message is asked for; then another offer has to come.
-define(QUESTIONS, 4).
%% The most messages that are asked for at a time; others are when they are offered again.
-define(WANTED, 4096).

-record(flood, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    incarnation :: pos_integer(),
    started :: integer(),
    random :: rand:state(),
    config :: map(),
    next = 1 :: pos_integer(),
    store :: starl_geocast_store:t(),
    %% the messages asked for, each with the robot that was asked and the number of questions
    wanted = #{} :: #{id() => {starl:robot_id(), pos_integer()}},
    delivery :: starl_geocast_delivery:t()
}).

-spec init(starl_machine:config()) -> {ready, #flood{}, [starl_machine:action()]}.
init(#{robot := Self, incarnation := Incarnation, random := Random, now := Now} = Config) ->
    #{participants := Team} = Config,
    Full = maps:merge(defaults(), maps:with(maps:keys(defaults()), Config)),
    #{limit := Limit, drift_ppm := Ppm} = Full,
    Flood = #flood{
        self = Self,
        team = Team,
        incarnation = Incarnation,
        started = Now,
        random = Random,
        config = Full,
        store = starl_geocast_store:new(Limit, Ppm),
        delivery = delivery(Self, Full)
    },
    {ready, Flood, [starl_sap:listen(geocast, geocast)]}.

delivery(Self, #{position_error_mm := Error, check_ms := Ms, listeners := Listeners}) ->
    starl_geocast_delivery:new(Self, #{
        position_error_mm => Error, check_us => 1000 * Ms, listeners => Listeners
    }).

defaults() ->
    #{
        drift_ppm => 10000,
        position_error_mm => 2.0,
        first_ms => 50,
        longest_ms => 1000,
        jitter_ms => 5,
        ask_ms => 100,
        gather_ms => 3,
        check_ms => 250,
        limit => 256,
        listeners => #{}
    }.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #flood{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, From, geocast, Message}, ready, Flood, #{now := Now}) ->
    message(Message, From, Now, Flood);
handle_event({timeout, Timer}, _, ready, Flood, #{now := Now}) ->
    timed_out(Timer, Now, Flood);
handle_event({reply, {where, N}}, Answer, ready, Flood, #{now := Now}) ->
    located(N, Answer, Now, Flood);
handle_event({call, From}, {send, Area, Type, Body, Lifetime, Hops}, ready, Flood, Meta) ->
    send(From, {Area, Type, Body, Lifetime, Hops}, maps:get(now, Meta), Flood);
handle_event(cast, {listen, Type, Machine}, ready, Flood, #{now := Now}) ->
    Delivery = starl_geocast_delivery:listen(Type, Machine, Flood#flood.delivery),
    check(Now, [], Flood#flood{delivery = Delivery});
handle_event(info, {late, {delivered, Id}}, ready, #flood{store = Store} = Flood, #{now := Now}) ->
    check(Now, [], Flood#flood{store = starl_geocast_store:undelivered(Id, Store)});
handle_event(info, {restarted, sap}, ready, _Flood, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(geocast, geocast)]};
handle_event(info, {restarted, _}, ready, _Flood, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

timed_out({offer, Id}, Now, Flood) ->
    offer(Id, Now, Flood);
timed_out({give, Id}, Now, Flood) ->
    give(Id, Now, Flood);
timed_out({ask, Id}, Now, Flood) ->
    ask_again(Id, Now, Flood);
timed_out(check, Now, #flood{store = Store} = Flood) ->
    {Actions, Next} = starl_geocast_delivery:check_again(Now, Store, Flood#flood.delivery),
    {keep_state, Flood#flood{delivery = Next}, Actions};
timed_out({over, Id}, _Now, #flood{store = Store} = Flood) ->
    Cancel = [{{timeout, {Timer, Id}}, cancel} || Timer <- [offer, give, ask]],
    Wanted = maps:remove(Id, Flood#flood.wanted),
    Over = starl_geocast_store:over(Id, Store),
    {keep_state, Flood#flood{store = Over, wanted = Wanted}, Cancel};
timed_out({forget, Id}, _Now, #flood{store = Store} = Flood) ->
    {keep_state, Flood#flood{store = starl_geocast_store:forget(Id, Store)}};
timed_out(_Timer, _Now, _Flood) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(geocast, {offer, _, Lifetime, Left, _} = Body) ->
    starl_shape:is([any, id(), count, integer, integer], Body) andalso is_lived(Lifetime, Left);
accepts(geocast, {ask, _, _} = Body) ->
    starl_shape:is([any, id(), [count, integer]], Body);
accepts(geocast, {give, {Id, Area, Type, Body, Lifetime, Left, Hops}, Askers}) ->
    Shape = [id(), area(), atom, content, count, integer, integer, askers()],
    starl_shape:is(Shape, {Id, Area, Type, Body, Lifetime, Left, Hops, Askers}) andalso
        is_lived(Lifetime, Left) andalso
        starl_geocast_area:check(Area) =:= ok;
accepts(_Type, _Body) ->
    false.

%% The rest of a lifetime is below zero where an answer has come after it.
is_lived(Lifetime, Left) ->
    Longest = starl_geocast_lifetime:longest_us(),
    Lifetime =< Longest andalso abs(Left) =< Longest.

askers() -> {list, [count, [count, integer]]}.

id() -> [count, count, count].

area() ->
    Circle = [{is, circle}, point, mm],
    Rectangle = [{is, rectangle}, [mm, mm, mm, mm]],
    {either, [Circle, Rectangle, [{is, polygon}, {list, point}]]}.

message({offer, Id, Lifetime, Left, Hops}, From, Now, Flood) ->
    offered({Id, Lifetime, Left, Hops}, From, Now, Flood);
message({ask, Id, Asked}, From, Now, Flood) ->
    asked(Id, {From, Asked}, Now, Flood);
message({give, Parcel, Askers}, From, Now, #flood{self = Self, incarnation = Life} = Flood) ->
    %% the time at which this robot asked comes back: it has passed
    Mine = [Us || {Robot, {Incarnation, Us}} <- Askers, Robot =:= Self, Incarnation =:= Life],
    case [Us || Us <- Mine, Us =< Now] of
        [] ->
            {Id, _, _, _, Lifetime, Left, Hops} = Parcel,
            offered({Id, Lifetime, Left, Hops}, From, Now, Flood);
        [_ | _] = Times ->
            given(Parcel, From, lists:max(Times), Now, Flood)
    end;
message(_, _, _, _) ->
    unknown_event.

%% -- sending and taking ---------------------------------------------------------------------

send(From, Content, Now, #flood{next = N, self = Self, incarnation = Incarnation} = Flood) ->
    Id = {Self, Incarnation, N},
    {Area, Type, Body, Lifetime, Hops} = Content,
    case starl_geocast_store:takes(Id, Flood#flood.store) of
        true ->
            Hash = erlang:phash2({Area, Type, Body}),
            Traced = [{reply, From, ok}, {trace, {sent, Id, Area, Lifetime, Hash}}],
            Parcel = {Id, Area, Type, Body, Lifetime, Lifetime, Hops},
            Until = starl_geocast_lifetime:deadline(Now, Lifetime, ppm(Flood)),
            hold(Parcel, Until, true, 0, Now, Traced, Flood#flood{next = N + 1});
        false ->
            {keep_state_and_data, [{reply, From, {error, full}}]}
    end.

%% A robot asks for a message that it does not know, or holds with less left or fewer hops.
offered({{Source, _, _} = Id, _, _, _} = Offer, From, Now, Flood) ->
    #flood{team = Team, store = Store, wanted = Wanted} = Flood,
    Worth = starl_team:has(Source, Team) andalso starl_geocast_store:is_worth(Offer, Now, Store),
    case {Worth, Wanted} of
        {false, _} ->
            keep_state_and_data;
        {true, #{Id := {_, N}}} ->
            %% when it asks again, it asks the robot that was heard last
            {keep_state, Flood#flood{wanted = Wanted#{Id := {From, N}}}};
        {true, #{}} when map_size(Wanted) < ?WANTED ->
            ask(Id, From, 1, Now, Flood);
        {true, #{}} ->
            keep_state_and_data
    end.

ask(Id, From, N, Now, #flood{wanted = Wanted} = Flood) ->
    case starl_geocast_store:takes(Id, Flood#flood.store) of
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

-spec given(
    starl_geocast_store:parcel(),
    starl:robot_id(),
    AskedUs :: integer(),
    integer(),
    #flood{}
) -> starl_machine:result().
given({{Source, _, _} = Id, Area, Type, Body, Lifetime, Told, Hops}, From, Asked, Now, Flood) ->
    IsOurs = starl_team:has(Source, Flood#flood.team),
    #flood{store = Store, wanted = Wanted, started = Started, incarnation = Life} = Flood,
    Left = min(Told, Lifetime),
    Until = starl_geocast_lifetime:deadline(Asked, Left, ppm(Flood)),
    Met = Flood#flood{wanted = maps:remove(Id, Wanted)},
    case starl_geocast_store:look(Id, Store) of
        over ->
            keep_state_and_data;
        held ->
            prolong(Id, From, Until, Hops - 1, Now, Met);
        unknown when Until =< Now; not IsOurs -> keep_state_and_data;
        unknown ->
            %% the first life of the machine has delivered nothing before
            New =
                Life =:= 1 orelse
                    starl_geocast_lifetime:is_sent_after(
                        Started, Asked, Lifetime, Left, ppm(Flood)
                    ),
            take({Id, Area, Type, Body, Lifetime, Left, Hops - 1}, From, Until, New, Now, Met)
    end.

take({Id, _, _, _, _, _, _} = Parcel, From, Until, New, Now, Flood0) ->
    case starl_geocast_store:takes(Id, Flood0#flood.store) of
        true ->
            {Jitter, Flood} = jitter(Flood0),
            Answered = [{{timeout, {ask, Id}}, cancel}, {trace, {held, Id, From}}],
            hold(Parcel, Until, New, Jitter, Now, Answered, Flood);
        false ->
            {keep_state, Flood0, [{trace, {full, Id}}, {{timeout, {ask, Id}}, cancel}]}
    end.

hold({Id, _, _, _, Lifetime, _, _} = Parcel, Until, New, Jitter, Now, Actions, Flood) ->
    First = us(first_ms, Flood),
    Held = starl_geocast_store:hold(Parcel, Until, New, First, Flood#flood.store),
    Timers = [
        {{timeout, {over, Id}}, Until - Now, over},
        {{timeout, {forget, Id}}, starl_geocast_lifetime:memory_us(Lifetime, ppm(Flood)), forget},
        {{timeout, {offer, Id}}, Jitter, again}
    ],
    check(Now, Actions ++ Timers, Flood#flood{store = Held}).

prolong(Id, From, Theirs, Hops, Now, #flood{store = Store} = Flood) ->
    {Until, IsTheirs, Better} = starl_geocast_store:prolong(Id, Theirs, Hops, Store),
    {keep_state, Flood#flood{store = Better}, [
        {{timeout, {ask, Id}}, cancel},
        {{timeout, {over, Id}}, max(0, Until - Now), over}
        | [{trace, {held, Id, From}} || IsTheirs]
    ]}.

%% -- offering and giving --------------------------------------------------------------------

offer(Id, Now, #flood{store = Store} = Flood) ->
    case starl_geocast_store:offer(Id, Now, us(longest_ms, Flood), Store) of
        {{Id, Lifetime, Left, Hops}, Wait, Next} ->
            {keep_state, Flood#flood{store = Next}, [
                starl_sap:shout(geocast, {offer, Id, Lifetime, Left, Hops}),
                {{timeout, {offer, Id}}, Wait, again}
            ]};
        none ->
            keep_state_and_data
    end.

%% Others may ask for the same: one packet will do for all of them.
asked(Id, Asker, Now, #flood{store = Store} = Flood) ->
    case starl_geocast_store:ask(Id, Asker, Now, Store) of
        {IsFirst, Next} ->
            Gather = [{{timeout, {give, Id}}, us(gather_ms, Flood), give} || IsFirst],
            {keep_state, Flood#flood{store = Next}, Gather};
        none ->
            keep_state_and_data
    end.

give(Id, Now, #flood{store = Store} = Flood) ->
    case starl_geocast_store:give(Id, Now, Store) of
        {Parcel, Askers, AreMore, Next} ->
            More = [{{timeout, {give, Id}}, 0, give} || AreMore],
            {keep_state, Flood#flood{store = Next}, [
                starl_sap:shout(geocast, {give, Parcel, Askers}) | More
            ]};
        none ->
            keep_state_and_data
    end.

%% -- delivering -----------------------------------------------------------------------------

check(Now, Before, #flood{store = Store, delivery = Delivery} = Flood) ->
    {Actions, Next} = starl_geocast_delivery:check(Now, Store, Delivery),
    {keep_state, Flood#flood{delivery = Next}, Before ++ Actions}.

located(N, Answer, Now, #flood{store = Store, delivery = Delivery} = Flood) ->
    case starl_geocast_delivery:located(N, Answer, Now, Store, Delivery) of
        {Actions, Delivered} -> {keep_state, Flood#flood{store = Delivered}, Actions};
        stale -> keep_state_and_data
    end.

%% -- configuration --------------------------------------------------------------------------

ppm(#flood{config = #{drift_ppm := Ppm}}) -> Ppm.

us(Key, #flood{config = Config}) -> maps:get(Key, Config) * 1000.

jitter(#flood{config = #{jitter_ms := 0}} = Flood) ->
    {0, Flood};
jitter(#flood{random = Random0} = Flood) ->
    {Jitter, Random} = rand:uniform_s(us(jitter_ms, Flood), Random0),
    {Jitter, Flood#flood{random = Random}}.
