%% @doc Leader election by the bully algorithm (Garcia-Molina, "Elections in a distributed
%% computing system", 1982): the highest robot that is alive wins.
%% ```
%%   robot                    each higher robot                          all others
%%     | challenge {E} ------------->|                                        |
%%     |<------------------ alive {E}|  challenges those above it in turn     |
%%     |                             |                                        |
%%     | nobody alive within answer_us: leader {E, self} -------------------->|  elect it,
%%     | somebody alive: waits for its announcement, challenges again later   |  unless elected
%% '''
%% A robot takes part from the first message of the election on, even before its application calls:
%% the highest robot alive can be elected without having asked. A robot keeps the leader that it has
%% elected, so it never reports two leaders for one term, as long as the election is among the last
%% 1024 that it took part in. (A term is an election within one life of the machine: a restarted
%% machine has forgotten, asks anew, and gets the others' leader.) A robot that has elected answers
%% a challenge with its leader.
%%
%% If no packet is lost and each takes at most half of `answer_us', only the highest robot alive
%% hears of none above itself, so all elect it. With loss, robots may elect different leaders: use
%% the ballots if agreement is needed under every fault.
%%
%% Call: `{elect, Election, TimeoutUs}', answer `{ok, Leader}' or `{error, timeout}'.
%% Trace: {@link event()}.
-module(starl_election_bully).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2]).

-export_type([config/0, event/0]).

%% The trace of an election.
-type event() ::
    %% the application has called
    {entered, starl_election:election()}
    %% itself, as no higher robot is alive; since another one announced it; elected before the call
    | {elected, starl_election:election(), Leader :: starl:robot_id(),
        highest | announcement | known}
    | {failed, starl_election:election(), timeout}.

%% `answer_ms': the wait for higher robots to answer that they are alive; with a little more than
%% twice the longest delay of a packet the guarantee holds, with time for a few retransmissions it
%% nearly always holds under loss, too. `rounds': the number of challenges by a robot whose
%% application does not wait (any more).
-type config() :: #{answer_ms => pos_integer(), rounds => pos_integer()}.

%% The number of elections that are remembered; beyond it the oldest for which no caller waits is
%% forgotten. A robot that rebooted may ask again for an old election: a robot that has forgotten it
%% holds it anew, and may report another leader.
-define(REMEMBERED, 1024).

-record(race, {
    leader = none :: starl:robot_id() | none,
    from = none :: starl_machine:from() | none,
    %% idle: not begun, or given up; asking: is a higher robot alive? hoping: one is
    phase = idle :: idle | asking | hoping,
    round = 0 :: non_neg_integer()
}).

-record(bully, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    higher :: [starl:robot_id()],
    answer_us :: pos_integer(),
    rounds :: pos_integer(),
    races = #{} :: #{starl_election:election() => #race{}},
    %% the elections, latest first
    order = [] :: [starl_election:election()]
}).

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) -> {ready, #bully{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team} = Config) ->
    Bully = #bully{
        self = Self,
        team = Team,
        higher = [Robot || Robot <- starl_team:members(Team), Robot > Self],
        answer_us = maps:get(answer_ms, Config, 500) * 1000,
        rounds = maps:get(rounds, Config, 4)
    },
    {ready, Bully, listen()}.

