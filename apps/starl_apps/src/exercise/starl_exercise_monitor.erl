%% @doc Progress, call by call: what a building block promises of each call of `exercise' when
%% nothing goes wrong any more. Judged is every call that is made after that time (`healed_us'), or
%% still waits then (`never': none). The calls are those of
%% {@link starl_exercise_use}. So long (`within_us') after it was made, after the heal, and after
%% the last robot that it waits for has come, a call has ended as promised:
%% ```
%%   send, broadcast   acknowledged, unless a receiver has died; the first after the restart of
%%                     either SAP may find that out instead (`restarted')
%%   acquire           granted, unless the home of any token has died: others hold what they have
%%                     while they wait for that one
%%   release           not lost, if the hold began after the heal; likewise
%%   elect             ballots: a leader, when all take part and nobody has died
%%                     bully: a leader; the highest that lives, if nobody took part before the heal
%%   sync              passed, when all have reached the round and nobody has died
%%   learn             another robot's write has come, unless its machine has crashed since; where a
%%                     store of registers was damaged, `apart_us' later (starl_registers_monitor)
%%   put, get, geocast an answer
%% '''
%% A call whose patience ends before that may fail. Whatever is promised, and whatever goes wrong,
%% every call with a patience ends `bound_us' after it at the latest, `margin_us' after the heal.
%%
%% Events of machine `app': {@link starl_exercise_use:event()}, `crashed'; of the machines `barrier'
%% (`reached'), `election' and `registers' (`crashed', and `store_damaged' of `registers'), `sap'
%% (`started', `outcome'); of machine `robot': `died'.
-module(starl_exercise_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, vocabulary/0]).

-type robot_id() :: starl_monitor:robot_id().
-type us() :: integer().

-record(call, {what :: starl_exercise_use:call(), since :: us(), ms :: pos_integer() | none}).

-record(state, {
    block :: starl_exercise:block(),
    robots :: [robot_id()],
    healed :: us() | never,
    within :: us(),
    margin :: us(),
    bound :: us(),
    apart :: us(),
    open = #{} :: #{robot_id() => #call{}},
    died = [] :: [robot_id()],
    %% when a robot's SAP restarted last; when one knew last which incarnation another's is, and what
    %% it has found out of that in its present call
    restarted = #{} :: #{robot_id() => us()},
    contact = #{} :: #{{robot_id(), robot_id()} => us()},
    found = #{} :: #{robot_id() => #{{robot_id(), robot_id()} => us()}},
    %% since when a robot has the tokens that it has acquired last
    held = #{} :: #{robot_id() => us()},
    %% the homes of the tokens that anybody has asked for
    homes = #{} :: #{robot_id() => true},
    %% when each robot began to take part in an election and when anybody did first
    voters = #{} :: #{Election :: term() => #{robot_id() => us()}},
    first = #{} :: #{Election :: term() => us()},
    %% how far a robot has come at a barrier, and when
    reached = #{} :: #{Name :: term() => #{robot_id() => {pos_integer(), us()}}},
    %% when a register was written last
    written = #{} :: #{Name :: term() => {robot_id(), us()}},
    %% when all clocks admit the stamps of machines with damaged stores, at the latest
    admitted = 0 :: us(),
    judged = 0 :: non_neg_integer()
}).

%% An acknowledgement is under way for no longer: it may have been given before a restart.
-define(UNDER_WAY_US, 5000000).
%% Others may find out so much later that a robot has restarted.
-define(SETTLED_US, 5000000).

%% @doc See above.
-spec init(#{
    block := starl_exercise:block(),
    robots := [robot_id()],
    healed_us := us() | never,
    within_us := us(),
    margin_us := us(),
    bound_us := us(),
    apart_us => us()
}) -> #state{}.
init(#{block := Block, robots := Robots, healed_us := Healed} = Config) ->
    #{within_us := Within, margin_us := Margin, bound_us := Bound} = Config,
    #state{
        block = Block,
        robots = Robots,
        healed = Healed,
        within = Within,
        margin = Margin,
        bound = Bound,
        apart = maps:get(apart_us, Config, 0)
    }.

%% @doc The applications, the end of robots, and how far the blocks have come.
-spec interests() -> [atom()].
interests() -> [app, barrier, election, registers, robot, sap].

