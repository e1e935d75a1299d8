%% @doc Leader election: the interface.
%%
%% An election has a name, any small term; a further election is one with another name. The
%% robots that call {@link elect/2} with the same name take part in the same election.
%% Guarantee (the paper's Proposition 1): any two robots that elect in the same election elect
%% the same leader; a robot that gets only the announcement elects the announced; else it fails
%% in bounded time. When no message is lost, all elect.
%%
%% That is what the ballots keep ({@link starl_election_ballots}, the default). The bully
%% algorithm ({@link starl_election_bully}) gives the highest robot that is alive, with dead
%% robots in the team, too; but under loss two robots may elect different leaders.
-module(starl_election).

-export([block/0, block/1, elect/2, elect/3]).

-export_type([election/0]).

-type election() :: term().

%% @doc The machine that a robot needs to take part in elections.
-spec block() -> starl_robot_sup:machine().
block() -> block(ballots).

%% @doc The same, by the algorithm of this name; the bully algorithm takes a configuration.
-spec block(ballots | bully | {bully, starl_election_bully:config()}) ->
    starl_robot_sup:machine().
block(ballots) -> {election, starl_election_ballots, #{}};
block(bully) -> block({bully, #{}});
block({bully, Config}) -> {election, starl_election_bully, Config}.

%% @doc Takes part in an election, with half a minute's patience.
-spec elect(starl:robot(), election()) ->
    {ok, Leader :: starl:robot_id()} | {error, timeout | restarted}.
elect(Robot, Election) -> elect(Robot, Election, 30000).

%% @doc Takes part in an election; fails after so many milliseconds. A robot that failed may
%% call again with the same name: it takes part with the same ballot, and those that have
%% elected meanwhile tell it their leader.
-spec elect(starl:robot(), election(), Ms :: pos_integer()) ->
    {ok, Leader :: starl:robot_id()} | {error, timeout | restarted}.
elect(Robot, Election, Ms) ->
    ok = starl_caller:check({?MODULE, elect, 3}, 'Ms', positive_ms, Ms),
    case starl:call(Robot, election, {elect, Election, Ms * 1000}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.
