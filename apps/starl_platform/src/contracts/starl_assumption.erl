%% @doc The assumptions of contracts about clocks, promptness and positions, and the windows in
%% which a robot breaks one of them. A monitor that rests on an assumption excuses what happens
%% within such a window, and judges everything else.
%%
%% The assumptions: no clock is set, stands still or drifts by more than its bound; no robot handles
%% an event later than a bound after it is due; positions are about right. A fault injector knows
%% when an assumption is broken and says so as data ({@link window()}). A cluster knows the windows
%% of its own faults when they are over ({@link broken/2}). A live robot reports when its computer
%% was late ({@link late/1}). Nothing else is known of real robots, and nothing is excused. A
%% monitor asks how far a broken assumption reaches:
%% ```
%%   true time       S            T0   clock set back by 2     E          E + 2
%%                   |-------------|-----------v---------------|-----------|
%%   claimed ..............  told: 5 left    lost = 2     clock_later(T0, E) = E + 2
%% '''
%% All answers are generous bounds: no window explains an event beyond them.
-module(starl_assumption).

-export([new/2, broken/2, late/1, is_kept/1, is_kept/3, is_kept/4, longest_us/2]).
-export([clock_later/4, clock_earlier/4, lost_us/4, gained_us/4, handled/4, begun_us/3]).
-export([behind_us/4, misleads/1, is_misplaced/4, delayed_us/5, calm_us/3, calm_us/4, leaves_us/3]).

-export_type([t/0, window/0, broken/0]).

%% The robot that breaks an assumption, from when to when (us), and which assumption.
-type window() ::
    {starl:robot_id() | all, FromUs :: integer(), ToUs :: integer(), broken()}.

%% `clock': the clock gains this much in the window (it loses if negative), on top of its drift; the
%% gain is a jump where the window is a moment. `pause': no event is handled before the end of the
%% window. `still': it stands still within a step, whose rest takes place at the end of the window; `caller': this
%% step is its application's, which tells only then what it has been answered.
%% `slow': events are handled up to `LagUs' later. `position': positions are those of
%% another time or of another robot. `fault': something that costs a team time, of whatever kind;
%% what assumptions are about is told apart from it.
-type broken() ::
    {clock, GainUs :: integer()}
    | pause
    | still
    | caller
    | {slow, LagUs :: integer()}
    | position
    | fault.

-type us() :: integer().

-record(assumption, {
    drift_ppm :: non_neg_integer(),
    %% ordered by their beginnings
    windows = #{} :: #{starl:robot_id() | all => [{us(), us(), broken()}]}
}).

-opaque t() :: #assumption{}.

-define(MILLION, 1000000).

%% @doc The assumption is kept outside these windows; clocks drift by at most `DriftPpm' millionths.
-spec new([window()], DriftPpm :: non_neg_integer()) -> t().
new(Windows, Ppm) ->
    Of = maps:groups_from_list(fun({Robot, _, _, _}) -> Robot end, fun untied/1, Windows),
    #assumption{drift_ppm = Ppm, windows = maps:map(fun(_, Own) -> lists:sort(Own) end, Of)}.

untied({_Robot, From, To, Broken}) -> {From, To, Broken}.

