%% @doc Estimates how far a sender's clock is apart from ours, by messages that carry the time at
%% which they were sent. A message arrives after it was sent. So the least difference between arrival
%% and sending time is the offset; it is too large by at most the delay of the fastest message. A pure
%% module; times in microseconds.
%%
%% Clocks drift apart, so differences that are older than two windows no longer count.
-module(starl_live_clock_offset).

-export([new/0, add/4, ours/3, is_off/4]).

-export_type([t/0]).

%% The least differences in this window, which began at a time of ours, and in the one before it.
-opaque t() :: none | {SinceUs :: integer(), Least :: integer(), Before :: integer() | none}.

%% @doc Nothing is known.
-spec new() -> t().
new() -> none.

%% @doc A message that was sent at a time of the sender's clock has arrived at a time of ours. After a
%% pause the window before it still counts: if the clocks have drifted apart since, messages are
%% rather taken for too old.
-spec add(TheirUs :: integer(), OurUs :: integer(), WindowUs :: pos_integer(), t()) -> t().
add(Their, Our, _Window, none) ->
    {Our, Our - Their, none};
add(Their, Our, Window, {Since, Least, _Before}) when Our - Since >= Window ->
    {Our, Our - Their, Least};
add(Their, Our, _Window, {Since, Least, Before}) ->
    {Since, min(Our - Their, Least), Before}.

%% @doc When a message was sent, by our clock; it has arrived at a time of ours. As long as nothing is
%% known, it was sent when it arrived.
-spec ours(TheirUs :: integer(), OurUs :: integer(), t()) -> integer().
ours(_Their, Our, none) -> Our;
ours(Their, Our, Known) -> min(Our, Their + offset(Known)).

%% An atom is greater than any number.
offset({_Since, Least, Before}) -> min(Least, Before).

%% @doc Whether a message was sent so long before its arrival, or so long after it, that a clock was
%% set.
-spec is_off(TheirUs :: integer(), OurUs :: integer(), MostUs :: pos_integer(), t()) -> boolean().
is_off(_Their, _Our, _Most, none) -> false;
is_off(Their, Our, Most, Known) -> abs(Our - Their - offset(Known)) > Most.
