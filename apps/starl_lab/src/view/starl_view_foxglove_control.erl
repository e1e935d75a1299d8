%% @doc Notifies a viewer that controls the time of a run. It reports how the run goes, whenever
%% that changes, and the results of the viewer's requests. A viewer that has requested nothing gets
%% no message, because older viewers take such messages for errors. A pure module.
-module(starl_view_foxglove_control).

-export([new/0, asked/3, clock/2]).

-export_type([t/0]).

%% How near to the time that it was to be taken to a run must be; after so many clocks it has not come.
-define(NEAR_US, 20000).
-define(FAR_US, 2000000).
-define(PATIENCE, 200).
%% As fast as it can.
-define(MAX_SPEED, 1000).

-record(control, {
    told = none :: none | {Status :: atom(), Speed :: number()},
    request = none :: none | {Id :: binary(), SeekUs :: integer() | none, Clocks :: integer()}
}).

-opaque t() :: #control{}.

%% @doc A viewer that has asked for nothing.
-spec new() -> t().
new() -> #control{}.

%% @doc The viewer asks for something, such as another time of the run.
-spec asked(Id :: binary(), SeekUs :: integer() | none, t()) -> t().
asked(Id, Seek, Control) -> Control#control{request = {Id, Seek, ?PATIENCE}}.

%% @doc The notification for the viewer at this clock.
-spec clock(#{now_us := integer(), atom() => term()}, t()) ->
    {none | starl_view_foxglove_words:playback(), t()}.
clock(_Clock, #control{told = none, request = none} = Control) ->
    {none, Control};
clock(#{now_us := Now} = Clock, #control{told = Told, request = Request} = Control) ->
    Goes = {status(Clock), speed(Clock)},
    case answer(Now, Request) of
        {wait, Waiting} -> {none, Control#control{request = Waiting}};
        none when Goes =:= Told -> {none, Control};
        none -> {playback(Goes, Now, {<<>>, false}), Control#control{told = Goes}};
        {_, _} = Answer -> {playback(Goes, Now, Answer), #control{told = Goes}}
    end.

playback({Status, Speed}, Now, {Id, Seeked}) ->
    #{status => Status, now_us => Now, speed => Speed, seeked => Seeked, id => Id}.

%% A request for another time is answered when the run is there, or does not get there.
answer(_Now, none) ->
    none;
answer(_Now, {Id, none, _}) ->
    {Id, false};
answer(Now, {Id, Seek, Clocks}) when
    Clocks > 0, (Now < Seek - ?NEAR_US orelse Now > Seek + ?FAR_US)
->
    {wait, {Id, Seek, Clocks - 1}};
answer(_Now, {Id, _, Clocks}) ->
    {Id, Clocks > 0}.

status(#{ending := Ending}) when Ending =/= null, Ending =/= none -> ended;
status(#{paused := true}) -> paused;
status(_) -> playing.

speed(#{speed := Speed}) when is_number(Speed) -> Speed;
speed(_) -> ?MAX_SPEED.
