%% @doc What a merged recording takes from each of its parts. Without a recording of the world, it takes
%% everything from the robots' own. With one, the true motions, the deaths of robots, faults and verdicts are the world's, and
%% all that the robots themselves know is theirs. A pure module.
-module(starl_trace_merge_selection).

-export([new/2, take/2]).

-export_type([t/0]).

-record(share, {
    of_world :: boolean(),
    has_world :: boolean(),
    %% the robots whose machines end with them
    falling = #{} :: #{starl:robot_id() => []}
}).

-opaque t() :: #share{}.

%% @doc The share of the world's recording or of a robot's.
-spec new(world | robot, HasWorld :: boolean()) -> t().
new(Kind, HasWorld) -> #share{of_world = Kind =:= world, has_world = HasWorld}.

%% @doc The messages that are taken, in their order.
-spec take([starl_trace_message:t()], t()) -> {[starl_trace_message:t()], t()}.
take(Messages, Share) ->
    {Taken, Next} = lists:foldl(fun one/2, {[], Share}, Messages),
    {lists:reverse(Taken), Next}.

one({trace, _, {Robot, Machine, Event}} = Message, {Taken, #share{falling = Before} = Share}) ->
    IsEnd = is_end(Robot, Machine, Event, Before),
    Falling =
        case IsEnd of
            true -> Before#{Robot => []};
            false -> maps:remove(Robot, Before)
        end,
    {[Message || takes_event(Machine, IsEnd, Share)] ++ Taken, Share#share{falling = Falling}};
one(Message, {Taken, Share}) ->
    {[Message || takes(element(1, Message), Share)] ++ Taken, Share}.

%% A robot goes down, and its machines with it.
is_end(_Robot, robot, down, _Falling) -> true;
is_end(Robot, _Machine, crashed, Falling) -> is_map_key(Robot, Falling);
is_end(_Robot, _Machine, _Event, _Falling) -> false.

takes_event(_Machine, _IsEnd, #share{has_world = false}) ->
    true;
takes_event(Machine, IsEnd, #share{of_world = OfWorld}) ->
    (Machine =:= chassis orelse IsEnd) =:= OfWorld.

%% Counts of one robot do not add up to those of the team.
takes(Topic, _Share) when Topic =:= scenario; Topic =:= metrics -> false;
takes(gap, _Share) -> true;
takes(_Topic, #share{has_world = false}) -> true;
takes(Topic, #share{of_world = true}) -> lists:member(Topic, [poses, faults, verdicts]);
takes(Topic, #share{of_world = false}) -> not lists:member(Topic, [poses, faults, verdicts]).
