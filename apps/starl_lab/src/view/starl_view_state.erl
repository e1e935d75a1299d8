%% @doc The state of a team, from its rows, for a page that has missed earlier rows. A pure module.
%% Its size is bounded by the number of robots, and by a maximum of ink points.
-module(starl_view_state).

-export([new/0, add/2, rows/2, said/1]).

-export_type([t/0]).

-define(MOST_INK, 100000).
-define(TOLERANCE_MM, 3.0).
-define(MOST_SAID, 1000).
%% With more last rows than these, no further key of drawings is kept.
-define(MOST_LAST, 20000).
%% The most values of a robot's measure that are kept, and the most of all: then each second one is left out, and no
%% further measure is kept.
-define(MOST_VALUES, 400).
-define(MOST_MEASURES, 1000).

-record(state, {
    %% the last rows of a kind, by robot (and device)
    last = #{} :: #{Key :: term() => starl_view_row:row()},
    %% the measures of each robot, latest first, and their number
    measures = #{} :: #{
        {starl:robot_id(), Key :: term()} => {pos_integer(), [starl_view_row:row(), ...]}
    },
    %% faults, violations, what is not judged, and crashes, newest first
    said = [] :: [starl_view_row:row()],
    %% the strokes of each robot's pen, latest first, and the number of their points
    ink = #{} :: #{starl:robot_id() => [[float()]]},
    points = 0 :: non_neg_integer()
}).

-opaque t() :: #state{}.

%% @doc Nothing is known.
-spec new() -> t().
new() -> #state{}.

%% @doc One row more.
-spec add(starl_view_row:row(), t()) -> t().
add([<<"m">>, T, Robot | _] = Row, #state{last = Last} = State) ->
    (stroke(T, Robot, State))#state{last = Last#{{m, Robot} => Row}};
add([<<"a">>, T, Robot, Device | _] = Row, #state{last = Last} = State) ->
    (stroke(T, Robot, State))#state{last = Last#{{a, Robot, Device} => Row}};
add([<<"r">>, _, Robot | _] = Row, #state{last = Last} = State) ->
    State#state{last = Last#{{r, Robot} => Row}};
add([<<"g">>, _, Robot, Key | _] = Row, #state{last = Last} = State) when
    map_size(Last) < ?MOST_LAST; is_map_key({g, Robot, Key}, Last)
->
    State#state{last = Last#{{g, Robot, Key} => Row}};
add([<<"n">>, _, Robot, Key | _] = Row, #state{measures = Measures} = State) when
    map_size(Measures) < ?MOST_MEASURES; is_map_key({Robot, Key}, Measures)
->
    {Count, Rows} = maps:get({Robot, Key}, Measures, {0, []}),
    State#state{measures = Measures#{{Robot, Key} => thinned(Count + 1, [Row | Rows])}};
add([Kind | _] = Row, #state{said = Said} = State) when
    Kind =:= <<"f">>; Kind =:= <<"v">>; Kind =:= <<"u">>; Kind =:= <<"x">>
->
    State#state{said = lists:sublist([Row | Said], ?MOST_SAID)};
add(_Row, State) ->
    State.

%% The latest value is always there.
thinned(Count, Rows) when Count =< ?MOST_VALUES -> {Count, Rows};
thinned(_Count, Rows) ->
    Kept = every_second(Rows),
    {length(Kept), Kept}.

every_second([Row, _ | Rows]) -> [Row | every_second(Rows)];
every_second(Rows) -> Rows.

%% The part of the last piece that was driven with the pen down, at most up to now.
stroke(Now, Robot, #state{last = Last, points = Points} = State) when Points < ?MOST_INK ->
    case Last of
        #{{m, Robot} := Motion, {a, Robot, <<"pen">>} := [_, Since, _, _, <<"down">>]} ->
            inked(Robot, line(Motion, Since, Now), State);
        #{} ->
            State
    end;
stroke(_Now, _Robot, State) ->
    State.

inked(_Robot, [_], State) ->
    State;
inked(Robot, Line, #state{ink = Ink, points = Points} = State) ->
    Flat = lists:append([[round1(X), round1(Y)] || {X, Y} <- Line]),
    Strokes = [Flat | maps:get(Robot, Ink, [])],
    State#state{ink = Ink#{Robot => Strokes}, points = Points + length(Line)}.

round1(Mm) -> round(Mm * 10) / 10.

line([_, _, _ | Piece], Since, Now) ->
    Known = piece(Piece),
    From = max(Since, starl_trajectory:start_us(Known)),
    starl_trajectory:polyline(Known, min(From, Now), Now, ?TOLERANCE_MM).

piece([0, T0, X, Y, Heading, V, W]) ->
    starl_trajectory:piece(T0, {X, Y}, Heading, V, W);
piece([1, T0, X, Y, Heading, VX0, VY0, VX1, VY1, Us]) ->
    starl_trajectory:ramp(T0, {X, Y}, Heading, {VX0, VY0}, {VX1, VY1}, Us).

%% @doc The rows that describe this state at a time to a page that knows nothing; ink as `["i", T,
%% Robot, [X, Y, X, Y, ...]]'.
-spec rows(integer(), t()) -> [starl_view_row:row()].
rows(Now, #state{last = Last} = State) ->
    Drawn = lists:foldl(
        fun(Robot, S) -> stroke(Now, Robot, S) end, State, [R || {m, R} <- maps:keys(Last)]
    ),
    #state{ink = Ink, said = Said, measures = Measures} = Drawn,
    [[<<"i">>, Now, R, Line] || {R, Lines} <- lists:sort(maps:to_list(Ink)), Line <- Lines] ++
        [Row || {_, Row} <- lists:sort(maps:to_list(Last))] ++
        [Row || {_, {_, Rows}} <- lists:sort(maps:to_list(Measures)), Row <- lists:reverse(Rows)] ++
        lists:reverse(Said).

%% @doc The faults, violations and crashes, as far as they are kept.
-spec said(t()) -> [starl_view_row:row()].
said(#state{said = Said}) -> lists:reverse(Said).
