%% @doc Leader election by the bully algorithm (Garcia-Molina, "Elections in a distributed
%% computing system", 1982): the highest robot that is alive wins.
%% ```
%%   robot                    each higher robot                          all others
%%     | challenge {E} ------------->|                                        |
%%     |<------------------ alive {E}|  challenges those above it in turn     |
%%     |                             |                                        |
%%     | nobody alive within answer_us: leader {E, self, few} --------------->|
%%     |<------------------------------------------------------ challenge {E} |  does it hear me?
%%     | leader {E, self, heard} -------------------------------------------->|  elects it
%%     | has been challenged by a majority: leader {E, self, majority} ------>|  elects it
%%     | somebody alive: waits for its announcement, challenges again later   |
%% '''
%% A robot follows only a leader that hears it, or that hears a majority of the team
%% (Garcia-Molina's coordinator leads those that have answered it). So a deaf robot leads nobody but
%% itself, however well it is heard. A leader that is deaf to one robot only is still followed by
%% that robot. A robot that has elected passes its leader on: `majority' counts, but `few' first
%% shows only that the robot is alive. If a higher robot says so again, and its leader does not
%% answer, the leader may have died after that robot elected it: this robot follows, since nobody
%% elects itself below a robot that has answered.
%%
%% A robot takes part from the first message of the election on, even before its application calls.
%% So the highest robot alive can be elected although its application has not asked. A robot keeps
%% the leader that it has elected, so it never reports two leaders for one term, as long as the
%% election is among the last 1024 that it took part in. A term is an election within one life of
%% the machine: a restarted machine has forgotten the result, asks again, and gets the others'
%% leader. A robot that has elected answers a challenge with its leader.
%%
%% If no packet is lost and each takes at most half of `answer_us', only the highest robot alive
%% hears of no robot above itself. So all elect it. If links are cut in one direction for good, a
%% majority of robots that hear each other elects its highest. With loss, robots may elect different
%% leaders: use the ballots if agreement is needed under every fault.
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

%% The number of elections that are remembered for each robot that was the first to name them here (those that the
%% application has entered are its own); beyond it the oldest for which no caller waits is forgotten. A robot that rebooted may ask again for an old election: a robot that has forgotten it
%% holds it anew, and may report another leader.
-define(REMEMBERED, 1024).

-record(race, {
    by :: starl:robot_id(),
    leader = none :: starl:robot_id() | none,
    from = none :: starl_machine:from() | none,
    %% idle: not begun, or given up; asking: is a higher robot alive? hoping: one is
    phase = idle :: idle | asking | hoping,
    round = 0 :: non_neg_integer(),
    %% the robots that have challenged this one; those that have answered its challenge
    heard = [] :: [starl:robot_id()],
    hears = [] :: [starl:robot_id()],
    %% the leader of a higher robot that has answered in this round, where that is all that is known of it
    rumour = none :: starl:robot_id() | none,
    %% does the leader hear a majority of the team, as far as is known?
    ground = few :: majority | few
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
    #{answer_ms := AnswerMs, rounds := Rounds} =
        maps:merge(starl_options:defaults(starl_bully:options()), Config),
    Bully = #bully{
        self = Self,
        team = Team,
        higher = [Robot || Robot <- starl_team:members(Team), Robot > Self],
        answer_us = 1000 * AnswerMs,
        rounds = Rounds
    },
    {ready, Bully, listen()}.

-spec handle_event(starl_machine:event_type(), term(), ready, #bully{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event({call, From}, {elect, Election, Us}, ready, Bully, _Meta) ->
    enter(Election, Us, From, Bully);
handle_event(cast, {message, Source, bully_challenge, Election}, ready, Bully, _Meta) ->
    challenged(Election, Source, Bully);
handle_event(cast, {message, Source, bully_alive, Election}, ready, Bully, _Meta) ->
    alive(Election, Source, Bully);
handle_event(
    cast, {message, Source, bully_leader, {Election, Leader, Ground}}, ready, Bully, _Meta
) ->
    case starl_team:has(Leader, Bully#bully.team) of
        true -> announced(Election, Leader, ground(Ground, Source, Leader), Source, Bully);
        false -> unknown_event
    end;
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
accepts(bully_leader, Body) ->
    starl_shape:is([label, count, {either, [{is, G} || G <- [heard, majority, few]]}], Body);
accepts(Type, Election) ->
    (Type =:= bully_challenge orelse Type =:= bully_alive) andalso starl_shape:is(label, Election).

listen() ->
    [starl_sap:listen(T, election) || T <- [bully_challenge, bully_alive, bully_leader]].

%% -- taking part ----------------------------------------------------------------------------

enter(Election, Us, From, #bully{self = Self} = Bully0) ->
    {Named, Bully1} = race(Election, Self, Bully0),
    Race = Named#race{by = Self},
    Bully = put_race(Election, Race, Bully1),
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

%% Another robot asks: this one is alive, and takes part. One that leads tells all as soon as a majority has asked.
challenged(Election, Source, #bully{self = Self} = Bully0) ->
    {Race0, Bully1} = race(Election, Source, Bully0),
    Race = hear(Source, Race0, Bully1),
    Bully = put_race(Election, Race, Bully1),
    case Race of
        #race{leader = none} ->
            Answer = starl_sap:post(Source, bully_alive, Election),
            prepend([Answer], challenge(Election, Bully));
        #race{leader = Self, ground = Ground} when Ground =/= Race0#race.ground ->
            {keep_state, Bully, [announcement(Election, Race)]};
        #race{leader = Self} ->
            {keep_state, Bully, [starl_sap:post(Source, bully_leader, {Election, Self, heard})]};
        #race{leader = Leader, ground = Ground} ->
            Known = {Election, Leader, Ground},
            {keep_state, Bully, [starl_sap:post(Source, bully_leader, Known)]}
    end.

%% Only what this robot hears itself is a ground for its own lead.
hear(_Source, #race{leader = Leader} = Race, #bully{self = Self}) when
    Leader =/= none, Leader =/= Self
->
    Race;
hear(_Source, #race{ground = majority} = Race, _Bully) ->
    Race;
hear(Source, #race{heard = Heard} = Race, #bully{team = Team}) ->
    More = ordsets:add_element(Source, Heard),
    case 2 * (length(More) + 1) > length(starl_team:members(Team)) of
        true -> Race#race{heard = [], ground = majority};
        false -> Race#race{heard = More}
    end.

%% Asks all higher robots, unless it is asking already; the highest of the team has none to ask.
challenge(Election, #bully{higher = []} = Bully) ->
    win(Election, Bully);
challenge(Election, #bully{higher = Higher} = Bully) ->
    case maps:get(Election, Bully#bully.races) of
        #race{phase = idle, round = Round} = Race ->
            Asking = Race#race{phase = asking, round = Round + 1, rumour = none},
            {keep_state, put_race(Election, Asking, Bully), [
                {{timeout, {round, Election}}, Bully#bully.answer_us, over}
                | [starl_sap:post(Robot, bully_challenge, Election) || Robot <- Higher]
            ]};
        #race{} ->
            {keep_state, Bully, []}
    end.

%% A higher robot is alive, and hears this one.
alive(Election, Source, #bully{races = Races} = Bully) ->
    case Races of
        #{Election := #race{leader = none, hears = Hears} = Race} ->
            Answered = Race#race{hears = ordsets:add_element(Source, Hears)},
            hope(Election, put_race(Election, Answered, Bully));
        #{} ->
            keep_state_and_data
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
            {keep_state, Bully}
    end.

round_over(Election, #bully{races = Races, rounds = Rounds} = Bully) ->
    case Races of
        #{Election := #race{leader = none, phase = asking, rumour = none}} ->
            win(Election, Bully);
        #{Election := #race{leader = none, phase = asking, rumour = Leader}} ->
            elect(Election, Leader, few, announcement, Bully);
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
    #race{ground = Ground} = race_of(Election, Bully),
    {keep_state, Elected, Actions} = elect(Election, Self, Ground, highest, Bully),
    {keep_state, Elected, Actions ++ [announcement(Election, race_of(Election, Elected))]}.

announcement(Election, #race{leader = Self, ground = Ground}) ->
    {cast, sap, {broadcast, bully_leader, {Election, Self, Ground}}}.

%% Only the leader itself can say whom it hears.
ground(heard, Leader, Leader) -> heard;
ground(heard, _Source, _Leader) -> few;
ground(Ground, _Source, _Leader) -> Ground.

announced(Election, Leader, Ground, Source, Bully0) ->
    {#race{leader = Known, hears = Hears} = Race, Bully} = race(Election, Source, Bully0),
    case Known =:= none andalso (Ground =/= few orelse lists:member(Leader, Hears)) of
        true ->
            elect(Election, Leader, Ground, announcement, Bully);
        false when Known =:= Leader, Ground =:= majority ->
            {keep_state, put_race(Election, Race#race{ground = majority}, Bully)};
        false when Known =/= none ->
            {keep_state, Bully};
        false ->
            doubted(Election, Leader, Source, Race, Bully)
    end.

%% Does the robot that wants to lead hear this one? What others say of it is at first a sign of life.
doubted(Election, Leader, Leader, #race{phase = idle} = Race, #bully{self = Self} = Bully) when
    Leader > Self
->
    Hoping = put_race(Election, Race#race{phase = hoping}, Bully),
    {keep_state, Hoping, [
        {{timeout, {round, Election}}, Bully#bully.answer_us, over},
        starl_sap:post(Leader, bully_challenge, Election)
    ]};
doubted(Election, Leader, Leader, _Race, Bully) ->
    challenge(Election, Bully);
doubted(Election, _Leader, _Source, #race{round = 1}, Bully) ->
    hope(Election, Bully);
doubted(Election, Leader, Source, Race, #bully{self = Self} = Bully) when Source > Self ->
    {keep_state, put_race(Election, Race#race{rumour = Leader}, Bully)};
doubted(_Election, _Leader, _Source, _Race, Bully) ->
    {keep_state, Bully}.

elect(Election, Leader, Ground, How, Bully) ->
    case race_of(Election, Bully) of
        #race{leader = none, from = From} = Race ->
            Elected = Race#race{
                leader = Leader, from = none, phase = idle, hears = [], ground = known(Ground)
            },
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

known(heard) -> few;
known(Ground) -> Ground.

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

race(Election, By, #bully{races = Races} = Bully) ->
    case Races of
        #{Election := Race} ->
            {Race, Bully};
        #{} ->
            Race = #race{by = By},
            {Race, put_race(Election, Race, forget(Election, By, Bully))}
    end.

race_of(Election, #bully{races = Races}) -> maps:get(Election, Races).

forget(New, By, #bully{order = Order, races = Races} = Bully) ->
    Same = [E || E <- Order, (maps:get(E, Races))#race.by =:= By],
    Done = [E || E <- lists:reverse(Same), (maps:get(E, Races))#race.from =:= none],
    case Done of
        [Oldest | _] when length(Same) >= ?REMEMBERED ->
            Left = lists:delete(Oldest, Order),
            Bully#bully{order = [New | Left], races = maps:remove(Oldest, Races)};
        _ ->
            Bully#bully{order = [New | Order]}
    end.

put_race(Election, Race, #bully{races = Races} = Bully) ->
    Bully#bully{races = Races#{Election => Race}}.
