%% @doc The exercise of elections: one election follows another, and robots enter at different
%% times.
%%
%% It promises a leader if all robots take part and none has died.
-module(starl_election_exercise).
-behaviour(starl_block_exercise).

-export([again_ms/1, block_options/1, work/3, final/3, watches/0, seen/1, noted/2, promise/3]).

%% The time at which each robot began to take part in an election.
-type seen() :: #{Election :: term() => #{starl:robot_id() => integer()}}.

%% The most by which a call may last longer than its patience.
-define(MARGIN_MS, 11000).

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(#{final := 0, patience := Ms}) ->
    #{patience_ms => Ms + ?MARGIN_MS};
block_options(#{patience := Ms, last_patience := Last}) ->
    #{patience_ms => max(Ms, Last) + ?MARGIN_MS}.

-spec again_ms(starl_block_exercise:use()) -> pos_integer().
again_ms(_Use) -> starl_election_ballots:again_us() div 1000.

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, Turn, #{patience := Patience}) -> elect(Robot, {term, Turn div 2}, Patience).

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, #{last_patience := Ms}) ->
    starl_block_exercise:again(fun() -> elect(Robot, {final, N}, Ms) end).

elect(Robot, Election, Ms) ->
    Elect = fun() -> starl_election:elect(Robot, Election, Ms) end,
    starl_block_exercise:call(Robot, {elect, Election}, Ms, Elect).

-spec watches() -> [starl_machine:name()].
watches() -> [election].

-spec seen([starl:robot_id()]) -> seen().
seen(_Robots) -> #{}.

-spec noted(starl_monitor:trace_event(), seen()) -> seen().
noted({T, Robot, app, {call, {elect, Election}, _}}, Voters) ->
    Of = maps:get(Election, Voters, #{}),
    Voters#{Election => maps:merge(#{Robot => T}, Of)};
noted({_, Robot, app, {answered, #{what := {elect, Election}}, {error, _}}}, Voters) ->
    #{Election := Of} = Voters,
    Voters#{Election := maps:remove(Robot, Of)};
noted({_, Robot, Machine, crashed}, Voters) when Machine =:= app; Machine =:= election ->
    maps:map(fun(_, Of) -> maps:remove(Robot, Of) end, Voters);
noted(_Event, Voters) ->
    Voters.

-spec promise(starl_promise:call(), starl_promise:team(), seen()) -> starl_promise:t().
promise(#{what := {elect, {final, _} = Election}} = Call, Team, Voters) ->
    Times = maps:values(maps:get(Election, Voters, #{})),
    starl_promise:when_all(Times, Call, fun starl_promise:is_some/1, Team);
promise(_Call, _Team, _Voters) ->
    none.
