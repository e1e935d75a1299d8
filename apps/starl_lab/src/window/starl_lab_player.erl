%% @doc Plays a simulation for a window at a chosen speed, and applies manual faults to it.
%%
%% A manual fault becomes a fault of the scenario, from the present time on. The run then restarts
%% with this scenario and goes to the present time, unseen and as fast as it can. What happened
%% before is the same, by the contract of the simulator, and the monitors know the fault as they
%% would in a replay. So the saved scenario ends with the digest of this run. In the same way the
%% run goes back to an earlier time.
%% ```
%%             +------ run to a time, step ------+
%%             v                                 |
%%   plays <-> rests -- fault, heal, back --> begins anew --> plays or rests, as before
%% '''
%% The simulation that is played is a {@link starl_lab_player_run}; a {@link starl_lab_player_pace}
%% controls its time.
-module(starl_lab_player).

-export([play/1, stop/1]).

-export_type([config/0, ran/0, played/0]).

%% Beside those of {@link starl_lab_player_run:config()}: `save' writes a scenario under a name. `over' is told of
%% the run at its end, and once more if it has been changed since and has come to an end again; its last
%% answer is part of what was played. `linger': a run that is over waits as long as somebody looks at it.
%% `commands' are done at the beginning, as if a page had sent them.
-type config() :: #{
    hub := pid(),
    scenario := starl_run_scenario:t(),
    options => starl_sim:options(),
    speed => starl_lab_player_pace:speed(),
    until_us => non_neg_integer(),
    paused => boolean(),
    linger => boolean(),
    over => fun((ran()) -> term()),
    recorded => boolean(),
    commands => [#{binary() => term()}],
    started => fun((starl_sim:sim()) -> fun(() -> term())),
    save => fun(
        (Name :: binary(), starl_run_scenario:t()) ->
            {ok, unicode:chardata()}
            | {error, unicode:chardata()}
    )
}.

%% The run at its end: not finished yet, so that its outcome can be asked for; its scenario has the
%% manual faults. `is_changed': has a user changed the faults? `again': has an end of it been told before?
-type ran() :: #{
    sim := starl_sim:sim(),
    scenario := starl_run_scenario:t(),
    ending := starl_sim_run:ending() | none,
    is_changed := boolean(),
    again := boolean()
}.

