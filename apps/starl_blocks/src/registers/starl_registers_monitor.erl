%% @doc The contract of the shared registers, as a monitor.
%%
%% Safety: a read returns a value that was written, under the stamp of its write. Reads of a
%% register at one robot never go back to an earlier stamp, nor to `unset', except after a crash of
%% its machine. A robot's own stamps always grow and carry its number, even across its restarts,
%% unless its machine's store is damaged, lost or set back. A register with an owner is written by
%% that robot only.
%%
%% Progress: when writes to a register stop, all robots alive come to hold the same write of it.
%% They hold it at most `bound_us' after its last write and the last crash or death of a robot, and
%% after `healed_us' (default 0; in a run, the end of the last fault, see {@link context/2}). With
%% `within_us' instead of `bound_us' faults do not widen the bound. A machine whose store is damaged
%% may begin so far ahead that slower clocks admit none of its stamps until they have caught up.
%% That adds `apart_us' after its start, the greatest difference of physical clocks (default 0).
%%
%% A robot whose stamps are beyond its clock by more than twice `apart_us' may set its clock right
%% (`set_right'). Then its stamps and reads go back, once.
%%
%% A robot that has refused the latest write since its stamp is too far ahead is excused
%% (`clocks_apart'), but the others must agree. It is excused only if the robot's clock can be
%% behind another by more than `apart_us', through faults (`broken') and through the differences
%% that clocks may have without faults (`clocks'). A clock that was ahead of its present time by
%% more than twice `apart_us' is an excuse only as long as it is wrong.
%%
%% Events of machine `registers': {@link starl_registers_lww:event()}, `crashed',
%% `store_damaged'; of machine `robot': `died', `store_set_back'.
-module(starl_registers_monitor).
-behaviour(starl_monitor).

-export([
    init/1,
    context/2,
    broken/2,
    step/2,
    finish/2,
    interests/0,
    vocabulary/0,
    sometimes/0,
    timeless/1
]).

-type name() :: term().
-type stamp() :: starl_hlc:stamp().

-record(state, {
    robots :: [starl:robot_id()],
    owners :: #{name() => starl:robot_id()},
    bound_us :: pos_integer() | infinity,
    healed :: integer() | never,
    apart_us :: non_neg_integer(),
    %% when, at the latest, all clocks admit the stamps of machines with damaged stores
    admitted = 0 :: integer(),
    writes = #{} :: #{{name(), stamp()} => Hash :: integer()},
    %% each robot's last stamp, last read of a register, and present copies
    stamps = #{} :: #{starl:robot_id() => stamp()},
    read = #{} :: #{starl:robot_id() => #{name() => stamp()}},
    holds = #{} :: #{starl:robot_id() => #{name() => stamp()}},
    %% the last write that a robot has refused, since its stamp was too far ahead
    refused = #{} :: #{{starl:robot_id(), name()} => stamp()},
    assumption :: starl_assumption:t(),
    clocks :: #{offset_us := non_neg_integer(), drift_ppm := number()},
    died = [] :: [starl:robot_id()],
    %% the registers on which all must agree
    agreements = starl_obligations:new(exact) :: starl_obligations:t(name()),
    judged = 0 :: non_neg_integer(),
    %% the robots that were excused, one for each register
    excused = 0 :: non_neg_integer(),
    reads = 0 :: non_neg_integer()
}).

-define(MILLION, 1000000).
-define(RESERVED_US, 1000000).
-define(AGREE, "all robots agree").

%% @doc `robots': the team; `owners' as in the configuration of the machines.
-spec init(#{
    robots := [starl:robot_id()],
    owners => #{name() => starl:robot_id()},
    bound_us => pos_integer(),
    within_us => pos_integer(),
    apart_us => non_neg_integer(),
    broken => [starl_assumption:window()],
    clocks => #{offset_us := non_neg_integer(), drift_ppm := number()},
    healed_us => integer() | never
}) -> #state{}.
init(#{robots := Robots} = Config) ->
    #state{
        robots = Robots,
        owners = maps:get(owners, Config, #{}),
        bound_us = maps:get(within_us, Config, maps:get(bound_us, Config, infinity)),
        healed = maps:get(healed_us, Config, 0),
        apart_us = maps:get(apart_us, Config, 0),
        %% the drift of clocks is told apart from what faults do to them
        assumption = starl_assumption:new(maps:get(broken, Config, []), 0),
        clocks = maps:get(clocks, Config, #{offset_us => 0, drift_ppm => 0})
    }.

%% @doc The configuration with the end of all faults, and those that set clocks apart; faults of clocks and
%% processes widen `bound_us'.
-spec context(starl_monitor:known(), map()) -> map().
context(#{slack_us := Slack} = Known, Config) ->
    Healed = starl_monitor:healed_us([network, clock, process, store], Known),
    Facts = (maps:with([broken, clocks], Known))#{healed_us => Healed},
    Told = longer(Known, maps:merge(Facts, Config)),
    case Told of
        #{bound_us := Bound} -> Told#{bound_us := Bound + Slack};
        #{} -> Told
    end.

%% The last exchange takes three messages. If SAP gives one of them up, the robots exchange all once more.
longer(#{sap := Sap, loss := Loss, delay_us := Delay}, #{within_us := Within} = Config) ->
    Reach = starl_sap_schedule:reach_us(Sap, Loss, Delay, Within),
    Config#{within_us := Within + 3 * Reach};
longer(_Known, Config) ->
    Config.

%% @doc The window is over: from then on robots have their time to agree.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _} = Window, #state{bound_us = Bound, healed = Healed} = State) ->
    %% nothing is owed if there is no bound
    Later = fun
        (Name, Since, Owed) when Since < To -> starl_obligations:owe(Name, team, To, Bound, Owed);
        (_Name, _Since, Owed) -> Owed
    end,
    Agreements = State#state.agreements,
    State#state{
        healed = max(Healed, To),
        agreements = maps:fold(Later, Agreements, starl_obligations:sinces(Agreements)),
        assumption = starl_assumption:broken(Window, State#state.assumption)
    }.

%% @doc The registers' own events and the end of robots.
-spec interests() -> [atom()].
interests() -> [registers, robot].

%% @doc {@link starl_registers_lww:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() ->
    #{
        registers => [
            {put, 3},
            {got, 3},
            {got, 2},
            {holds, 2},
            {too_far_ahead, 2},
            {refused, 3},
            {denied, 1},
            {set_right, 1}
        ]
    }.

%% @doc The writes and reads; without `bound_us' nothing else is judged.
-spec timeless(#state{}) -> term().
timeless(#state{writes = Writes, stamps = Stamps, read = Read}) -> {Writes, Stamps, Read}.

%% @doc A write of a robot that may not write is seldom, and so are clocks that are too far apart.
-spec sometimes() -> [{clocks_apart | {atom(), atom()}, seldom}].
sometimes() ->
    [{clocks_apart, seldom} | [{{registers, T}, seldom} || T <- [refused, denied, set_right]]].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Disagreeing, Current} = agreed(T, State),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Current),
    starl_violation:step(Disagreeing ++ Broken, Next).

%% @doc Judges the agreements due before `EndTimeUs'. Results: the number of `writes', `reads'
%% and `agreements' judged, and the excuses.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Found, End} = agreed(EndTimeUs, State),
    #state{writes = Writes, reads = Reads, judged = Judged, excused = Excused} = End,
    Results = starl_unjudged:with(unjudged(EndTimeUs, End), #{
        writes => map_size(Writes),
        reads => Reads,
        agreements => Judged,
        sometimes => #{clocks_apart => Excused}
    }),
    starl_violation:finish(Found, Results).

unjudged(_EndUs, #state{bound_us = infinity}) ->
    [];
unjudged(EndUs, #state{healed = Healed, agreements = Owed, bound_us = Bound} = State) ->
    case starl_unjudged:unhealed(?AGREE, Healed, EndUs) of
        [] ->
            Open = [
                Name
             || {Name, Since} <- maps:to_list(starl_obligations:sinces(Owed)),
                disagreement(Since + Bound, Name, State) =/= {[], 0}
            ],
            [
                C
             || Open =/= [], C <- starl_unjudged:too_short(?AGREE, Bound, "they do not agree yet")
            ];
        Unhealed ->
            Unhealed
    end.

%% -- events ---------------------------------------------------------------------------------

judge({registers, Event}, T, Robot, State) ->
    registers(Event, T, Robot, State);
judge({robot, store_set_back}, T, Robot, State) ->
    registers(store_damaged, T, Robot, State);
judge({robot, {died, _Reason}}, T, Robot, #state{died = Died} = State) ->
    {[], postpone(T, State#state{died = [Robot | Died]}, written(State))};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

registers({put, Name, Hash, Stamp}, T, Robot, State) ->
    wrote(Name, Hash, Stamp, T, Robot, State);
registers({got, Name, Hash, Stamp}, T, Robot, #state{reads = Reads} = State) ->
    Broken = unwritten(Name, Hash, Stamp, T, Robot, State) ++ back(Name, Stamp, T, Robot, State),
    Read = note(Robot, Name, Stamp, State#state.read),
    {Broken, State#state{reads = Reads + 1, read = Read}};
registers({got, Name, unset}, T, Robot, #state{read = Read} = State) ->
    Before = maps:get(Robot, Read, #{}),
    {[violation(read_goes_back, T, [Robot], #{name => Name}) || is_map_key(Name, Before)], State};
registers({holds, Name, Stamp}, _T, Robot, #state{holds = Holds} = State) ->
    {[], State#state{holds = note(Robot, Name, Stamp, Holds)}};
registers({too_far_ahead, Name, Stamp}, _T, Robot, #state{refused = Refused} = State) ->
    Key = {Robot, Name},
    {[], State#state{refused = Refused#{Key => max(Stamp, maps:get(Key, Refused, Stamp))}}};
registers(crashed, T, Robot, #state{read = Read, holds = Holds} = State) ->
    Forgotten = State#state{
        read = maps:remove(Robot, Read), holds = maps:remove(Robot, Holds)
    },
    {[], postpone(T, Forgotten, written(State))};
registers(store_damaged, T, Robot, #state{stamps = Stamps, apart_us = Apart} = State) ->
    Admitted = T + Apart,
    {[], State#state{stamps = maps:remove(Robot, Stamps), admitted = Admitted}};
registers({set_right, Clock}, T, Robot, State) ->
    set_right(Clock, T, Robot, State);
registers(_Event, _T, _Robot, State) ->
    {[], State}.

%% The stamps of a robot go back to its clock: only if some are beyond all clocks within their bound.
%% The stored time that follows a stamp is later by up to a second.
set_right(Clock, T, Robot, #state{stamps = Stamps, read = Read, holds = Holds} = State) ->
    Beyond = fun({Time, _, _}) -> Time + ?RESERVED_US > Clock + 2 * State#state.apart_us end,
    Broken = [
        violation(set_right_without_cause, T, [Robot], #{clock => Clock})
     || not lists:any(Beyond, [Stamp || {_, Stamp} <- maps:keys(State#state.writes)])
    ],
    Kept = maps:filter(fun(_, Stamp) -> not Beyond(Stamp) end, maps:get(Robot, Holds, #{})),
    {Broken, State#state{
        stamps = maps:remove(Robot, Stamps),
        read = maps:remove(Robot, Read),
        holds = Holds#{Robot => Kept}
    }}.

wrote(Name, Hash, Stamp, T, Robot, #state{writes = Writes, stamps = Stamps} = State) ->
    Broken = stamp_back(Name, Stamp, T, Robot, Stamps) ++ not_owner(Name, T, Robot, State),
    Written = State#state{
        writes = maps:merge(#{{Name, Stamp} => Hash}, Writes), stamps = Stamps#{Robot => Stamp}
    },
    {Broken, postpone(T, Written, [Name])}.

written(#state{writes = Writes}) -> [Name || {Name, _} <- maps:keys(Writes)].

note(Robot, Name, Stamp, Notes) ->
    Notes#{Robot => (maps:get(Robot, Notes, #{}))#{Name => Stamp}}.

%% -- the clauses of the contract ------------------------------------------------------------

stamp_back(Name, Stamp, T, Robot, Stamps) ->
    %% an atom is less than every stamp
    Back = maps:get(Robot, Stamps, none) >= Stamp,
    [violation(stamp_goes_back, T, [Robot], #{name => Name, stamp => Stamp}) || Back] ++
        [
            violation(stamp_of_another, T, [Robot], #{name => Name})
         || starl_hlc:robot(Stamp) =/= Robot
        ].

not_owner(Name, T, Robot, #state{owners = Owners}) ->
    [
        violation(not_owner, T, [Robot], #{name => Name})
     || maps:get(Name, Owners, Robot) =/= Robot
    ].

unwritten(Name, Hash, Stamp, T, Robot, #state{writes = Writes}) ->
    case Writes of
        #{{Name, Stamp} := Hash} -> [];
        #{} -> [violation(never_written, T, [Robot], #{name => Name, stamp => Stamp})]
    end.

back(Name, Stamp, T, Robot, #state{read = Read}) ->
    case Read of
        #{Robot := #{Name := Last}} when Last > Stamp ->
            [violation(read_goes_back, T, [Robot], #{name => Name})];
        #{} ->
            []
    end.

postpone(_T, #state{bound_us = Bound, healed = Healed} = State, _Names) when
    Bound =:= infinity; Healed =:= never
->
    State#state{agreements = starl_obligations:new(exact)};
postpone(T, #state{bound_us = Bound, healed = Healed, agreements = Agreements} = State, Names) ->
    From = lists:max([T, Healed, State#state.admitted]),
    Owe = fun(Name, Owed) -> starl_obligations:owe(Name, team, From, Bound, Owed) end,
    State#state{agreements = lists:foldl(Owe, Agreements, Names)}.

%% The registers whose time is up.
agreed(T, #state{agreements = Agreements, assumption = Assumption, judged = Judged} = State) ->
    case starl_obligations:overdue(T, Assumption, Agreements) of
        none ->
            {[], State};
        {Up, Left} ->
            {Found, Excused} = lists:unzip([disagreement(Due, Name, State) || {Due, Name} <- Up]),
            {lists:append(Found), State#state{
                agreements = Left,
                judged = Judged + length(Up),
                excused = State#state.excused + lists:sum(Excused)
            }}
    end.

%% What is found, and how many robots are excused.
disagreement(T, Name, #state{robots = Robots, died = Died, holds = Holds} = State) ->
    Copies = [{R, maps:get(Name, maps:get(R, Holds, #{}), unset)} || R <- Robots -- Died],
    %% an atom is less than every stamp
    Latest = lists:max([unset | [Copy || {_, Copy} <- Copies]]),
    case [R || {R, Copy} <- Copies, Copy =/= Latest, not is_excused(T, R, Name, Latest, State)] of
        [_ | _] ->
            {[violation(no_agreement, T, [R || {R, _} <- Copies], #{name => Name})], 0};
        [] ->
            {[], length([R || {R, Copy} <- Copies, Copy =/= Latest])}
    end.

%% The robot's clock can be so far behind that it must not take the latest write.
is_excused(T, Robot, Name, Latest, #state{refused = Refused, robots = Robots} = State) ->
    #state{apart_us = Apart, clocks = #{offset_us := Offset, drift_ppm := Ppm}} = State,
    Differ = 2 * Offset + round(2 * Ppm * T / ?MILLION),
    Ever = starl_assumption:behind_us(Robot, Robots, T, State#state.assumption) + Differ,
    maps:get({Robot, Name}, Refused, none) =:= Latest andalso
        ((Ever > Apart andalso Ever =< 2 * Apart + Differ) orelse
            behind_now(Robot, T, State) + Differ > Apart).

%% How far a robot's clock is behind the others' now.
behind_now(Robot, T, #state{robots = Robots, assumption = Assumption}) ->
    Off = fun(Id) ->
        starl_assumption:gained_us(Id, 0, T, Assumption) -
            starl_assumption:lost_us(Id, 0, T, Assumption)
    end,
    lists:max([Off(Id) || Id <- Robots]) - Off(Robot).

violation(What, T, Robots, Details) ->
    starl_violation:new(registers, What, T, Robots, Details).
