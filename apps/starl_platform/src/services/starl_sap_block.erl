%% @doc Declares reliable messages as a block. Every robot has the service SAP, and its contract
%% judges every run, so no application lists this block; it is exercised and checked like the
%% others.
-module(starl_sap_block).
-behaviour(starl_block).

-export([
    options/0, machines/1, monitors/2, everywhere/0, guarantees/0, contract/0, exercise/0, models/0
]).

-spec options() -> [starl_options:option()].
options() -> [].

-spec machines(starl_block:options()) -> [].
machines(_Options) -> [].

-spec monitors(starl_block:options(), starl_block:context()) -> [].
monitors(_Options, _Context) -> [].

-spec everywhere() -> [module()].
everywhere() -> [starl_sap_monitor].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {once, safety,
            "delivered at most once per receiver, never changed, never to the wrong type of listener",
            []},
        {told, safety,
            "a lost report after the last retransmission (a message reported lost may have been "
            "delivered all the same)", []},
        {read, safety, "an application can read every acknowledged message", [no_restart]},
        {others, safety, "a dead robot delays no other; memory is bounded", []},
        {outcome, progress, "delivered, or reported lost, in bounded time", [clock_rate, prompt]},
        {delivered, progress, "delivered, where packets get through", [delivery]}
    ].

-spec contract() -> string().
contract() ->
    "a message is delivered at most once, as it was sent, or reported lost; judged in every run".

-spec exercise() -> module().
exercise() -> starl_sap_exercise.

-spec models() -> [starl_block:model_entry()].
models() -> [{sap, "reliable messages, packet by packet", fun model/1}].

%% The first robot sends to the second, the second to all; one retransmission.
model(#{robots := Ids}) ->
    #{
        sap => real,
        blocks => [{sap, starl_sap, #{limit => 1}}],
        script => fun(Place) -> script(Place, Ids) end,
        monitor => {starl_sap_monitor, #{bound_us => 1}},
        fixed => lists:seq(1, length(Ids))
    }.

script(1, [_, To | _]) ->
    [{listen, note}, {'try', sap, {send, To, note, a}}, {'try', sap, {send, To, note, b}}];
script(2, _Ids) ->
    [{listen, note}, {'try', sap, {broadcast, note, c}}];
script(_, _Ids) ->
    [{listen, note}].
