%% @doc Leader election: the interface.
%%
%% An election has a name, any small term; a further election is one with another name. The
%% robots that call {@link elect/2} with the same name take part in the same election.
%% Guarantee (the paper's Proposition 1): any two robots that elect in the same election elect
%% the same leader; a robot that gets only the announcement elects the announced; else it fails
%% in bounded time. When no message is lost, all elect.
-module(starl_election).

-export([block/0, elect/2, elect/3]).

-export_type([election/0]).

-type election() :: term().

%% @doc The machine that a robot needs to take part in elections.
-spec block() -> starl_robot_sup:machine().
block() -> {election, starl_election_ballots, #{}}.

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
    case starl:call(Robot, election, {elect, Election, Ms * 1000}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.
