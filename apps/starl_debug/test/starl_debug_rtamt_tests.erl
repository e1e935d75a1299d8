%% With perfect clocks and dense samples the check says what RTAMT says, a monitor of signal temporal logic by
%% others (https://github.com/nickovic/rtamt): by the sign of the robustness. A development tool: `pip install
%% rtamt', and STARL_PYTHON names the Python that has it. Without it the test is skipped.
%%
%% RTAMT's signals are steps, so both get a value each millisecond. Where the robustness is less than a step
%% it says nothing.
%%
%% Holds: With perfect clocks and dense samples the answer is that of another tool, RTAMT, by the
%% sign of its robustness
%% Red: with 330 mm on one side and 300 mm on the other, run
-module(starl_debug_rtamt_tests).

-include_lib("eunit/include/eunit.hrl").

-define(RUNS, 200).
-define(MS, 1000).
-define(LEAST_MM, 3.0).

%% Each line of input is a run: its distances (mm), and who holds the token. Each line of output is the two
%% robustnesses.
-define(PYTHON,
    "\n"
    "import json, sys, rtamt\n"
    "def spec(names, text):\n"
    "    s = rtamt.StlDenseTimeSpecification()\n"
    "    for name in names: s.declare_var(name, 'float')\n"
    "    s.spec = text\n"
    "    s.parse()\n"
    "    return s\n"
    "def signal(name, values): return [name, [[i / 1000.0, float(v)] for i, v in enumerate(values)]]\n"
    "for line in sys.stdin:\n"
    "    run = json.loads(line)\n"
    "    near = spec(['d'], 'eventually (d <= 300)')\n"
    "    both = spec(['a', 'b'], 'eventually (a >= 0.5 and b >= 0.5)')\n"
    "    r = near.evaluate(signal('d', run['d']))[0][1]\n"
    "    q = both.evaluate(signal('a', run['a']), signal('b', run['b']))[0][1]\n"
    "    print(json.dumps([r, q]), flush=True)\n"
).

all_test_() ->
    Python = os:getenv("STARL_PYTHON", "python3"),
    case os:cmd(Python ++ " -c 'import rtamt' 2>&1 && echo there") of
        "there\n" ->
            {timeout, 600, fun() -> agree(Python) end};
        _ ->
            fun() -> io:format(user, "rtamt: skipped, pip install rtamt~n", []) end
    end.

agree(Python) ->
    First = list_to_integer(os:getenv("STARL_DEBUG_SEED", "1")),
    Runs = [
        starl_debug_truth:make(Seed, #{ms => ?MS, sigma => 0, hz => 1000})
     || Seed <- lists:seq(First, First + ?RUNS - 1)
    ],
    Signs = robustness(Python, [starl_debug_truth:signals(1, 2, Run) || {_, Run} <- Runs]),
    Compared = lists:append([
        [
            {Seed, Text, sign(R, Least), verdict(Text, Recording)}
         || {Text, R, Least} <- [
                {"dist(r1.pos, r2.pos) < 300 mm", Near, ?LEAST_MM},
                {"owner(r1, t) and owner(r2, t)", Both, 0.1}
            ]
        ]
     || {Seed, {Recording, _}, [Near, Both]} <- lists:zip3(
            lists:seq(First, First + ?RUNS - 1), Runs, Signs
        )
    ]),
    Told = [C || {_, _, Sign, _} = C <- Compared, Sign =/= none],
    %% both signs occur, and little is left out
    ?assert(length(Told) > ?RUNS * 19 div 10),
    [?assert([x || {_, _, S, _} <- Told, S =:= Sign] =/= []) || Sign <- [certainly, never]],
    ?assertEqual([], [C || {_, _, Sign, Verdict} = C <- Told, Sign =/= Verdict]).

sign(R, Least) when R > Least -> certainly;
sign(R, Least) when R < -Least -> never;
sign(_R, _Least) -> none.

verdict(Text, Recording) ->
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Go = fun(_Done) -> continue end,
    maps:get(verdict, starl_debug_check:run(Formula, Recording, #{sigma => 0}, Go)).

robustness(Python, Runs) ->
    Port = open_port({spawn_executable, os:find_executable(Python)}, [
        {args, ["-c", ?PYTHON]}, {line, 10000}, exit_status
    ]),
    [
        begin
            true = port_command(Port, [json(Run), "\n"]),
            receive
                {Port, {data, {eol, Line}}} -> numbers(Line);
                {Port, {exit_status, Status}} -> error({python, Status})
            end
        end
     || Run <- Runs
    ].

json({Distances, A, B}) ->
    ["{\"d\": ", list(Distances), ", \"a\": ", list(A), ", \"b\": ", list(B), "}"].

list(Numbers) -> ["[", lists:join(",", [io_lib:format("~w", [N]) || N <- Numbers]), "]"].

numbers(Line) ->
    {match, Numbers} = re:run(Line, "-?[0-9][0-9.e+-]*", [global, {capture, first, list}]),
    [list_to_float(N) || [N] <- Numbers].
