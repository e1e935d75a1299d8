%% @doc Finds out what a Create 1 does at a wait for no time: is it over at once, or at the robot's next
%% look, 15 ms later? The document does not say. By waits of 15 ms a robot without a computer stops
%% sooner than by those of 100 ms ({@link starl_create_script}).
%%
%% The robot is asked for a byte after a number of such waits. A computer that is busy hears the answer later,
%% so only an answer in time counts.
-module(starl_create_waits).

-export([measure/1, judge/1, line/1]).

-define(WAITS, 20).
-define(LOOK_MS, 15).
-define(ASK_MS, 900).
%% Of an answer in time, in looks.
-define(LATE, 6).
-define(TRIES, 3).

%% @doc The waits of this robot.
-spec measure(starl_create_probe:t()) -> starl_create_script:waits().
measure(Probe) -> measure(Probe, ?TRIES).

measure(_Probe, 0) ->
    long;
measure(Probe, Tries) ->
    case judge(answer_ms(Probe)) of
        unclear -> measure(Probe, Tries - 1);
        Waits -> Waits
    end.

answer_ms(Probe) ->
    ok = starl_create_probe:quiet(Probe),
    Begin = erlang:monotonic_time(millisecond),
    Question = [binary:copy(<<155, 0>>, ?WAITS), 142, 35],
    case starl_create_probe:ask(Probe, Question, 1, ?ASK_MS) of
        {ok, _} -> erlang:monotonic_time(millisecond) - Begin;
        none -> none
    end.

%% @doc What the time to the answer says. Before it is asked, the line has been quiet for a while.
-spec judge(Ms :: non_neg_integer() | none) -> starl_create_script:waits() | unclear.
judge(Ms) when is_integer(Ms) ->
    case (Ms - starl_create_probe:quiet_ms()) / ?LOOK_MS of
        Looks when Looks < ?WAITS div 2 -> long;
        Looks when Looks >= ?WAITS - 1, Looks < ?WAITS + ?LATE -> short;
        _ -> unclear
    end;
judge(none) ->
    unclear.

%% @doc What they mean.
-spec line(starl_create_script:waits()) -> string().
line(short) ->
    "of 15 ms: without its computer it stops within 100 ms, if the driver is told (short_waits)";
line(long) ->
    "of 100 ms only: without its computer it stops within 165 ms".
