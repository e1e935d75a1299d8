%% Runs whose truth is known: robots that drive at random with stops, hold a token at random, and
%% are recorded by clocks with errors and drifts within sigma, at uneven samples of their places.
%% The truth is taken from the true time, millisecond by millisecond, by other code than that under
%% test.
-module(starl_debug_truth).

-export([recording/3, make/2, signals/3, truth/2, answers/3, wrong/2, table/1, table/3]).

-define(SPEED, 500.0).
-define(MOST_PPM, 100).

predicates() ->
    [
        "dist(r1.pos, r2.pos) < 300 mm",
        "too_near(200 mm)",
        "dist(r1.pos, r2.pos) > 2 m",
        "two_owners",
        "owner(r1, t) and owner(r2, t) and owner(r3, t)",
        "count(r: owner(r, t)) >= 2 and not owner(r3, t)",
        "count(r: owner(r, t)) <= 1 and r1.x < 1 m",
        "count(r: owner(r, t)) <= 2 and owner(r1, t) and owner(r2, t)",
        "count(r: owner(r, t)) < 2 and not count(r: owner(r, t)) = 0",
        "count(r: owner(r, t)) = 2 for 50 ms",
        "count(r: owner(r, t)) != 1 and owner(r2, t)",
        "(owner(r1, t) and owner(r2, t)) for 100 ms",
        "dist(r1.pos, r2.pos) < 400 mm and owner(r3, t)",
        "dist(r1.pos, r2.pos) < 500 mm for 300 ms",
        "not (owner(r2, t) within 400 ms after owner(r1, t))",
        "r1.x < 1 m and not r2.x < 1 m and dist(r3.pos, point(1 m, 1 m)) < 300 mm"
    ].

%% What is only just true of a run, and only just false: with a little less margin the answer is wrong.
edges(#{robots := #{1 := #{places := A}, 2 := #{places := B}}}) ->
    Distances = [starl_geometry:distance(P, Q) || {P, Q} <- lists:zip(A, B)],
    Xs = [X || {X, _} <- A],
    Off = 2 + rand:uniform(10),
    Edges = [
        {"dist(r1.pos, r2.pos) < ~.1f mm", lists:min(Distances)},
        {"dist(r1.pos, r2.pos) > ~.1f mm", lists:max(Distances)},
        {"dist(r1.pos, r2.pos) < ~.1f mm for 300 ms", lists:min(highest(300, Distances))},
        {"r1.x < ~.1f mm", lists:min(Xs)},
        {"r1.x > ~.1f mm and r2.x > -99 m", lists:max(Xs)},
        {"r1.x < ~.1f mm for 200 ms", lists:min(highest(200, Xs))}
    ],
    {Text, Value} = lists:nth(rand:uniform(length(Edges)), Edges),
    [lists:flatten(io_lib:format(Text, [Value + Sign * Off])) || Sign <- [1, -1]].

%% The greatest of each so many values that follow each other.
highest(N, Values) when length(Values) =< N -> [];
highest(N, Values) -> [lists:max(lists:sublist(Values, N + 1)) | highest(N, skip(5, Values))].

skip(N, Values) -> lists:nthtail(min(N, length(Values)), Values).

%% A whole recording of robots with these states and tracks.
recording(Extent, States, Tracks) ->
    #{
        how => exact,
        app => made,
        monitors => [],
        robots => lists:sort(maps:keys(States)),
        begun => 0,
        extent => Extent,
        states => States,
        tracks => Tracks,
        packets => [],
        tokens => [<<"t">>],
        elections => [],
        vocabulary => #{},
        geocasts => [],
        missing => [],
        too_fast => [],
        holes => [],
        left_out => []
    }.

