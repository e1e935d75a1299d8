%% @doc The contract of the geocast, as a monitor.
%%
%% The window of a message is from its sending to the end of its lifetime, both included.
%%
%% Under every fault: only messages that were sent are delivered, unchanged, and at most once in
%% each life of a robot's machine. More holds as long as clocks and positions keep the assumptions.
%% A message is delivered at most once per robot, across all restarts. It is never delivered after
%% the window, and never at a robot that is outside the area during the whole window. `broken' lists
%% the times at which an assumption is broken ({@link starl_assumption}; see {@link context/2}).
%% Only deviations that it explains are excused:
%% ```
%%   late           by no more than has been lost by the clocks on the way of the message to the
%%                  robot, each while it counted ({@link starl_geocast_provenance})
%%   once more      after a restart, if the message had been sent before that by no more than the
%%                  clocks on the way have lost before it was given to the robot, and the robot's
%%                  own has gained since the restart
%%   outside        if the robot's positions were wrong at the delivery, or up to 0.1 s before,
%%                  the longest that an answer may take. One that is late and excused has to be
%%                  inside then
%% '''
%% Progress is judged only with `progress' (default false: then messages may have no listener or few
%% hops, and nothing need be delivered). It covers messages that are sent at `healed_us' or later
%% (default 0; in a run, the end of the last fault, see {@link context/2}). They must live long
%% enough for packets that take `delay_us' (default 0; in a run, the longest delay;
%% {@link starl_geocast_lifetime:least_us/3}). A robot that is inside during the whole window, at
%% least `margin_mm' from the border (default 4: twice the error of a position), gets the message
%% delivered.
%%
%% There are exceptions. In the window, or up to `grace_us' (default 1 s) before, the robot or the
%% source died, or the geocast machine of either began anew. Or any robot's assumption was broken in
%% the window. If the robot's clock has lost time since its machine began, the machine counts as
%% begun that much later. Until the clock shows again what it showed at the beginning, no message is
%% surely a later one. The places of robots are known in continuous time, from the segments of their
%% motion.
%%
%% On a radio that loses packets, chance may keep a message from a robot that hears its source. This
%% is rarer the more often the source offers the message. For messages of others that a robot misses
%% in a row, the probabilities are multiplied. A row with a probability below 10^-9 breaks the
%% contract. If so few messages were due that missing all of them would not be that rare, nothing is
%% judged.
%%
%% Events of machine `geocast': {@link starl_geocast_flood:event()}, `crashed'; of machine
%% `chassis': `motion'; of machine `robot': `up', `died'.
-module(starl_geocast_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, sometimes/0]).

-type id() :: {starl:robot_id(), pos_integer(), pos_integer()}.

%% The longest that the answer to the question for the own position may take.
-define(FRESH_US, 100000).
%% The time that the giver of a message waits for others that ask for it.
-define(GATHER_US, 3000).
-define(DRIFT_PPM, 10000).
%% The first wait before an offer is repeated, and the longest one.
-define(OFFERS_US, {50000, 1000000}).
%% Faults that can keep a message from a robot.
-define(CLASSES, [network, clock, process, store, location]).
-define(CLAUSE, "delivered to every robot that is inside").

%% A message, with the robots that got it and the times, latest first.
-record(message, {
    area :: starl_geocast_area:area(),
    hash :: integer(),
    from_us :: integer(),
    to_us :: integer(),
    way :: starl_geocast_provenance:t(),
    %% the robots that have it, from somebody else, and those that had no room for it
    held = #{} :: #{starl:robot_id() => held | full},
    got = #{} :: #{starl:robot_id() => [integer(), ...]}
}).

-record(state, {
    robots :: [starl:robot_id()],
    progress :: boolean(),
    healed :: integer() | never,
    margin_mm :: float(),
    grace_us :: non_neg_integer(),
    least_us :: non_neg_integer(),
    loss :: number(),
    delay_us :: non_neg_integer(),
    offers_us :: {FirstUs :: pos_integer(), LongestUs :: pos_integer()},
    %% the probability of the messages in a row that a robot has missed
    rows = #{} :: #{starl:robot_id() => float()},
    %% that of missing all messages that a robot was owed
    all = #{} :: #{starl:robot_id() => float()},
    assumption :: starl_assumption:t(),
    messages = #{} :: #{id() => #message{}},
    %% the ends of the windows that are still open, and their beginnings
    open = gb_sets:new() :: gb_sets:set({ToUs :: integer(), id(), FromUs :: integer()}),
    %% the motion of each robot, latest piece first, from the beginning of the open windows on
    paths = #{} :: #{starl:robot_id() => [starl_trajectory:piece()]},
    %% when its machine crashed last, and began anew; when it died
    crashed = #{} :: #{starl:robot_id() => integer()},
    began = #{} :: #{starl:robot_id() => integer()},
    died = #{} :: #{starl:robot_id() => integer()},
    owed = 0 :: non_neg_integer(),
    latency_us = 0 :: integer()
}).

%% @doc `robots': the robots that listen; `drift_ppm': the drift of clocks, as the machines have it
%% (default 10000); the rest as above.
-spec init(#{
    robots := [starl:robot_id()],
    progress => boolean(),
    healed_us => integer() | never,
    delay_us => non_neg_integer(),
    loss => number(),
    offers_us => {pos_integer(), pos_integer()},
    margin_mm => float(),
    grace_us => non_neg_integer(),
    drift_ppm => non_neg_integer(),
    broken => [starl_assumption:window()]
}) -> #state{}.
init(#{robots := Robots} = Config) ->
    Ppm = maps:get(drift_ppm, Config, ?DRIFT_PPM),
    Delay = maps:get(delay_us, Config, 0),
    #state{
        robots = Robots,
        progress = maps:get(progress, Config, false),
        healed = maps:get(healed_us, Config, 0),
        margin_mm = maps:get(margin_mm, Config, 4.0),
        grace_us = maps:get(grace_us, Config, 1000000),
        least_us = starl_geocast_lifetime:least_us(Delay, ?GATHER_US, Ppm),
        loss = maps:get(loss, Config, 0),
        delay_us = Delay,
        offers_us = maps:get(offers_us, Config, ?OFFERS_US),
        assumption = starl_assumption:new(maps:get(broken, Config, []), Ppm)
    }.

%% @doc The configuration with the times of broken assumptions, the end of all faults and the
%% longest delay of a packet.
-spec context(starl_monitor:known(), map()) -> map().
context(Known, Config) ->
    #{broken := Broken, positions := Positions} = Known,
    Told = (maps:with([loss, delay_us], Known))#{
        broken => Broken ++ Positions, healed_us => starl_monitor:healed_us(?CLASSES, Known)
    },
    maps:merge(Told, Config).

%% @doc What a robot should have received in the window is not judged.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _} = Window, #state{assumption = Assumption, healed = Healed} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption), healed = max(Healed, To)
    }.

%% @doc The geocasts' own events, the motion and the end of robots.
-spec interests() -> [atom()].
interests() -> [geocast, chassis, robot].

%% @doc {@link starl_geocast_flood:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{geocast => [{sent, 4}, {held, 2}, {delivered, 2}, {full, 1}]}.

%% @doc A memory that is full is seldom.
-spec sometimes() -> [{{atom(), atom()}, seldom}].
sometimes() ->
    [{{geocast, Tag}, seldom} || Tag <- [full]].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Closed, Current} = close_until(T, State, []),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Current),
    starl_violation:step(Closed ++ Broken, Next).

%% @doc Judges the windows that end before `EndTimeUs'. Results: the number of messages `sent', of
%% deliveries (`delivered') and of deliveries `owed', and the longest time that one took
%% (`latency_us').
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Found, #state{messages = Messages} = End} = close_until(EndTimeUs, State, []),
    Healed = End#state.healed,
    Off =
        case End#state.progress of
            true -> starl_unjudged:unhealed(?CLAUSE, Healed, EndTimeUs) ++ few(End);
            false -> [{?CLAUSE, "all_listen is not set"}]
        end,
    Results = starl_unjudged:with(Off, #{
        sent => map_size(Messages),
        delivered => lists:sum([map_size(Got) || #message{got = Got} <- maps:values(Messages)]),
        owed => End#state.owed,
        latency_us => End#state.latency_us
    }),
    starl_violation:finish(Found, Results).

%% -- events ---------------------------------------------------------------------------------

judge({chassis, {motion, Piece}}, _T, Robot, #state{paths = Paths} = State) ->
    Path = [Piece | maps:get(Robot, Paths, [])],
    {[], State#state{paths = Paths#{Robot => needed(Path, earliest(State))}}};
judge({geocast, {sent, Id, Area, Lifetime, Hash}}, T, Robot, State) ->
    {[], sent(Id, Area, Lifetime, Hash, T, Robot, State)};
judge({geocast, {held, Id, From}}, T, Robot, State) ->
    {[], held(Id, From, T, Robot, State)};
judge({geocast, {full, Id}}, _T, Robot, #state{messages = Messages} = State) ->
    case Messages of
        #{Id := #message{held = Held} = Message} ->
            Noted = Message#message{held = maps:merge(#{Robot => full}, Held)},
            {[], State#state{messages = Messages#{Id := Noted}}};
        #{} ->
            {[], State}
    end;
judge({geocast, {delivered, Id, Hash}}, T, Robot, #state{messages = Messages} = State) ->
    case Messages of
        #{Id := #message{} = Message} -> delivered(Id, Message, Hash, T, Robot, State);
        #{} -> {[violation(never_sent, T, Robot, Id, #{})], State}
    end;
judge({geocast, crashed}, T, Robot, #state{crashed = Crashed, began = Began} = State) ->
    {[], State#state{crashed = Crashed#{Robot => T}, began = Began#{Robot => T}}};
judge({robot, up}, T, Robot, #state{began = Began} = State) ->
    {[], State#state{began = Began#{Robot => T}}};
judge({robot, {died, _Reason}}, T, Robot, #state{died = Died} = State) ->
    {[], State#state{died = Died#{Robot => T}}};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

sent(Id, Area, Lifetime, Hash, T, Robot, #state{messages = Messages, open = Open} = State) ->
    Message = #message{
        area = Area,
        hash = Hash,
        from_us = T,
        to_us = T + Lifetime,
        way = starl_geocast_provenance:new(Robot, T)
    },
    State#state{
        messages = Messages#{Id => Message}, open = gb_sets:add({T + Lifetime, Id, T}, Open)
    }.

held(Id, From, T, Robot, #state{messages = Messages} = State) ->
    case Messages of
        #{Id := #message{held = Held} = Message} ->
            Noted = way(From, T, Robot, Message#message{held = Held#{Robot => held}}, State),
            State#state{messages = Messages#{Id := Noted}};
        #{} ->
            State
    end.

%% As long as clocks keep the assumptions nobody asks for the way of a message.
way(From, T, Robot, #message{way = Way} = Message, #state{assumption = Assumption}) ->
    case starl_assumption:is_kept(Assumption) of
        true -> Message;
        false -> Message#message{way = starl_geocast_provenance:held(T, Robot, From, Way)}
    end.

delivered(Id, #message{got = Got, from_us = From} = Message, Hash, T, Robot, State) ->
    Broken =
        [violation(changed, T, Robot, Id, #{}) || Hash =/= Message#message.hash] ++
            twice(Id, Message, T, Robot, State) ++ late(Id, Message, T, Robot, State),
    Next = Message#message{got = Got#{Robot => [T | maps:get(Robot, Got, [])]}},
    {Broken, State#state{
        messages = (State#state.messages)#{Id := Next},
        latency_us = max(State#state.latency_us, T - From)
    }}.

twice(Id, #message{got = Got, from_us = Sent} = Message, T, Robot, State) ->
    #state{crashed = Crashed, assumption = Assumption} = State,
    case {Got, Crashed} of
        {#{Robot := [Last | _]}, #{Robot := Crash}} when Crash >= Last ->
            Before = starl_geocast_provenance:spans_before(Robot, T, Message#message.way),
            Gained = starl_assumption:gained_us(Robot, Crash, T, Assumption),
            [
                violation(delivered_twice, T, Robot, Id, #{})
             || Crash - Sent > Gained + lost(Before, Assumption)
            ];
        {#{Robot := _}, #{}} ->
            [violation(delivered_twice, T, Robot, Id, #{})];
        {#{}, #{}} ->
            []
    end.

late(_Id, #message{to_us = To}, T, _Robot, _State) when T =< To ->
    [];
late(Id, #message{to_us = To} = Message, T, Robot, #state{assumption = Assumption} = State) ->
    Spans = starl_geocast_provenance:spans(Robot, T, Message#message.way),
    case T - To =< lost(Spans, Assumption) of
        true ->
            Now = Message#message{from_us = T - ?FRESH_US, to_us = T},
            elsewhere(Id, Now, [T], Robot, spans(Now, path(Robot, State)), State);
        false ->
            [violation(too_late, T, Robot, Id, #{late_us => T - To})]
    end.

lost(Spans, Assumption) ->
    lists:sum([
        starl_assumption:lost_us(Robot, From, Until, Assumption)
     || {Robot, From, Until} <- Spans
    ]).

%% -- the end of a window --------------------------------------------------------------------

close_until(T, #state{open = Open} = State, Found) ->
    case gb_sets:is_empty(Open) orelse gb_sets:smallest(Open) of
        {To, Id, _From} when To < T ->
            Left = State#state{open = gb_sets:delete_any(gb_sets:smallest(Open), Open)},
            {Broken, Closed} = close(Id, Left),
            close_until(T, Closed, Found ++ Broken);
        _NothingOver ->
            {Found, State}
    end.

close(Id, #state{robots = Robots, messages = Messages} = State0) ->
    Message = maps:get(Id, Messages),
    {Broken, State} = lists:foldl(
        fun(Robot, {Found, Before}) ->
            {New, After} = hold_against(Id, Message, Robot, Before),
            {Found ++ New, After}
        end,
        {[], State0},
        lists:usort(Robots ++ maps:keys(Message#message.got))
    ),
    Earliest = earliest(State),
    Paths = maps:map(fun(_, Path) -> needed(Path, Earliest) end, State#state.paths),
    {Broken, State#state{paths = Paths}}.

%% No row of messages could have been too long.
few(#state{all = All, rows = Rows, loss = Loss}) ->
    IsShort = lists:all(fun(Row) -> not starl_sap_schedule:is_rare(Row) end, maps:values(All)),
    [
        Few
     || Loss > 0, map_size(Rows) > 0, IsShort, Few <- starl_unjudged:too_few(?CLAUSE, Loss)
    ].

hold_against(Id, #message{got = Got} = Message, Robot, State) ->
    Spans = spans(Message, path(Robot, State)),
    Owed =
        case is_owed(Id, Message, Robot, Spans, State) of
            true -> owed(Id, Message, Robot, State);
            false -> none
        end,
    case {Got, Owed} of
        {#{Robot := Times}, none} ->
            {elsewhere(Id, Message, Times, Robot, Spans, State), got(Id, Robot, State)};
        {#{Robot := Times}, {_Chance, Next}} ->
            {elsewhere(Id, Message, Times, Robot, Spans, State), got(Id, Robot, Next)};
        {#{}, none} ->
            {[], State};
        {#{}, {Chance, Next}} ->
            missed(Id, Message, Robot, Chance, Next)
    end.

%% Its own message tells nothing of what a robot hears.
got({Robot, _, _}, Robot, State) -> State;
got(_Id, Robot, #state{rows = Rows} = State) -> State#state{rows = maps:remove(Robot, Rows)}.

%% The probability that chance keeps the message from the robot. The source has its own message at once.
owed({Robot, _, _}, _Message, Robot, #state{owed = Owed} = State) ->
    {0.0, State#state{owed = Owed + 1}};
owed(_Id, Message, Robot, #state{owed = Owed, all = All, loss = Loss} = State) ->
    #message{from_us = From, to_us = To} = Message,
    Live = (To - From) * 49 div 50,
    Offers = starl_geocast_lifetime:offers(Live, State#state.delay_us, State#state.offers_us),
    Chance = starl_geocast_lifetime:missed(Loss, Offers),
    {Chance, State#state{owed = Owed + 1, all = times(Robot, Chance, All)}}.

times(Robot, Chance, Rows) -> Rows#{Robot => Chance * maps:get(Robot, Rows, 1.0)}.

%% What a robot holds chance has not taken.
missed({Source, _, _} = Id, #message{held = Held} = Message, Robot, Chance, State) ->
    case maps:merge(#{Source => held}, Held) of
        #{Robot := held} ->
            {[violation(not_delivered, Message#message.to_us, Robot, Id, #{})], State};
        #{Robot := _} ->
            {[], got(Id, Robot, State)};
        #{} ->
            unlucky(Id, Message, Robot, Chance, State)
    end.

unlucky(Id, #message{to_us = To}, Robot, Chance, #state{rows = Rows, loss = Loss} = State) ->
    #{Robot := Row} = Next = times(Robot, Chance, Rows),
    case Loss == 0 orelse starl_sap_schedule:is_rare(Row) of
        true -> {[violation(not_delivered, To, Robot, Id, #{})], got(Id, Robot, State)};
        false -> {[], State#state{rows = Next}}
    end.

is_owed(Id, #message{from_us = From, to_us = To} = Message, Robot, Spans, State) ->
    #state{assumption = Assumption} = State,
    %% an atom is more than every number
    State#state.progress andalso From >= State#state.healed andalso
        To - From >= State#state.least_us andalso inside(Message, Spans, State) andalso
        able(Robot, Message, State) andalso able(element(1, Id), Message, State) andalso
        is_later(Robot, From, State) andalso starl_assumption:is_kept(From, To, Assumption).

%% The deliveries at these times, the latest first, with the robot outside the area.
elsewhere(Id, Message, [T | _] = Times, Robot, Spans, #state{assumption = Assumption}) ->
    [
        violation(outside, T, Robot, Id, #{})
     || outside(Message, Spans),
        not lists:all(
            fun(At) -> starl_assumption:is_misplaced(Robot, At - ?FRESH_US, At, Assumption) end,
            Times
        )
    ].

path(Robot, #state{paths = Paths}) -> maps:get(Robot, Paths, []).

outside(_Message, []) ->
    false;
outside(#message{area = Area}, Spans) ->
    lists:all(
        fun({Piece, T1, T2}) -> starl_geocast_area:keeps_outside(Piece, T1, T2, Area) end, Spans
    ).

inside(_Message, [], _State) ->
    false;
inside(#message{area = Area}, Spans, #state{margin_mm = Margin}) ->
    lists:all(
        fun({Piece, T1, T2}) -> starl_geocast_area:keeps_inside(Piece, T1, T2, Area, Margin) end,
        Spans
    ).

able(Robot, #message{from_us = From}, #state{began = Began, died = Died} = State) ->
    not is_map_key(Robot, Died) andalso
        maps:get(Robot, Began, -infinite()) < From - State#state.grace_us.

%% Was it sent after the robot's machine began, also by the robot's own clock?
is_later(Robot, From, #state{began = Began, grace_us = Grace, assumption = Assumption}) ->
    case Began of
        #{Robot := At} -> At + starl_assumption:lost_us(Robot, At, From, Assumption) < From - Grace;
        #{} -> true
    end.

infinite() -> 1 bsl 62.

%% The pieces that cover the window, each with the part of the window in which it was driven.
%% None where the robot's place is not known from the beginning on.
spans(#message{from_us = From, to_us = To}, Path) ->
    Spans = spans(From, To, Path, []),
    case Spans of
        [{_, From, _} | _] -> Spans;
        _ -> []
    end.

spans(_From, _To, [], Spans) ->
    Spans;
spans(From, To, [Piece | Earlier], Spans) ->
    Began = began(Piece),
    if
        Began > To -> spans(From, To, Earlier, Spans);
        Began =< From -> [{Piece, From, To} | Spans];
        true -> spans(From, Began, Earlier, [{Piece, Began, To} | Spans])
    end.

%% -- motion ---------------------------------------------------------------------------------

earliest(#state{open = Open}) ->
    case [From || {_, _, From} <- gb_sets:to_list(Open)] of
        [] -> infinite();
        Froms -> lists:min(Froms)
    end.

%% The pieces up to the one that was driven at that time.
needed(Path, Earliest) ->
    {Later, Before} = lists:splitwith(fun(Piece) -> began(Piece) > Earliest end, Path),
    Later ++ lists:sublist(Before, 1).

began(Piece) -> starl_trajectory:start_us(Piece).

violation(What, T, Robot, Id, Details) ->
    starl_violation:new(geocast, What, T, [Robot], Details#{id => Id}).
