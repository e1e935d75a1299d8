%% @doc Records which packets the radio has lost, and when; it judges nothing. Its result `lost'
%% lists them in the order of time.
-module(starl_run_loss_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-export_type([lost/0]).

%% A packet lost at a time (us): its source and destination, and its number among those on this link, or among
%% those to all.
-type lost() :: {
    non_neg_integer(),
    Source :: starl:robot_id(),
    Dest :: starl:robot_id(),
    Number :: pos_integer() | {all, pos_integer()}
}.

-spec interests() -> [radio].
interests() -> [radio].

-spec init(map()) -> [lost()].
init(#{}) -> [].

-spec step(starl_monitor:trace_event(), [lost()]) -> {ok, [lost()]}.
step({Time, Source, radio, {lost, Dest, Number}}, Lost) ->
    {ok, [{Time, Source, Dest, Number} | Lost]};
step({_Time, _Robot, radio, _Other}, Lost) ->
    {ok, Lost}.

-spec finish(integer(), [lost()]) -> {ok, #{lost := [lost()]}}.
finish(_EndUs, Lost) -> {ok, #{lost => lists:reverse(Lost)}}.
