%% @doc The monitor of progress: judges each call of `exercise' by the promise that the building
%% block makes for a time without faults. It judges every call that is made after the heal
%% (`healed_us') or still waits then; with `never', no calls. The block's exercise defines the
%% promise (`exercise', a {@link starl_block_exercise}). In most cases a call must have succeeded
%% within `within_us' after the latest of three times: the call, the heal, and the arrival of the
%% last robot that the call waits for.
%%
%% In a team with a core, a majority for which all faults end while others stay cut off, mute or slow for
%% ever (`rest'), the core is promised what it is promised when those others have died, and they are
%% promised nothing.
%%
%% A call whose patience ends earlier may fail. Independent of promises and faults, every call with
%% a patience ends within the patience plus `bound_us', counted from the call, and within the
%% patience plus `margin_us', counted from the heal. The first of these may be later by what the
%% clock, the pauses and the slowness of the calling robot explain in that time ({@link
%% starl_assumption:delayed_us/5}).
%%
%% Events of machine `app': {@link starl_block_exercise:event()}, `crashed'; of the machines that
%% the exercise watches; of machine `robot': `down', `{died, Reason}'.
-module(starl_exercise_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/1, vocabulary/0]).

-type us() :: integer().

-record(state, {
    exercise :: module(),
    robots :: [starl:robot_id()],
    healed :: us() | never,
    within :: us(),
    margin :: us(),
    bound :: us(),
    assumption :: starl_assumption:t(),
    reach :: us(),
    %% the part of the packets that is lost, where nothing is promised for it
    lossy :: number() | none,
    use :: starl_block_exercise:use() | none,
    open = #{} :: #{starl:robot_id() => starl_promise:call()},
    died = [] :: [starl:robot_id()],
    rest :: [starl:robot_id()],
    %% the memory of the exercise, and its update by an event
    seen :: term(),
    noted :: fun((starl_monitor:trace_event(), Seen :: term()) -> term()) | none,
    judged = 0 :: non_neg_integer()
}).

%% The most steps of a call at the robot that makes it: a machine's message waits for the last of its
%% transmissions, and is answered.
-define(STEPS, 20).
%% The time for a message, there and back, that all bounds of exercises allow for.
-define(ORDINARY_US, 100000).
%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
-define(CLAUSE, "calls end as the block promises").

%% @doc The fields are described above; the default of `healed_us' is `never'.
-spec init(#{
    exercise := module(),
    robots := [starl:robot_id()],
    healed_us => us() | never,
    rest => [starl:robot_id()],
    within_us := us(),
    margin_us := us(),
    bound_us := us(),
    broken => [starl_assumption:window()],
    reach_us => us(),
    lossy => number(),
    use => starl_block_exercise:use()
}) -> #state{}.
init(#{exercise := Exercise, robots := Robots} = Config) ->
    #{within_us := Within, margin_us := Margin, bound_us := Bound} = Config,
    #state{
        exercise = Exercise,
        robots = Robots,
        healed = maps:get(healed_us, Config, never),
        rest = maps:get(rest, Config, []),
        within = Within,
        margin = Margin,
        bound = Bound,
        reach = maps:get(reach_us, Config, 0),
        lossy = maps:get(lossy, Config, none),
        use = maps:get(use, Config, none),
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM),
        seen = starl_block_exercise:seen(Exercise, Robots),
        noted = starl_block_exercise:noted(Exercise)
    }.

