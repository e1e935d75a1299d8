%% @doc Leader election by randomized ballots (the coordinator of the paper's section on leader
%% election).
%% ```
%%   robot                                  all others
%%     | ballot {Election, B} ---------------->|   once, when the robot takes part
%%     |<---------------- ballot {Election, B} |
%%     |   all ballots here: elect the largest (ties: the larger robot)
%%     | leader {Election, L} ---------------->|   elect L, unless elected already
%% '''
%% Only a complete set of ballots elects, so two robots that elect by ballots elect the same leader.
%% A robot's ballot in an election follows from the team's seed, the election and the robot. So it
%% casts the same ballot in each of its lives, whatever is left of its store. A robot keeps ballots
%% and announcements that come before it takes part itself. A ballot for an election that is over
%% here is answered with its leader, so a robot that failed can call again.
%%
%% Call: `{elect, Election, TimeoutUs}', answer `{ok, Leader}' or `{error, timeout}'.
%% Trace: {@link event()}.
-module(starl_election_ballots).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2, again_us/0]).

-export_type([event/0]).

%% The trace of an election.
-type event() ::
    %% the application has called
    {entered, starl_election:election()}
    | {ballot, starl_election:election(), ballot()}
    %% by all ballots, or since another one announced it
    | {elected, starl_election:election(), Leader :: starl:robot_id(), all_ballots | announcement}
    | {failed, starl_election:election(), timeout}.

%% A number by lot, and the robot whose ballot it is.
-type ballot() :: {non_neg_integer(), starl:robot_id()}.

%% The number of elections that are remembered for each robot that was the first to name them here; its
%% oldest are forgotten first. Those that the application has entered are its own.
-define(REMEMBERED, 64).
%% The time after which a robot without a result asks again.
-define(AGAIN_US, 3000000).
%% The number of different ballots.
-define(BALLOTS, 1 bsl 30).

-record(race, {
    by :: starl:robot_id(),
    ballots = #{} :: #{starl:robot_id() => ballot()},
    leader = none :: starl:robot_id() | none,
    from = none :: starl_machine:from() | none
}).

-record(election, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    seed :: integer(),
    ballots :: pos_integer(),
    races = #{} :: #{starl_election:election() => #race{}},
    order = [] :: [starl_election:election()]
}).

%% @doc The time after which a robot without a result asks again, in microseconds.
-spec again_us() -> pos_integer().
again_us() -> ?AGAIN_US.

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) -> {ready, #election{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, team_seed := Seed} = Config) ->
    Ballots = maps:get(ballots, Config, ?BALLOTS),
    {ready, #election{self = Self, team = Team, seed = Seed, ballots = Ballots}, listen()}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #election{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {elect, Election, Us}, ready, Data, _Meta) ->
    enter(Election, Us, From, Data);
handle_event(cast, {message, Source, ballot, {Election, {_, Source} = Ballot}}, ready, Data, _) ->
    ballot(Election, Source, Ballot, Data);
handle_event(cast, {message, Source, leader, {Election, Leader}}, ready, Data, _Meta) ->
    announced(Election, Source, Leader, Data);
handle_event({timeout, {again, Election}}, _, ready, Data, _Meta) ->
    again(Election, Data);
handle_event({timeout, {patience, Election}}, _, ready, Data, _Meta) ->
    give_up(Election, Data);
handle_event(info, {restarted, sap}, ready, _Data, _Meta) ->
    {keep_state_and_data, listen()};
handle_event(info, {restarted, _}, ready, _Data, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(ballot, Body) -> starl_shape:is([label, [natural, count]], Body);
accepts(leader, Body) -> starl_shape:is([label, count], Body);
accepts(_Type, _Body) -> false.

listen() -> [starl_sap:listen(ballot, election), starl_sap:listen(leader, election)].

enter(Election, Us, From, #election{self = Self} = Data0) ->
    {Named, Data1} = race(Election, Self, Data0),
    Race = Named#race{by = Self},
    Data = put_race(Election, Race, Data1),
    case Race of
        #race{leader = none} ->
            Ballot = own_ballot(Election, Data),
            Entered = put_race(Election, cast_own(Ballot, Race#race{from = From}, Data), Data),
            Actions = [
                {trace, {entered, Election}},
                {trace, {ballot, Election, Ballot}},
                {cast, sap, {broadcast, ballot, {Election, Ballot}}},
                {{timeout, {again, Election}}, ?AGAIN_US, again},
                {{timeout, {patience, Election}}, Us, patience}
            ],
            count(Election, Actions, Entered);
        #race{leader = Leader} ->
            {keep_state, Data, [{reply, From, {ok, Leader}}]}
    end.

cast_own(Ballot, #race{ballots = Ballots} = Race, #election{self = Self}) ->
    Race#race{ballots = Ballots#{Self => Ballot}}.

%% The same in each life of the robot.
own_ballot(Election, #election{self = Self, seed = Seed, ballots = Ballots}) ->
    {erlang:phash2({Seed, Election, Self}, Ballots), Self}.

ballot(Election, Source, Ballot, Data0) ->
    {Race, Data} = race(Election, Source, Data0),
    case Race of
        #race{leader = none, ballots = Ballots} ->
            Heard = Race#race{ballots = Ballots#{Source => Ballot}},
            count(Election, [], put_race(Election, Heard, Data));
        #race{leader = Leader} ->
            {keep_state, Data, [starl_sap:post(Source, leader, {Election, Leader})]}
    end.

%% Elects when all ballots are here; only a robot that takes part does.
count(Election, Actions, #election{team = Team} = Data) ->
    #race{ballots = Ballots, from = From} = maps:get(Election, Data#election.races),
    case From =/= none andalso map_size(Ballots) =:= starl_team:count(Team) of
        true ->
            {_, Leader} = lists:max(maps:values(Ballots)),
            Announce = {cast, sap, {broadcast, leader, {Election, Leader}}},
            {keep_state, Elected, More} = elect(Election, Leader, all_ballots, Data),
            {keep_state, Elected, Actions ++ More ++ [Announce]};
        false ->
            {keep_state, Data, Actions}
    end.

announced(Election, Source, Leader, #election{team = Team} = Data0) ->
    case starl_team:has(Leader, Team) of
        true ->
            {_, Data} = race(Election, Source, Data0),
            elect(Election, Leader, announcement, Data);
        false ->
            unknown_event
    end.

elect(Election, Leader, How, #election{races = Races} = Data) ->
    case maps:get(Election, Races) of
        #race{leader = none, from = From} = Race ->
            Elected = put_race(Election, Race#race{leader = Leader, from = none}, Data),
            Reply = [{reply, From, {ok, Leader}} || From =/= none],
            Actions = [
                {trace, {elected, Election, Leader, How}},
                {{timeout, {again, Election}}, cancel},
                {{timeout, {patience, Election}}, cancel}
            ],
            {keep_state, Elected, Actions ++ Reply};
        #race{} ->
            {keep_state, Data, []}
    end.

%% A ballot or an announcement may have been lost: robots that have the result will tell it.
again(Election, #election{self = Self, team = Team} = Data) ->
    case maps:get(Election, Data#election.races, none) of
        #race{leader = none, from = From, ballots = Ballots} when From =/= none ->
            Own = maps:get(Self, Ballots),
            Others = starl_team:others(Self, Team),
            {keep_state, Data, [
                {{timeout, {again, Election}}, ?AGAIN_US, again}
                | [starl_sap:post(Other, ballot, {Election, Own}) || Other <- Others]
            ]};
        _ ->
            keep_state_and_data
    end.

give_up(Election, Data) ->
    case maps:get(Election, Data#election.races, none) of
        #race{leader = none, from = From} = Race when From =/= none ->
            {keep_state, put_race(Election, Race#race{from = none}, Data), [
                {trace, {failed, Election, timeout}},
                {{timeout, {again, Election}}, cancel},
                {reply, From, {error, timeout}}
            ]};
        _ ->
            keep_state_and_data
    end.

%% The race of an election; a new one takes the place of the oldest that the same robot has named.
race(Election, By, #election{races = Races, order = Order} = Data) ->
    case Races of
        #{Election := Race} ->
            {Race, Data};
        #{} ->
            Same = [E || E <- Order, (maps:get(E, Races))#race.by =:= By],
            Old = lists:nthtail(min(?REMEMBERED - 1, length(Same)), Same),
            Gone = [E || E <- Old, (maps:get(E, Races))#race.from =:= none],
            Race = #race{by = By},
            {Race, Data#election{
                races = (maps:without(Gone, Races))#{Election => Race},
                order = [Election | Order -- Gone]
            }}
    end.

put_race(Election, Race, #election{races = Races} = Data) ->
    Data#election{races = Races#{Election => Race}}.
