%% @doc The timers of a live robot, by their marks. The link gets a message when a timer is due.
-module(starl_live_timers).

-export([new/0, plan/4, due_us/3]).

-export_type([t/0, timer/0]).

%% A machine's timer, its time from now on, and its event.
-type timer() ::
    {starl_machine:name(), starl_robot_timers:timer(), Us :: non_neg_integer(), Content :: term()}.

-record(timers, {
    next = 0 :: non_neg_integer(),
    dues = #{} :: #{starl_robot_timers:mark() => DueUs :: integer()}
}).

-opaque t() :: #timers{}.

%% @doc None.
-spec new() -> t().
new() -> #timers{}.

%% @doc Plans a timer's event: this process gets `{timeout, _, {starl_timer, Name, Timer, Mark,
%% Content}}'. The time is rounded up to a millisecond.
-spec plan(timer(), NowUs :: integer(), starl_live_clock:t(), t()) ->
    {starl_robot_timers:mark(), t()}.
plan({Name, Timer, Us, Content}, Now, Clock, #timers{next = Mark, dues = Dues}) ->
    Due = starl_live_clock:monotonic_ms(Now + Us, Clock),
    Message = {starl_timer, Name, Timer, Mark, Content},
    At = max(Due, starl_live_clock:monotonic_time(millisecond, Clock)),
    _ = starl_live_clock:start_timer(At, Message, [{abs, true}], Clock),
    {Mark, #timers{next = Mark + 1, dues = Dues#{Mark => Now + Us}}}.

%% @doc When the first of these timers, which run, was due; the present time, if none is. All others are
%% forgotten.
-spec due_us([starl_robot_timers:mark()], NowUs :: integer(), t()) -> {DueUs :: integer(), t()}.
due_us(Running, Now, #timers{dues = Dues} = Timers) ->
    Left = maps:with(Running, Dues),
    {lists:min([Now | maps:values(Left)]), Timers#timers{dues = Left}}.
