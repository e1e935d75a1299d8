%% @doc The interface of a counter that all robots share and that only grows. It is the example of
%% CONTRIBUTING.md, "To add a block": small, and complete.
%%
%% Each robot counts its own increments. The value is the sum over all robots, as far as this robot
%% has heard. Guarantee: a value never goes back at a robot, unless its machine has restarted, and
%% never exceeds the number of increments made. When increments stop and messages get through, all
%% robots read the same value. Increments are stored. They are lost if their robot loses its store
%% before another robot has heard of them.
%% ```
%%   blocks() -> [starl_counter].
%%   {ok, Value} = starl_counter:increment(Robot),
%%   {ok, Later} = starl_counter:value(Robot)
%% '''
-module(starl_counter).
-behaviour(starl_block).

-export([increment/1, value/1, within_ms/2]).
-export([
    options/0, machines/1, monitors/2, guarantees/0, contract/0, exercise/0, models/0, history/0
]).

%% @doc Adds one to the counter and returns the new value.
-spec increment(starl:robot()) -> {ok, Value :: pos_integer()} | {error, restarted}.
increment(Robot) -> starl:call(Robot, counter, increment, infinity).

%% @doc Returns the value of the counter, as far as this robot has heard.
-spec value(starl:robot()) -> {ok, Value :: non_neg_integer()} | {error, restarted}.
value(Robot) -> starl:call(Robot, counter, value, infinity).

%% -- the block ------------------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() ->
    [
        {gossip_ms, {integer, 10, 1000000}, 1000,
            "the time between two messages with what a robot has heard, ms"}
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) -> [{counter, starl_counter_gossip, Options}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{gossip_ms := Ms}, #{robots := Robots}) ->
    Within = 1000 * within_ms(Ms, length(Robots)),
    Turn = 1000 * Ms * length(Robots),
    [{starl_counter_monitor, #{robots => Robots, within_us => Within, turn_us => Turn}}].

%% @doc The time (ms) after the last increment within which all robots agree, when messages get
%% through. Each robot sends its tallies to all others in turn, twice: the first message to a robot
%% that has restarted may be refused.
-spec within_ms(GossipMs :: pos_integer(), Robots :: pos_integer()) -> pos_integer().
within_ms(Gossip, Robots) when is_integer(Gossip), is_integer(Robots) ->
    5000 + 2 * Robots * Gossip.

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {grows, safety,
            "a value goes back only if its robot's machine has crashed since, and never exceeds the "
            "increments made", []},
        {counts, safety, "an increment counts at once at its robot", []},
        {agree, progress,
            "all robots agree, and no increment is lost but with the robot that made it", [
                delivery
            ]}
    ].

-spec contract() -> string().
contract() ->
    "the value goes back only with a crash, and never exceeds the increments; all come to agree".

-spec exercise() -> module().
exercise() -> starl_counter_exercise.

-spec history() -> module().
history() -> starl_counter_history.

-spec models() -> [starl_block:model_entry()].
models() -> [{counter, "a shared counter that only grows", fun model/1}].

%% The first robot counts twice, the others once and read. All know that a robot sends to the others
%% in the order of their numbers, so no two are alike.
model(#{robots := Ids}) ->
    #{
        blocks => machines(#{}),
        script => fun script/1,
        crash => [counter],
        monitor => {starl_counter_monitor, #{robots => Ids}},
        fixed => lists:seq(1, length(Ids))
    }.

script(1) -> [{'try', counter, increment}, {'try', counter, increment}];
script(_) -> [{'try', counter, increment}, {'try', counter, value}].
