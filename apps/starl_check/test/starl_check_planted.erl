%% Machines with bugs that only the checker itself can miss, chosen by the key `variant':
%% `partial', a barrier that forgets its rounds in a crash, but at the last of the team only; `numbered',
%% the same at the robot whose number is 2; `calling', a counter that sends to robots 1 and 9;
%% `patient', an election that never answers and looks again and again whether it can; `weary', one
%% that does so after a crash; `counting', a patient one that counts how often it has looked;
%% `untimely', a coordinator of path planning that says what it says whenever it leaves.
-module(starl_check_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{variant := partial, robot := Self, participants := Team} = Config) ->
    Known =
        case lists:last(Team) of
            Self -> Config#{incarnation := 1, stored := none};
            _ -> Config
        end,
    {State, Data, Actions} = starl_barrier_rounds:init(Known),
    {State, {starl_barrier_rounds, Data}, Actions};
init(#{variant := numbered, robot := 2} = Config) ->
    {State, Data, Actions} = starl_barrier_rounds:init(Config#{incarnation := 1, stored := none}),
    {State, {starl_barrier_rounds, Data}, Actions};
init(#{variant := numbered} = Config) ->
    {State, Data, Actions} = starl_barrier_rounds:init(Config),
    {State, {starl_barrier_rounds, Data}, Actions};
init(#{variant := calling} = Config) ->
    {State, Data, Actions} = starl_counter_gossip:init(Config),
    Calls = [starl_sap:post(Robot, counter, {tallies, []}) || Robot <- [1, 9]],
    {State, {starl_counter_gossip, Data}, Actions ++ Calls};
init(#{variant := unread, incarnation := Life} = Config) ->
    Read = [{stored, {0, 0, 0}} || Life > 1] ++ [none],
    {State, Data, Actions} = starl_dpp_participant:init(Config#{stored := hd(Read)}),
    {State, {starl_dpp_participant, Data}, Actions};
init(#{variant := untimely} = Config) ->
    {State, Data, Actions} = starl_dpp_coordinator:init(maps:remove(variant, Config)),
    {State, {untimely, Data}, Actions};
init(#{variant := weary, incarnation := 1} = Config) ->
    {State, Data, Actions} = starl_election_ballots:init(Config),
    {State, {starl_election_ballots, Data}, Actions};
init(#{variant := weary} = Config) ->
    init(Config#{variant := patient});
init(#{variant := Variant}) ->
    {waiting, {Variant, 0}, []}.

handle_event({call, _From}, {elect, _, _}, waiting, {Variant, N}, _Meta) ->
    {keep_state, {Variant, N}, again()};
handle_event({timeout, again}, _, waiting, {counting, N}, _Meta) ->
    {keep_state, {counting, N + 1}, again()};
handle_event({timeout, again}, _, waiting, {patient, N}, _Meta) ->
    {keep_state, {patient, N}, again()};
handle_event(_, _, waiting, {patient, _}, _Meta) ->
    keep_state_and_data;
handle_event(_, _, waiting, {counting, _}, _Meta) ->
    keep_state_and_data;
handle_event(Type, Content, State, {untimely, Data}, Meta) ->
    case starl_dpp_coordinator:handle_event(Type, Content, State, Data, Meta) of
        {next_state, To, Next, Actions} ->
            {next_state, To, {untimely, Next}, starl_action:without_latest(Actions)};
        {keep_state, Next, Actions} ->
            {keep_state, {untimely, Next}, starl_action:without_latest(Actions)};
        Other ->
            Other
    end;
handle_event(Type, Content, State, {Module, Data}, Meta) ->
    case Module:handle_event(Type, Content, State, Data, Meta) of
        {next_state, To, Next, Actions} -> {next_state, To, {Module, Next}, Actions};
        {next_state, To, Next} -> {next_state, To, {Module, Next}};
        {keep_state, Next, Actions} -> {keep_state, {Module, Next}, Actions};
        {keep_state, Next} -> {keep_state, {Module, Next}};
        Other -> Other
    end.

again() -> [{{timeout, again}, 1000000, again}].
