%% @doc What contracts assume of clocks, of promptness and of positions, and when which robot does
%% not keep it: windows, for monitors that judge what rests on an assumption everywhere else.
%%
%% Assumed is that no clock is set, stands still or drifts by more than its bound, that no robot
%% handles an event later than a bound after it is due, and that positions are about right. Who
%% injects faults knows when that is not so and says it as data ({@link window()}); of real robots
%% nothing is known, and nothing is excused. A monitor asks how far a broken assumption reaches:
%% ```
%%   true time       S            T0   clock set back by 2     E          E + 2
%%                   |-------------|-----------v---------------|-----------|
%%   claimed ..............  told: 5 left    lost = 2     clock_later(T0, E) = E + 2
%% '''
%% All answers are bounds on the side of the excuse: what goes beyond them no window explains.
-module(starl_assumption).

-export([new/2, is_kept/1, is_kept/3, longest_us/2]).
-export([clock_later/4, clock_earlier/4, lost_us/4, gained_us/4, handled/4, is_misplaced/4]).

-export_type([t/0, window/0, broken/0]).

%% Whose assumption is broken, from when to when (us), and which.
-type window() ::
    {starl_monitor:robot_id() | all, FromUs :: integer(), ToUs :: integer(), broken()}.

%% The clock gains so much in the window (a negative number: it loses), beyond what it drifts; at
%% once where the window is a moment. Nothing is handled before the end of the window. Events are
%% handled up to so much later. Positions are those of another time or of another robot.
-type broken() :: {clock, GainUs :: integer()} | pause | {slow, LagUs :: integer()} | position.

-type us() :: integer().
-type robot_id() :: starl_monitor:robot_id().

-record(assumption, {
    drift_ppm :: non_neg_integer(),
    %% in the order of their beginnings
    windows = #{} :: #{robot_id() | all => [{us(), us(), broken()}]}
}).

-opaque t() :: #assumption{}.

-define(MILLION, 1000000).

%% @doc The assumption is kept outside these windows; clocks drift by at most so many millionths.
-spec new([window()], DriftPpm :: non_neg_integer()) -> t().
new(Windows, Ppm) ->
    Of = maps:groups_from_list(fun({Robot, _, _, _}) -> Robot end, fun untied/1, Windows),
    #assumption{drift_ppm = Ppm, windows = maps:map(fun(_, Own) -> lists:sort(Own) end, Of)}.

untied({_Robot, From, To, Broken}) -> {From, To, Broken}.

%% @doc Is it kept by all robots at all times, as far as is known?
-spec is_kept(t()) -> boolean().
is_kept(#assumption{windows = Windows}) -> map_size(Windows) =:= 0.

%% @doc Is it kept by all robots between two times?
-spec is_kept(FromUs :: us(), UntilUs :: us(), t()) -> boolean().
is_kept(From, Until, #assumption{windows = Windows}) ->
    lists:all(
        fun({Begin, End, _}) -> End < From orelse Until < Begin end,
        lists:append(maps:values(Windows))
    ).

%% @doc When at the latest a robot's clock shows what it should show at `DueUs', reckoned from
%% `FromUs' on: later by all that it loses meanwhile.
-spec clock_later(robot_id(), FromUs :: us(), DueUs :: us(), t()) -> us().
clock_later(Robot, From, Due, Assumption) ->
    lists:foldl(
        fun
            ({Begin, End, {clock, Gain}}, Late) when Gain < 0, Begin =< Late, From =< End ->
                Late + longest(-Gain, Assumption);
            (_, Late) ->
                Late
        end,
        Due, of_robot(Robot, Assumption)
    ).

%% @doc When at the earliest a robot's clock may have shown what a right one would have shown at
%% `SinceUs', or more, reckoned back from `UntilUs'. One that is set back shows some times twice, so
%% the first of them may lie before the setting.
-spec clock_earlier(robot_id(), UntilUs :: us(), SinceUs :: us(), t()) -> us().
clock_earlier(Robot, Until, Since, Assumption) ->
    Shows = fun(At) -> At + lost_us(Robot, At, Until, Assumption) end,
    Turns = lists:usort([
        Turn
     || {Begin, End, {clock, Gain}} <- of_robot(Robot, Assumption),
        Gain < 0,
        Begin =< Until,
        Turn <- [Begin, Begin + 1, End, End + 1]
    ]),
    case Turns of
        [] -> Since;
        [First | _] -> earliest(First - max(0, Shows(First) - Since), Turns, Since, Shows)
    end.