%% @doc {@link starl_exercise_use:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{call, 2}, {answer, 1}]}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, app, {answer, Outcome}}, #state{open = Open} = State) ->
    case maps:take(Robot, Open) of
        {Call, Left} ->
            Next = answered(T, Robot, Call, Outcome, State#state{open = Left}),
            told(ended(T, Robot, Call, Outcome, State), Next);
        error ->
            {ok, State}
    end;
step({T, Robot, Machine, Event}, State) ->
    {ok, noted(Machine, Event, T, Robot, State)}.

told([], State) -> {ok, State};
told([Violation], State) -> {violation, Violation, State}.

%% @doc Calls that should have ended break the contract, too. Results: how many calls that were
%% promised something were `judged'.
-spec finish(us(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(End, #state{open = Open, judged = Judged} = State) ->
    Late = lists:append([
        overdue(End, Robot, Call, State)
     || {Robot, Call} <- lists:sort(maps:to_list(Open))
    ]),
    case Late of
        [] -> {ok, #{judged => Judged}};
        [_ | _] -> {{violation, Late}, #{judged => Judged}}
    end.

%% -- what is known --------------------------------------------------------------------------

noted(app, {call, What, Ms}, T, Robot, #state{open = Open} = State) ->
    Call = #call{what = What, since = T, ms = Ms},
    begun(What, T, Robot, State#state{open = Open#{Robot => Call}});
noted(app, crashed, _T, Robot, State) ->
    votes_for_nobody(Robot, dropped(Robot, State));
noted(election, crashed, _T, Robot, State) ->
    votes_for_nobody(Robot, State);
noted(registers, crashed, _T, Robot, #state{written = Written} = State) ->
    State#state{written = maps:filter(fun(_, {Writer, _}) -> Writer =/= Robot end, Written)};
noted(registers, store_damaged, T, _Robot, #state{apart = Apart} = State) ->
    State#state{admitted = T + Apart};
noted(sap, {started, N}, T, Robot, #state{restarted = Restarted} = State) when N > 1 ->
    State#state{restarted = Restarted#{Robot => T}};
noted(sap, {outcome, _Id, To, acknowledged}, T, Robot, #state{contact = Contact} = State) ->
    State#state{contact = Contact#{{Robot, To} => T}};
noted(sap, {outcome, _Id, To, restarted}, T, Robot, #state{found = Found} = State) ->
    New = maps:get(Robot, Found, #{}),
    State#state{found = Found#{Robot => New#{{Robot, To} => T}}};
noted(barrier, {reached, Name, K}, T, Robot, #state{reached = Reached} = State) ->
    Of = maps:get(Name, Reached, #{}),
    State#state{reached = Reached#{Name => Of#{Robot => {K, T}}}};
noted(robot, {died, _Reason}, _T, Robot, #state{died = Died} = State) ->
    dropped(Robot, State#state{died = [Robot | Died]});
noted(_Machine, _Event, _T, _Robot, State) ->
    State.

dropped(Robot, #state{open = Open} = State) -> State#state{open = maps:remove(Robot, Open)}.

begun({elect, Election}, T, Robot, #state{voters = Voters, first = First} = State) ->
    Of = maps:get(Election, Voters, #{}),
    State#state{
        voters = Voters#{Election => maps:merge(#{Robot => T}, Of)},
        first = maps:merge(#{Election => T}, First)
    };
begun({acquire, Tokens}, _T, _Robot, #state{homes = Homes, robots = Robots} = State) ->
    New = [starl_mutex:home(Token, Robots) || Token <- lists:flatten([Tokens])],
    State#state{homes = maps:merge(Homes, maps:from_keys(New, true))};
begun(_What, _T, _Robot, State) ->
    State.

votes_for_nobody(Robot, #state{voters = Voters} = State) ->
    State#state{voters = maps:map(fun(_, Of) -> maps:remove(Robot, Of) end, Voters)}.

answered(T, Robot, Call, Outcome, #state{contact = Contact, found = Found} = State) ->
    noted_answer(Call, Outcome, T, Robot, State#state{
        contact = maps:merge(Contact, maps:get(Robot, Found, #{})),
        found = maps:remove(Robot, Found),
        judged = State#state.judged + length([x || promise(Robot, Call, State) =/= none])
    }).

noted_answer(#call{what = {acquire, _}}, {ok, _}, T, Robot, #state{held = Held} = State) ->
    State#state{held = Held#{Robot => T}};
noted_answer(#call{what = {put, Name}}, ok, T, Robot, #state{written = Written} = State) ->
    State#state{written = Written#{Name => {Robot, T}}};
noted_answer(#call{what = {elect, Election}}, {error, _}, _T, Robot, State) ->
    #state{voters = #{Election := Of} = Voters} = State,
    State#state{voters = Voters#{Election := maps:remove(Robot, Of)}};
noted_answer(_Call, _Outcome, _T, _Robot, State) ->
    State.

%% Has one of the two restarted, and they have not met since?
is_news(Robot, To, #state{restarted = Restarted, contact = Contact}) ->
    Latest = lists:max([maps:get(R, Restarted, -1) || R <- [Robot, To]]),
    Latest >= 0 andalso Latest > maps:get({Robot, To}, Contact, 0) - ?UNDER_WAY_US.

%% -- the judgement --------------------------------------------------------------------------

ended(T, Robot, #call{since = Since} = Call, Outcome, #state{healed = Healed} = State) ->
    case promise(Robot, Call, State) of
        none ->
            overdue(T, Robot, Call, State);
        {Due, Expected} ->
            Kept = keeps(Expected, Outcome) orelse finds_out(Call, Outcome, Robot, State),
            IsBound = Outcome =/= {error, timeout} andalso Since >= add(Healed, ?SETTLED_US),
            [
                violation(what(Kept), T, Robot, Call, #{outcome => Outcome})
             || T > Due orelse (IsBound andalso not Kept)
            ]
    end.

finds_out(#call{what = {send, To}}, {error, restarted}, Robot, State) ->
    is_news(Robot, To, State);
finds_out(#call{what = broadcast}, {error, {lost, Lost}}, Robot, State) ->
    lists:all(fun(To) -> is_news(Robot, To, State) end, Lost);
finds_out(_Call, _Outcome, _Robot, _State) ->
    false.

what(true) -> too_late;
what(false) -> not_as_promised.

%% A call that has not ended by this time, and should have.
overdue(T, Robot, Call, State) ->
    Ends = ends(Call, State),
    case promise(Robot, Call, State) of
        {Due, _} when Due < T -> [violation(no_answer, Due, Robot, Call, #{})];
        _ when Ends < T -> [violation(no_answer, Ends, Robot, Call, #{})];
        _ -> []
    end.

%% By the clock of a robot that drifts. An atom is more than every number: what is judged after the
%% heal never is where nothing heals.
ends(#call{ms = none} = Call, #state{within = Within} = State) ->
    add(from(Call, State), Within);
ends(#call{ms = Ms, since = Since} = Call, #state{margin = Margin, bound = Bound} = State) ->
    min(Since + Ms * 1020 + Bound, add(from(Call, State), Ms * 1020 + Margin)).

from(#call{since = Since}, #state{healed = Healed}) -> max(Since, Healed).

add(never, _Us) -> never;
add(Time, Us) -> Time + Us.

keeps(ok, Outcome) -> Outcome =:= ok;
keeps(some, {ok, _}) -> true;
keeps(some, _Error) -> false;
keeps({leader, Leader}, Outcome) -> Outcome =:= {ok, Leader};
keeps(answer, Outcome) -> Outcome =/= {error, restarted} andalso Outcome =/= {error, timeout}.

%% What is promised of a call, and by when.
promise(_Robot, #call{what = {send, To}} = Call, #state{died = Died} = State) ->
    unless(lists:member(To, Died), soon(Call, State), ok);
promise(_Robot, #call{what = broadcast} = Call, #state{died = Died} = State) ->
    unless(Died =/= [], soon(Call, State), ok);
promise(_Robot, #call{what = {acquire, _}} = Call, State) ->
    unless(is_homeless(State), soon(Call, State), some);
promise(Robot, #call{what = {release, _}} = Call, #state{healed = Healed} = State) ->
    Held = maps:get(Robot, State#state.held, 0),
    unless(is_homeless(State) orelse Held < Healed, soon(Call, State), ok);
promise(_Robot, #call{what = {elect, E}} = Call, #state{block = bully} = State) ->
    {soon(Call, State), leader(E, State)};
promise(_Robot, #call{what = {elect, {final, _} = E}} = Call, #state{voters = Voters} = State) ->
    Times = maps:values(maps:get(E, Voters, #{})),
    when_all(Times, Call, some, State);
promise(Robot, #call{what = {sync, Name}} = Call, #state{reached = Reached} = State) ->
    Of = maps:get(Name, Reached, #{}),
    {Round, _} = maps:get(Robot, Of, {0, 0}),
    when_all([T || {K, T} <- maps:values(Of), Round > 0, K >= Round], Call, ok, State);
promise(_Robot, #call{what = {learn, Name}} = Call, #state{written = Written} = State) ->
    case Written of
        #{Name := {_, T}} ->
            #state{within = Within, admitted = Admitted} = State,
            {max(max(T, Admitted) + Within, soon(Call, State)), ok};
        #{} -> none
    end;
promise(_Robot, #call{what = {What, _}} = Call, State) when
    What =:= put; What =:= get; What =:= geocast
->
    {soon(Call, State), answer};
promise(_Robot, _Call, _State) ->
    none.

unless(true, _Due, _Expected) -> none;
unless(false, Due, Expected) -> {Due, Expected}.

soon(Call, #state{within = Within} = State) -> add(from(Call, State), Within).

%% All robots have come, at these times.
when_all(Times, Call, Expected, #state{robots = Robots, died = Died, within = Within} = State) ->
    case length(Times) =:= length(Robots) andalso Died =:= [] of
        true -> {max(lists:max(Times) + Within, soon(Call, State)), Expected};
        false -> none
    end.

leader(Election, #state{first = First, healed = Healed, robots = Robots, died = Died}) ->
    case First of
        #{Election := T} when T >= Healed + ?SETTLED_US -> {leader, lists:max(Robots -- Died)};
        #{} -> some
    end.

is_homeless(#state{homes = Homes, died = Died}) ->
    lists:any(fun(Robot) -> is_map_key(Robot, Homes) end, Died).

violation(What, T, Robot, #call{what = Of, since = Since}, Details) ->
    #{
        contract => calls,
        what => What,
        at_us => T,
        robots => [Robot],
        details => Details#{call => Of, since_us => Since}
    }.