%% The same with the last answer of `over'.
-type played() :: #{
    sim := starl_sim:sim(),
    scenario := starl_run_scenario:t(),
    ending := starl_sim_run:ending() | none,
    is_changed := boolean(),
    again := boolean(),
    answer := term()
}.

-define(IDLE_MS, 500).

-record(player, {
    hub :: pid(),
    run :: starl_lab_player_run:t(),
    pace :: starl_lab_player_pace:t(),
    linger :: boolean(),
    save :: fun((binary(), starl_run_scenario:t()) -> {ok | error, unicode:chardata()}),
    over :: fun((ran()) -> term()),
    %% the scenario whose end has been told, with the answer
    told = none :: none | {starl_run_scenario:t(), Answer :: term()},
    %% the number of manual faults; has anything been changed, such as by healing?
    manual = 0 :: non_neg_integer(),
    changed = false :: boolean(),
    stop = false :: boolean()
}).

%% @doc Plays to the end. The calling process gets the pages' commands meanwhile.
-spec play(config()) -> {ok, played()} | {error, starl_sim:reason()}.
play(#{hub := Hub} = Config) ->
    ok = starl_view_hub:lead(Hub, self()),
    Answer = begin_with(Config),
    ok = starl_view_hub:lead(Hub, none),
    Answer.

%% @doc Asks the process that plays to end the run, with its results so far.
-spec stop(pid()) -> ok.
stop(Player) ->
    Player ! {starl_view, none, #{<<"do">> => <<"stop">>}},
    ok.

begin_with(#{hub := Hub} = Config) ->
    case starl_lab_player_run:start(Config) of
        {ok, Run} ->
            Speed = maps:get(speed, Config, 1),
            _ = [self() ! {starl_view, none, Command} || Command <- maps:get(commands, Config, [])],
            ended(
                loop(#player{
                    hub = Hub,
                    run = Run,
                    pace = starl_lab_player_pace:new(
                        Speed, maps:get(paused, Config, false), now_ms()
                    ),
                    linger = maps:get(linger, Config, false),
                    over = maps:get(over, Config, fun(_) -> none end),
                    save = maps:get(save, Config, fun(_, _) ->
                        {error, "nothing can be saved here"}
                    end)
                })
            );
        {error, _} = Error ->
            Error
    end.

ended(Player) ->
    #player{run = Run, told = {_, Answer}} = Told = told(Player),
    ok = starl_lab_player_run:release(Run),
    {ok, (ran(Told))#{answer => Answer}}.

%% The end of a run is told once, however often it is looked at again.
told(#player{run = Run, told = Told, over = Over} = Player) ->
    Scenario = starl_lab_player_run:scenario(Run),
    case Told of
        {Scenario, _} -> Player;
        _ -> Player#player{told = {Scenario, Over(ran(Player))}}
    end.

ran(#player{run = Run, changed = Changed, told = Told}) ->
    (starl_lab_player_run:result(Run))#{is_changed => Changed, again => Told =/= none}.

%% -- time -----------------------------------------------------------------------------------

loop(#player{stop = true} = Player) ->
    Player;
loop(#player{run = Run, pace = Pace} = Player) ->
    case {starl_lab_player_run:is_over(Run), starl_lab_player_pace:rests(Pace)} of
        {true, _} -> over(told(tell(Player#player{run = starl_lab_player_run:judge(Run)})));
        {false, true} -> wait(?IDLE_MS, tell(Player));
        {false, false} -> plays(now_ms(), Player)
    end.

%% As fast as it can: only commands that are there already are handled.
plays(Begun, Player) ->
    Moved = tell(move(Begun, Player)),
    wait(starl_lab_player_pace:wait_ms(Begun, now_ms(), Moved#player.pace), Moved).

wait(Ms, Player) ->
    receive
        {starl_view, Page, Command} -> loop(do(Command, Page, Player))
    after Ms -> loop(Player)
    end.

%% The user may want to look at the end, go back, or save.
over(#player{hub = Hub, linger = Linger} = Player) ->
    case Linger andalso starl_view_hub:is_attended(Hub) of
        true -> wait(?IDLE_MS, Player);
        false -> Player
    end.

%% Runs a piece, up to the time that it is now.
move(Begun, #player{run = Run, pace = Pace} = Player) ->
    From = starl_lab_player_run:now(Run),
    Until = starl_lab_player_run:until(Run),
    Target = starl_lab_player_pace:target(Begun, Until, Pace),
    case min(Target, From + starl_lab_player_pace:piece(Pace)) of
        To when To > From ->
            Moved = starl_lab_player_run:run(To, Run),
            Wall = now_ms(),
            Ran = starl_lab_player_pace:ran(To - From, Wall - Begun, Pace),
            Now = starl_lab_player_run:now(Moved),
            Player#player{run = Moved, pace = starl_lab_player_pace:arrived(Wall, Now, Ran)};
        _ ->
            Player
    end.

tell(#player{hub = Hub, run = Run, pace = Pace} = Player) ->
    Measured = starl_lab_player_pace:measured(now_ms(), starl_lab_player_run:now(Run), Pace),
    Clock = maps:merge(starl_lab_player_run:clock(Run), starl_lab_player_pace:clock(Measured)),
    ok = starl_view_hub:clock(Hub, Clock),
    Player#player{pace = Measured}.

now_ms() -> erlang:monotonic_time(millisecond).

%% -- commands -------------------------------------------------------------------------------

do(Command, From, #player{run = Run} = Player) ->
    Page = starl_view_hub:asker(From, Command),
    case starl_lab_player_request:read(Command) of
        {ok, Order} -> permitted(refused(Order, Run), Order, Page, Player);
        {error, Why} -> refuse(Page, Why, Player)
    end.

permitted(no, Order, Page, Player) -> order(Order, Page, Player);
permitted(Why, _Order, Page, Player) -> refuse(Page, Why, Player).

%% Why an order makes no sense at this time.
refused({Change, _}, Run) when Change =:= fault; Change =:= heal ->
    case {starl_lab_player_run:is_recorded(Run), Change =:= fault andalso has_ended(Run)} of
        {true, _} -> "the run is being recorded: without --record it can be changed";
        {false, true} -> "the run is over; go back in time first";
        {false, false} -> no
    end;
refused({until, Us, _GoesOn}, Run) ->
    case
        {Us < starl_lab_player_run:now(Run), starl_lab_player_run:is_recorded(Run), has_ended(Run)}
    of
        {true, true, _} -> "the run is being recorded: without --record it can go back";
        {false, _, true} -> "the run is over";
        _ -> no
    end;
refused(Order, Run) when element(1, Order) =:= step; element(1, Order) =:= step_to ->
    case has_ended(Run) of
        true -> "the run is over";
        false -> no
    end;
refused(_Order, _Run) ->
    no.

has_ended(Run) -> starl_lab_player_run:ending(Run) =/= none.

order(stop, _Page, #player{run = Run} = Player) ->
    Player#player{run = starl_lab_player_run:halt(Run), stop = true};
order(pause, _Page, Player) ->
    rest(Player);
order(go, _Page, #player{run = Run, pace = Pace} = Player) ->
    Player#player{pace = starl_lab_player_pace:go(now_ms(), starl_lab_player_run:now(Run), Pace)};
order({go, Speed}, Page, #player{pace = Pace} = Player) ->
    order(go, Page, Player#player{pace = starl_lab_player_pace:speed(Speed, Pace)});
order({speed, Speed}, _Page, #player{pace = Pace} = Player) ->
    anchored(Player#player{pace = starl_lab_player_pace:speed(Speed, Pace)});
order({until, Us, GoesOn}, Page, Player) ->
    until(Us, GoesOn, Page, Player);
order({step, Robot}, Page, Player) ->
    step(Robot, Page, Player);
order({step_to, Robot, N}, Page, Player) ->
    step_to(Robot, N, Page, Player);
order({fault, Command}, Page, Player) ->
    fault(Command, Page, Player);
order({heal, Id}, Page, Player) ->
    heal(Id, Page, Player);
order({save, Name}, Page, Player) ->
    save(Name, Page, Player);
order({look, Robot}, Page, Player) ->
    look(Robot, Page, Player).

until(Us, GoesOn, Page, #player{run = Run, pace = Pace} = Player) ->
    case Us < starl_lab_player_run:now(Run) of
        true when GoesOn ->
            order(go, Page, Player#player{run = starl_lab_player_run:back(Us, Run)});
        true ->
            anchored((rest(Player))#player{run = starl_lab_player_run:back(Us, Run)});
        false ->
            Player#player{pace = starl_lab_player_pace:goal(Us, GoesOn, Pace)}
    end.

step(none, _Page, #player{run = Run} = Player) ->
    goal(starl_lab_player_run:now(Run) + starl_lab_player_run:window(Run), Player);
step(Robot, Page, #player{run = Run} = Player) ->
    case starl_lab_player_run:events(Robot, Run) of
        {ok, N} -> step_to(Robot, N + 1, Page, Player);
        none -> refuse(Page, "there is no such robot", rest(Player))
    end.

step_to(Robot, N, Page, #player{run = Run} = Player) ->
    case starl_lab_player_run:step(Robot, N, Run) of
        {ok, Stepped} -> (rest(Player))#player{run = Stepped};
        {error, Why, Ran} -> refuse(Page, Why, (rest(Player))#player{run = Ran})
    end.

fault(Command, Page, #player{run = Run, manual = N} = Player) ->
    case starl_lab_window_fault:faults(Command, N + 1, starl_lab_player_run:place(Run)) of
        {ok, New} ->
            #{faults := Faults} = starl_lab_player_run:scenario(Run),
            changed(Faults ++ New, Player#player{manual = N + length(New)});
        {error, Why} ->
            refuse(Page, Why, Player)
    end.

heal(Id, Page, #player{run = Run} = Player) ->
    #{from_ms := Now, faults := Faults} = starl_lab_player_run:place(Run),
    case starl_lab_window_fault:healed(Id, Now, Faults) of
        {ok, Healed} -> changed(Healed, Player);
        {error, Why} -> refuse(Page, Why, Player)
    end.

save(Name, Page, #player{run = Run, save = Save} = Player) ->
    case Save(Name, starl_lab_player_run:scenario(Run)) of
        {ok, What} -> answer(Page, yes, What, Player);
        {error, Why} -> refuse(Page, Why, Player)
    end.

look(Robot, Page, #player{run = Run} = Player) ->
    case starl_lab_player_run:look(Robot, Run) of
        {ok, Seen} ->
            ok = starl_view_hub:tell(Page, [<<"look">>, starl_lab_player_run:now(Run), Robot, Seen]),
            Player;
        none ->
            refuse(Page, "there is no such robot", Player)
    end.

rest(#player{pace = Pace} = Player) -> Player#player{pace = starl_lab_player_pace:rest(Pace)}.

goal(Us, #player{pace = Pace} = Player) ->
    Player#player{pace = starl_lab_player_pace:goal(Us, Pace)}.

%% Making a run again takes time, which is not made up for.
anchored(#player{run = Run, pace = Pace} = Player) ->
    Player#player{
        pace = starl_lab_player_pace:anchored(now_ms(), starl_lab_player_run:now(Run), Pace)
    }.

changed(Faults, #player{run = Run} = Player) ->
    anchored(Player#player{run = starl_lab_player_run:changed(Faults, Run), changed = true}).

refuse(Page, Why, Player) -> answer(Page, no, Why, Player).

answer(Page, YesOrNo, Text, Player) ->
    ok = starl_view_hub:say(Page, YesOrNo, Text),
    Player.
