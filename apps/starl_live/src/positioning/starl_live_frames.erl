%% @doc Decides the order and the age of a source's pictures, from their numbers and the source's
%% own times.
%%
%% <em>Order.</em> A picture counts only if it is newer than all before it: its number is higher, and
%% so is its time, where it has one. Datagrams overtake each other, and are doubled; a source that is
%% stuck sends its last picture again and again. None of that renews the age of a pose. A picture may
%% come in several datagrams of the same number; each shows other robots.
%%
%% <em>A source that was started anew</em> counts from zero again. So an older picture is believed
%% under two conditions: the source has shown nothing newer for a second, and a second picture
%% follows that is newer than this picture.
%%
%% <em>Age.</em> The clock of a source need not agree with ours. The fastest datagram of the last five
%% to ten seconds shows how far the two are apart ({@link starl_live_clock_offset}). A datagram that
%% was delayed, or waited until it was read, is that much older than its arrival. A picture without a
%% time is as old as its arrival, plus the source's latency. All times here are system time in
%% microseconds.
-module(starl_live_frames).

-export([new/0, picture/3]).

-export_type([t/0, picture/1, order/0]).

%% A picture as it arrives: its number, its time by the source's clock, and the time that had passed
%% since the cameras took it. Both `none': each picture is a new one.
-type picture(Pose) :: #{
    number := integer() | none,
    time_us := integer() | none,
    age_us := non_neg_integer(),
    poses := [{starl:robot_id(), Pose}]
}.

%% The next picture; a part of the same picture; an earlier one or a source that starts anew.
-type order() :: new | same | old.

%% The time after which an older picture may be that of a source that was started anew; half the time
%% for which the fastest datagram is remembered.
-define(ANEW_US, 1000000).
-define(WINDOW_US, 5000000).

-record(frames, {
    %% the newest picture's number and time, when it arrived, and the robots that it has shown
    newest = none :: {integer() | none, integer() | none} | none,
    arrived_us = 0 :: integer(),
    shown = [] :: [starl:robot_id()],
    %% an older picture that came when the source had been silent for long enough
    anew = none :: {integer() | none, integer() | none} | none,
    offset = starl_live_clock_offset:new() :: starl_live_clock_offset:t()
}).

-opaque t() :: #frames{}.

%% @doc Nothing has arrived yet.
-spec new() -> t().
new() -> #frames{}.

%% @doc The robots that a picture shows anew, each with the time at which it was there.
-spec picture(picture(Pose), ArrivedUs :: integer(), t()) ->
    {order(), [{starl:robot_id(), Pose, TakenUs :: integer()}], t()}
when
    Pose :: term().
picture(#{number := Number, time_us := Time} = Picture, Arrived, Frames) ->
    case order({Number, Time}, Arrived, Frames) of
        old -> {old, [], older({Number, Time}, Arrived, Frames)};
        same -> shown(same, Picture, Arrived, Frames);
        new -> shown(new, Picture, Arrived, newer({Number, Time}, Arrived, Frames));
        anew -> shown(new, Picture, Arrived, newer({Number, Time}, Arrived, new()))
    end.

order(_, _, #frames{newest = none}) ->
    new;
order(This, Arrived, #frames{newest = Newest, anew = Anew} = Frames) ->
    case {compare(This, Newest), is_silent(Arrived, Frames), Anew} of
        {old, true, Earlier} when Earlier =/= none -> anew(compare(This, Earlier));
        {Order, _, _} -> Order
    end.

anew(new) -> anew;
anew(_) -> old.

%% A new number with an old time is a source that has stopped behind its counter.
compare({none, none}, _) -> new;
compare({Number, _}, {Number, _}) when Number =/= none -> same;
compare({Number, _}, {Last, _}) when Number < Last -> old;
compare({_, Time}, {_, Last}) when is_integer(Time), is_integer(Last), Time =< Last -> old;
compare(_, _) -> new.

is_silent(Arrived, #frames{arrived_us = Last}) -> Arrived - Last > ?ANEW_US.

older(This, Arrived, Frames) ->
    case is_silent(Arrived, Frames) of
        true -> Frames#frames{anew = This};
        false -> Frames
    end.

%% Only a new picture counts for the offset: one that is repeated has been under way for ever longer.
newer({_, Time} = This, Arrived, #frames{offset = Before}) ->
    Offset =
        case Time of
            none -> Before;
            _ -> starl_live_clock_offset:add(Time, Arrived, ?WINDOW_US, Before)
        end,
    #frames{newest = This, arrived_us = Arrived, offset = Offset}.

%% A part of a picture may have its time where the others have none.
shown(Order, #{time_us := Time, age_us := Age, poses := Poses}, Arrived, Frames) ->
    #frames{shown = Shown, offset = Offset} = Frames,
    Sent =
        case Time of
            none -> Arrived;
            _ -> starl_live_clock_offset:ours(Time, Arrived, Offset)
        end,
    Fresh = [{Robot, Pose} || {Robot, Pose} <- Poses, not lists:member(Robot, Shown)],
    Next = Frames#frames{shown = [Robot || {Robot, _} <- Fresh] ++ Shown},
    {Order, [{Robot, Pose, Sent - Age} || {Robot, Pose} <- Fresh], Next}.
