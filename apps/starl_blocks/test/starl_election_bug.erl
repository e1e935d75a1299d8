%% Broken elections, one per pitfall, around the sound machines. The key `bug' says which:
%% early: the bully makes itself leader before the higher robots can have answered;
%% fickle: the bully takes each leader that is announced, also after it has reported one;
%% incomplete: the ballots are counted when but one is missing;
%% deaf: ballots that come before the robot itself takes part are dropped;
%% ignores: what another robot announces is not taken, neither at once nor as the answer to a ballot;
%% patient: nobody gives up;
%% late: a ballot of an earlier election is counted in the one that is under way.
-module(starl_election_bug).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{bug := incomplete, participants := Team} = Config) ->
    %% everybody leaves out the next one of the ring
    Missing = starl_team:next(maps:get(robot, Config), Team),
    Fewer = starl_team:others(Missing, Team),
    begin_as(starl_election_ballots, incomplete, Config#{participants := Fewer});
init(#{bug := early} = Config) ->
    begin_as(starl_election_bully, early, Config#{answer_ms => 1});
init(#{bug := fickle} = Config) ->
    begin_as(starl_election_bully, fickle, Config);
init(#{bug := Bug} = Config) when Bug =:= ignores; Bug =:= patient ->
    begin_as(starl_election_ballots, Bug, Config);
init(#{bug := Bug} = Config) when Bug =:= deaf; Bug =:= late ->
    begin_as(starl_election_ballots, {Bug, none}, Config).

begin_as(Module, Bug, Config) ->
    {ready, Data, Actions} = Module:init(Config),
    {ready, {Module, Bug, Config, Data}, Actions}.

handle_event(cast, {message, _, bully_leader, {E, L, _}} = Message, ready, {M, fickle, C, D}, Meta) ->
    Takes = {trace, {elected, E, L, announcement}},
    case M:handle_event(cast, Message, ready, D, Meta) of
        {keep_state, Next, Actions} ->
            Elects = [x || {trace, {elected, _, _, _}} <- Actions] =/= [],
            {keep_state, {M, fickle, C, Next}, [Takes || not Elects] ++ Actions};
        {keep_state, Next} ->
            {keep_state, {M, fickle, C, Next}, [Takes]};
        keep_state_and_data ->
            {keep_state_and_data, [Takes]};
        {keep_state_and_data, Actions} ->
            {keep_state_and_data, [Takes | Actions]}
    end;
handle_event({timeout, {patience, _}}, _, ready, {_, patient, _, _}, _Meta) ->
    keep_state_and_data;
handle_event(cast, {message, _, leader, _}, ready, {_, ignores, _, _}, _Meta) ->
    keep_state_and_data;
handle_event({call, _} = Type, {elect, E, _} = Call, ready, {M, {Bug, _}, C, D}, Meta) ->
    forward(Type, Call, {M, {Bug, E}, C, D}, Meta);
handle_event(
    cast,
    {message, _, ballot, {E, _}} = Message,
    ready,
    {_, {deaf, Latest}, _, _} = Bug,
    Meta
) ->
    %% an atom, where it has not taken part in any, is less than a tuple
    case E > Latest of
        true -> keep_state_and_data;
        false -> forward(cast, Message, Bug, Meta)
    end;
handle_event(
    cast,
    {message, From, ballot, {E, Ballot}},
    ready,
    {_, {late, Latest}, _, _} = Bug,
    Meta
) ->
    Counted =
        case is_tuple(Latest) andalso E < Latest of
            true -> Latest;
            false -> E
        end,
    forward(cast, {message, From, ballot, {Counted, Ballot}}, Bug, Meta);
handle_event(Type, Content, ready, Bug, Meta) ->
    forward(Type, Content, Bug, Meta).

forward(Type, Content, {Module, Bug, Config, Data}, Meta) ->
    case Module:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {keep_state, {Module, Bug, Config, Next}, Actions};
        {keep_state, Next} -> {keep_state, {Module, Bug, Config, Next}};
        Other -> Other
    end.