%% The clock goes evenly before the first turn, from one turn to the next, and after the last.
earliest(Before, [First | _], _Since, _Shows) when Before < First -> Before;
earliest(_Before, Turns, Since, Shows) -> reached(Turns, Since, Shows).

reached([Last], Since, Shows) -> max(Last, Last + Since - Shows(Last));
reached([A, B | Turns], Since, Shows) ->
    case {Shows(A), Shows(B)} of
        {X, _} when X >= Since -> A;
        {X, Y} when Y >= Since -> A + (Since - X) * (B - A) div (Y - X);
        _ -> reached([B | Turns], Since, Shows)
    end.

%% @doc By how much a robot's clock has fallen back between two times: so much longer is
%% whatever it measured.
-spec lost_us(robot_id(), FromUs :: us(), UntilUs :: us(), t()) -> us().
lost_us(Robot, From, Until, Assumption) ->
    longest(
        lists:sum([
            part(-Gain, Begin, End, From, Until)
         || {Begin, End, {clock, Gain}} <- of_robot(Robot, Assumption), Gain < 0
        ]),
        Assumption
    ).

%% @doc By how much it has run ahead: so much shorter is whatever it measured.
-spec gained_us(robot_id(), FromUs :: us(), UntilUs :: us(), t()) -> us().
gained_us(Robot, From, Until, Assumption) ->
    longest(
        lists:sum([
            part(Gain, Begin, End, From, Until)
         || {Begin, End, {clock, Gain}} <- of_robot(Robot, Assumption), Gain > 0
        ]),
        Assumption
    ).

%% The part of the window that lies between the two times.
part(_Us, Begin, End, From, Until) when Begin > Until; End < From -> 0;
part(Us, Moment, Moment, _From, _Until) -> Us;
part(Us, Begin, End, From, Until) ->
    Length = End - Begin,
    up(Us * (min(End, Until) - max(Begin, From)), Length).

up(Us, Parts) -> (Us + Parts - 1) div Parts.

longest(Us, #assumption{drift_ppm = Ppm}) -> longest_us(Us, Ppm).

%% @doc The time that passes at most while a clock that drifts by at most so many millionths shows
%% so much.
-spec longest_us(Us :: us(), DriftPpm :: non_neg_integer()) -> us().
longest_us(Us, Ppm) -> up(Us * ?MILLION, ?MILLION - Ppm).

%% @doc When at the latest a robot handles what is due at `DueUs', if in order it does so within
%% `LagUs'.
-spec handled(robot_id(), DueUs :: us(), LagUs :: us(), t()) -> us().
handled(Robot, Due, Lag, Assumption) ->
    Windows = of_robot(Robot, Assumption),
    Slow = [
        Us || {Begin, End, {slow, Us}} <- Windows, Us > Lag, Begin =< Due + Lag, Due =< End
    ],
    lists:foldl(
        fun
            ({Begin, End, pause}, Late) when Begin =< Late -> max(Late, End + Lag);
            (_, Late) -> Late
        end,
        Due + lists:max([Lag | Slow]), Windows
    ).

%% @doc May the robot have been told a wrong position between two times?
-spec is_misplaced(robot_id(), FromUs :: us(), UntilUs :: us(), t()) -> boolean().
is_misplaced(Robot, From, Until, Assumption) ->
    [
        position
     || {Begin, End, position} <- of_robot(Robot, Assumption), Begin =< Until, From < End
    ] =/= [].

of_robot(Robot, #assumption{windows = Windows}) ->
    lists:merge(maps:get(Robot, Windows, []), maps:get(all, Windows, [])).
