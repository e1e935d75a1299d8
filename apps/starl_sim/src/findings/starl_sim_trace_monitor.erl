%% @doc Hashes the traced events of each robot into one number, or records those of one robot. It
%% judges nothing. Two runs whose robots have had the same events, and so the same digest, may still
%% differ in what their programs traced. The cause is often a random number that is not the robot's
%% own.
%%
%% The reason of a crash is left out, because its stack depends on the mode of the run.
-module(starl_sim_trace_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2]).

-export_type([chains/0, traced/0]).

-type chains() :: #{starl:robot_id() => non_neg_integer()}.
-type traced() :: {starl_sim_queue:time(), starl_machine:name(), Event :: term()}.

-record(state, {
    chains = #{} :: chains(),
    robot :: starl:robot_id() | none,
    recorded = [] :: [traced()]
}).

%% @doc `record': the robot whose events are recorded.
-spec init(#{record => starl:robot_id()}) -> #state{}.
init(Config) -> #state{robot = maps:get(record, Config, none)}.

-spec step(starl_monitor:trace_event(), #state{}) -> {ok, #state{}}.
step({T, Robot, Machine, Event0}, #state{chains = Chains, robot = Recorded} = State) ->
    Event = plain(Event0),
    Link = erlang:phash2({maps:get(Robot, Chains, 0), T, Machine, Event}, 1 bsl 32),
    Chained = State#state{chains = Chains#{Robot => Link}},
    case Robot of
        Recorded ->
            {ok, Chained#state{recorded = [{T, Machine, Event} | State#state.recorded]}};
        _ ->
            {ok, Chained}
    end.

plain({crashed, Machine, _Cause}) -> {crashed, Machine};
plain({code_change_failed, _Cause}) -> code_change_failed;
plain(Event) -> Event.

-spec finish(integer(), #state{}) -> {ok, #{chains := chains(), recorded := [traced()]}}.
finish(_EndUs, #state{chains = Chains, recorded = Recorded}) ->
    {ok, #{chains => Chains, recorded => lists:reverse(Recorded)}}.
