%% @doc Plays a simulation for a window, at a chosen speed, and lends hands to it.
%%
%% A fault by hand becomes a fault of the scenario, from the present time on. The run then begins
%% anew with this scenario and goes to the present time, unseen and as fast as it can: what happened
%% before is the same, by the contract of the simulator, and the monitors know the fault as they
%% would know it in a replay. So the scenario that is saved ends with the digest of this run. In
%% the same way the run goes back to an earlier time.
%% ```
%%             +------ run to a time, step ------+
%%             v                                 |
%%   plays <-> rests -- fault, heal, back --> begins anew --> plays or rests, as before
%% '''
-module(starl_view_player).

-export([play/1, stop/1]).

-export_type([config/0, played/0]).

%% `scenario' and `options' as of {@link starl_sim:start/2}. `speed': of virtual time, `max' as
%% fast as it can. `started' is called with each simulation, and gives a function that is called
%% when that simulation ends. `save' writes a scenario under a name. `until_us': the end of the
%% run. `linger': a run that is over waits for the last page to close. `recorded': the run is on
%% record, so it can neither go back nor be changed. `commands' are done at the beginning, as if a
%% page had sent them.
-type config() :: #{
    hub := pid(),
    scenario := starl_sim_scenario:t(),
    options => starl_sim:options(),
    speed => number() | max,
    until_us => non_neg_integer(),
    paused => boolean(),
    linger => boolean(),
    recorded => boolean(),
    commands => [#{binary() => term()}],
    started => fun((starl_sim:sim()) -> fun(() -> term())),
    save => fun(
        (Name :: binary(), starl_sim_scenario:t()) ->
            {ok, unicode:chardata()}
            | {error, unicode:chardata()}
    )
}.

%% The run at its end: not finished yet, so that its outcome can be asked for; its scenario has the
%% faults by hand. `hands': was anything done by hand?
-type played() :: #{
    sim := starl_sim:sim(),
    scenario := starl_sim_scenario:t(),
    ending := starl_sim_run:ending() | none,
    hands := boolean()
}.

-define(TICK_MS, 30).
-define(IDLE_MS, 500).
%% Behind by more than this, the run gives up the time that it has lost.
-define(LATE_MS, 250).
-define(FIRST_US, 20000).
-define(MOST_SPEED, 1000).

-record(player, {
    hub :: pid(),
    config :: config(),
    scenario :: starl_sim_scenario:t(),
    facts :: starl_observer:facts(),
    sim :: starl_sim:sim(),
    ended :: fun(() -> term()),
    window_us :: pos_integer(),
    until_us :: non_neg_integer(),
    speed :: number() | max,
    paused :: boolean(),
    %% runs as fast as it can to this time, and rests there
    goal = none :: non_neg_integer() | none,
    now = 0 :: non_neg_integer(),
    %% the events before this time have been told
    told = 0 :: non_neg_integer(),
    ending = none :: starl_sim_run:ending() | none,
    running = 0 :: non_neg_integer(),
    %% this wall time (ms) is this virtual time
    anchor = {0, 0} :: {integer(), non_neg_integer()},
    piece_us = ?FIRST_US :: pos_integer(),
    %% speed as measured, since an anchor of its own
    measured = {0, 0, 0.0} :: {integer(), non_neg_integer(), float()},
    hands = 0 :: non_neg_integer(),
    stop = false :: boolean()
}).

