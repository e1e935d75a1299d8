%% @doc Draws the scenario of a soak run from a seed. It draws the size of the team, the longest
%% fault, the options of the block, and the quality of the clocks. The simulator draws the faults
%% themselves. All values stand in the scenario, and so in the command that repeats the run.
%%
%% The draws favour critical cases. A lease or a vote is tested only by a fault that outlasts it. A
%% contract of small teams is tested only in small teams, and a bound on clock drift only near the
%% bound.
-module(starl_lab_soak_draw).

-export([scenario/3, applications/0]).

%% The end of the faults, and the time after it in which the work must be done, s.
-define(HEAL_S, 25).
-define(CONVERGE_S, 2000).
%% For path planning the faults end later, and most runs end soon after them, because painting takes
%% time. One run of this number continues until all robots are done, within this time, s.
-define(DPP_HEAL_S, 45).
-define(DPP_TIME_S, 60).
-define(DPP_CONVERGE_S, 1800).
-define(DPP_TO_THE_END, 20).
%% That of an application, s.
-define(APP_TIME_S, 300).
%% An upper limit of the time, s; a run ends earlier, when all work is done.
-define(TIME_S, 7200).
-define(MOST_ROBOTS, 10).
%% The bound on the drift of clocks is 10,000 ppm. Faults that let a clock drift would add to it.
-define(NEARLY_PPM, 9999).
-define(STEADY, 0.3).
%% The part of the runs with a sound radio; else the parts of the packets that it loses and repeats,
%% and their delays, ms.
-define(SOUND, 0.5).
-define(LOSSES, [0.0, 0.01, 0.05, 0.1, 0.2, 0.4]).
-define(DUPLICATES, [0.0, 0.0, 0.2]).
-define(DELAYS, [{5, 20}, {5, 20}, {20, 200}, {1, 1000}]).
%% The part of the runs in which only a core of the team heals, of two robots or more; the earliest time from
%% which the others are cut off, ms; how slow they are, ms, and the names of these faults.
-define(QUIET, 0.2).
-define(EARLIEST_MS, 3000).
-define(LEAST_CORE, 2).
-define(LAG_MS, 200).
-define(SLOW, [slow_1, slow_2, slow_3, slow_4]).
%% The delays of drive commands, ms.
-define(LATENCIES, [{0, 0}, {0, 8}, {0, 20}, {10, 50}]).
%% The part of the runs of path planning on a floor with walls.
-define(WALLS, 0.25).
%% The part of its runs that paint short lines.
-define(SHORT_LINES, 0.25).
%% The faults of positions, bodies and stores that path planning tolerates. It assumes positions
%% within their stated error, and noise, bias and exchanged robots exceed that.
-define(DPP_BEARS, [location_dropout, location_frozen, actuation, serial, store]).

%% @doc The values of a run of a block that differ from the defaults. Painting stands for path
%% planning: it must be safe at all times, while the time for a picture depends on the faults.
-spec scenario(atom(), Robots :: pos_integer() | none, Seed :: non_neg_integer()) ->
    #{atom() => term()}.
scenario(dpp, Robots, Seed) ->
    Drawn = maps:merge(maps:merge(clocks(dpp, Seed), ending(Seed)), radio(dpp, Seed)),
    N = robots(Robots, dpp, Seed),
    on_a_floor(
        Seed,
        maps:merge(Drawn, #{
            app => starl_painting,
            robots => N,
            faults => quiet(N, {dpp, ?DPP_HEAL_S}, Seed),
            seed => Seed,
            picture => picture(Seed),
            choice => one_of(["ink", "ink", "nearest"], {Seed, dpp, choice}),
            heal => ?DPP_HEAL_S,
            longest_fault => longest(?DPP_HEAL_S, dpp, Seed),
            chassis => one_of([differential, differential, holonomic, mixed], {Seed, dpp, chassis})
        })
    );
scenario(Name, Robots, Seed) ->
    case starl_block_catalogue:find(Name) of
        {ok, _} -> block(Name, Robots, Seed);
        error -> application(Name, module(Name), Robots, Seed)
    end.

%% In some runs a picture of lines of 0.01 to 10 mm.
picture(Seed) ->
    case starl_run_draw:uniform({Seed, dpp, picture}) < ?SHORT_LINES of
        true -> lists:concat(["short_lines:", Seed]);
        false -> "house"
    end.

