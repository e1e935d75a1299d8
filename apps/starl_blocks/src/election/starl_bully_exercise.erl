%% @doc The exercise of the election by the bully algorithm. It makes the same calls as the exercise
%% of the election by ballots.
%%
%% It promises a leader. If no robot took part before the last fault was over, the leader is the
%% highest robot that lives.
-module(starl_bully_exercise).
-behaviour(starl_block_exercise).

-export([block_options/1, work/3, final/3, seen/1, noted/2, promise/3]).

%% The time at which a robot first took part in an election.
-type seen() :: #{Election :: term() => integer()}.

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(Use) -> starl_election_exercise:block_options(Use).

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, Turn, Use) -> starl_election_exercise:work(Robot, Turn, Use).

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, Use) -> starl_election_exercise:final(Robot, N, Use).

-spec seen([starl:robot_id()]) -> seen().
seen(_Robots) -> #{}.

-spec noted(starl_monitor:trace_event(), seen()) -> seen().
noted({T, _Robot, app, {call, {elect, Election}, _}}, First) ->
    maps:merge(#{Election => T}, First);
noted(_Event, First) ->
    First.

-spec promise(starl_promise:call(), starl_promise:team(), seen()) -> starl_promise:t().
promise(#{what := {elect, Election}} = Call, Team, First) ->
    starl_promise:soon(Call, leader(maps:get(Election, First, none), Team), Team);
promise(_Call, _Team, _First) ->
    none.

%% Of the robots that are cut off, a higher one may be heard.
leader(_T, #{rest := [_ | _]}) ->
    fun starl_promise:is_some/1;
leader(T, #{healed_us := Healed, robots := Robots, died := Died} = Team) when
    is_integer(T), is_integer(Healed)
->
    Settled = T >= Healed + starl_sap_schedule:settled_us(),
    %% a robot that does not answer in time counts as dead
    case Settled andalso maps:get(reach_us, Team, 0) =< answer_us() of
        true ->
            Leader = lists:max(Robots -- Died),
            fun(Outcome) -> Outcome =:= {ok, Leader} end;
        false ->
            fun starl_promise:is_some/1
    end;
leader(_T, _Team) ->
    fun starl_promise:is_some/1.

answer_us() ->
    #{answer_ms := Ms} = starl_options:defaults(starl_bully:options()),
    1000 * Ms.
