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

-export_type([event/0]).

%% The trace of geocast; a hash is that of area, type and body.
-type event() ::
    %% at the source
    {sent, id(), starl_geocast:area(), LifetimeUs :: pos_integer(), Hash :: non_neg_integer()}
    %% the robot has the message now; its deadline comes from the named robot
    | {held, id(), From :: starl:robot_id()}
    | {delivered, id(), Hash :: non_neg_integer()}
    %% not taken: `limit' messages are known already
    | {full, id()}.

-type id() :: starl_geocast:id().

%% A robot that asked, with the life of its machine and the time by its clock.
-type asker() :: {starl:robot_id(), {Incarnation :: pos_integer(), Us :: integer()}}.

%% The number of times that a message is asked for; then another offer has to come.
-define(QUESTIONS, 4).
%% The most messages that are asked for at a time; others are when they are offered again.
-define(WANTED, 4096).
%% An offer is better than the message held if its rest is longer by this part of the lifetime.
-define(BETTER, 8).
%% The most robots that are given a message with one packet.
-define(AT_ONCE, 50).
%% The number of ranges of delivered messages that are remembered of each source.
-define(RANGES, 256).
%% A position that took longer to come is out of date.
-define(FRESH_US, 100000).

%% A message that is alive until a time of the own clock.
-record(held, {
    area :: starl_geocast:area(),
    type :: atom(),
    body :: term(),
    lifetime_us :: pos_integer(),
    until :: integer(),
    hops :: non_neg_integer(),
    %% the wait before its next offer is repeated
    wait_us :: pos_integer(),
    %% it may be delivered here, and has not been
    deliverable :: boolean(),
    %% the robots that have asked for it, in this order
    askers = [] :: [asker()]
}).

-record(flood, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    incarnation :: pos_integer(),
    started :: integer(),
    random :: rand:state(),
    %% the options of starl_geocast
    config :: map(),
    next = 1 :: pos_integer(),
    %% the messages that are held, or were once
    known = #{} :: #{id() => #held{} | over},
    delivered = starl_geocast_memory:new(?RANGES) :: starl_geocast_memory:t(),
    %% the messages asked for, each with the robot that was asked and the number of questions
    wanted = #{} :: #{id() => {starl:robot_id(), pos_integer()}},
    listeners :: #{Type :: atom() => starl_machine:name()},
    %% the last question for the own position, and when it was asked
    located = {0, 0} :: {N :: non_neg_integer(), AtUs :: integer()},
    %% is the timer of the next question set?
    checking = false :: boolean()
}).

-spec init(starl_machine:config()) -> {ready, #flood{}, [starl_machine:action()]}.
init(#{robot := Self, incarnation := Incarnation, random := Random, now := Now} = Config) ->
    #{participants := Team} = Config,
    Defaults = starl_options:defaults(starl_geocast:options()),
    Options = maps:merge(Defaults, maps:with(maps:keys(Defaults), Config)),
    Flood = #flood{
        self = Self,
        team = Team,
        incarnation = Incarnation,
        started = Now,
        random = Random,
        config = maps:without([listeners, all_listen], Options),
        listeners = map_get(listeners, Options)
    },
    {ready, Flood, [starl_sap:listen(geocast, geocast)]}.

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
    #flood{listeners = Listeners} = Flood,
    check(Now, [], Flood#flood{listeners = Listeners#{Type => Machine}});
handle_event(info, {late, {delivered, Id}}, ready, Flood, #{now := Now}) ->
    check(Now, [], undelivered(Id, Flood));
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
timed_out(check, Now, Flood) ->
    check(Now, [], Flood#flood{checking = false});
timed_out({over, Id}, _Now, #flood{known = Known, wanted = Wanted} = Flood) ->
    Over =
        case Known of
            #{Id := _} -> Known#{Id := over};
            %% it may be forgotten already, as when the clock was set back after it was asked for
            #{} -> Known
        end,
    Cancel = [{{timeout, {Timer, Id}}, cancel} || Timer <- [offer, give, ask]],
    {keep_state, Flood#flood{known = Over, wanted = maps:remove(Id, Wanted)}, Cancel};
timed_out({forget, Id}, _Now, #flood{known = Known} = Flood) ->
    {keep_state, Flood#flood{known = maps:remove(Id, Known)}};
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

%% -- sending --------------------------------------------------------------------------------

send(From, {Area, Type, Body, Lifetime, Hops}, Now, #flood{next = N, self = Self} = Flood) ->
    Id = {Self, Flood#flood.incarnation, N},
    case has_room(Id, Flood) of
        true ->
            Traced = [
                {reply, From, ok},
                {trace, {sent, Id, Area, Lifetime, erlang:phash2({Area, Type, Body})}}
            ],
            Held = #held{
                area = Area,
                type = Type,
                body = Body,
                lifetime_us = Lifetime,
                until = starl_geocast_lifetime:deadline(Now, Lifetime, ppm(Flood)),
                hops = Hops,
                wait_us = us(first_ms, Flood),
                deliverable = true
            },
            hold(Id, Held, 0, Now, Traced, Flood#flood{next = N + 1});
        false ->
            {keep_state_and_data, [{reply, From, {error, full}}]}
    end.

has_room(Id, #flood{known = Known, config = #{limit := Limit}}) ->
    map_size(Known) < Limit orelse is_map_key(Id, Known).

%% Holds a message from now on, and offers it for the first time after `Wait'.
hold(Id, #held{deliverable = Deliverable} = Held, Wait, Now, Actions, Flood) ->
    %% delivered it may be, although it was forgotten meanwhile
    New = Deliverable andalso not starl_geocast_memory:is_member(Id, Flood#flood.delivered),
    #held{lifetime_us = Lifetime, until = Until} = Held,
    Timers = [
        {{timeout, {over, Id}}, Until - Now, over},
        {{timeout, {forget, Id}}, starl_geocast_lifetime:memory_us(Lifetime, ppm(Flood)), forget},
        {{timeout, {offer, Id}}, Wait, again}
    ],
    check(Now, Actions ++ Timers, put_held(Id, Held#held{deliverable = New}, Flood)).

%% -- asking ---------------------------------------------------------------------------------

%% A robot asks for a message that it does not know, or holds with less left or fewer hops.
offered({{Source, _, _} = Id, _, _, _} = Offer, From, Now, Flood) ->
    #flood{team = Team, wanted = Wanted} = Flood,
    case {starl_team:has(Source, Team) andalso is_worth(Offer, Now, Flood), Wanted} of
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

is_worth({Id, Lifetime, Left, Hops}, Now, #flood{known = Known}) ->
    case Known of
        #{Id := over} ->
            false;
        #{Id := #held{hops = Own, until = Until}} when
            Hops - 1 =< Own, Left - (Until - Now) =< Lifetime div ?BETTER
        ->
            false;
        #{} ->
            Left > 0 andalso Hops > 0
    end.

ask(Id, From, N, Now, #flood{self = Self, incarnation = Incarnation, wanted = Wanted} = Flood) ->
    case has_room(Id, Flood) of
        true ->
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

%% -- taking ---------------------------------------------------------------------------------

%% The answer to a question of this robot.
given({Id, Area, Type, Body, Lifetime, Rest, Hops}, From, Asked, Now, Flood) ->
    #flood{known = Known, wanted = Wanted} = Flood,
    Left = min(Rest, Lifetime),
    Until = starl_geocast_lifetime:deadline(Asked, Left, ppm(Flood)),
    Met = Flood#flood{wanted = maps:remove(Id, Wanted)},
    case Known of
        #{Id := over} ->
            keep_state_and_data;
        #{Id := #held{} = Held} ->
            prolong(Id, Held, From, Until, Hops - 1, Now, Met);
        #{} when Until =< Now ->
            keep_state_and_data;
        #{} ->
            take(Id, From, Now, Met, #held{
                area = Area,
                type = Type,
                body = Body,
                lifetime_us = Lifetime,
                until = Until,
                hops = Hops - 1,
                wait_us = us(first_ms, Flood),
                deliverable = is_new(Asked, Lifetime, Left, Flood)
            })
    end.

%% The first life of the machine has delivered nothing before.
is_new(_Asked, _Lifetime, _Left, #flood{incarnation = 1}) ->
    true;
is_new(Asked, Lifetime, Left, #flood{started = Started} = Flood) ->
    starl_geocast_lifetime:is_sent_after(Started, Asked, Lifetime, Left, ppm(Flood)).

take({Source, _, _} = Id, From, Now, #flood{team = Team} = Flood0, Held) ->
    case {starl_team:has(Source, Team), has_room(Id, Flood0)} of
        {false, _} ->
            keep_state_and_data;
        {true, true} ->
            {Jitter, Flood} = jitter(Flood0),
            Answered = [{{timeout, {ask, Id}}, cancel}, {trace, {held, Id, From}}],
            hold(Id, Held, Jitter, Now, Answered, Flood);
        {true, false} ->
            {keep_state, Flood0, [{trace, {full, Id}}, {{timeout, {ask, Id}}, cancel}]}
    end.

%% A held message is given once more: the longer deadline and the larger number of hops count.
prolong(Id, #held{until = Until, hops = Hops} = Held, From, TheirUntil, TheirHops, Now, Flood) ->
    Longer = max(Until, TheirUntil),
    Better = Held#held{until = Longer, hops = max(Hops, TheirHops)},
    {keep_state, put_held(Id, Better, Flood), [
        {{timeout, {ask, Id}}, cancel},
        {{timeout, {over, Id}}, max(0, Longer - Now), over}
        | [{trace, {held, Id, From}} || TheirUntil > Until]
    ]}.

put_held(Id, Held, #flood{known = Known} = Flood) -> Flood#flood{known = Known#{Id => Held}}.

%% -- offering and giving --------------------------------------------------------------------

%% The wait doubles each time, up to the longest.
offer(Id, Now, Flood) ->
    case travelling(Id, Now, Flood) of
        #held{hops = Hops, wait_us = Wait, lifetime_us = Lifetime} = Held ->
            Doubled = Held#held{wait_us = min(2 * Wait, us(longest_ms, Flood))},
            {keep_state, put_held(Id, Doubled, Flood), [
                starl_sap:shout(geocast, {offer, Id, Lifetime, left(Held, Now, Flood), Hops}),
                {{timeout, {offer, Id}}, Wait, again}
            ]};
        none ->
            keep_state_and_data
    end.

%% A message that is alive and may travel on.
travelling(Id, Now, #flood{known = Known}) ->
    case Known of
        #{Id := #held{hops = Hops, until = Until} = Held} when Hops > 0, Now < Until -> Held;
        #{} -> none
    end.

%% Others may ask for the same: one packet will do for all of them.
asked(Id, Asker, Now, Flood) ->
    case travelling(Id, Now, Flood) of
        #held{askers = Askers} = Held ->
            Gather = [{{timeout, {give, Id}}, us(gather_ms, Flood), give} || Askers =:= []],
            {keep_state, put_held(Id, Held#held{askers = Askers ++ [Asker]}, Flood), Gather};
        none ->
            keep_state_and_data
    end.

give(Id, Now, #flood{known = Known} = Flood) ->
    case Known of
        #{Id := #held{askers = [_ | _] = Askers, until = Until} = Held} when Now < Until ->
            {Some, Rest} = lists:split(min(?AT_ONCE, length(Askers)), Askers),
            #held{area = Area, type = Type, body = Body, lifetime_us = Us, hops = Hops} = Held,
            Parcel = {Id, Area, Type, Body, Us, left(Held, Now, Flood), Hops},
            {keep_state, put_held(Id, Held#held{askers = Rest}, Flood), [
                starl_sap:shout(geocast, {give, Parcel, Some})
                | [{{timeout, {give, Id}}, 0, give} || Rest =/= []]
            ]};
        #{} ->
            keep_state_and_data
    end.

left(#held{until = Until}, Now, Flood) -> starl_geocast_lifetime:left(Until, Now, ppm(Flood)).

%% -- delivering -----------------------------------------------------------------------------

%% Asks for the own position if a message waits for it, now and again from time to time.
check(Now, Before, #flood{self = Self, located = {N, _}, checking = Checking} = Flood) ->
    case waiting(Now, Flood) of
        [] ->
            {keep_state, Flood, Before};
        [_ | _] ->
            Ask = starl_location:pose(Self, {where, N + 1}),
            Timer = [{{timeout, check}, us(check_ms, Flood), check} || not Checking],
            Asked = Flood#flood{located = {N + 1, Now}, checking = true},
            {keep_state, Asked, Before ++ [Ask | Timer]}
    end.

%% The messages that are alive, not delivered yet, and listened to, in the order of their ids.
waiting(Now, #flood{known = Known, listeners = Listeners}) ->
    lists:keysort(1, [
        {Id, Held}
     || {Id, #held{deliverable = true, until = Until, type = Type} = Held} <- maps:to_list(Known),
        Now < Until,
        is_map_key(Type, Listeners)
    ]).

%% The answer to the last question for the position: delivers the messages in whose areas the robot
%% surely is. A delivery leaves while the position is fresh and the message lives, or not at all,
%% since a computer may stall in mid-step while its robot drives on.
located(N, {ok, {X, Y, _}}, Now, #flood{located = {N, At}} = Flood) when Now - At =< ?FRESH_US ->
    #flood{config = #{position_error_mm := Error}, listeners = Listeners} = Flood,
    Inside = [
        One
     || {_, #held{area = Area}} = One <- waiting(Now, Flood),
        starl_geocast_area:depth({X, Y}, Area) >= Error
    ],
    Deliveries = [
        {until, min(At + ?FRESH_US, Until - 1), deliver(Id, Held, Listeners), {delivered, Id}}
     || {Id, #held{until = Until} = Held} <- Inside
    ],
    {keep_state, lists:foldl(fun delivered/2, Flood, Inside), Deliveries};
located(_N, _Answer, _Now, _Flood) ->
    keep_state_and_data.

deliver({Source, _, _} = Id, #held{area = Area, type = Type, body = Body}, Listeners) ->
    [
        {trace, {delivered, Id, erlang:phash2({Area, Type, Body})}},
        {cast, maps:get(Type, Listeners), {message, Source, Type, Body}}
    ].

delivered({Id, Held}, #flood{delivered = Memory} = Flood) ->
    Remembered = Flood#flood{delivered = starl_geocast_memory:add(Id, Memory)},
    put_held(Id, Held#held{deliverable = false}, Remembered).

%% This message was to be delivered, but too late: it waits again.
undelivered(Id, #flood{known = Known} = Flood) ->
    case Known of
        #{Id := #held{} = Held} -> put_held(Id, Held#held{deliverable = true}, Flood);
        #{} -> Flood
    end.

%% -- configuration --------------------------------------------------------------------------

ppm(#flood{config = #{drift_ppm := Ppm}}) -> Ppm.

us(Key, #flood{config = Config}) -> maps:get(Key, Config) * 1000.

jitter(#flood{config = #{jitter_ms := 0}} = Flood) ->
    {0, Flood};
jitter(#flood{random = Random0} = Flood) ->
    {Jitter, Random} = rand:uniform_s(us(jitter_ms, Flood), Random0),
    {Jitter, Flood#flood{random = Random}}.