%% In some runs there are walls, doors that close, and boxes that are put down, so that ways are blocked.
on_a_floor(Seed, #{random_faults := Faults} = Scenario) ->
    case starl_run_draw:uniform({Seed, dpp, floor}) < ?WALLS of
        true ->
            Scenario#{floor => "two_rooms", random_faults := Faults ++ [floor]};
        false ->
            Scenario
    end.

%% Searching the code path for it, as `applications/0' does, takes too long for each run.
module(Name) ->
    Shipped = list_to_atom("starl_" ++ atom_to_list(Name)),
    case code:ensure_loaded(Shipped) of
        {module, Shipped} -> Shipped;
        {error, _} -> Name
    end.

%% @doc The applications that a soak knows beside: those that ship, but for the exercise of blocks, and
%% painting, which stands for path planning.
-spec applications() -> [{atom(), module()}].
applications() ->
    [
        {list_to_atom(Name), App}
     || {Name, App} <- starl_cli_target:apps(), App =/= starl_exercise, App =/= starl_painting
    ].

%% What has leases of path planning bears what path planning bears, and all faults of senses.
application(Name, App, Robots, Seed) ->
    Keys = [Key || {Key, _, _, _} <- starl_app:options(App)],
    {Heal, Faults} =
        case lists:member(jump, Keys) of
            true ->
                #{random_faults := Borne} = Drawn = clocks(dpp, Seed),
                {?DPP_HEAL_S, Drawn#{random_faults := Borne ++ [sense]}};
            false ->
                {?HEAL_S, clocks(Name, Seed)}
        end,
    N = robots(Robots, Name, Seed),
    (maps:merge(Faults, radio(Name, Seed)))#{
        app => App,
        robots => N,
        faults => quiet(N, {Name, Heal}, Seed),
        seed => Seed,
        heal => Heal,
        longest_fault => longest(Heal, Name, Seed),
        time => ?APP_TIME_S
    }.

block(Block, Robots, Seed) ->
    Figures = maps:merge(clocks(Block, Seed), figures(Block, Seed)),
    Drawn = maps:merge(maps:merge(Figures, radio(Block, Seed)), bodies(Block, Seed)),
    N = robots(Robots, Block, Seed),
    maps:merge(Drawn, #{
        app => starl_exercise,
        block => Block,
        robots => N,
        faults => quiet(N, {Block, ?HEAL_S}, Seed),
        seed => Seed,
        heal => ?HEAL_S,
        longest_fault => longest(?HEAL_S, Block, Seed),
        final => 2,
        converge => ?CONVERGE_S,
        time => ?TIME_S
    }).

%% In some runs a majority recovers; the rest stay deaf, mute or slow until the end, or one robot does not hear
%% one other. The seed draws which robot that is, whether it leads, and when it begins, before the other faults are over.
quiet(N, {Name, Heal}, Seed) when N >= ?LEAST_CORE + 1 ->
    Key = fun(Of) -> {Seed, Name, quiet, Of} end,
    case starl_run_draw:uniform(Key(share)) < ?QUIET of
        false ->
            [];
        true ->
            From = starl_run_draw:between(Key(from), ?EARLIEST_MS, 1000 * Heal),
            Kind = one_of([deaf, mute, slow, link], Key(kind)),
            [
                {Id, From, 1000 * ?TIME_S, What, Target, Params}
             || {Id, What, Target, Params} <- endless(Kind, N, Key)
            ]
    end;
quiet(_N, _Name, _Seed) ->
    [].

endless(deaf, N, Key) ->
    [{deaf, one_way_partition, lists:seq(1, N) -- rest(N, Key), #{}}];
endless(mute, N, Key) ->
    [{mute, one_way_partition, rest(N, Key), #{}}];
endless(slow, N, Key) ->
    Robots = rest(N, Key),
    Names = lists:sublist(?SLOW, length(Robots)),
    [{Name, slow, Robot, #{lag_ms => ?LAG_MS}} || {Name, Robot} <- lists:zip(Names, Robots)];
endless(link, N, Key) ->
    From = starl_run_draw:between(Key(first), 1, N),
    To = starl_run_draw:between(Key(to), 1, N - 1),
    [{link, loss, {From, 1 + (From + To - 1) rem N}, #{part => 1.0}}].

%% Fewer than half of the team.
rest(N, Key) ->
    First = starl_run_draw:between(Key(first), 1, N),
    Count = starl_run_draw:between(Key(count), 1, min(length(?SLOW), (N - 1) div 2)),
    lists:sort([1 + (First + I) rem N || I <- lists:seq(1, Count)]).

bodies(motion, Seed) ->
    #{
        chassis => one_of([differential, holonomic, mixed], {Seed, motion, chassis}),
        command_latency => one_of(?LATENCIES, {Seed, motion, latency}),
        controller => one_of(["straight", "straight", "wary"], {Seed, motion, controller})
    };
bodies(_Block, _Seed) ->
    #{}.

ending(Seed) ->
    case starl_run_draw:between({Seed, dpp, ending}, 1, ?DPP_TO_THE_END) of
        1 -> #{converge => ?DPP_CONVERGE_S, time => ?TIME_S};
        _ -> #{time => ?DPP_TIME_S}
    end.

robots(none, Block, Seed) -> starl_run_draw:between({Seed, Block, robots}, 1, ?MOST_ROBOTS);
robots(Robots, _Block, _Seed) -> Robots.

%% In most runs a third of the time, in some the whole time.
longest(Heal, Block, Seed) -> one_of([Heal div 3, Heal div 3, Heal], {Seed, Block, longest}).

%% In half of the runs the radio is sound without faults, so that all that was lost has a cause; in the
%% others it loses, repeats and delays packets all the time.
radio(Block, Seed) ->
    case starl_run_draw:uniform({Seed, Block, radio}) < ?SOUND of
        true ->
            #{};
        false ->
            #{
                loss => one_of(?LOSSES, {Seed, Block, loss}),
                duplicate => one_of(?DUPLICATES, {Seed, Block, duplicate}),
                delay => one_of(?DELAYS, {Seed, Block, delay})
            }
    end.

%% Either clocks near the bound of their drift, without faults that change their drift (path
%% planning: without any faults of clocks), or good clocks with all faults of clocks.
clocks(dpp, Seed) ->
    clocks_of_dpp(is_steady(dpp, Seed), Seed);
clocks(Block, Seed) ->
    case is_steady(Block, Seed) of
        true ->
            #{
                clock_drift => ?NEARLY_PPM,
                random_faults => [
                    network,
                    clock_offset,
                    clock_step,
                    clock_freeze,
                    process,
                    location,
                    actuation,
                    serial,
                    store
                ]
            };
        false ->
            #{random_faults => [all]}
    end.

clocks_of_dpp(true, Seed) ->
    %% clocks are not set here, so no margin is needed for that
    #{
        lease => starl_run_draw:between({Seed, dpp, lease}, 5000, 8000),
        jump => 50,
        clock_drift => ?NEARLY_PPM,
        random_faults => [network, process | ?DPP_BEARS]
    };
clocks_of_dpp(false, Seed) ->
    #{
        lease => starl_run_draw:between({Seed, dpp, lease}, 7000, 12000),
        command_latency => one_of(?LATENCIES, {Seed, dpp, latency}),
        random_faults => [network, clock, process | ?DPP_BEARS]
    }.

is_steady(Block, Seed) -> starl_run_draw:uniform({Seed, Block, steady}) < ?STEADY.

%% The values that the block draws for its exercise; those of a user's block are given in `with'.
figures(Name, Seed) ->
    {ok, Block} = starl_block_catalogue:find(Name),
    Draw = fun
        (Key, Values) when is_list(Values) -> one_of(Values, {Seed, Key});
        (Key, {Low, High}) -> starl_run_draw:between({Seed, Key}, Low, High)
    end,
    Drawn = starl_block_exercise:draw(Block:exercise(), Draw),
    Known = [Key || {Key, _, _, _} <- starl_app:options(starl_exercise)],
    case maps:without(Known, Drawn) of
        None when None =:= #{} -> Drawn;
        Own -> (maps:with(Known, Drawn))#{with => Own}
    end.

one_of(List, Key) -> lists:nth(starl_run_draw:between(Key, 1, length(List)), List).
