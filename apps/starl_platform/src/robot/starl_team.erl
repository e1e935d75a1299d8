%% @doc Keeps the robots of a team as ranges of consecutive numbers. So each machine needs as little
%% memory for a team of ten thousand as for a team of two.
-module(starl_team).

-export([new/1, members/1, others/2, count/1, next/2, has/2]).

-export_type([t/0]).

%% Ascending; a plain list of robots is a team as well.
-type t() :: [starl:robot_id() | {First :: starl:robot_id(), Last :: starl:robot_id()}].

%% @doc The team of these robots.
-spec new([starl:robot_id()]) -> t().
new(Robots) -> runs(lists:usort(Robots)).

%% @doc Its robots, ascending.
-spec members(t()) -> [starl:robot_id()].
members([]) -> [];
members([{First, Last} | Rest]) -> lists:seq(First, Last) ++ members(Rest);
members([Robot | Rest]) -> [Robot | members(Rest)].

%% @doc All robots but this one, ascending.
-spec others(starl:robot_id(), t()) -> [starl:robot_id()].
others(Robot, Team) -> lists:delete(Robot, members(Team)).

%% @doc The number of its robots.
-spec count(t()) -> non_neg_integer().
count([]) ->
    0;
count([{First, Last} | Rest]) when is_integer(First), is_integer(Last) ->
    Last - First + 1 + count(Rest);
count([_ | Rest]) ->
    1 + count(Rest).

%% @doc Is the robot in the team?
-spec has(starl:robot_id(), t()) -> boolean().
has(_Robot, []) -> false;
has(Robot, [{First, Last} | _]) when Robot >= First, Robot =< Last -> true;
has(Robot, [Robot | _]) -> true;
has(Robot, [_ | Rest]) -> has(Robot, Rest).

%% @doc The robot after this one, in a ring.
-spec next(starl:robot_id(), t()) -> starl:robot_id().
next(Robot, Team) -> next(Robot, Team, first(Team)).

%% Else is the answer when no later robot follows.
next(_Robot, [], Else) -> Else;
next(Robot, [{_, Last} | Rest], Else) when Robot >= Last -> next(Robot, Rest, Else);
next(Robot, [{First, _} | _], _Else) -> max(First, Robot + 1);
next(Robot, [Next | _], _Else) when Next > Robot -> Next;
next(Robot, [_ | Rest], Else) -> next(Robot, Rest, Else).

first([{First, _} | _]) -> First;
first([First | _]) -> First.

runs([]) -> [];
runs([Robot | Robots]) -> runs(Robots, Robot, Robot).

runs([Next | Rest], First, Last) when Next =:= Last + 1 -> runs(Rest, First, Next);
runs([Next | Rest], First, Last) -> [{First, Last} | runs(Rest, Next, Next)];
runs([], First, Last) -> [{First, Last}].
