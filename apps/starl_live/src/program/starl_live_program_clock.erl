%% @doc Estimates the difference between a program's clock and the robot's clock. A line arrives
%% after it was sent. So the least difference between arrival and sending time is the shift of the
%% clocks; it is too large by at most the delay of the quickest line. A pure module; times in
%% microseconds.
%%
%% Clocks drift apart, so differences that are older than two spans no longer count.
-module(starl_live_program_clock).

-export([new/0, said/3]).

-export_type([t/0]).

-define(SPAN_US, 10000000).
%% A line that was said so long ago, or not yet, tells of a clock that was set.
-define(SET_US, 2000000).

%% The least differences in this span and in the one before it, and since when this one is.
-opaque t() :: none | {Least :: integer(), Before :: integer(), SinceUs :: integer()}.

%% @doc Nothing is known.
-spec new() -> t().
new() -> none.

%% @doc When something was said, by the robot's clock: at this time of the program's clock, and it has come
%% now. What bears no time was said when it came.
-spec said(At :: number() | none, NowUs :: integer(), t()) -> {Us :: integer(), t()}.
said(none, Now, Clock) ->
    {Now, Clock};
said(At, Now, none) ->
    {Now, {Now - round(At), Now - round(At), Now}};
said(At, Now, {Least, Before, Since}) ->
    Apart = Now - round(At),
    Shift = min(Least, Before),
    case Apart - Shift of
        Late when Late > ?SET_US; Late < -?SET_US -> said(At, Now, none);
        _ when Now - Since > ?SPAN_US -> known(At, Now, {Apart, Least, Now});
        _ -> known(At, Now, {min(Apart, Least), Before, Since})
    end.

known(At, Now, {Least, Before, _Since} = Clock) ->
    {min(Now, round(At) + min(Least, Before)), Clock}.
