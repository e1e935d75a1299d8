%% @doc The report of a run of the painting application: the completeness of the picture, the amount
%% of ink, the cost, and the picture itself.
-module(starl_painting_report).

-export([report/2]).

-type figures() :: [{atom(), number() | null}].

%% @doc The report of a run. The picture is complete when all lines are covered with ink.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{memo := Memo}, #{monitors := Monitors} = Outcome) ->
    #{starl_painting_monitor := #{coverage := Covered} = Paint} = Monitors,
    Figures = figures(Memo, Outcome),
    #{
        figures => Figures,
        formats => formats(),
        complete => Covered >= 1.0,
        done => [percent(Covered), " of the lines painted"],
        summary => summary(Figures) ++ left_out(Memo),
        write => fun(Dir) -> draw(Dir, Memo, Paint, Outcome) end
    }.

-spec figures(map(), starl_scene:outcome()) -> figures().
figures(Memo, #{monitors := Monitors, end_us := EndUs}) ->
    #{starl_painting_monitor := Paint, starl_dpp_monitor := Dpp} = Monitors,
    #{lines_mm := Length, robots := N, speed := Speed} = Memo,
    Bound = Length / (N * Speed),
    [
        {ink_mm, maps:get(ink_mm, Paint)},
        {ink_covered, maps:get(coverage, Paint)},
        {ink_per_line, ratio(maps:get(ink_mm, Paint), Length)},
        {lines_inked, maps:get(inked, Paint)},
        {driven_mm, maps:get(driven_mm, Paint)},
        {makespan_bound_ratio, EndUs / 1.0e6 / Bound},
        {min_separation_mm, number(maps:get(min_separation_mm, Dpp))},
        {safety_distance_mm, maps:get(safety_distance, Memo)},
        {deadlocks_resolved, maps:get(deadlocks_resolved, Dpp)},
        {assignments, maps:get(assignments, Dpp)},
        {assignments_per_robot, maps:get(assignments, Dpp) / N},
        {lines_mm, Length}
    ].

ratio(_Mm, Length) when Length == 0 -> null;
ratio(Mm, Length) -> Mm / Length.

%% A single robot has no distance from others.
number(infinity) -> null;
number(X) -> X.

%% Coverage and separation are rounded down.
-spec formats() -> #{atom() => starl_scene:format()}.
formats() ->
    #{
        ink_mm => #{decimals => 1},
        ink_covered => #{decimals => 6, rounded => down, label => "part of the lines painted"},
        ink_per_line => #{decimals => 6},
        lines_inked => #{decimals => 6},
        driven_mm => #{decimals => 1},
        min_separation_mm => #{rounded => down},
        assignments_per_robot => #{label => "assignments per robot", plotted => true}
    }.

%% -- summary --------------------------------------------------------------------------------

%% 99.99 % must not read 100 %.
percent(Covered) when Covered >= 1.0 -> "100 %";
percent(Covered) -> [decimals(2, floor(Covered * 10000) / 100), " %"].

summary(Figures) ->
    Told = maps:from_list(Figures),
    [driven(Told)] ++ closest(Told) ++ [planned(Told)].

%% What a browser shows of the picture and the team does not paint.
left_out(#{picture := Picture, lost := Lost}) ->
    starl_painting_walls:left_out(Lost) ++
        starl_picture_omissions:lines(starl_picture:left_out(Picture)).

driven(#{ink_mm := Ink, driven_mm := Driven, makespan_bound_ratio := Ratio}) ->
    io_lib:format("ink ~ts m of ~ts m driven; ~ts x the least time possible", [
        decimals(1, Ink / 1000), decimals(1, Driven / 1000), decimals(2, Ratio)
    ]).

closest(#{min_separation_mm := null}) ->
    [];
closest(#{min_separation_mm := Least, safety_distance_mm := Safe}) ->
    [
        io_lib:format("the closest two robots came to each other: ~ts mm (at least ~ts)", [
            decimals(1, floor(Least * 10) / 10), decimals(0, Safe)
        ])
    ].

planned(#{assignments := Paths, deadlocks_resolved := Resolved}) ->
    io_lib:format("~b paths assigned, ~b deadlock~ts resolved", [
        Paths, Resolved, [$s || Resolved =/= 1]
    ]).

decimals(N, X) -> float_to_list(float(X), [{decimals, N}]).

%% -- the picture ----------------------------------------------------------------------------

draw(Dir, #{picture := Picture, world := World} = Memo, #{ink := Ink}, #{robots := Robots}) ->
    Drawing = #{
        floor => World,
        target => starl_picture:segments(Picture),
        plan => maps:get(floor, Memo),
        ink => Ink,
        robots => [{Id, {X, Y}, Heading} || {Id, #{pose := {X, Y, Heading}}} <- Robots],
        title => starl_picture:title(Picture)
    },
    case starl_picture_draw:write(Dir, "painting", Drawing) of
        {ok, Files} -> {ok, Files};
        {partly, Files, Reason} -> {partly, Files, starl_picture_draw:format_error(Reason)};
        {error, Reason} -> {error, starl_picture_draw:format_error(Reason)}
    end.
