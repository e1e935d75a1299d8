%% @doc Measures how long a Create 1 waits when a script asks for a wait of zero length. The wait
%% may end at once, or up to 15 ms later, at the robot's next sensor check. The document does not
%% say. With waits of 15 ms, a robot that has lost its computer stops sooner than with those of 100
%% ms ({@link starl_create_script}).
%%
%% The robot is asked for a byte after a number of such waits. A busy computer receives the answer
%% late, so only an answer in time counts. Two different numbers of waits must be answered in time:
%% a delay that is the same for both can make at most one of them look right. An answer that is
%% early cannot come from a robot that waits.
-module(starl_create_waits).

-export([measure/1, found/1, judge/2, line/1]).

-define(NUMBERS, [20, 10]).
-define(LOOK_MS, 15).
-define(ASK_MS, 900).
%% Of an answer in time, in looks.
-define(LATE, 6).
-define(TRIES, 3).

%% @doc The waits of this robot.
-spec measure(starl_create_probe:t()) -> starl_create_script:waits().
measure(Probe) -> found(fun(Number) -> answer_ms(Number, Probe) end).

%% @doc The waits of a robot, from the times of its answers after given numbers of waits.
-spec found(AnswerMs :: fun((Number :: pos_integer()) -> non_neg_integer() | none)) ->
    starl_create_script:waits().
found(AnswerMs) -> found(?NUMBERS, ?TRIES, AnswerMs).

found([], _Tries, _AnswerMs) ->
    short;
found(_Numbers, 0, _AnswerMs) ->
    long;
found([Number | Others] = Numbers, Tries, AnswerMs) ->
    case judge(Number, AnswerMs(Number)) of
        unclear -> found(Numbers, Tries - 1, AnswerMs);
        short -> found(Others, ?TRIES, AnswerMs);
        long -> long
    end.

answer_ms(Number, Probe) ->
    ok = starl_create_probe:quiet(Probe),
    Begin = erlang:monotonic_time(millisecond),
    Question = [binary:copy(<<155, 0>>, Number), 142, 35],
    case starl_create_probe:ask(Probe, Question, 1, ?ASK_MS) of
        {ok, _} -> erlang:monotonic_time(millisecond) - Begin;
        none -> none
    end.

%% @doc What the time to the answer says. Before it is asked, the line has been quiet for a while.
-spec judge(Number :: pos_integer(), Ms :: non_neg_integer() | none) ->
    starl_create_script:waits() | unclear.
judge(Number, Ms) when is_integer(Ms) ->
    case (Ms - starl_create_probe:quiet_ms()) / ?LOOK_MS of
        Looks when Looks < Number div 2 -> long;
        Looks when Looks >= Number - 1, Looks < Number + ?LATE -> short;
        _ -> unclear
    end;
judge(_Number, none) ->
    unclear.

%% @doc What they mean.
-spec line(starl_create_script:waits()) -> string().
line(short) ->
    "of 15 ms: without its computer it stops within 100 ms, if the driver is told (short_waits)";
line(long) ->
    "of 100 ms only: without its computer it stops within 165 ms".
