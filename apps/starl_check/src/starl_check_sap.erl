%% @doc A model of SAP by its contract. It replaces the machine {@link starl_sap} when other blocks
%% are checked. A message is delivered at most once, and its source hears that it was acknowledged,
%% lost, or refused by a restarted receiver. A message reported lost may have been delivered, or may
%% be delivered later.
%%
%% This is the local part of one robot: its listeners, the messages that wait for a listener, and
%% the calls that wait for an outcome. The messages under way belong to {@link starl_check_state}.
-module(starl_check_sap).

-export([new/0, request/5, deliver/4, acknowledge/3, refuse/3, delay/2, settle/3, calls/1]).

-export_type([t/0, ref/0, call/0]).

%% The number of a call that waits for its outcome: the lowest free one, so that equal situations
%% are equal terms.
-type ref() :: pos_integer().

%% The state of a call's message: the receivers that lack it, those that have it, those that refused
%% it; and whether the answer is slow.
-type call() :: {
    ref(),
    Open :: [starl:robot_id()],
    Reached :: [starl:robot_id()],
    Refused :: [starl:robot_id()],
    IsSlow :: boolean()
}.

%% The service knows the outcome at a receiver at once. The caller hears of it later, when the
%% outcomes at all receivers are known.
-record(call, {
    from :: starl_machine:from(),
    open :: [starl:robot_id()],
    reached = [] :: [starl:robot_id()],
    refused = [] :: [starl:robot_id()],
    broadcast :: boolean(),
    slow = false :: boolean()
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

%% @doc Handles a request of a machine; gives events for the robot's machines and messages to send.
-spec request(
    Request :: tuple(),
    starl_machine:from() | none,
    starl:robot_id(),
    [starl:robot_id()],
    t()
) ->
    {[starl_robot:local()], [{starl:robot_id(), atom(), term(), ref() | none}], t()}.
request({listen, Type, Machine}, none, _Self, _Others, #sap{} = Sap) ->
    #sap{listeners = Listeners, unclaimed = Unclaimed} = Sap,
    {Mine, Rest} = lists:partition(fun({_, T, _}) -> T =:= Type end, Unclaimed),
    Heard = [message(Machine, Source, Type, Body) || {Source, _, Body} <- lists:reverse(Mine)],
    {Heard, [], Sap#sap{listeners = Listeners#{Type => Machine}, unclaimed = Rest}};
request({send, Self, Type, Body}, From, Self, _Others, Sap) ->
    {Heard, Delivered} = deliver(Self, Type, Body, Sap),
    {Heard ++ answer(From, ok), [], Delivered};
request({send, To, Type, Body}, From, _Self, Others, Sap) ->
    case lists:member(To, Others) of
        true -> put_under_way([To], Type, Body, From, false, Sap);
        %% the team has no such robot
        false -> {answer(From, {error, {lost, [To]}}), [], Sap}
    end;
request({send, To, Type, Body, _Until}, From, Self, Others, Sap) ->
    request({send, To, Type, Body}, From, Self, Others, Sap);
request({shout, Type, Body, _Until}, none, Self, Others, Sap) ->
    request({shout, Type, Body}, none, Self, Others, Sap);
request({shout, Type, Body}, none, _Self, Others, Sap) ->
    put_under_way(Others, Type, Body, none, true, Sap);
request({broadcast, Type, Body}, From, _Self, Others, Sap) ->
    put_under_way(Others, Type, Body, From, true, Sap).

put_under_way([], _Type, _Body, From, _Broadcast, Sap) ->
    {answer(From, ok), [], Sap};
put_under_way(Dests, Type, Body, none, _Broadcast, Sap) ->
    {[], [{Dest, Type, Body, none} || Dest <- Dests], Sap};
put_under_way(Dests, Type, Body, From, Broadcast, #sap{calls = Calls} = Sap) ->
    Ref = lowest(1, Calls),
    Call = #call{from = From, open = Dests, broadcast = Broadcast},
    {[], [{Dest, Type, Body, Ref} || Dest <- Dests], Sap#sap{calls = Calls#{Ref => Call}}}.

lowest(Ref, Calls) when is_map_key(Ref, Calls) -> lowest(Ref + 1, Calls);
lowest(Ref, _Calls) -> Ref.

%% @doc A message arrives.
-spec deliver(starl:robot_id(), atom(), Body :: term(), t()) -> {[starl_robot:local()], t()}.
deliver(Source, Type, Body, #sap{listeners = Listeners, unclaimed = Unclaimed} = Sap) ->
    case Listeners of
        #{Type := Machine} -> {[message(Machine, Source, Type, Body)], Sap};
        #{} -> {[], Sap#sap{unclaimed = [{Source, Type, Body} | Unclaimed]}}
    end.

message(Machine, Source, Type, Body) -> {Machine, cast, {message, Source, Type, Body}}.

%% @doc The message of a call has reached a receiver.
-spec acknowledge(ref(), starl:robot_id(), t()) -> t().
acknowledge(Ref, Dest, Sap) ->
    #call{open = Open, reached = Reached} = Call = call(Ref, Sap),
    put_call(
        Ref,
        Call#call{
            open = lists:delete(Dest, Open), reached = lists:sort([Dest | Reached])
        },
        Sap
    ).

%% @doc A receiver that has restarted refuses the message of a call.
-spec refuse(ref(), starl:robot_id(), t()) -> t().
refuse(Ref, Dest, Sap) ->
    #call{open = Open, refused = Refused} = Call = call(Ref, Sap),
    put_call(
        Ref,
        Call#call{
            open = lists:delete(Dest, Open), refused = lists:sort([Dest | Refused])
        },
        Sap
    ).

%% @doc The answer to a call is slow.
-spec delay(ref(), t()) -> t().
delay(Ref, Sap) -> put_call(Ref, (call(Ref, Sap))#call{slow = true}, Sap).

%% @doc The caller hears the outcome of its message; at these receivers it is reported lost.
-spec settle(ref(), Lost :: [starl:robot_id()], t()) -> {[starl_robot:local()], t()}.
settle(Ref, Lost, #sap{calls = Calls} = Sap) ->
    #call{from = From} = Call = call(Ref, Sap),
    {answer(From, result(Call, Lost)), Sap#sap{calls = maps:remove(Ref, Calls)}}.

result(#call{refused = []}, []) ->
    ok;
result(#call{broadcast = true, refused = Refused}, Lost) ->
    {error, {lost, lists:usort(Refused ++ Lost)}};
result(#call{refused = []}, [_]) ->
    {error, lost};
result(#call{refused = [_]}, []) ->
    {error, restarted}.

%% @doc The calls that wait for an answer, by their numbers.
-spec calls(t()) -> [call()].
calls(#sap{calls = Calls}) ->
    [
        {Ref, Open, Reached, Refused, Slow}
     || {Ref, #call{open = Open, reached = Reached, refused = Refused, slow = Slow}} <-
            lists:sort(maps:to_list(Calls))
    ].

call(Ref, #sap{calls = Calls}) -> maps:get(Ref, Calls).

put_call(Ref, Call, #sap{calls = Calls} = Sap) -> Sap#sap{calls = Calls#{Ref := Call}}.

answer(none, _Answer) -> [];
answer({To, Tag}, Answer) -> [{To, {reply, Tag}, Answer}].