%% A run of three robots: its recording, and the truth. `ms': its length; `sigma': us; `hz': samples
%% a second; `ppm': how much clocks drift at most; `error': how far off a sample is at most (mm).
make(Seed, Given) ->
    #{ms := Ms} = Kind = maps:merge(#{ppm => ?MOST_PPM, error => 0.0}, Given),
    _ = rand:seed(exsss, Seed),
    Tight = tight(Ms),
    Robots = [{R, robot(maps:get(R, Tight, none), Kind)} || R <- [1, 2, 3]],
    Extents = [{round(clock(0, C)), round(clock(Ms, C))} || {_, #{clock := C}} <- Robots],
    States = maps:from_list([
        {R, starl_debug_state:new(R, #{mutex => events(Robot)}, Own, exact)}
     || {{R, Robot}, Own} <- lists:zip(Robots, Extents)
    ]),
    Extent = {lists:min([A || {A, _} <- Extents]), lists:max([B || {_, B} <- Extents])},
    Tracks = maps:from_list([{R, track(Robot, Kind)} || {R, Robot} <- Robots]),
    {
        recording(Extent, States, Tracks),
        #{ms => Ms, robots => maps:from_list(Robots)}
    }.

%% In two runs of three one robot takes the token just before another lets it go, or just after, or
%% has it together with the other for nearly a tenth of a second or a little more.
tight(Ms) ->
    Meet = 1000 + rand:uniform(Ms - 2000),
    Late = fun() ->
        Little = lists:nth(rand:uniform(2), [-1, 1]) * (2 + rand:uniform(8)),
        Meet + lists:nth(rand:uniform(2), [0, -100]) + Little
    end,
    lists:nth(rand:uniform(3), [
        #{},
        #{1 => [{Meet - 400, Meet}], 2 => [{Late(), Meet + 300}], 3 => [{Late(), Meet + 500}]},
        #{1 => [{Late(), Meet + 300}], 2 => [{Meet - 400, Meet}], 3 => []}
    ]).

robot(Tight, #{ms := Ms, sigma := Sigma, hz := Hz, ppm := Ppm, error := Error}) ->
    %% the robot's clock is never farther than half of sigma from the true time
    Drift = min(Ppm * 1.0e-6, Sigma / 2 / (1000 * Ms)) * uniform(-1, 1),
    Room = Sigma / 2 - abs(Drift) * 1000 * Ms,
    Clock = {max(0.0, Room) * uniform(-1, 1), Drift},
    Path = path(0, Ms, {uniform(0, 2000), uniform(0, 2000)}),
    #{
        clock => Clock,
        path => Path,
        places => places(0, Ms, Path),
        samples => [
            {round(clock(T, Clock)), off(Error, place(T, Path))}
         || T <- samples(0.0, Ms, Hz)
        ],
        holds =>
            case Tight of
                none -> holds(rand:uniform(1500), Ms);
                _ -> Tight
            end
    }.

off(Error, P) when Error == 0 -> P;
off(Error, {X, Y}) ->
    {Far, Angle} = {uniform(0, Error), uniform(0, 2 * math:pi())},
    {X + Far * math:cos(Angle), Y + Far * math:sin(Angle)}.

uniform(Low, High) -> Low + (High - Low) * rand:uniform().

%% What its clock shows (us) at a true time (ms).
clock(T, {Offset, Drift}) -> 1000 * T + Offset + Drift * 1000 * T.

samples(T, Ms, _Hz) when T >= Ms -> [Ms];
samples(T, Ms, Hz) -> [T | samples(T + 1000 / Hz * uniform(0.6, 1.4), Ms, Hz)].

%% Legs of even motion: begin and end (ms), place at the beginning, velocity (mm/ms).
path(T, Ms, _P) when T > Ms -> [];
path(T, Ms, {X, Y} = P) ->
    To = T + 200 + rand:uniform(1500),
    {GX, GY} = {uniform(0, 2000), uniform(0, 2000)},
    Away = max(1.0, starl_geometry:distance(P, {GX, GY})),
    Speed = lists:nth(rand:uniform(3), [0.0, ?SPEED * 0.5, ?SPEED]) / 1000,
    Run = min(Speed, Away / (To - T)),
    V = {VX, VY} = {Run * (GX - X) / Away, Run * (GY - Y) / Away},
    [{T, To, P, V} | path(To, Ms, {X + VX * (To - T), Y + VY * (To - T)})].

place(T, [{From, To, {X, Y}, {VX, VY}} | Rest]) when T =< To; Rest =:= [] ->
    {X + VX * (T - From), Y + VY * (T - From)};
place(T, [_ | Rest]) ->
    place(T, Rest).

places(T, Ms, _Path) when T > Ms -> [];
places(T, Ms, [{_, To, _, _} | [_ | _] = Rest]) when T > To -> places(T, Ms, Rest);
places(T, Ms, Path) -> [place(T, Path) | places(T + 1, Ms, Path)].

%% Begin and end lie between two milliseconds.
holds(T, Ms) when T > Ms -> [];
holds(T, Ms) ->
    To = T + 20 + rand:uniform(400),
    [{T, To} | holds(To + 20 + rand:uniform(1500), Ms)].

events(#{holds := Holds, clock := Clock}) ->
    lists:append([
        [
            {round(clock(From + 0.5, Clock)), {acquired, t, N}},
            {round(clock(To + 0.5, Clock)), {released, t, N}}
        ]
     || {N, {From, To}} <- lists:zip(lists:seq(1, length(Holds)), Holds)
    ]).

track(#{samples := Samples}, #{error := Error, ppm := Ppm}) ->
    %% by a slow clock it is faster
    Limits = #{speed => ?SPEED * (1.0005 + 1.1e-6 * Ppm), error => Error + 0.01},
    {Track, 0} = starl_debug_track:samples(Samples, Limits),
    Track.

%% The distance of two robots (mm) and who of them holds the token (1 or 0), each millisecond.
signals(R, Q, #{ms := Ms, robots := Robots}) ->
    #{R := #{places := A, holds := HoldsA}, Q := #{places := B, holds := HoldsB}} = Robots,
    Held = fun(Holds) -> [number(V) || V <- held_at(0, Ms, Holds)] end,
    {
        [starl_geometry:distance(P, Other) || {P, Other} <- lists:zip(A, B)],
        Held(HoldsA),
        Held(HoldsB)
    }.

%% -- the truth ------------------------------------------------------------------------------

%% `true' or `false' if that is beyond the millisecond's doubt, else `doubtful'.
truth(Formula, Run) ->
    case {holds_at(Formula, 1, Run), holds_at(Formula, -1, Run)} of
        {true, _} -> true;
        {false, true} -> doubtful;
        {false, false} -> false
    end.

holds_at(Formula, Strict, Run) -> lists:member(true, values(Formula, Strict, Run)).

%% The values of a formula by milliseconds; strict: what is true is so by a margin, else what is
%% false.
values({local, R, Local}, S, Run) ->
    own(Local, S, R, Run);
values({'and', Parts}, S, Run) ->
    joined(fun(A, B) -> A andalso B end, [values(P, S, Run) || P <- Parts]);
values({'or', Parts}, S, Run) ->
    joined(fun(A, B) -> A orelse B end, [values(P, S, Run) || P <- Parts]);
values({at_least, K, Parts}, S, Run) ->
    Numbers = [[number(V) || V <- values(P, S, Run)] || P <- Parts],
    [N >= K || N <- joined(fun(A, B) -> A + B end, Numbers)];
values({How, Us, A}, S, Run) when How =:= held; How =:= once; How =:= ago ->
    lasting(How, Us div 1000, S, values(A, S, Run));
values({Comparison, R, Q, Mm}, S, #{robots := Robots}) ->
    #{R := #{places := A}, Q := #{places := B}} = Robots,
    [
        compared(Comparison, starl_geometry:distance(P, Other), Mm, S)
     || {P, Other} <- lists:zip(A, B)
    ].

own({state, {owner, _}}, _S, R, #{ms := Ms, robots := Robots}) ->
    #{R := #{holds := Holds}} = Robots,
    held_at(0, Ms, Holds);
own({left, Mm}, S, R, #{robots := Robots}) ->
    #{R := #{places := Places}} = Robots,
    [compared('<', X, Mm, S) || {X, _} <- Places];
own({near, P, Mm}, S, R, #{robots := Robots}) ->
    #{R := #{places := Places}} = Robots,
    [compared('<', starl_geometry:distance(P, Q), Mm, S) || Q <- Places];
%% What lasts is judged where the recording goes back as far.
own({'not', {once, Us, A}}, S, R, Run) ->
    own({held, Us, {'not', A}}, S, R, Run);
own({'not', {held, Us, A}}, S, R, Run) ->
    own({once, Us, {'not', A}}, S, R, Run);
own({'not', {ago, Us, A}}, S, R, Run) ->
    own({ago, Us, {'not', A}}, S, R, Run);
own({'not', {'not', A}}, S, R, Run) ->
    own(A, S, R, Run);
own({'not', A}, S, R, Run) ->
    [not V || V <- own(A, -S, R, Run)];
own({Operator, Parts}, S, R, Run) when Operator =:= 'and'; Operator =:= 'or' ->
    values({Operator, [{local, R, P} || P <- Parts]}, S, Run);
own({How, Us, A}, S, R, Run) ->
    values({How, Us, {local, R, A}}, S, Run).

compared('<', Value, Mm, S) -> Value < Mm - 1.5 * S;
compared('>', Value, Mm, S) -> Value > Mm + 1.5 * S.

number(true) -> 1;
number(false) -> 0.

joined(_Fun, [Values]) -> Values;
joined(Fun, [Values | Rest]) -> lists:zipwith(Fun, Values, joined(Fun, Rest)).

held_at(T, Ms, _Holds) when T > Ms -> [];
held_at(T, Ms, [{_, To} | Holds]) when T > To -> held_at(T, Ms, Holds);
held_at(T, Ms, [{From, _} | _] = Holds) -> [T > From | held_at(T + 1, Ms, Holds)];
held_at(T, Ms, []) -> [false | held_at(T + 1, Ms, [])].

%% A duration is off by 2 ms.
lasting(held, Ms, S, Values) ->
    run_of(Ms + 2 * S, 0, Values);
lasting(once, Ms, S, Values) ->
    since(Ms - 2 * S, infinity, Values);
lasting(ago, Ms, 1, Values) ->
    joined(fun(A, B) -> A andalso B end, [before(Ms + D, Values) || D <- [-2, 0, 2]]);
lasting(ago, Ms, -1, Values) ->
    joined(fun(A, B) -> A orelse B end, [before(Ms + D, Values) || D <- [-2, -1, 0, 1, 2]]).

run_of(_Ms, _N, []) -> [];
run_of(Ms, N, [true | Values]) -> [N >= Ms | run_of(Ms, N + 1, Values)];
run_of(Ms, _N, [false | Values]) -> [false | run_of(Ms, 0, Values)].

since(_Ms, _N, []) -> [];
since(Ms, _N, [true | Values]) -> [true | since(Ms, 1, Values)];
since(Ms, infinity, [false | Values]) -> [false | since(Ms, infinity, Values)];
since(Ms, N, [false | Values]) -> [N =< Ms | since(Ms, N + 1, Values)].

before(Ms, Values) ->
    lists:sublist(lists:duplicate(Ms, false) ++ Values, length(Values)).

%% -- a table --------------------------------------------------------------------------------

%% Judges that many runs by sigma and samples a second: how often the answer was undecided.
table(Runs) -> table(Runs, [0, 500, 5000, 50000, 200000], [2, 5, 20]).

table(Runs, Sigmas, Rates) ->
    io:format("sigma  samples  true  false  certainly of true  possibly of false  wrong~n"),
    [row(Sigma, Hz, Runs) || Sigma <- Sigmas, Hz <- Rates].

row(Sigma, Hz, Runs) ->
    Answers = lists:append([verdicts(Seed, Sigma, Hz) || Seed <- lists:seq(1, Runs)]),
    Of = fun(Truth) -> [V || {T, V} <- Answers, T =:= Truth] end,
    {True, False} = {Of(true), Of(false)},
    Wrong = length([x || never <- True]) + length([x || certainly <- False]),
    io:format("~5.1f ms ~4b Hz ~6b ~6b ~15.1f % ~16.1f % ~6b~n", [
        Sigma / 1000,
        Hz,
        length(True),
        length(False),
        share(certainly, True),
        share(possibly, False),
        Wrong
    ]),
    {Sigma, Hz, Wrong}.

share(_Verdict, []) -> 0.0;
share(Verdict, All) -> 100 * length([x || V <- All, V =:= Verdict]) / length(All).

verdicts(Seed, Sigma, Hz) ->
    {Recording, Run} = make(Seed, #{ms => 4000, sigma => Sigma, hz => Hz}),
    [{Truth, Verdict} || {_, Truth, Verdict} <- answers(Recording, Run, #{sigma => Sigma})].

%% The predicates with their truths and the verdicts of the check.
answers(Recording, Run, Options) ->
    Go = fun(_Done) -> continue end,
    [
        {Text, truth(Formula, Run),
            maps:get(verdict, starl_debug_check:run(Formula, Recording, Options, Go))}
     || Text <- predicates() ++ edges(Run),
        {ok, Predicate} <- [starl_debug:predicate(Text)],
        {ok, Formula} <- [starl_debug:formula(Predicate, Recording)]
    ].

%% The answers of a run that are wrong.
wrong(Seed, #{sigma := Sigma, ppm := Ppm} = Kind) ->
    {Recording, Run} = make(Seed, Kind),
    [
        {{seed, Seed}, Kind, Text, Truth, Verdict}
     || {Text, Truth, Verdict} <-
            answers(Recording, Run, #{sigma => Sigma, drift_ppm => Ppm}),
        {Truth, Verdict} =:= {true, never} orelse {Truth, Verdict} =:= {false, certainly}
    ].