-spec handle_event(starl_machine:event_type(), term(), ready, #bully{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event({call, From}, {elect, Election, Us}, ready, Bully, _Meta) ->
    enter(Election, Us, From, Bully);
handle_event(cast, {message, Source, bully_challenge, Election}, ready, Bully, _Meta) ->
    challenged(Election, Source, Bully);
handle_event(cast, {message, _Source, bully_alive, Election}, ready, Bully, _Meta) ->
    hope(Election, Bully);
handle_event(cast, {message, _, bully_leader, {Election, Leader}}, ready, Bully, _Meta) ->
    announced(Election, Leader, Bully);
handle_event({timeout, {round, Election}}, _, ready, Bully, _Meta) ->
    round_over(Election, Bully);
handle_event({timeout, {patience, Election}}, _, ready, Bully, _Meta) ->
    give_up(Election, Bully);
handle_event(info, {restarted, sap}, ready, _Bully, _Meta) ->
    {keep_state_and_data, listen()};
handle_event(info, {restarted, _}, ready, _Bully, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(bully_leader, Body) -> starl_shape:is([any, count], Body);
accepts(Type, _Election) -> Type =:= bully_challenge orelse Type =:= bully_alive.

listen() ->
    [starl_sap:listen(T, election) || T <- [bully_challenge, bully_alive, bully_leader]].

%% -- taking part ----------------------------------------------------------------------------

enter(Election, Us, From, Bully0) ->
    {Race, Bully} = race(Election, Bully0),
    Entered = {trace, {entered, Election}},
    case Race of
        #race{leader = none} ->
            Waiting = put_race(Election, Race#race{from = From, round = 0}, Bully),
            Patience = {{timeout, {patience, Election}}, Us, patience},
            prepend([Entered, Patience], challenge(Election, Waiting));
        #race{leader = Leader} ->
            Report = {trace, {elected, Election, Leader, known}},
            {keep_state, Bully, [Entered, Report, {reply, From, {ok, Leader}}]}
    end.

%% A lower robot asks: this one is alive, and takes part.
challenged(Election, Source, Bully0) ->
    {Race, Bully} = race(Election, Bully0),
    case Race of
        #race{leader = none} ->
            Answer = starl_sap:post(Source, bully_alive, Election),
            prepend([Answer], challenge(Election, Bully));
        #race{leader = Leader} ->
            {keep_state, Bully, [starl_sap:post(Source, bully_leader, {Election, Leader})]}
    end.

%% Asks all higher robots, unless it is asking already; the highest of the team has none to ask.
challenge(Election, #bully{higher = []} = Bully) ->
    win(Election, Bully);
challenge(Election, #bully{higher = Higher} = Bully) ->
    case maps:get(Election, Bully#bully.races) of
        #race{phase = idle, round = Round} = Race ->
            Asking = Race#race{phase = asking, round = Round + 1},
            {keep_state, put_race(Election, Asking, Bully), [
                {{timeout, {round, Election}}, Bully#bully.answer_us, over}
                | [starl_sap:post(Robot, bully_challenge, Election) || Robot <- Higher]
            ]};
        #race{} ->
            {keep_state, Bully, []}
    end.

%% A higher robot is alive. It needs one round, or one after the other above it gives up.
hope(Election, #bully{races = Races} = Bully) ->
    case Races of
        #{Election := #race{leader = none, phase = asking} = Race} ->
            Hoping = put_race(Election, Race#race{phase = hoping}, Bully),
            {keep_state, Hoping, [
                {{timeout, {round, Election}}, 3 * Bully#bully.answer_us, over}
            ]};
        #{} ->
            keep_state_and_data
    end.

round_over(Election, #bully{races = Races, rounds = Rounds} = Bully) ->
    case Races of
        #{Election := #race{leader = none, phase = asking}} ->
            win(Election, Bully);
        #{Election := #race{leader = none, from = From, round = Round} = Race} ->
            Idle = put_race(Election, Race#race{phase = idle}, Bully),
            case From =/= none orelse Round < Rounds of
                true -> challenge(Election, Idle);
                false -> {keep_state, Idle}
            end;
        #{} ->
            keep_state_and_data
    end.

%% -- the result -----------------------------------------------------------------------------

win(Election, #bully{self = Self} = Bully) ->
    {keep_state, Elected, Actions} = elect(Election, Self, highest, Bully),
    Announcement = {cast, sap, {broadcast, bully_leader, {Election, Self}}},
    {keep_state, Elected, Actions ++ [Announcement]}.

announced(Election, Leader, #bully{team = Team} = Bully) ->
    case starl_team:has(Leader, Team) of
        true -> elect(Election, Leader, announcement, Bully);
        false -> unknown_event
    end.

elect(Election, Leader, How, Bully0) ->
    {Race, Bully} = race(Election, Bully0),
    case Race of
        #race{leader = none, from = From} ->
            Elected = Race#race{leader = Leader, from = none, phase = idle},
            Reply = [{reply, From, {ok, Leader}} || From =/= none],
            {keep_state, put_race(Election, Elected, Bully), [
                {trace, {elected, Election, Leader, How}},
                {{timeout, {round, Election}}, cancel},
                {{timeout, {patience, Election}}, cancel}
                | Reply
            ]};
        #race{} ->
            {keep_state, Bully, []}
    end.

%% The application waits no longer; the robot's part in the election goes on.
give_up(Election, #bully{races = Races} = Bully) ->
    case Races of
        #{Election := #race{leader = none, from = From} = Race} when From =/= none ->
            {keep_state, put_race(Election, Race#race{from = none}, Bully), [
                {trace, {failed, Election, timeout}}, {reply, From, {error, timeout}}
            ]};
        #{} ->
            keep_state_and_data
    end.

%% -- the elections --------------------------------------------------------------------------

prepend(More, {keep_state, Bully, Actions}) -> {keep_state, Bully, More ++ Actions}.

race(Election, #bully{races = Races} = Bully) ->
    case Races of
        #{Election := Race} -> {Race, Bully};
        #{} -> {#race{}, put_race(Election, #race{}, forget(Bully, Election))}
    end.

forget(#bully{order = Order, races = Races} = Bully, New) when length(Order) < ?REMEMBERED ->
    Bully#bully{order = [New | Order], races = Races};
forget(#bully{order = Order, races = Races} = Bully, New) ->
    Done = [E || E <- lists:reverse(Order), (maps:get(E, Races))#race.from =:= none],
    case Done of
        [Oldest | _] ->
            Left = lists:delete(Oldest, Order),
            Bully#bully{order = [New | Left], races = maps:remove(Oldest, Races)};
        [] ->
            Bully#bully{order = [New | Order]}
    end.

put_race(Election, Race, #bully{races = Races} = Bully) ->
    Bully#bully{races = Races#{Election => Race}}.
