%% @doc What a soak runs with a seed: besides the faults, which the simulator draws, the size of
%% the team, how long faults may last, leases and other figures of the block, and how well clocks
%% run. All of it stands in the scenario, and so in the command that runs it again.
%%
%% Leases and votes are at stake only where a fault outlasts them, contracts of small teams only in
%% small teams, a bound on the drift of clocks only near it.
-module(starl_lab_soak_draw).

-export([scenario/3]).

%% Faults are over by this time, s; then everything has to be done so soon.
-define(HEAL_S, 25).
-define(CONVERGE_S, 2000).
%% For path planning faults are over later, and as a rule it ends soon after, as it takes time to
%% paint; one run of so many goes on until all robots are done, which they have to be so soon.
-define(DPP_HEAL_S, 45).
-define(DPP_TIME_S, 60).
-define(DPP_CONVERGE_S, 1800).
-define(DPP_TO_THE_END, 20).
%% Nothing goes on for so long, s: a run ends when all is done.
-define(TIME_S, 7200).
-define(MOST_ROBOTS, 10).
%% Clocks may go wrong by a hundredth; faults that let one drift would add to that.
-define(NEARLY_PPM, 9999).
-define(STEADY, 0.3).
%% Path planning rests on positions that are right to within their stated error: noise, bias and
%% robots taken for each other are beyond it.
-define(DPP_BEARS, [location_dropout, location_frozen, actuation, serial, store]).

%% @doc The values of the runs of a block, but for the defaults. Painting stands for path planning:
%% it has to be safe at all times; how long a picture takes depends on what goes wrong.
-spec scenario(atom(), Robots :: pos_integer() | none, Seed :: non_neg_integer()) ->
    #{atom() => term()}.
scenario(dpp, Robots, Seed) ->
    Drawn = maps:merge(clocks(dpp, Seed), ending(Seed)),
    maps:merge(Drawn, #{
        app => starl_painting, robots => robots(Robots, dpp, Seed), seed => Seed,
        picture => "house", heal => ?DPP_HEAL_S, longest_fault => longest(?DPP_HEAL_S, dpp, Seed),
        chassis => one_of([differential, differential, holonomic, mixed], {Seed, dpp, chassis})
    });
scenario(Block, Robots, Seed) ->
    Drawn = maps:merge(clocks(Block, Seed), figures(Block, Seed)),
    maps:merge(Drawn, #{
        app => starl_exercise,
        block => Block,
        robots => robots(Robots, Block, Seed),
        seed => Seed,
        heal => ?HEAL_S,
        longest_fault => longest(?HEAL_S, Block, Seed),
        final => 2,
        converge => ?CONVERGE_S,
        time => ?TIME_S
    }).

ending(Seed) ->
    case starl_sim_draw:between({Seed, dpp, ending}, 1, ?DPP_TO_THE_END) of
        1 -> #{converge => ?DPP_CONVERGE_S, time => ?TIME_S};
        _ -> #{time => ?DPP_TIME_S}
    end.

robots(none, Block, Seed) -> starl_sim_draw:between({Seed, Block, robots}, 1, ?MOST_ROBOTS);
robots(Robots, _Block, _Seed) -> Robots.

%% As a rule a third of the time, now and then all of it.
longest(Heal, Block, Seed) -> one_of([Heal div 3, Heal div 3, Heal], {Seed, Block, longest}).

%% Clocks that nobody sets, near the bound of their drift; or good ones, which faults set.
clocks(dpp, Seed) ->
    case is_steady(dpp, Seed) of
        true ->
            %% nothing need be left for clocks that are set
            #{
                lease => starl_sim_draw:between({Seed, dpp, lease}, 5000, 8000),
                jump => 50,
                clock_drift => ?NEARLY_PPM,
                random_faults => [network, process | ?DPP_BEARS]
            };
        false ->
            #{
                lease => starl_sim_draw:between({Seed, dpp, lease}, 7000, 12000),
                random_faults => [network, clock, process | ?DPP_BEARS]
            }
    end;
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

is_steady(Block, Seed) -> starl_sim_draw:uniform({Seed, Block, steady}) < ?STEADY.

%% What the block draws for its exercise; the flags of a user's own go by `with'.
figures(Name, Seed) ->
    {ok, Block} = starl_blocks:find(Name),
    Draw = fun
        (Key, Values) when is_list(Values) -> one_of(Values, {Seed, Key});
        (Key, {Low, High}) -> starl_sim_draw:between({Seed, Key}, Low, High)
    end,
    Drawn = starl_block_exercise:draw(Block:exercise(), Draw),
    Known = [Key || {Key, _, _, _} <- starl_exercise:options()],
    case maps:without(Known, Drawn) of
        None when None =:= #{} -> Drawn;
        Own -> (maps:with(Known, Drawn))#{with => Own}
    end.

one_of(List, Key) -> lists:nth(starl_sim_draw:between(Key, 1, length(List)), List).
