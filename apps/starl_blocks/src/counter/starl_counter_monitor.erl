%% @doc The contract of the shared counter, as a monitor.
%%
%% Safety: the value of a robot never goes back, except after a crash of its machine, and never
%% exceeds the number of increments that were made. An increment counts at once where it is made.
%%
%% Progress: after increments stop, all robots alive have the same value. They have it at most
%% `within_us' (default: none) after the last increment and the last crash or death of a robot, and
%% after `healed_us'. By default `healed_us' is 0; in a run it is the end of the last fault of
%% radio, clocks, computers and stores ({@link context/2}). No increment since that crash or death
%% is lost, nor one that was known elsewhere at the time. So the value is at least what any of them
%% had at some time, plus what it and the others have counted since in their present lives.
%%
%% Events of machine `counter': those of {@link starl_counter_gossip:event()}, and `crashed'; of
%% machine `robot': `{died, Reason}'.
-module(starl_counter_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

-type us() :: integer().

-record(state, {
    within :: us() | infinity,
    healed :: us() | never,
    made = 0 :: non_neg_integer(),
    %% the least value on which those alive may agree: what one of them had at some time, and what each
    %% has counted since and not forgotten
    had = {none, 0} :: {starl:robot_id() | none, Value :: non_neg_integer()},
    since = #{} :: #{starl:robot_id() => pos_integer()},
    %% each robot's value; the dead are not there
    values :: #{starl:robot_id() => non_neg_integer()},
    due = infinity :: us() | infinity,
    judged = 0 :: non_neg_integer()
}).

%% @doc See above.
-spec init(#{robots := [starl:robot_id()], within_us => us(), healed_us => us() | never}) ->
    #state{}.
init(#{robots := Robots} = Config) ->
    #state{
        within = maps:get(within_us, Config, infinity),
        healed = maps:get(healed_us, Config, 0),
        values = maps:from_keys(Robots, 0)
    }.

%% Faults that can delay the messages of a robot to the others.
-define(CLASSES, [network, clock, process, store]).
-define(AGREE, "all robots agree").

%% @doc The configuration with the end of the faults that can hold it up.
-spec context(starl_monitor:known(), map()) -> map().
context(Known, Config) ->
    Healed = starl_monitor:healed_us(?CLASSES, Known),
    longer(Known, maps:merge(#{healed_us => Healed}, Config)).

%% The last message that all wait for may be given up by SAP, and is sent again in the next turn.
longer(
    #{sap := Sap, loss := Loss, delay_us := Delay}, #{within_us := Within, turn_us := Turn} = Config
) ->
    Config#{within_us := Within + starl_sap_schedule:reach_us(Sap, Loss, Delay, Turn)};
longer(_Known, Config) ->
    Config.

%% @doc The window is over: from then on robots have their time to agree.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _}, #state{healed = Healed, due = Due} = State) ->
    Later = State#state{healed = max(Healed, To)},
    case Due of
        infinity -> Later;
        _ -> postponed(To, Later)
    end.

%% @doc The counters' own events and the end of robots.
-spec interests() -> [atom()].
interests() -> [counter, robot].

%% @doc {@link starl_counter_gossip:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{counter => [{incremented, 1}, {holds, 1}, {read, 1}]}.

%% @doc The increments and each robot's value; without `within_us' nothing else is judged.
-spec timeless(#state{}) -> term().
timeless(#state{made = Made, values = Values}) -> {Made, Values}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Late, Current} = agreement(T, State),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Current),
    starl_violation:step(Late ++ Broken, Next).

%% @doc Judges the time until `EndUs'. Results: the number of `increments', and the number of times
%% agreement was `agreed'.
-spec finish(us(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, State) ->
    {Late, #state{made = Made, judged = Judged} = End} = agreement(EndUs, State),
    Results = #{increments => Made, agreed => Judged},
    starl_violation:finish(Late, starl_unjudged:with(unjudged(EndUs, End), Results)).

unjudged(_EndUs, #state{within = infinity}) ->
    [];
unjudged(EndUs, #state{healed = Healed, within = Within, due = Due} = State) ->
    case starl_unjudged:unhealed(?AGREE, Healed, EndUs) of
        [] when Due =/= infinity ->
            %% would they agree if the time were up?
            {Open, _} = agreement(Due + 1, State),
            [
                C
             || Open =/= [], C <- starl_unjudged:too_short(?AGREE, Within, "they do not agree yet")
            ];
        Unhealed ->
            Unhealed
    end.

judge({counter, {incremented, Value}}, T, Robot, #state{made = Made, since = Since} = State) ->
    Broken = not_counted(Value, T, Robot, State),
    Counted = State#state{
        made = Made + 1, since = maps:update_with(Robot, fun(N) -> N + 1 end, 1, Since)
    },
    {More, Next} = has(Value, T, Robot, postponed(T, Counted)),
    {Broken ++ More, Next};
judge({counter, {holds, Value}}, T, Robot, State) ->
    has(Value, T, Robot, State);
judge({counter, {read, Value}}, T, Robot, State) ->
    has(Value, T, Robot, State);
judge({counter, crashed}, T, Robot, #state{values = Values} = State) ->
    {[], postponed(T, forgotten(Robot, State#state{values = Values#{Robot => 0}}))};
judge({robot, {died, _Reason}}, T, Robot, #state{values = Values} = State) ->
    {[], postponed(T, forgotten(Robot, State#state{values = maps:remove(Robot, Values)}))};
judge(_Other, _T, _Robot, State) ->
    {[], State}.

%% What the robot has counted may be lost, and what it knew; what another one has now is not.
forgotten(Robot, #state{had = {Who, _}, since = Since, values = Values} = State) ->
    Others = State#state{since = maps:remove(Robot, Since)},
    Left =
        case Who of
            Robot -> Others#state{had = {none, 0}};
            _ -> Others
        end,
    {Most, Other} = lists:max([{0, none} | [{V, R} || {R, V} <- maps:to_list(Values)]]),
    case Most > least(Left) of
        true -> State#state{had = {Other, Most}, since = #{}};
        false -> Left
    end.

least(#state{had = {_, Value}, since = Since}) -> Value + lists:sum(maps:values(Since)).

not_counted(Value, T, Robot, #state{values = Values}) ->
    case maps:get(Robot, Values, 0) of
        Value -> [violation(not_counted, T, [Robot], #{value => Value})];
        _ -> []
    end.

has(Value, T, Robot, #state{made = Made, values = Values} = State) ->
    Before = maps:get(Robot, Values, 0),
    Broken =
        [violation(goes_back, T, [Robot], #{from => Before, to => Value}) || Value < Before] ++
            [violation(exceeds, T, [Robot], #{value => Value, made => Made}) || Value > Made],
    {Broken, State#state{values = Values#{Robot => Value}}}.

%% Agreement is due later. An atom is more than every number.
postponed(_T, #state{within = infinity} = State) ->
    State;
postponed(_T, #state{healed = never} = State) ->
    State;
postponed(T, #state{within = Within, healed = Healed} = State) ->
    State#state{due = max(T, Healed) + Within}.

agreement(T, #state{due = Due, values = Values, judged = Judged} = State) when Due < T ->
    Least = least(State),
    Disagree = fun(What, Details) ->
        Broken = violation(What, Due, lists:sort(maps:keys(Values)), Details),
        {[Broken], State#state{due = infinity}}
    end,
    case lists:usort(maps:values(Values)) of
        [_, _ | _] = Different ->
            Disagree(no_agreement, #{values => Different});
        [Value] when Value < Least ->
            Disagree(increments_lost, #{value => Value, least => Least});
        _ ->
            {[], State#state{due = infinity, judged = Judged + 1}}
    end;
agreement(_T, State) ->
    {[], State}.

violation(What, T, Robots, Details) ->
    starl_violation:new(counter, What, T, Robots, Details).
