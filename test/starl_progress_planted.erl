%% Building blocks and applications whose progress is broken in one line: a robot does not take an event, or does not
%% do an action. `./starl planted --progress' runs each on radios that lose packets, and beside faults that do no harm.
%% A monitor has to find each, or the run has to say which clause it does not judge. `none' is the sound one.
-module(starl_progress_planted).
-behaviour(starl_scene).
-behaviour(starl_machine).

-export([bugs/0, cells/0, scenario/3, sound/1]).
-export([options/0, scene/1]).
-export([init/1, handle_event/5]).
-export([init/2, step/2]).

%% The time for which robots of the exercise stay when they are done (ms).
-define(STAYS_MS, 600000).

%% Its name, the subject, the monitors that judge its progress, the broken machine, and what is wrong.
bugs() ->
    [{Bug, Contracts, Doc} || {Bug, _, Contracts, _, _, Doc} <- table()].

table() ->
    [
        {sap_deaf, sap, [sap], sap, #{}, "robot 3 takes nothing from robot 2"},
        {geocast_keeps, geocast, [geocast], geocast, #{}, "gives its content to nobody"},
        {mutex_keeps, mutex, [mutex, exercise], mutex, #{}, "never grants a token"},
        {registers_deaf, registers, [registers], registers, #{}, "take no write of others"},
        {counter_deaf, counter, [counter], counter, #{}, "never hears the others"},
        {barrier_deaf, barrier, [barrier, exercise], barrier, #{}, "never lets robot 2 pass"},
        {election_no_ballots, election, [election, exercise], election, #{}, "ignores ballots"},
        {election_no_news, election, [election, exercise], election, one_link(),
            "ignores announcements, where a link is cut for a minute"},
        {bully_mute, bully, [election_bully, exercise], election, #{}, "never announces a leader"},
        {motion_stands, motion, [motion, exercise], motion, #{}, "robot 2 never moves"},
        {dpp_one, starl_painting, [dpp, painting], dpp_coordinator, #{}, "answers robot 1 only"},
        {dpp_nobody, starl_painting, [dpp, painting], dpp_coordinator, #{}, "answers nobody"},
        {painting_blind, starl_painting, [painting], {dpp_coordinator, "blind"}, #{},
            "never assigns every second line"},
        {search_nobody, starl_search, [dpp, search], dpp_coordinator, nowhere(),
            "path planning answers nobody"},
        {search_deaf, starl_search, [registers, search], registers, #{},
            "nobody hears of the ball"},
        {swarm_relays_nothing, starl_swarm, [swarm], geocast, short_radio(),
            "nobody gives a message of others"},
        {swarm_keeps, starl_swarm, [swarm, geocast], geocast, long(), "nobody gives any message"},
        {follow_mute, starl_follow, [follow, election_bully], election, long(),
            "never announces a leader"},
        {follow_nobody, starl_follow, [follow], election, long(), "nobody takes the lead"},
        {formation_deaf, starl_formation, [formation, barrier], barrier, #{},
            "robot 2 does not learn that all stand in their places"},
        {formation_undecided, starl_formation, [formation, registers], registers, #{},
            "nobody hears of the order that the leader has decided"},
        {crossing_closed, starl_crossing, [crossing, mutex], mutex,
            #{options => #{duration => 600}}, "nobody gets a section"},
        {convoy_stands, starl_convoy, [convoy, mutex], mutex, #{time => 600},
            "nobody gets a section"}
    ].

%% What a machine with the bug takes.
takes(sap_deaf, 3, packet, {starl, 1, data, {2, _, _, _, _, _, _}}) -> false;
takes(geocast_keeps, _, {timeout, {give, _}}, _) -> false;
takes(swarm_keeps, _, {timeout, {give, _}}, _) -> false;
takes(swarm_relays_nothing, Robot, {timeout, {give, {Of, _, _}}}, _) -> Robot =:= Of;
takes(mutex_keeps, _, cast, {message, _, mutex, {ask, claim, _, _, _}}) -> false;
takes(crossing_closed, Robot, Type, Content) -> takes(mutex_keeps, Robot, Type, Content);
takes(convoy_stands, Robot, Type, Content) -> takes(mutex_keeps, Robot, Type, Content);
takes(registers_deaf, _, cast, {message, _, registers, _}) -> false;
takes(search_deaf, _, cast, {message, _, registers, _}) -> false;
takes(formation_undecided, _, cast, {message, _, registers, _}) -> false;
takes(counter_deaf, _, cast, {message, _, counter, _}) -> false;
takes(barrier_deaf, 2, cast, {message, _, barrier, _}) -> false;
takes(formation_deaf, 2, cast, {message, _, barrier, _}) -> false;
takes(election_no_ballots, _, cast, {message, _, ballot, _}) -> false;
takes(election_no_news, _, cast, {message, _, leader, _}) -> false;
takes(dpp_one, _, cast, {message, Robot, dpp_request, _}) -> Robot =:= 1;
takes(dpp_nobody, _, cast, {message, _, dpp_request, _}) -> false;
takes(search_nobody, _, cast, {message, _, dpp_request, _}) -> false;
takes(_Bug, _Robot, _Type, _Content) -> true.

%% What it does.
does(bully_mute, _, {cast, sap, {_, bully_leader, _}}) -> false;
does(bully_mute, _, {cast, sap, {send, _, bully_leader, _}}) -> false;
does(follow_mute, Robot, Action) -> does(bully_mute, Robot, Action);
does(motion_stands, 2, {drive, _, _}) -> false;
%% who is elected never hears of it
does(follow_nobody, Robot, {reply, _, {ok, Robot}}) -> false;
does(_Bug, _Robot, _Action) -> true.

%% A link on which nothing gets through in the first minute.
one_link() -> #{faults => [{cut, 0, 60000, loss, {1, 2}, #{part => 1.0}}]}.

%% There is no ball: all lines have to be driven.
nowhere() -> #{options => #{ball => nowhere}}.

short_radio() -> #{range => 4500, robots => 8, options => #{duration => 300, every => 5}}.

%% Long enough for the bounds.
long() -> #{options => #{duration => 600}}.

%% -- the runs ---------------------------------------------------------------------------------

%% The radios and the faults that do no harm: what they change.
cells() ->
    [
        {"loss 0", #{}, none},
        {"loss 0.01", #{loss => 0.01}, none},
        {"loss 0.2", #{loss => 0.2}, none},
        {"loss 0.3", #{loss => 0.3}, none},
        {"1 ms slower", #{}, {delay, {3, 4}, #{extra_ms => 1}}},
        {"slow wheel", #{}, {wheel_slow, 4, #{wheel => left, factor => 0.9}}},
        {"1 % doubled", #{}, {duplicate, {3, 4}, #{part => 0.01}}}
    ].

%% The run of a bug in a cell.
scenario(Bug, {_, Changes, Lasting}, Seed) ->
    {Bug, Subject, _, _, Own, _} = lists:keyfind(Bug, 1, table()),
    #{time := Seconds, faults := Faults} =
        Scenario = maps:merge(maps:merge(run(Subject, Seed), Changes), Own),
    Scenario#{app => ?MODULE, bug => Bug, faults := lasting(Lasting, 1000 * Seconds) ++ Faults}.

lasting(none, _Ms) -> [];
lasting({Kind, Target, Params}, Ms) -> [{elsewhere, 0, Ms, Kind, Target, Params}].

run(Subject, Seed) ->
    Known = #{robots => 4, seed => Seed, faults => [], time => 1200, subject => Subject},
    case Subject of
        starl_painting -> Known#{options => #{picture => "house"}};
        starl_search -> Known#{options => #{}};
        _ -> own(Subject, Known)
    end.

own(Subject, Known) ->
    case starl_block_catalogue:find(Subject) of
        {ok, _} -> Known#{options => exercise(Subject), subject => starl_exercise, time => 7200};
        error -> Known#{options => #{}}
    end.

%% Nobody gives up waiting before a monitor can find that it waits in vain.
exercise(mutex) -> #{block => mutex, final => 2, patience => 2000000};
exercise(Block) -> #{block => Block, final => 2}.

sound(Scenario) -> Scenario#{bug => none}.

%% -- the application ------------------------------------------------------------------------

options() ->
    [
        {bug, {one_of, [none | [Bug || {Bug, _, _} <- bugs()]]}, none, "which bug"},
        {subject, {term, "an application", fun is_atom/1}, starl_exercise, "what it breaks"},
        {options, {term, "a map", fun is_map/1}, #{}, "the options of that application"}
    ].

scene(#{options := #{bug := Bug, subject := App, options := Given}} = Context) ->
    {ok, Options} = starl_options:check(Given, starl_app:options(App)),
    {ok, Scene} = starl_scene:make(App, Context#{options := Options}),
    {ok, broken(lists:keyfind(Bug, 1, table()), lingering(Scene))}.

%% The robots of the exercise stay when they are done, so that a run is longer than the bounds.
lingering(#{app := {sequential, starl_exercise, Use}} = Scene) ->
    Scene#{app := {sequential, ?MODULE, Use}};
lingering(Scene) ->
    Scene.

init(Robot, Use) -> starl_exercise:init(Robot, Use).

step(Robot, State) ->
    case starl_exercise:step(Robot, State) of
        {done, Result} ->
            ok = starl:sleep(Robot, ?STAYS_MS),
            {done, Result};
        Continued ->
            Continued
    end.

broken(false, Scene) ->
    Scene;
broken({Bug, _, _, sap, _, _}, #{sap := Sap} = Scene) ->
    Scene#{sap := Sap#{stalled => {Bug, starl_sap}}, sap_machine => ?MODULE};
broken({_, _, _, motion, _, _}, Scene) ->
    Scene#{motion_machine => ?MODULE};
broken({_, _, _, {Name, Mutant}, _, _}, #{blocks := Blocks} = Scene) ->
    {Name, _, Config} = lists:keyfind(Name, 1, Blocks),
    Machine = starl_mutant_planted:machine(Mutant),
    Scene#{blocks := lists:keyreplace(Name, 1, Blocks, {Name, Machine, Config})};
broken({Bug, _, _, Name, _, _}, #{blocks := Blocks} = Scene) ->
    {Name, Machine, Config} = lists:keyfind(Name, 1, Blocks),
    Broken = {Name, ?MODULE, Config#{stalled => {Bug, Machine}}},
    Scene#{blocks := lists:keyreplace(Name, 1, Blocks, Broken)}.

%% -- the machine ----------------------------------------------------------------------------

init(#{robot := Robot} = Config) ->
    {Bug, Machine} = maps:get(stalled, Config, {motion_stands, starl_motion}),
    {State, Data, Actions} = Machine:init(maps:remove(stalled, Config)),
    {State, {Bug, Machine, Robot, Data}, done(Bug, Robot, Actions)}.

handle_event(Type, Content, State, {Bug, Machine, Robot, Data}, Meta) ->
    case takes(Bug, Robot, Type, Content) of
        true ->
            wrapped(Bug, Machine, Robot, Machine:handle_event(Type, Content, State, Data, Meta));
        false ->
            keep_state_and_data
    end.

wrapped(Bug, Machine, Robot, {next_state, State, Data, Actions}) ->
    {next_state, State, {Bug, Machine, Robot, Data}, done(Bug, Robot, Actions)};
wrapped(Bug, Machine, Robot, {keep_state, Data, Actions}) ->
    {keep_state, {Bug, Machine, Robot, Data}, done(Bug, Robot, Actions)};
wrapped(Bug, _Machine, Robot, {keep_state_and_data, Actions}) ->
    {keep_state_and_data, done(Bug, Robot, Actions)};
wrapped(Bug, Machine, Robot, {next_state, State, Data}) ->
    {next_state, State, {Bug, Machine, Robot, Data}};
wrapped(Bug, Machine, Robot, {keep_state, Data}) ->
    {keep_state, {Bug, Machine, Robot, Data}};
wrapped(_Bug, _Machine, _Robot, Other) ->
    Other.

done(Bug, Robot, Actions) -> [Action || Action <- Actions, does(Bug, Robot, Action)].
