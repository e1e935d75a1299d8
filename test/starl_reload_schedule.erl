%% Schedules of one to three reloads at distances from 0 to 10 s, drawn from a seed: of the
%% application {@link starl_reload_census}, or of the machine {@link starl_reload_tally}. New code
%% is good, crashes (at once, later, in `init', in `code_change'), has another state, with the way
%% back or without it, or does not know an event.
-module(starl_reload_schedule).
-behaviour(starl_monitor).

-export([drawn/1, scenario/1, code/2, broken/2, violated/2, shown/1]).
-export([init/1, step/2, finish/2, interests/0]).

-export_type([t/0]).

%% What is reloaded when, on which robots; processes that are killed meanwhile.
-type t() :: #{
    seed := pos_integer(),
    robots := pos_integer(),
    reloads := [
        {AtMs :: non_neg_integer(), Robots :: [pos_integer()], TrialMs :: pos_integer(), version()}
    ],
    kills := [{AtMs :: non_neg_integer(), pos_integer(), app | tally}]
}.

%% `converted': it has a state of another shape, and `code_change'; `silent': it leaves another
%% shape, and has no `code_change'. It crashes, or does not know an event, from that time on (ms).
-type version() :: {
    app | tally, Shape :: same | {converted | silent, atom()}, Fault :: fault()
}.

-type fault() ::
    none
    | {crashes | unknown_event, From :: non_neg_integer()}
    | in_init
    | in_code_change
    | no_way_back.

-define(TRIALS_MS, [1000, 2000, 5000]).
%% The longest time between two steps of the application, and two events of the machine.
-define(LONGEST_MS, 700).

%% @doc The schedule of a seed.
drawn(Seed) ->
    _ = rand:seed(exsss, {Seed, 29, 1}),
    Robots = 1 + rand:uniform(2),
    Reloads = reloads(one_of([1, 2, 2, 2, 3, 3, 3]), rand:uniform(8000), Robots),
    #{seed => Seed, robots => Robots, reloads => Reloads, kills => kills(Reloads)}.

reloads(0, _At, _Robots) ->
    [];
reloads(Left, At, Robots) ->
    Which = one_of([lists:seq(1, Robots), lists:seq(1, Robots), [rand:uniform(Robots)]]),
    Trial = one_of(?TRIALS_MS),
    Later = At + rand:uniform(Trial - ?LONGEST_MS),
    Reload = {At, Which, Trial, version(one_of([app, tally]), Left, Later)},
    Distance = one_of([0, 0, rand:uniform(300), rand:uniform(3000), rand:uniform(10000)]),
    [Reload | reloads(Left - 1, At + Distance, Robots)].

version(Part, Left, Later) ->
    Name = element(Left, {third, second, next}),
    Shape = one_of([same, {converted, Name}, {converted, Name}, {silent, Name}]),
    {Part, Shape,
        one_of([none, none, {crashes, 0}, {crashes, Later}, in_code_change | own(Part, Later)])}.

own(app, _) -> [in_init];
own(tally, Later) -> [no_way_back, {unknown_event, 0}, {unknown_event, Later}].

%% What cannot start is killed while it is on trial.
kills(Reloads) ->
    [
        {At + rand:uniform(400), one_of(Robots), app}
     || {At, Robots, _, {app, _, in_init}} <- Reloads
    ] ++
        [
            {At + rand:uniform(2000), one_of(Robots), Part}
         || {At, Robots, _, {Part, _, _}} <- Reloads, rand:uniform(4) =:= 1, not has_init(Reloads)
        ].

has_init(Reloads) -> [1 || {_, _, _, {app, _, in_init}} <- Reloads] =/= [].

one_of(Choices) -> lists:nth(rand:uniform(length(Choices)), Choices).

%% @doc The scenario of a schedule.
scenario(#{seed := Seed, robots := Robots, reloads := Reloads, kills := Kills}) ->
    #{
        app => starl_reload_census,
        robots => Robots,
        seed => Seed,
        time => 120,
        %% versions crash by the clock
        clock_offset => 0,
        clock_drift => 0,
        reloads => [
            {At, Which, code(N, Version), #{trial_ms => Trial}}
         || {N, {At, Which, Trial, Version}} <- numbered(Reloads)
        ],
        faults => [
            {element(K, {k1, k2, k3, k4, k5, k6}), At, At, kill_machine, {R, Part}, #{}}
         || {K, {At, R, Part}} <- numbered(Kills)
        ]
    }.

numbered(List) -> lists:zip(lists:seq(1, length(List)), List).

%% @doc One line on a schedule.
shown(#{seed := Seed} = Schedule) ->
    io_lib:format("seed ~b: ~0tp", [Seed, maps:remove(seed, Schedule)]).

%% -- code -----------------------------------------------------------------------------------

%% @doc The compiled code of a version; the number makes it another code than that of other reloads.
code(Number, {Part, Shape, Fault}) ->
    Module = module(Part),
    Name = atom_to_list(Module),
    Head = [
        "-module(" ++ Name ++ ").",
        "-file(\"" ++ Name ++ ".erl\", 1).",
        "-number(" ++ integer_to_list(Number) ++ ")."
    ],
    Texts = filled(text(Part), words(Shape, Fault)) ++ code_change(Part, Shape, Fault),
    Functions = [form(Text) || Text <- Texts],
    Exports = {attribute, 1, export, [{F, A} || {function, _, F, A, _} <- Functions]},
    Forms = [form(Text) || Text <- Head] ++ [Exports | Functions],
    {ok, Module, Beam} = compile:forms(Forms, [binary, debug_info]),
    {Module, Name ++ ".erl", Beam}.

module(app) -> starl_reload_census;
module(tally) -> starl_reload_tally.

form(Text) ->
    {ok, Tokens, _} = erl_scan:string(lists:flatten(Text)),
    {ok, Form} = erl_parse:parse_form(Tokens),
    Form.

filled(Texts, Words) -> lists:foldl(fun fill/2, Texts, Words).

fill({Word, Text}, Texts) -> [string:replace(T, Word, Text, all) || T <- Texts].

text(app) ->
    [
        "blocks() -> [starl_reload_tally].",
        "options() -> [].",
        "init(R, _) -> ok = $INIT, starl:trace(R, begins), {[$FIRST], 0}.",
        "step(R, {$TAKEN, N}) -> case starl:now(R) >= $CRASHES of"
        " true -> error(planted);"
        " false -> case starl_reload_tally:count(R, N) of"
        " {done, D} -> {done, D}; M -> {continue, {$LEFT, M}} end end."
    ];
text(tally) ->
    [
        "init(_) -> {ready, {[$FIRST], 0}, []}.",
        "handle_event({call, _}, add, _, {$TAKEN, _}, #{now := Now})"
        " when Now >= $CRASHES * 1000 -> error(planted);"
        "handle_event({call, From}, add, _, {$TAKEN, N}, #{now := Now})"
        " when Now < $UNKNOWN * 1000 -> {keep_state, {$LEFT, N + 1}, [{reply, From, N + 1}]};"
        "handle_event({call, _}, add, _, {[Other | _], _}, _) when Other =/= $OWN ->"
        " error({shape, Other});"
        "handle_event(_, _, _, _, _) -> unknown_event."
    ].

words(Shape, Fault) ->
    Never = "1000000000",
    {Taken, Left, First, Own} = shapes(Shape),
    [
        {"$TAKEN", Taken},
        {"$LEFT", Left},
        {"$FIRST", First},
        {"$OWN", Own},
        {"$INIT", hd(["error(planted)" || Fault =:= in_init] ++ ["ok"])},
        {"$CRASHES", hd([integer_to_list(From) || {crashes, From} <- [Fault]] ++ [Never])},
        {"$UNKNOWN", hd([integer_to_list(From) || {unknown_event, From} <- [Fault]] ++ [Never])}
    ].

%% What it takes, what it leaves, what it starts with, what it knows. Code that has the same state
%% as the one before takes any.
shapes(same) ->
    {"[_ | _] = S", "S", "first", "Other"};
shapes({converted, Name}) ->
    Own = atom_to_list(Name),
    {"[" ++ Own ++ " | _] = S", "S", Own ++ ", first", Own};
shapes({silent, Name}) ->
    {"[_ | _] = S", "[" ++ atom_to_list(Name) ++ " | S]", "first", "Other"}.

code_change(app, _Shape, in_code_change) ->
    ["code_change(_, _) -> error(planted)."];
code_change(tally, _Shape, in_code_change) ->
    ["code_change(_, _, _) -> error(planted)."];
code_change(tally, _Shape, no_way_back) ->
    ["code_change(Md5, S, {_, N}) when is_binary(Md5) -> {ok, S, {[lost], N}}."];
code_change(app, {converted, Name}, _) ->
    [["code_change({S, N}, _) -> {[", atom_to_list(Name), " | S], N}."]];
code_change(tally, {converted, Name}, _) ->
    [
        [
            "code_change({down, _}, S, {[_ | [_ | _] = Before], N}) -> {ok, S, {Before, N}};",
            "code_change({down, _}, S, D) -> {ok, S, D};",
            "code_change(_, S, {Before, N}) -> {ok, S, {[",
            atom_to_list(Name),
            " | Before], N}}."
        ]
    ];
code_change(_, _, _) ->
    [].

%% -- what must hold -------------------------------------------------------------------------

%% @doc What a run has broken: an application that is lost, or a state that is lost without a
%% version that says so, a reload of which nothing was told, a robot with code that has failed. A
%% line each.
broken(#{robots := Robots} = Schedule, #{violations := Violations} = Outcome) ->
    Trace = starl_sim_ct:trace(Outcome),
    violated(Violations, Schedule) ++
        lists:append([of_robot(R, Schedule, Trace) || R <- lists:seq(1, Robots)]).

%% @doc The violations of a run, a line each. A machine whose version has silently left another
%% state cannot go back, and starts anew: the run ends with its crash.
violated(Violations, Schedule) ->
    case [1 || #{contract := tally, what := crashed} <- Violations, is_silent(tally, Schedule)] of
        [] -> [starl_violation:format(V) || V <- Violations];
        _ -> []
    end.

is_silent(Part, #{reloads := Reloads}) ->
    [1 || {_, _, _, {P, {silent, _}, _}} <- Reloads, P =:= Part] =/= [].

of_robot(R, Schedule, Trace) ->
    Own = [{T, Name, Event} || {T, Robot, Name, Event} <- Trace, Robot =:= R],
    Lines =
        states(R, Schedule, Own) ++ tallies(R, Schedule, Own) ++ told(R, Schedule, Own) ++
            remains(Trace, Own),
    [io_lib:format("robot ~b: ~ts", [R, Line]) || Line <- Lines].

%% The numbers of an application grow by one. If it goes back from code that has another state, they
%% go on from the switch at the earliest; if it goes back from other code, from where they are. A
%% process that was killed has lost its state, and what has started with code that converts states
%% has none for the former code.
states(R, #{kills := Kills} = Schedule, Own) ->
    Events = [E || {_, app, E} <- Own],
    Anew = length([1 || begins <- Events]) - 1,
    case length([1 || {_, Robot, app} <- Kills, Robot =:= R]) of
        0 ->
            [["began anew"] || Anew > 0] ++
                [io_lib:format("state lost: ~0tp", [Jump]) || Jump <- jumps(Events, Schedule)];
        Killed ->
            Back = length([1 || {reloaded, _, O} <- Events, is_back(O)]),
            [io_lib:format("began anew ~b times", [Anew]) || Anew > Killed + Back]
    end.

jumps(Events, Schedule) ->
    Begin = #{n => 0, least => 0, taken => #{}, schedule => Schedule},
    {_, Jumps} = lists:foldl(fun counted/2, {Begin, []}, Events),
    Jumps.

counted({counted, M, _}, {#{n := N, least := Least} = Seen, Jumps}) ->
    Jump = [{after_step, N, M} || M > N + 1 orelse M < Least],
    {Seen#{n := M, least := M + 1}, Jump ++ Jumps};
counted({reloaded, Number, taken}, {#{n := N, taken := Taken} = Seen, Jumps}) ->
    {Seen#{taken := Taken#{Number => {N, there}}}, Jumps};
counted({reloaded, Number, Outcome}, {#{taken := Taken} = Seen, Jumps}) ->
    case {is_back(Outcome), Taken} of
        {true, #{Number := {At, _}}} ->
            {Seen#{taken := Taken#{Number := {At, left}}, least := least(Number, Seen)}, Jumps};
        _ ->
            {Seen, Jumps}
    end;
counted(_, Acc) ->
    Acc.

%% The number of the crashed step may be told already. The way back leads through the versions that
%% were left before.
least(Number, #{n := N, least := Least, taken := Taken, schedule := Schedule}) ->
    Left = [{M, At} || {M, {At, How}} <- maps:to_list(Taken), M =:= Number orelse How =:= left],
    lists:min([N, Least | [At || {M, At} <- Left, has_own_state(M, Schedule)]]).

has_own_state(Number, #{reloads := Reloads}) ->
    {_, _, _, {_, Shape, _}} = lists:nth(Number, Reloads),
    Shape =/= same.

is_back(taken) -> false;
is_back(done) -> false;
is_back({migration_failed, _}) -> false;
is_back(_) -> true.

%% The numbers of the machine grow, whatever code it goes back to.
tallies(R, #{kills := Kills} = Schedule, Own) ->
    Numbers = [T || {_, app, {counted, _, T}} <- Own],
    Excused =
        [1 || {_, Robot, tally} <- Kills, Robot =:= R] =/= [] orelse is_silent(tally, Schedule),
    [
        io_lib:format("the state of its machine is lost: ~0tp", [{A, B}])
     || not Excused, {A, B} <- lists:zip(lists:droplast([0 | Numbers]), Numbers), B =< A
    ].

%% Each reload of the robot is told.
told(R, #{reloads := Reloads}, Own) ->
    {End, _, _} = lists:last(Own),
    [
        io_lib:format("nothing is told of reload ~b, ~0tp", [N, Version])
     || {N, {At, Robots, _, {Part, _, _} = Version}} <- numbered(Reloads),
        lists:member(R, Robots),
        1000 * (At + ?LONGEST_MS) < End,
        [] =:= [O || {_, Name, {reloaded, M, O}} <- Own, M =:= N, Name =:= Part]
    ].

%% Code that has failed on a robot runs nowhere a second later, while the robot works.
remains(Trace, Own) ->
    Works = [T || {T, app, {counted, _, _}} <- Own],
    Last = maps:from_list([{{Name, N}, O} || {_, Name, {reloaded, N, O}} <- Own]),
    [
        io_lib:format("~p still runs the code of reload ~b, which failed on robot ~b", [Name, N, F])
     || {T, F, Name, {reloaded, N, Outcome}} <- Trace,
        starl_reload:is_failure(Outcome),
        T + 1000000 < lists:max([0 | Works]),
        taken =:= maps:get({Name, N}, Last, none)
    ].

%% -- a monitor: all robots have counted to the end ------------------------------------------

interests() -> [app].

init(#{robots := Robots}) -> Robots.

step({_, Robot, app, {done, _}}, At) -> {ok, lists:delete(Robot, At)};
step(_, At) -> {ok, At}.

finish(_End, []) ->
    {ok, #{}};
finish(End, At) ->
    Lost = #{contract => census, what => lost, at_us => End, robots => At, details => #{}},
    {{violation, [Lost]}, #{}}.
