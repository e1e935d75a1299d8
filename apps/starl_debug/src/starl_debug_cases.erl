%% @doc Decides whether three or more robots were certainly in given states at one moment, whatever
%% the errors of their clocks. For each choice of the clocks' errors, some tuple of intervals, one
%% of each robot, must overlap. This is a question of cases between linear inequalities, in SMT-LIB:
%% is there a choice for which no tuple overlaps?
%%
%% Intervals [a, b] by the clocks have a common moment iff no two of them are apart: with errors o,
%% `o_j − o_i ≤ b_j − a_i' for all i and j. Only tuples that can overlap at all become clauses.
-module(starl_debug_cases).

-export([decide/5, query/4]).

-export_type([solver/0]).

%% Answers a query in SMT-LIB that ends before `(check-sat)'.
-type solver() :: fun((iodata()) -> sat | unsat | undecided).

-type tuple_of() :: [{starl:robot_id(), starl_debug_set:interval()}].

-define(MOST_TUPLES, 2000).

%% @doc Asks the solver about a conjunction of what robots know of themselves; others stay
%% undecided.
-spec decide(
    starl_debug_ground:t(),
    {starl_debug_set:interval(), starl_debug_eval:windows()},
    starl_debug_eval:facts(),
    starl_debug_search:limits(),
    solver()
) -> certainly | not_certainly | undecided.
decide({'and', Parts}, {Range, Windows}, #{locals := Locals}, #{drift := Drift}, Solver) when
    length(Parts) >= 3
->
    Sets = [
        {R, near(Range, maps:get(R, Windows), maps:get(Part, Locals))}
     || {local, R, _} = Part <- Parts
    ],
    case length(Sets) =:= length(Parts) andalso tuples(Sets, Windows) of
        false -> undecided;
        Tuples when length(Tuples) > ?MOST_TUPLES -> undecided;
        Tuples -> answer(Solver(query(Tuples, Windows, Drift, [R || {R, _} <- Sets])))
    end;
decide(_Formula, _When, _Facts, _Limits, _Solver) ->
    undecided.

answer(unsat) -> certainly;
answer(sat) -> not_certainly;
answer(undecided) -> undecided.

%% The intervals that surely hold and touch the slice, whole.
near({From, To}, {Lo, Hi}, {_May, Must}) ->
    [I || {A, B} = I <- Must, B >= From + Lo, A =< To + Hi].

%% Those that overlap for some errors.
-spec tuples([{starl:robot_id(), starl_debug_set:t()}], starl_debug_eval:windows()) -> [tuple_of()].
tuples([], _Windows) ->
    [[]];
tuples([{R, Set} | Sets], Windows) ->
    [
        [{R, I} | Tuple]
     || Tuple <- tuples(Sets, Windows),
        I <- Set,
        lists:all(fun(Other) -> can_meet({R, I}, Other, Windows) end, Tuple)
    ].

can_meet({R, {A, B}}, {Q, {C, D}}, Windows) ->
    #{R := {LoR, HiR}, Q := {LoQ, HiQ}} = Windows,
    A - HiR =< D - LoQ andalso C - HiQ =< B - LoR.

%% @doc The query: errors within the windows for which no tuple overlaps by more than the drift.
-spec query([tuple_of()], starl_debug_eval:windows(), Drift :: integer(), [starl:robot_id()]) ->
    iolist().
query(Tuples, Windows, Drift, Robots) ->
    [
        "(set-logic QF_LRA)\n",
        [["(declare-const ", name(R), " Real)\n"] || R <- Robots],
        [
            [
                "(assert (and (<= ",
                number(Lo),
                " ",
                name(R),
                ") (<= ",
                name(R),
                " ",
                number(Hi),
                ")))\n"
            ]
         || R <- Robots, {Lo, Hi} <- [maps:get(R, Windows)]
        ],
        [["(assert ", apart(Tuple, Drift), ")\n"] || Tuple <- Tuples]
    ].

apart(Tuple, Drift) ->
    [
        "(or",
        [
            [" (> (- ", name(J), " ", name(I), ") ", number(B - A - Drift), ")"]
         || {I, {A, _}} <- Tuple, {J, {_, B}} <- Tuple, I =/= J
        ],
        ")"
    ].

name(R) -> ["o", integer_to_list(R)].

%% SMT-LIB has no negative numbers.
number(N) when N < 0 -> ["(- ", integer_to_list(-N), ".0)"];
number(N) -> [integer_to_list(N), ".0"].
