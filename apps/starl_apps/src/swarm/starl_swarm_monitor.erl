%% @doc Contract of swarm messages: every robot inside the area that is connected to the sender by radio must
%% receive it within a second. Connected: a chain of robots links the two, each in range of the next. Robots
%% that could leave the area, or break the chain, within that second at full speed do not count.
%%
%% On a radio that loses packets chance may keep a message from a robot, the more often the longer
%% the chain and the more packets are lost. The probabilities of consecutive missed messages are
%% multiplied. A series that is rarer than 10^-9 breaks the contract.
%%
%% Not judged are, in slow radios, a chain of too many hops, and
%% messages with a fault during that second or up to five seconds before. That nobody else hears, the
%% contract of geocast judges ({@link starl_geocast_monitor}).
%%
%% Events of machine `geocast': {@link starl_geocast_flood:event()}; of machine `chassis': `motion'; of
%% machine `robot': `died'.
-module(starl_swarm_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0]).

-type id() :: {starl:robot_id(), pos_integer(), pos_integer()}.

-record(state, {
    range :: number() | none,
    %% how far a robot drives in the time of a message (mm)
    drive :: float(),
    loss :: number(),
    delay_us :: non_neg_integer(),
    %% the probability of the messages in a row that were missed, and that of missing all
    rows = #{} :: rows(),
    all = #{} :: rows(),
    hops :: non_neg_integer(),
    faults :: [starl_assumption:window()],
    pieces = #{} :: #{starl:robot_id() => starl_trajectory:piece()},
    %% the messages on their way, the latest first, with those that still have to hear, each with the length of its chain
    open = [] :: [
        {id(), DueUs :: integer(), [{starl:robot_id(), {near | far, Hops :: pos_integer()}}]}
    ],
    owed = 0 :: non_neg_integer()
}).

%% Of the messages that a robot near their source missed, and of those that anybody far from it missed: that robots hear
%% their neighbours says nothing of those who pass messages on.
-type rows() :: #{{near, starl:robot_id()} | relayed => float()}.

-define(WITHIN_US, 1000000).
-define(BEFORE_US, 5000000).
%% Packets of a hop: an offer, a question, an answer, each with the longest delay and a wait.
-define(PACKETS, 3).
-define(WAIT_US, 10000).
%% The waits of a holder between its offers, the first and the longest ({@link starl_geocast:options/0}).
-define(OFFERS_US, {50000, 1000000}).
-define(CLAUSE, "who is inside, and linked to the sender, hears it").
%% From this loss on nothing is judged. It also stands for walls and shadows, of which nobody knows what they take.
-define(MOST_LOSS, 0.5).

-spec init(#{
    range_mm := number() | none,
    speed := number(),
    loss => number(),
    delay_us => non_neg_integer(),
    faults => [starl_assumption:window()]
}) -> #state{}.
init(#{range_mm := Range, speed := Speed} = Config) ->
    Delay = maps:get(delay_us, Config, 0),
    Hop = ?PACKETS * (Delay + ?WAIT_US),
    #state{
        range = Range,
        drive = Speed * ?WITHIN_US / 1.0e6,
        loss = maps:get(loss, Config, 0),
        delay_us = Delay,
        hops = ?WITHIN_US div Hop,
        faults = maps:get(faults, Config, [])
    }.

%% @doc The faults, but those of wheels, which keep no robot from hearing; without the window of the whole run that stands for a limited range.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, faults := Faults, bodies := Bodies} = Known, Config) ->
    Places = maps:get(places, Known, Bodies),
    Own = [Window || {Who, From, _, _} = Window <- Faults, {Who, From} =/= {all, 0}],
    (maps:merge(maps:with([loss, delay_us], Known), Config))#{faults => Broken ++ Own ++ Places}.

%% @doc In real time a fault is known when it happens.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{faults = Faults} = State) -> State#state{faults = [Window | Faults]}.

-spec interests() -> [atom()].
interests() -> [geocast, chassis, robot].

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    {Late, Next} = late(T, State),
    starl_violation:step(Late, note(Event, Next)).