%% @doc Enters the time of the heal and the windows of broken assumptions; the bound is longer on a
%% computer that has other work, too, and all bounds are longer on a radio that is slow or loses
%% packets: by the time for each message of the longest chain that a call waits for. All others are in
%% front, each for two tokens, say, which cost a request, a hand-over, a claim and an answer each. Where
%% SAP may give a message up for good, nothing is promised.
-spec context(starl_monitor:known(), map()) -> map().
context(#{slack_us := Slack} = Known, #{bound_us := Bound} = Config) ->
    Classes = classes(Config),
    Told = maps:merge(core(Classes, Known), Config#{bound_us := Bound + Slack}),
    case reach(Known, Config) of
        never -> Told#{healed_us => never, lossy => maps:get(loss, Known, 0)};
        Reach -> longer(Reach, Told)
    end.

classes(#{exercise := Exercise}) -> starl_block_exercise:hindered_by(Exercise);
classes(#{use := #{exercise := Exercise}}) -> starl_block_exercise:hindered_by(Exercise).

core(Classes, #{core := #{rest := Rest}} = Known) ->
    (maps:with([broken], Known))#{
        rest => Rest, healed_us => starl_monitor:core_healed_us(Classes, Known)
    };
core(Classes, Known) ->
    (maps:with([broken], Known))#{healed_us => starl_monitor:healed_us(Classes, Known)}.

%% A message has arrived, for its sender, when its acknowledgement has.
reach(#{sap := Sap, loss := Loss, delay_us := Delay}, #{use := #{exercise := Exercise} = Use}) ->
    Again =
        case starl_block_exercise:again_ms(Exercise, Use) of
            never -> never;
            Ms -> 1000 * Ms
        end,
    case lists:member(network, starl_block_exercise:hindered_by(Exercise)) of
        true -> starl_sap_schedule:reach_us(Sap, 1 - (1 - Loss) * (1 - Loss), 2 * Delay, Again);
        false -> 0
    end;
reach(_Known, _Config) ->
    0.

longer(
    Reach, #{robots := Robots, within_us := Within, margin_us := Margin, bound_us := Bound} = Config
) ->
    Longer = 8 * (length(Robots) + 1) * max(0, Reach - ?ORDINARY_US),
    Config#{
        reach_us => Reach,
        within_us := Within + Longer,
        margin_us := Margin + Longer,
        bound_us := Bound + Longer
    }.

%% @doc The heal is later than the window, which excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _} = Window, #state{healed = Healed, assumption = Assumption} = State) ->
    %% an atom, `never', is greater than every number
    State#state{
        healed = max(Healed, To), assumption = starl_assumption:broken(Window, Assumption)
    }.

%% @doc The applications, the end of robots, and the machines that the exercise watches.
-spec interests(#state{}) -> [atom()].
interests(#state{exercise = Exercise}) ->
    lists:usort([app, robot | starl_block_exercise:watches(Exercise)]).

%% @doc {@link starl_block_exercise:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{call, 2}, {answer, 1}]}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, app, {answer, Outcome}}, #state{open = Open} = State) ->
    case maps:take(Robot, Open) of
        {Call, Left} ->
            Judged = State#state.judged + length([x || promise(Call, State) =/= none]),
            Next = noted({T, Robot, app, {answered, Call, Outcome}}, State#state{
                open = Left, judged = Judged
            }),
            starl_violation:step(ended(T, Call, Outcome, State), Next);
        error ->
            {ok, State}
    end;
step(Event, State) ->
    {ok, noted(Event, happened(Event, State))}.

%% @doc Calls that should have ended break the contract, too. Results: `judged', the number of
%% judged calls with a promise.
-spec finish(us(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(End, #state{open = Open, judged = Judged} = State) ->
    Late = lists:append([overdue(End, Call, State) || {_, Call} <- lists:sort(maps:to_list(Open))]),
    Results = starl_unjudged:with(unjudged(End, State), #{judged => Judged}),
    starl_violation:finish(Late, Results).

unjudged(_End, #state{lossy = Loss}) when is_number(Loss) -> starl_unjudged:lossy(?CLAUSE, Loss);
unjudged(End, #state{healed = Healed}) -> starl_unjudged:unhealed(?CLAUSE, Healed, End).

noted(_Event, #state{noted = none} = State) -> State;
noted(Event, #state{noted = Noted, seen = Seen} = State) -> State#state{seen = Noted(Event, Seen)}.

happened({T, Robot, app, {call, What, Ms}}, #state{open = Open} = State) ->
    Call = #{what => What, robot => Robot, since_us => T, patience_ms => Ms},
    State#state{open = Open#{Robot => Call}};
happened({_, Robot, app, crashed}, State) ->
    dropped(Robot, State);
happened({_, Robot, robot, {died, _Reason}}, #state{died = Died} = State) ->
    dropped(Robot, State#state{died = [Robot | Died]});
happened(_Event, State) ->
    State.

dropped(Robot, #state{open = Open} = State) -> State#state{open = maps:remove(Robot, Open)}.

%% -- the judgement --------------------------------------------------------------------------

ended(T, #{since_us := Since, robot := Robot} = Call, Outcome, State) ->
    Healed = healed(Robot, State),
    case promise(Call, State) of
        none ->
            overdue(T, Call, State);
        {Due, Is} ->
            Kept = Is(Outcome),
            Settled = add(Healed, starl_sap_schedule:settled_us()),
            IsBound = Outcome =/= {error, timeout} andalso Since >= Settled,
            [
                violation(what(Kept), T, Call, #{outcome => Outcome})
             || T > Due orelse (IsBound andalso not Kept)
            ]
    end.

what(true) -> too_late;
what(false) -> not_as_promised.

%% The violation of a call that should have ended by this time and has not.
overdue(T, Call, State) ->
    Ends = ends(Call, State),
    case promise(Call, State) of
        {Due, _} when Due < T -> [violation(no_answer, Due, Call, #{})];
        _ when Ends < T -> [violation(no_answer, Ends, Call, #{})];
        _ -> []
    end.

%% The end by the drifting clock of the robot. An atom is greater than every number, so that without
%% a heal nothing is judged after it.
ends(#{patience_ms := none} = Call, State) ->
    starl_promise:due_us(Call, team(Call, State));
ends(#{patience_ms := Ms, since_us := Since, robot := Robot}, State) ->
    #state{margin = Margin, bound = Bound, assumption = Assumption} = State,
    Healed = healed(Robot, State),
    Due = Since + Ms * 1020 + Bound,
    min(
        starl_assumption:delayed_us(Robot, Since, Due, ?STEPS, Assumption),
        add(max(Since, Healed), Ms * 1020 + Margin)
    ).

add(never, _Us) -> never;
add(Time, Us) -> Time + Us.

promise(Call, #state{exercise = Exercise, seen = Seen} = State) ->
    starl_block_exercise:promise(Exercise, Call, team(Call, State), Seen).

healed(Robot, #state{rest = Rest, healed = Healed}) ->
    case lists:member(Robot, Rest) of
        true -> never;
        false -> Healed
    end.

team(#{robot := Robot}, #state{robots = Robots, died = Died, rest = Rest} = State) ->
    Whole = #{
        robots => Robots,
        died => lists:usort(Rest ++ Died),
        healed_us => healed(Robot, State),
        within_us => State#state.within
    },
    Team = maps:merge(Whole, maps:from_list([{rest, Rest} || Rest =/= []])),
    case State of
        #state{use = none} -> Team;
        #state{use = Use, reach = Reach} -> Team#{use => Use, reach_us => Reach}
    end.

violation(What, T, #{what := Of, since_us := Since, robot := Robot}, Details) ->
    starl_violation:new(calls, What, T, [Robot], Details#{call => Of, since_us => Since}).