%% @doc Plays to the end. The calling process gets the pages' commands meanwhile.
-spec play(config()) -> {ok, played()} | {error, starl_sim:reason()}.
play(#{hub := Hub, scenario := Given} = Config) ->
    Options = maps:get(options, Config, #{}),
    case starl_sim:plan(Given, Options) of
        {ok, Planned} ->
            ok = starl_view_hub:lead(Hub, self()),
            Answer = begin_with(Planned, Config),
            ok = starl_view_hub:lead(Hub, none),
            Answer;
        {error, _} = Error ->
            Error
    end.

%% @doc Asks the process that plays to end the run, with its results so far.
-spec stop(pid()) -> ok.
stop(Player) ->
    Player ! {starl_view, none, #{<<"do">> => <<"stop">>}},
    ok.

begin_with({#{time := Seconds} = Scenario, _, #{window_us := Window}} = Planned, Config) ->
    #{hub := Hub} = Config,
    Watching = maps:get(watch, maps:get(options, Config, #{}), []),
    Facts = starl_sim_plan:facts(Planned, Watching),
    ok = head(Hub, Facts),
    case start(Scenario, 0, Config) of
        {ok, Sim, Ended} ->
            Now = now_ms(),
            _ = [self() ! {starl_view, none, Command} || Command <- maps:get(commands, Config, [])],
            ended(
                loop(#player{
                    hub = Hub,
                    config = Config,
                    scenario = Scenario,
                    facts = Facts,
                    sim = Sim,
                    ended = Ended,
                    window_us = Window,
                    until_us = maps:get(until_us, Config, round(Seconds * 1.0e6)),
                    speed = maps:get(speed, Config, 1),
                    paused = maps:get(paused, Config, false),
                    anchor = {Now, 0},
                    measured = {Now, 0, 0.0}
                })
            );
        {error, _} = Error ->
            Error
    end.

head(Hub, #{robots := Robots, machines := Machines} = Facts) ->
    Kinds = [
        [Kind, Shape, [[Key | range(Type)] || {Key, Type, _} <- Specs], list_to_binary(Doc)]
     || {Kind, _, Shape, Specs, Doc} <- starl_view_hand:kinds()
    ],
    Extra = #{kind => simulation, kinds => Kinds, machines => lists:sort(maps:keys(Machines))},
    starl_view_hub:head(Hub, {starl_view_head:rows(Facts, Extra), length(Robots)}).

range({one_of, Words}) -> [Words];
range({_, Low, High}) -> [Low, High].

start(Scenario, ToldUs, #{hub := Hub} = Config) ->
    Options = maps:get(options, Config, #{}),
    Observe = starl_observer:all([
        maps:get(observe, Options, none), starl_view_hub:observer(Hub, ToldUs)
    ]),
    case starl_sim:start(Scenario, Options#{observe => Observe, packets => true}) of
        {ok, Sim} ->
            Started = maps:get(started, Config, fun(_) -> fun() -> ok end end),
            {ok, Sim, Started(Sim)};
        {error, _} = Error ->
            Error
    end.

ended(#player{sim = Sim, ending = Ending, scenario = Scenario, ended = Ended, hands = Hands}) ->
    _ = Ended(),
    {ok, #{sim => Sim, scenario => Scenario, ending => Ending, hands => Hands > 0}}.

%% -- time -----------------------------------------------------------------------------------

loop(#player{stop = true} = Player) ->
    Player;
loop(#player{ending = none, now = Now, until_us = Until} = Player) when Now >= Until ->
    over(Player);
loop(#player{ending = none, paused = true, goal = none} = Player) ->
    wait(?IDLE_MS, tell(Player));
loop(#player{ending = none} = Player) ->
    Begun = now_ms(),
    Moved = tell(move(Player)),
    wait(pause_ms(Begun, Moved), Moved);
loop(Player) ->
    over(Player).

%% As fast as it can: only commands that are there already are handled.
pause_ms(_Begun, #player{goal = Goal}) when Goal =/= none -> 0;
pause_ms(_Begun, #player{speed = max}) -> 0;
pause_ms(Begun, _Player) -> max(0, Begun + ?TICK_MS - now_ms()).

wait(Ms, Player) ->
    receive
        {starl_view, Page, Command} -> loop(do(Command, Page, Player))
    after Ms -> loop(Player)
    end.

%% With a page open, the user may want to look at the end, go back, or save.
over(#player{hub = Hub} = Player) ->
    Pages = starl_view_hub:pages(Hub),
    case maps:get(linger, Player#player.config, false) of
        true when Pages > 0 ->
            lingered(tell(Player));
        _ ->
            tell(Player)
    end.

lingered(Player) ->
    receive
        {starl_view, Page, Command} -> loop(do(Command, Page, Player))
    after ?IDLE_MS -> loop(Player)
    end.

%% Runs a piece, up to the time that it is now.
move(#player{sim = Sim, now = From, piece_us = Piece} = Player) ->
    Begun = now_ms(),
    Target = min(target(Begun, Player), From + Piece),
    case Target > From of
        true ->
            Status = starl_sim:run(Sim, Target / 1.0e6),
            Fitted = fitted(Piece, Target - From, now_ms() - Begun),
            arrived(caught_up(moved(Status, Player#player{piece_us = Fitted})));
        false ->
            Player
    end.

target(_Wall, #player{goal = Goal, until_us = Until}) when Goal =/= none -> min(Goal, Until);
target(_Wall, #player{speed = max, until_us = Until}) ->
    Until;
target(Wall, #player{speed = Speed, anchor = {Then, At}, until_us = Until}) ->
    min(Until, At + round((Wall - Then) * 1000 * Speed)).

%% A piece should take no longer than a tick.
fitted(Piece, Ran, Ms) when Ran >= Piece ->
    max(1000, min(2 * Piece, Piece * ?TICK_MS div max(1, Ms)));
fitted(_Piece, Ran, Ms) when Ms > ?TICK_MS -> max(1000, Ran * ?TICK_MS div Ms);
fitted(Piece, _Ran, _Ms) ->
    Piece.

moved(#{now_us := Now, ending := Ending, running := Running}, Player) ->
    Player#player{now = Now, told = Now, ending = Ending, running = Running}.

caught_up(#player{goal = none, speed = Speed, anchor = {Then, At}, now = Now} = Player) when
    Speed =/= max
->
    Wall = now_ms(),
    case (Wall - Then) - (Now - At) / 1000 / Speed > ?LATE_MS of
        true -> Player#player{anchor = {Wall, Now}};
        false -> Player
    end;
caught_up(Player) ->
    Player.

arrived(#player{goal = Goal, now = Now} = Player) when Goal =/= none, Now >= Goal ->
    rest(Player);
arrived(Player) ->
    Player.

rest(Player) -> Player#player{paused = true, goal = none}.

anchored(#player{now = Now} = Player) -> Player#player{anchor = {now_ms(), Now}}.

tell(#player{hub = Hub, now = Now, ending = Ending} = Player) ->
    Measured = measured(Player),
    #player{speed = Speed, paused = Paused, running = Running, until_us = Until} = Player,
    ok = starl_view_hub:clock(Hub, #{
        now_us => Now,
        speed => Speed,
        real => element(3, Measured),
        paused => Paused andalso Player#player.goal =:= none,
        running => Running,
        ending => ending(Ending, Now >= Until),
        until => Until
    }),
    Player#player{measured = Measured}.

ending(none, true) -> time;
ending(none, false) -> null;
ending(Ending, _) -> Ending.

measured(#player{measured = {Then, At, _}, now = Now}) when Now < At -> {Then, Now, 0.0};
measured(#player{measured = {Then, At, Last}, now = Now}) ->
    case now_ms() - Then of
        Ms when Ms >= 500 -> {Then + Ms, Now, round((Now - At) / Ms / 10) / 100};
        _ -> {Then, At, Last}
    end.

now_ms() -> erlang:monotonic_time(millisecond).

%% -- commands -------------------------------------------------------------------------------

do(#{<<"do">> := <<"stop">>}, _Page, #player{sim = Sim, ending = none} = Player) ->
    ok = starl_sim:stop(Sim),
    Player#player{stop = true, ending = stopped};
do(#{<<"do">> := <<"stop">>}, _Page, Player) ->
    Player#player{stop = true};
do(#{<<"do">> := <<"pause">>}, _Page, Player) ->
    rest(Player);
do(#{<<"do">> := <<"go">>} = Command, Page, #player{speed = Before} = Player) ->
    case maps:get(<<"speed">>, Command, Before) of
        Speed when is_number(Speed), Speed > 0, Speed =< ?MOST_SPEED ->
            goes_on(Player#player{speed = Speed});
        Max when Max =:= max; Max =:= <<"max">> -> goes_on(Player#player{speed = max});
        _ ->
            refuse(Page, "a speed is a number from 0 to 1000, or max", Player)
    end;
do(#{<<"do">> := <<"speed">>, <<"speed">> := _} = Command, Page, #player{paused = Paused} = P) ->
    Going = do(Command#{<<"do">> := <<"go">>}, Page, P),
    Going#player{paused = Paused};
do(#{<<"do">> := <<"until">>, <<"at">> := At}, Page, Player) when
    is_number(At), At >= 0, At < 1.0e9
->
    until(round(At * 1.0e6), Page, Player);
do(#{<<"do">> := <<"step">>, <<"robot">> := Robot, <<"to">> := N}, Page, Player) when
    is_integer(Robot), is_integer(N), N > 0, Player#player.ending =:= none
->
    #player{sim = Sim} = Resting = rest(Player),
    stepped(starl_sim:run_until_event(Sim, Robot, N), Page, Resting);
do(#{<<"do">> := <<"step">>} = Command, Page, #player{ending = none} = Player) ->
    step(maps:get(<<"robot">>, Command, none), Page, rest(Player));
do(#{<<"do">> := Do}, Page, #player{config = #{recorded := true}} = Player) when
    Do =:= <<"fault">>; Do =:= <<"heal">>
->
    refuse(Page, "the run is being recorded: without --record it can be changed", Player);
do(#{<<"do">> := <<"fault">>} = Command, Page, Player) ->
    fault(Command, Page, Player);
do(#{<<"do">> := <<"heal">>, <<"id">> := Id}, Page, #player{scenario = Scenario} = Player) ->
    #{faults := Faults} = Scenario,
    case starl_view_hand:healed(Id, from_ms(Player), Faults) of
        {ok, Healed} -> anew(Scenario#{faults := Healed}, present(Player), Page, Player);
        {error, Why} -> refuse(Page, Why, Player)
    end;
do(#{<<"do">> := <<"save">>, <<"name">> := Name}, Page, Player) when is_binary(Name) ->
    save(Name, Page, Player);
do(#{<<"do">> := <<"look">>, <<"robot">> := Robot}, Page, Player) when is_integer(Robot) ->
    look(Robot, Page, Player);
do(_Command, Page, Player) ->
    refuse(Page, "this cannot be done here", Player).

refuse(Page, Why, Player) -> tell(Page, [<<"no">>, unicode:characters_to_binary(Why)], Player).

say(Page, What, Player) -> tell(Page, [<<"yes">>, unicode:characters_to_binary(What)], Player).

%% A command at the beginning has no page.
tell(none, _Row, Player) ->
    Player;
tell(Page, Row, Player) ->
    Page ! {tell, Row},
    Player.

goes_on(Player) -> anchored(Player#player{paused = false, goal = none}).

until(Us, _Page, #player{now = Now, ending = none} = Player) when Us >= Now ->
    Player#player{goal = Us, paused = true};
until(Us, Page, #player{now = Now, config = #{recorded := true}} = Player) when Us < Now ->
    refuse(Page, "the run is being recorded: without --record it can go back", Player);
until(Us, Page, #player{now = Now, scenario = Scenario, window_us = Window} = Player) when
    Us < Now
->
    Back = rest(Player),
    anew(Scenario, Us div Window * Window, Page, Back#player{told = 0});
until(_Us, Page, Player) ->
    refuse(Page, "the run is over", Player).

step(none, _Page, #player{now = Now, window_us = Window} = Player) ->
    Player#player{goal = Now + Window};
step(Robot, Page, #player{sim = Sim} = Player) when is_integer(Robot) ->
    case [N || {Id, #{events := N}} <- starl_sim:robots(Sim), Id =:= Robot] of
        [N] -> stepped(starl_sim:run_until_event(Sim, Robot, N + 1), Page, Player);
        [] -> refuse(Page, "there is no such robot", Player)
    end;
step(_, Page, Player) ->
    refuse(Page, "there is no such robot", Player).

%% The robot halts within a window, of which nothing has been told yet.
stepped({ok, #{now_us := Now, ending := Ending}}, _Page, #player{told = Told} = Player) ->
    Player#player{now = max(Now, Told), ending = Ending};
stepped({error, Missed}, Page, #player{sim = Sim} = Player) ->
    refuse(Page, starl_sim:format_error(Missed), moved(starl_sim:status(Sim), Player)).

save(Name, Page, #player{scenario = Scenario, config = Config} = Player) ->
    case Config of
        #{save := Save} ->
            case Save(Name, Scenario) of
                {ok, What} -> say(Page, What, Player);
                {error, Why} -> refuse(Page, Why, Player)
            end;
        #{} ->
            refuse(Page, "nothing can be saved here", Player)
    end.

look(Robot, Page, #player{sim = Sim, hub = Hub, now = Now} = Player) ->
    case starl_sim:inspect(Sim, Robot) of
        #{} = Machines ->
            {Robot, Summary} = lists:keyfind(Robot, 1, starl_sim:robots(Sim)),
            Timers = starl_sim:timers(Sim, Robot),
            Last = starl_view_hub:events(Hub, Robot),
            Seen = starl_view_words:robot(Summary, Machines, Timers, Last),
            tell(Page, [<<"look">>, Now, Robot, Seen], Player);
        _ ->
            refuse(Page, "there is no such robot", Player)
    end.

%% -- hands ----------------------------------------------------------------------------------

%% A fault begins with the next window at the earliest.
present(#player{now = Now, window_us = Window}) -> (Now + Window - 1) div Window * Window.

from_ms(Player) -> (present(Player) + 999) div 1000.

fault(_Command, Page, #player{ending = Ending} = Player) when Ending =/= none ->
    refuse(Page, "the run is over; go back in time first", Player);
fault(Command, Page, #player{hands = N, scenario = Scenario, until_us = Until} = Player) ->
    #{faults := Faults, robots := Robots} = Scenario,
    #player{facts = #{machines := Machines}} = Player,
    Where = #{
        from_ms => from_ms(Player),
        until_ms => Until div 1000,
        robots => Robots,
        machines => maps:keys(Machines),
        faults => Faults
    },
    case starl_view_hand:faults(Command, N + 1, Where) of
        {ok, New} ->
            Next = anew(Scenario#{faults := Faults ++ New}, present(Player), Page, Player),
            Next#player{hands = N + length(New)};
        {error, Why} ->
            refuse(Page, Why, Player)
    end.

%% Begins anew with a scenario and goes to a time. Events that were told before are not told again,
%% unless the run goes back: then all are.
anew(Scenario, To, Page, #player{told = Told, ended = Ended, sim = Sim} = Player) ->
    #player{hub = Hub, facts = Facts, config = Config} = Player,
    _ = Ended(),
    ok = starl_sim:close(Sim),
    ok = head(Hub, Facts#{scenario := Scenario}),
    ok = tell_faults(Told, Scenario, Player),
    case start(Scenario, Told, Config) of
        {ok, New, NewEnded} ->
            Begun = Player#player{
                sim = New,
                ended = NewEnded,
                scenario = Scenario,
                facts = Facts#{scenario := Scenario},
                now = 0,
                ending = none
            },
            anchored(run_to(To, Begun));
        {error, Reason} ->
            %% a checked fault in a checked scenario
            _ = refuse(Page, starl_sim:format_error(Reason), Player),
            exit({starl_view_player, Reason})
    end.

tell_faults(0, #{faults := Faults}, #player{hub = Hub}) ->
    ok = starl_view_hub:reset(Hub),
    told(0, Faults, Hub);
tell_faults(_, #{faults := Faults}, #player{hub = Hub, now = Now} = Player) ->
    #player{scenario = #{faults := Before}} = Player,
    told(Now, Faults -- Before, Hub).

told(Now, Faults, Hub) ->
    lists:foreach(fun(F) -> ok = starl_view_hub:put(Hub, starl_view_row:fault(Now, F)) end, Faults).

run_to(To, #player{now = Now, ending = none, sim = Sim, piece_us = Piece} = Player) when Now < To ->
    Begun = now_ms(),
    #{now_us := At} = Status = starl_sim:run(Sim, min(To, Now + Piece) / 1.0e6),
    Fitted = max(1000, min(4 * Piece, 4 * Piece * ?TICK_MS div max(1, now_ms() - Begun))),
    #player{told = Told} = Player,
    Next = moved(Status, Player#player{piece_us = Fitted}),
    _ = At > Told andalso starl_view_hub:flush(Player#player.hub),
    run_to(To, Next#player{told = max(Told, At)});
run_to(_To, Player) ->
    Player.