%% @doc The same assumption, broken in a further window. Two pauses that meet become one.
-spec broken(window(), t()) -> t().
broken({Robot, From, To, Broken}, #assumption{windows = Windows} = Assumption) ->
    Own = lists:sort(united({From, To, Broken}, maps:get(Robot, Windows, []))),
    Assumption#assumption{windows = Windows#{Robot => Own}}.

united({From, To, pause}, Own) ->
    {Met, Apart} = lists:partition(
        fun({Begin, End, What}) -> What =:= pause andalso Begin =< To andalso From =< End end, Own
    ),
    {Begins, Ends, _} = lists:unzip3([{From, To, pause} | Met]),
    [{lists:min(Begins), lists:max(Ends), pause} | Apart];
united(Window, Own) ->
    [Window | Own].

%% @doc The windows in which the computers of live robots were late, by their own reports. For a
%% contract, a late computer counts as stalled for that time.
-spec late([starl_monitor:trace_event()]) -> [window()].
late(Facts) ->
    [{Robot, From, To, pause} || {_, Robot, robot, {late, From, To}} <- Facts].

%% @doc Checks whether all robots keep the assumption at all times, as far as is known.
-spec is_kept(t()) -> boolean().
is_kept(#assumption{windows = Windows}) -> map_size(Windows) =:= 0.

%% @doc Checks whether all robots keep it between two times.
-spec is_kept(FromUs :: us(), UntilUs :: us(), t()) -> boolean().
is_kept(From, Until, #assumption{windows = Windows}) ->
    lists:all(
        fun({Begin, End, _}) -> End < From orelse Until < Begin end,
        lists:append(maps:values(Windows))
    ).

%% @doc Checks whether these robots keep it between two times.
-spec is_kept([starl:robot_id()], FromUs :: us(), UntilUs :: us(), t()) -> boolean().
is_kept(_Robots, _From, _Until, #assumption{windows = Windows}) when map_size(Windows) =:= 0 ->
    true;
is_kept(Robots, From, Until, #assumption{windows = Windows}) ->
    lists:all(
        fun({Begin, End, _}) -> End < From orelse Until < Begin end,
        lists:append(maps:values(maps:with([all | Robots], Windows)))
    ).

%% @doc The latest time at which a robot's clock shows what it should show at `DueUs', counted from
%% `FromUs' on: later by everything that the clock loses meanwhile.
-spec clock_later(starl:robot_id(), FromUs :: us(), DueUs :: us(), t()) -> us().
clock_later(Robot, From, Due, Assumption) ->
    lists:foldl(
        fun
            ({Begin, End, {clock, Gain}}, Late) when Gain < 0, Begin =< Late, From =< End ->
                Late + longest(-Gain, Assumption);
            (_, Late) ->
                Late
        end,
        Due,
        of_robot(Robot, Assumption)
    ).

%% @doc The earliest time at which a robot's clock may have shown what a right clock would have
%% shown at `SinceUs', or more, counted back from `UntilUs'. A clock that is set back shows some
%% times twice, so the first of them may lie before the setting.
-spec clock_earlier(starl:robot_id(), UntilUs :: us(), SinceUs :: us(), t()) -> us().
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

%% The clock runs evenly before the first turn, between two turns, and after the last one.
earliest(Before, [First | _], _Since, _Shows) when Before < First -> Before;
earliest(_Before, Turns, Since, Shows) -> reached(Turns, Since, Shows).

reached([Last], Since, Shows) ->
    max(Last, Last + Since - Shows(Last));
reached([A, B | Turns], Since, Shows) ->
    case {Shows(A), Shows(B)} of
        {X, _} when X >= Since -> A;
        {X, Y} when Y >= Since -> A + (Since - X) * (B - A) div (Y - X);
        _ -> reached([B | Turns], Since, Shows)
    end.

%% @doc The time that a robot's clock has lost between two moments: a duration that it measures is
%% longer than measured by this time.
-spec lost_us(starl:robot_id(), FromUs :: us(), UntilUs :: us(), t()) -> us().
lost_us(Robot, From, Until, Assumption) ->
    longest(
        lists:sum([
            part(-Gain, Begin, End, From, Until)
         || {Begin, End, {clock, Gain}} <- of_robot(Robot, Assumption), Gain < 0
        ]),
        Assumption
    ).

%% @doc The time that the clock has gained: a duration that it measures is shorter by this time.
-spec gained_us(starl:robot_id(), FromUs :: us(), UntilUs :: us(), t()) -> us().
gained_us(Robot, From, Until, Assumption) ->
    longest(
        lists:sum([
            part(Gain, Begin, End, From, Until)
         || {Begin, End, {clock, Gain}} <- of_robot(Robot, Assumption), Gain > 0
        ]),
        Assumption
    ).

%% @doc How far the clock of a robot is, at a time of the run, behind the latest time that any of these robots'
%% clocks has shown until then, if all were right at the beginning of the run.
-spec behind_us(starl:robot_id(), [starl:robot_id()], AtUs :: us(), t()) -> non_neg_integer().
behind_us(Robot, Robots, At, Assumption) ->
    Shown = fun(Id, T) -> T + gained_us(Id, 0, T, Assumption) - lost_us(Id, 0, T, Assumption) end,
    %% a clock that is set back had shown its latest time just before that
    Latest = [
        Shown(Id, T)
     || Id <- Robots,
        T <- [At | [Begin - 1 || {Begin, _, {clock, _}} <- of_robot(Id, Assumption), Begin =< At]]
    ],
    max(0, lists:max([0 | Latest]) - Shown(Robot, At)).

%% The part of the gain that falls between the two times.
part(_Us, Begin, End, From, Until) when Begin > Until; End < From -> 0;
part(Us, Moment, Moment, _From, _Until) ->
    Us;
part(Us, Begin, End, From, Until) ->
    Length = End - Begin,
    up(Us * (min(End, Until) - max(Begin, From)), Length).

up(Us, Parts) -> (Us + Parts - 1) div Parts.

longest(Us, #assumption{drift_ppm = Ppm}) -> longest_us(Us, Ppm).

%% @doc The longest real time that passes while a clock, which drifts by at most `DriftPpm'
%% millionths, advances by `Us'.
-spec longest_us(Us :: us(), DriftPpm :: non_neg_integer()) -> us().
longest_us(Us, Ppm) -> up(Us * ?MILLION, ?MILLION - Ppm).

%% @doc The latest time at which a robot handles an event that is due at `DueUs', where an unbroken
%% robot handles it within `LagUs'.
-spec handled(starl:robot_id(), DueUs :: us(), LagUs :: us(), t()) -> us().
handled(Robot, Due, Lag, Assumption) ->
    Windows = of_robot(Robot, Assumption),
    Slow = [Us || {Begin, End, {slow, Us}} <- Windows, Us > Lag, Begin =< Due + Lag, Due =< End],
    lists:foldl(
        fun
            ({Begin, End, pause}, Late) when Begin =< Late -> max(Late, End + Lag);
            (_, Late) -> Late
        end,
        Due + lists:max([Lag | Slow]),
        Windows
    ).

%% @doc The latest time at which a robot finishes work of so many steps that it began at `FromUs'.
%% With the assumption kept, it would finish at `DueUs'. Only windows that the work meets delay it.
%% A clock that loses time delays it by the loss, a pause by the part that the work meets, and a
%% slow computer by its lag at every step.
-spec delayed_us(starl:robot_id(), FromUs :: us(), DueUs :: us(), Steps :: non_neg_integer(), t()) ->
    us().
delayed_us(Robot, From, Due, Steps, Assumption) ->
    lists:foldl(
        fun
            ({Begin, End, Broken}, Late) when Begin =< Late, From =< End ->
                Late + delay(Broken, Begin, End, max(Begin, From), Steps, Assumption);
            (_, Late) ->
                Late
        end,
        Due,
        of_robot(Robot, Assumption)
    ).

delay({clock, Gain}, Begin, End, Met, _Steps, Assumption) when Gain < 0 ->
    longest(part(-Gain, Begin, End, Met, End), Assumption);
delay(pause, _Begin, End, Met, _Steps, _Assumption) ->
    End - Met;
delay({slow, Lag}, _Begin, _End, _Met, Steps, _Assumption) ->
    Steps * Lag;
delay(_Other, _Begin, _End, _Met, _Steps, _Assumption) ->
    0.

%% @doc The latest time at which a team finishes work that takes it so long from `SinceUs' on, if
%% nothing goes wrong. Every window that the work meets may undo it all, so the work begins anew at
%% the end of the window.
-spec calm_us(SinceUs :: us(), WithinUs :: us(), t()) -> us().
calm_us(Since, Within, #assumption{windows = Windows}) ->
    anew(Since, Within, lists:merge(maps:values(Windows))).

%% @doc The same for work of a single robot.
-spec calm_us(starl:robot_id(), SinceUs :: us(), WithinUs :: us(), t()) -> us().
calm_us(Robot, Since, Within, Assumption) ->
    anew(Since, Within, of_robot(Robot, Assumption)).

anew(Since, Within, Windows) ->
    lists:foldl(
        fun
            ({Begin, End, _}, Late) when Begin =< Late, Since =< End -> max(Late, End + Within);
            (_, Late) -> Late
        end,
        Since + Within,
        Windows
    ).

%% @doc The earliest time at which a step may have begun that traced something at this time. A step
%% that stalls traces the rest when it goes on.
-spec begun_us(starl:robot_id(), AtUs :: us(), t()) -> us().
begun_us(Robot, At, Assumption) ->
    lists:min([
        At | [Begin || {Begin, End, still} <- of_robot(Robot, Assumption), Begin =< At, At =< End]
    ]).

%% @doc Latest send time of an action that a step at `AtUs' performs: a stalled robot sends the rest when it
%% goes on.
-spec leaves_us(starl:robot_id(), AtUs :: us(), t()) -> us().
leaves_us(Robot, At, Assumption) ->
    lists:max([
        At
        | [
            End
         || {Begin, End, Broken} <- of_robot(Robot, Assumption),
            Broken =:= still orelse Broken =:= pause,
            Begin =< At,
            At =< End
        ]
    ]).

%% @doc Checks whether a fault of this kind gives a robot wrong positions. A robot itself detects a
%% picture that is frozen.
-spec misleads(Kind :: atom()) -> boolean().
misleads(Kind) -> lists:member(Kind, [location_noise, location_bias, location_swap]).

%% @doc Checks whether the robot may have received a wrong position between two times.
-spec is_misplaced(starl:robot_id(), FromUs :: us(), UntilUs :: us(), t()) -> boolean().
is_misplaced(Robot, From, Until, Assumption) ->
    [
        position
     || {Begin, End, position} <- of_robot(Robot, Assumption), Begin =< Until, From < End
    ] =/= [].

of_robot(Robot, #assumption{windows = Windows}) ->
    lists:merge(maps:get(Robot, Windows, []), maps:get(all, Windows, [])).
