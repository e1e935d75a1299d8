%% @doc SAP as its contract states it, in the place of the machine {@link starl_sap}: what the
%% other blocks are checked over. A message is delivered at most once, and its source hears that
%% it was acknowledged, lost or refused by a restarted receiver; lost says nothing about whether
%% it was delivered or will be.
%%
%% This is the local part of one robot: its listeners, the messages that wait for one, and its
%% calls that wait for an outcome. What is under way is the checker's ({@link starl_check_state}).
-module(starl_check_sap).

-export([new/0, request/5, deliver/4, settle/4]).

-export_type([t/0, ref/0, outcome/0]).

%% The number of a call that waits for its outcome; the lowest that is free, so that the same
%% situation is the same term however it came about.
-type ref() :: pos_integer().

-type outcome() :: acknowledged | lost | restarted.

-record(call, {
    from :: starl_machine:from(),
    waiting :: [starl:robot_id()],
    lost = [] :: [starl:robot_id()],
    broadcast :: boolean()
}).

-record(sap, {
    listeners = #{} :: #{atom() => starl_machine:name()},
    unclaimed = [] :: [{starl:robot_id(), atom(), term()}],
    calls = #{} :: #{ref() => #call{}}
}).

-opaque t() :: #sap{}.

%% @doc A service that has just started.
-spec new() -> t().
new() -> #sap{}.

%% @doc What a machine of the robot asks for: events for its machines, messages to put under way.
-spec request(Request :: tuple(), starl_machine:from() | none, starl:robot_id(),
    [starl:robot_id()], t()) ->
    {[starl_platform:local()], [{starl:robot_id(), atom(), term(), ref() | none}], t()}.
request({listen, Type, Machine}, none, _Self, _Others, #sap{} = Sap) ->
    #sap{listeners = Listeners, unclaimed = Unclaimed} = Sap,
    {Mine, Rest} = lists:partition(fun({_, T, _}) -> T =:= Type end, Unclaimed),
    Heard = [message(Machine, Source, Type, Body) || {Source, _, Body} <- lists:reverse(Mine)],
    {Heard, [], Sap#sap{listeners = Listeners#{Type => Machine}, unclaimed = Rest}};
request({send, Self, Type, Body}, From, Self, _Others, Sap) ->
    {Heard, Delivered} = deliver(Self, Type, Body, Sap),
    {Heard ++ answer(From, ok), [], Delivered};
request({send, To, Type, Body}, From, _Self, _Others, Sap) ->
    put_under_way([To], Type, Body, From, false, Sap);
request({broadcast, Type, Body}, From, _Self, Others, Sap) ->
    put_under_way(Others, Type, Body, From, true, Sap).

put_under_way([], _Type, _Body, From, _Broadcast, Sap) ->
    {answer(From, ok), [], Sap};
put_under_way(Dests, Type, Body, none, _Broadcast, Sap) ->
    {[], [{Dest, Type, Body, none} || Dest <- Dests], Sap};
put_under_way(Dests, Type, Body, From, Broadcast, #sap{calls = Calls} = Sap) ->
    Ref = lowest(1, Calls),
    Call = #call{from = From, waiting = Dests, broadcast = Broadcast},
    {[], [{Dest, Type, Body, Ref} || Dest <- Dests], Sap#sap{calls = Calls#{Ref => Call}}}.

lowest(Ref, Calls) when is_map_key(Ref, Calls) -> lowest(Ref + 1, Calls);
lowest(Ref, _Calls) -> Ref.

%% @doc A message has come.
-spec deliver(starl:robot_id(), atom(), Body :: term(), t()) -> {[starl_platform:local()], t()}.
deliver(Source, Type, Body, #sap{listeners = Listeners, unclaimed = Unclaimed} = Sap) ->
    case Listeners of
        #{Type := Machine} -> {[message(Machine, Source, Type, Body)], Sap};
        #{} -> {[], Sap#sap{unclaimed = [{Source, Type, Body} | Unclaimed]}}
    end.

message(Machine, Source, Type, Body) -> {Machine, cast, {message, Source, Type, Body}}.

%% @doc The outcome of a call's message to one of its receivers.
-spec settle(ref(), starl:robot_id(), outcome(), t()) -> {[starl_platform:local()], t()}.
settle(Ref, Dest, Outcome, #sap{calls = Calls} = Sap) ->
    #{Ref := #call{waiting = Waiting, lost = Lost} = Call} = Calls,
    Settled = Call#call{
        waiting = lists:delete(Dest, Waiting),
        lost = lists:sort([Dest || Outcome =/= acknowledged] ++ Lost)
    },
    case Settled#call.waiting of
        [] -> {answer(Call#call.from, result(Settled, Outcome)), forget(Ref, Sap)};
        _ -> {[], Sap#sap{calls = Calls#{Ref := Settled}}}
    end.

forget(Ref, #sap{calls = Calls} = Sap) -> Sap#sap{calls = maps:remove(Ref, Calls)}.

result(#call{lost = []}, _Outcome) -> ok;
result(#call{broadcast = true, lost = Lost}, _Outcome) -> {error, {lost, Lost}};
result(#call{}, Outcome) -> {error, Outcome}.

answer(none, _Answer) -> [];
answer({To, Tag}, Answer) -> [{To, {reply, Tag}, Answer}].
