%% Painting with a bug planted in the participants of path planning, to show that the monitors find
%% it. `overstaying': they drive on when their lease has ended. `fickle': they vote for whoever
%% asks, whatever they have promised, and tell no coordinator of another's term. `one_clock': a
%% coordinator counts votes as if only one clock could be set. `farsighted': it plans three horizons ahead.
%% `deaf_pen' is the actuator's. Other bugs
%% are the coordinator's, in modules of their own.
-module(starl_dpp_planted).
-behaviour(starl_scene).
-behaviour(starl_machine).

-export([options/0, scene/1, report/2]).
-export([init/1, handle_event/5]).

options() ->
    [
        {bug, string, "none", "which bug"},
        {judge, {term, "a map", fun is_map/1}, #{}, "what the monitor of painting asks besides"},
        {sap, {term, "a map", fun is_map/1}, #{}, "the configuration of SAP"}
        | starl_painting:options()
    ].

scene(#{options := Options} = Context) ->
    #{bug := Bug, judge := Judge, sap := Sap} = Options,
    Known = Context#{options => maps:without([bug, judge, sap], Options)},
    {ok, #{blocks := Blocks, monitors := Monitors} = Scene} = starl_painting:scene(Known),
    {ok, {Machines, Contracts}} = starl_block:expand(Blocks, Known),
    {ok, Scene#{
        sap => Sap,
        blocks => [planted(Bug, Machine) || Machine <- Machines],
        monitors => Contracts ++ [judged(Judge, Monitor) || Monitor <- Monitors]
    }}.

judged(Judge, {starl_painting_monitor, Config}) ->
    {starl_painting_monitor, maps:merge(Config, Judge)};
judged(_Judge, Monitor) ->
    Monitor.

planted("deaf_pen", {actuator, _, Config}) ->
    {actuator, starl_actuator_planted, Config};
planted("deaf_pen", Block) ->
    Block;
planted("one_clock", {dpp_coordinator, Module, #{lease_ms := Ms, jump_ms := Jump} = Config}) ->
    {dpp_coordinator, Module, Config#{lease_ms := Ms + Jump}};
planted("one_clock", Block) ->
    Block;
planted("farsighted", {dpp_coordinator, Module, #{horizon := Mm} = Config}) ->
    {dpp_coordinator, Module, Config#{horizon := 3 * Mm}};
planted("farsighted", Block) ->
    Block;
planted(Bug, {dpp, starl_dpp_participant, Config}) ->
    {dpp, ?MODULE, Config#{bug => Bug}};
planted(Bug, {dpp_coordinator, _, Config}) when
    Bug =:= "late_clear"; Bug =:= "freed"; Bug =:= "untimely"; Bug =:= "idle"
->
    {dpp_coordinator, starl_coordinator_planted, Config#{bug => Bug}};
planted(Bug, {dpp_coordinator, _, Config}) when
    Bug =/= "none", Bug =/= "overstaying", Bug =/= "fickle"
->
    {dpp_coordinator, starl_mutant_planted:machine(Bug), Config};
planted(_Bug, Block) ->
    Block.

report(Scene, Outcome) -> starl_painting:report(Scene, Outcome).

%% -- the participant ------------------------------------------------------------------------

init(#{bug := Bug} = Config) ->
    {State, Data, Actions} = starl_dpp_participant:init(maps:remove(bug, Config)),
    {State, {Bug, Data}, Actions}.

%% Who votes for whoever asks also says that it would.
handle_event(cast, {message, From, dpp_prevote, _}, _State, {"fickle", _Data}, _Meta) ->
    {keep_state_and_data, [starl_sap:post(From, dpp_prevoted, {0, 0, 0})]};
handle_event(Type, Content, State, {Bug, Data}, Meta) ->
    Heard = hears(Bug, Type, Content),
    Then = forgets(Bug, Type, Content, Meta),
    says(Bug, starl_dpp_participant:handle_event(Type, Heard, State, Data, Then)).

%% At the end of its lease, and when it is sent on its way, it takes the time for a minute earlier.
forgets("overstaying", {timeout, leave}, _, Meta) -> earlier(Meta);
forgets("overstaying", {call, _}, {drive, _, _}, Meta) -> earlier(Meta);
forgets(_Bug, _Type, _Content, Meta) -> Meta.

earlier(#{now := Now} = Meta) -> Meta#{now => Now - 60000000}.

hears("fickle", cast, {message, From, dpp_recover, {Term, Seq, _}}) ->
    {message, From, dpp_recover, {Term, Seq, true}};
hears(_Bug, _Type, Content) ->
    Content.

says(Bug, {next_state, State, Data, Actions}) ->
    {next_state, State, {Bug, Data}, votes(Bug, Actions)};
says(Bug, {keep_state, Data, Actions}) ->
    {keep_state, {Bug, Data}, votes(Bug, Actions)};
says(Bug, {keep_state, Data}) ->
    {keep_state, {Bug, Data}};
says(_Bug, Nothing) ->
    Nothing.

votes("fickle", Actions) -> [vote(Action) || Action <- Actions, not refuses(Action)];
votes(_Bug, Actions) -> Actions.

refuses({cast, sap, {send, _, dpp_refused, _}}) -> true;
refuses(_Action) -> false.

vote({cast, sap, {send, To, dpp_here, {Term, {Seq, Stamp, _}}}}) ->
    {cast, sap, {send, To, dpp_here, {Term, {Seq, Stamp, true}}}};
vote({cast, sap, {send, To, dpp_state, {Term, Id, Place, Painted, {Seq, Stamp, _}}}}) ->
    {cast, sap, {send, To, dpp_state, {Term, Id, Place, Painted, {Seq, Stamp, true}}}};
vote(Action) ->
    Action.
