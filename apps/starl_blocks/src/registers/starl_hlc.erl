%% @doc A hybrid logical clock (Kulkarni, Demirbas et al., "Logical physical clocks", 2014).
%%
%% A stamp has three parts: a time that is not behind the own clock nor any stamp seen, a counter
%% within that time, and the writer. So no two stamps are equal, and all are ordered by Erlang's
%% order of terms. A robot that has lived before may have forgotten what it wrote, and go on from an
%% earlier stamp of its own that it sees elsewhere. So the writer includes the life, too. A clock
%% accepts no stamp that is more than its bound ahead of the own physical clock, so its time is
%% never further ahead. After a stamp with the largest counter that a message can hold comes a stamp
%% of the next microsecond. A clock that starts ahead by the bound ({@link after_restart/4}) is
%% later than all stamps that it gave before, although it has stored nothing.
-module(starl_hlc).

-export([new/2, after_restart/4, restart/2, stamp/2, observe/3, admits/3, now/1, robot/1]).
-export([is_beyond/3, is_ahead/2]).

-export_type([t/0, stamp/0, writer/0]).

%% Time (us), counter, writer; compared in this order.
-type stamp() :: {TimeUs :: integer(), Counter :: non_neg_integer(), writer()}.
%% A robot in its first life, or in a later one.
-type writer() :: starl:robot_id() | {starl:robot_id(), Life :: pos_integer()}.

%% The largest counter of a stamp: one of 128 bits ({@link starl_shape}).
-define(MOST, (1 bsl 128 - 1)).

-record(hlc, {
    writer :: writer(),
    ahead_us :: non_neg_integer(),
    time :: integer() | beginning,
    counter = 0 :: non_neg_integer()
}).

-opaque t() :: #hlc{}.

%% @doc The clock of a writer that has given no stamp before. `AheadUs': the most by which stamps may
%% be ahead of its physical clock.
-spec new(writer(), AheadUs :: non_neg_integer()) -> t().
new(Writer, AheadUs) -> #hlc{writer = Writer, ahead_us = AheadUs, time = beginning}.

%% @doc The clock of a robot that has forgotten its own, at this time of its physical clock: all
%% its stamps will be later than those before. `Start' counts the starts; it keeps two restarts
%% within one microsecond apart.
-spec after_restart(
    writer(), AheadUs :: non_neg_integer(), NowUs :: integer(), Start :: pos_integer()
) -> t().
after_restart(Writer, AheadUs, Now, Start) ->
    #hlc{writer = Writer, ahead_us = AheadUs, time = Now + AheadUs + 1, counter = Start bsl 32}.

%% @doc A new stamp, later than all that this clock has given or observed.
-spec stamp(NowUs :: integer(), t()) -> {stamp(), t()}.
stamp(Now, #hlc{writer = Writer} = Clock0) ->
    Clock = advance(Now, Clock0),
    {{Clock#hlc.time, Clock#hlc.counter, Writer}, Clock}.

%% @doc Takes note of a stamp from elsewhere; it must be one that the clock {@link admits/3}.
-spec observe(stamp(), NowUs :: integer(), t()) -> t().
observe({Time, Counter, _}, _Now, #hlc{time = beginning} = Clock) ->
    Clock#hlc{time = Time, counter = Counter};
observe({Time, Counter, _}, _Now, #hlc{time = Own} = Clock) when Time > Own ->
    Clock#hlc{time = Time, counter = Counter};
observe({Time, Counter, _}, _Now, #hlc{time = Time, counter = Own} = Clock) ->
    Clock#hlc{counter = max(Counter, Own)};
observe(_Earlier, _Now, Clock) ->
    Clock.

%% @doc Is the stamp not too far ahead?
-spec admits(stamp(), NowUs :: integer(), t()) -> boolean().
admits({Time, _, _}, Now, #hlc{ahead_us = Ahead}) -> Time =< Now + Ahead.

%% @doc Is the stamp so far ahead that no clocks within their bound explain it? A clock that has forgotten
%% its own starts ahead by the bound, and another one may be behind it by the bound.
-spec is_beyond(stamp(), NowUs :: integer(), t()) -> boolean().
is_beyond({Time, _, _}, Now, #hlc{ahead_us = Ahead}) -> Time > Now + 2 * Ahead + 1.

%% @doc Are all stamps that this clock will give so far ahead of the physical clock?
-spec is_ahead(NowUs :: integer(), t()) -> boolean().
is_ahead(_Now, #hlc{time = beginning}) ->
    false;
is_ahead(Now, #hlc{time = Time, writer = Writer} = Clock) ->
    is_beyond({Time, 0, Writer}, Now, Clock).

%% @doc The clock of the same writer, later than these stamps only.
-spec restart([stamp()], t()) -> t().
restart(Stamps, #hlc{writer = Writer, ahead_us = Ahead}) ->
    lists:foldl(fun(Stamp, Clock) -> observe(Stamp, 0, Clock) end, new(Writer, Ahead), Stamps).

%% @doc The time of the clock, for inspection.
-spec now(t()) -> integer() | beginning.
now(#hlc{time = Time}) -> Time.

%% @doc The robot that gave the stamp.
-spec robot(stamp()) -> starl:robot_id().
robot({_, _, {Robot, _Life}}) -> Robot;
robot({_, _, Robot}) -> Robot.

advance(Now, #hlc{time = beginning} = Clock) ->
    Clock#hlc{time = Now};
advance(Now, #hlc{time = Time} = Clock) when Now > Time -> Clock#hlc{time = Now, counter = 0};
advance(_Now, #hlc{time = Time, counter = Counter} = Clock) when Counter >= ?MOST ->
    Clock#hlc{time = Time + 1, counter = 0};
advance(_Now, #hlc{counter = Counter} = Clock) ->
    Clock#hlc{counter = Counter + 1}.