note({_, Robot, chassis, {motion, Piece}}, #state{pieces = Pieces} = State) ->
    State#state{pieces = Pieces#{Robot => Piece}};
note({_, Robot, robot, {died, _}}, #state{pieces = Pieces} = State) ->
    State#state{pieces = maps:remove(Robot, Pieces)};
note({T, Robot, geocast, {sent, Id, Area, _Lifetime, _Hash}}, State) ->
    case due(T, Robot, Area, State) of
        [] ->
            State;
        Due ->
            #state{open = Open, owed = Owed, all = All} = State,
            State#state{
                open = [{Id, T + ?WITHIN_US, Due} | Open],
                owed = Owed + length(Due),
                all = maps:fold(
                    fun(Key, Hops, Rows) -> longer(Key, Hops, Rows, State) end, All, keys(Due)
                )
            }
    end;
note({_, Robot, geocast, {delivered, Id, _Hash}}, #state{open = Open, rows = Rows} = State) ->
    Heard = keys([One || {Of, _, Due} <- Open, Of =:= Id, {R, _} = One <- Due, R =:= Robot]),
    State#state{
        open = [heard(Robot, Id, One) || One <- Open],
        rows = maps:without(maps:keys(Heard), Rows)
    };
note(_Event, State) ->
    State.

heard(Robot, Id, {Id, Due, Robots}) -> {Id, Due, lists:keydelete(Robot, 1, Robots)};
heard(_Robot, _Id, Other) -> Other.

due(_T, _Robot, _Area, #state{loss = Loss}) when Loss >= ?MOST_LOSS ->
    [];
due(T, Robot, Area, #state{faults = Faults, drive = Drive} = State) ->
    case [W || {_, From, To, _} = W <- Faults, From =< T + ?WITHIN_US, To >= T - ?BEFORE_US] of
        [] ->
            Places = maps:map(
                fun(_, Piece) -> starl_trajectory:position(T, Piece) end, State#state.pieces
            ),
            Others = maps:without([Robot], Places),
            [
                {Id, {far(Id, Robot, Places, State), Hops}}
             || {Id, Hops} <- reached(1, [Robot], Others, Places, State),
                starl_geocast_area:depth(maps:get(Id, Places), Area) > Drive
            ];
        _ ->
            []
    end.

%% Whom the source's own packets surely do not reach.
far(_Id, _Robot, _Places, #state{range = none}) ->
    near;
far(Id, Robot, Places, #state{range = Range, drive = Drive}) ->
    Mm = starl_geometry:distance(maps:get(Id, Places), maps:get(Robot, Places)),
    case Mm > Range + 2 * Drive of
        true -> far;
        false -> near
    end.

%% All robots that a chain reaches, each with the length of its chain.
reached(Hop, _Edge, _Others, _Places, #state{hops = Most}) when Hop > Most ->
    [];
reached(_Hop, [], _Others, _Places, _State) ->
    [];
reached(Hop, Edge, Others, Places, #state{range = Range, drive = Drive} = State) ->
    Next = [
        Id
     || {Id, At} <- lists:sort(maps:to_list(Others)),
        Range =:= none orelse
            lists:any(
                fun(From) ->
                    starl_geometry:distance(At, maps:get(From, Places)) + 2 * Drive < Range
                end,
                Edge
            )
    ],
    [{Id, Hop} || Id <- Next] ++ reached(Hop + 1, Next, maps:without(Next, Others), Places, State).

late(T, #state{open = Open} = State) ->
    {Over, Waiting} = lists:partition(fun({_, Due, _}) -> Due < T end, Open),
    lists:foldl(fun missed/2, {[], State#state{open = Waiting}}, lists:reverse(Over)).

missed({Id, Due, Robots}, {Found, State}) ->
    {Missed, Next} = maps:fold(fun unlucky/3, {[], State}, keys(Robots)),
    Broken = [R || {R, Way} <- Robots, lists:member(key(R, Way), Missed)],
    Violations = [
        starl_violation:new(swarm, not_heard, Due, Broken, #{message => Id})
     || Broken =/= []
    ],
    {Found ++ Violations, Next}.

%% The rows to which these robots belong, each with the longest chain.
keys(Robots) ->
    lists:foldl(
        fun({Robot, {_, Hops} = Way}, Keys) ->
            maps:update_with(key(Robot, Way), fun(Most) -> max(Most, Hops) end, Hops, Keys)
        end,
        #{},
        Robots
    ).

key(Robot, {near, _Hops}) -> {near, Robot};
key(_Robot, {far, _Hops}) -> relayed.

unlucky(Key, Hops, {Missed, #state{loss = Loss, rows = Rows} = State}) ->
    #{Key := Row} = Next = longer(Key, Hops, Rows, State),
    case Loss == 0 orelse starl_sap_schedule:is_rare(Row) of
        true -> {[Key | Missed], State#state{rows = maps:remove(Key, Rows)}};
        false -> {Missed, State#state{rows = Next}}
    end.

%% One more message that is missed. Each hop of a chain has its part of the time.
longer(Key, Hops, Rows, #state{loss = Loss, delay_us = Delay}) ->
    Offers = starl_geocast_lifetime:offers(?WITHIN_US div Hops, Delay, ?OFFERS_US),
    Chance = min(1.0, Hops * starl_geocast_lifetime:missed(Loss, Offers)),
    Rows#{Key => Chance * maps:get(Key, Rows, 1.0)}.

%% @doc Results: how many times a message had to be heard.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{atom() => term()}}.
finish(EndUs, State) ->
    {Late, #state{owed = Owed, loss = Loss} = Last} = late(EndUs, State),
    Results = starl_unjudged:with(off(Loss, Last), #{owed => Owed}),
    starl_violation:finish(Late, Results).

%% Of so few messages that no row of missed ones could be too long, nothing is known if some were missed.
off(Loss, _State) when Loss >= ?MOST_LOSS -> starl_unjudged:lossy(?CLAUSE, Loss);
off(Loss, #state{all = All, rows = Rows}) ->
    case [K || K <- maps:keys(Rows), not starl_sap_schedule:is_rare(maps:get(K, All))] of
        [] -> [];
        [_ | _] -> starl_unjudged:too_few(?CLAUSE, Loss)
    end.
