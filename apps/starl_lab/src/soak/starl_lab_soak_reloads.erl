%% @doc Reloads in soak runs of the application `exercise': draws them, and judges their contract as
%% a monitor. New code is sound or not: it keeps the state as it is, gives it another shape, crashes
%% at once, after a step or on some robots only, or cannot convert the state.
%%
%% The contract:
%% <ul>
%% <li>Sound code never fails.</li>
%% <li>A robot reports the result of each reload, unless it went down meanwhile.</li>
%% <li>If code has failed on a robot, all other robots go back from it.</li>
%% <li>No application is given up, and none ends by itself, except an application that has started with
%%   such code and has no state for the code to which it goes back.</li>
%% </ul>
-module(starl_lab_soak_reloads).
-behaviour(starl_monitor).

-export([add/2]).
-export([init/1, step/2, finish/2, interests/0]).

-export_type([config/0]).

%% The sound reloads, and when which robots get each.
-type config() :: #{
    sound := [starl_reload:count()],
    orders := #{starl_reload:count() => {AtUs :: integer(), [starl:robot_id()]}}
}.

-type version() ::
    sound
    | reshaped
    | crashes_at_once
    | crashes_after_a_step
    | crashes_on_some
    | takes_nothing_over.

-define(VERSIONS, [
    sound,
    sound,
    reshaped,
    reshaped,
    crashes_at_once,
    crashes_after_a_step,
    crashes_on_some,
    takes_nothing_over
]).
%% The latest first reload, the longest distance between two, and trial times, ms.
-define(LATEST_MS, 15000).
-define(DISTANCE_MS, 10000).
-define(TRIALS_MS, [2000, 5000, 60000]).
%% Longer than a step: a call waits for its answer for a minute or two at most.
-define(LONGER_MS, 300000).
%% The calls of an application before which it has heeded a word for sure: it heeds words between steps.
-define(CALLS, 10).

%% What is known of an application: the times of its last calls, the newest first; what it has told last
%% of each reload; whether it has just left a version, and how often it has started anew.
-record(app, {
    calls = [] :: [integer()],
    told = #{} :: #{starl_reload:count() => starl_reload:outcome()},
    has_left = false :: boolean(),
    restarts = 0 :: non_neg_integer()
}).

-record(state, {
    sound :: [starl_reload:count()],
    %% the words that a robot has not answered for yet
    due :: #{{starl:robot_id(), starl_reload:count()} => AtUs :: integer()},
    failed = #{} :: #{starl_reload:count() => AtUs :: integer()},
    apps = #{} :: #{starl:robot_id() => #app{}}
}).

%% -- the draw -------------------------------------------------------------------------------

%% @doc Adds one to three reloads to every second scenario, and the monitor of their contract.
-spec add(Seed :: integer(), #{atom() => term()}) -> #{atom() => term()}.
add(Seed, #{robots := Robots, block := Block} = Scenario) ->
    Key = {Seed, Block, reloads},
    case starl_run_draw:between(Key, -2, 3) of
        N when N > 0 ->
            Drawn = drawn(N, Key, Robots),
            Scenario#{
                reloads => [entry(Reload) || Reload <- Drawn],
                watch => [{?MODULE, config(Drawn)}]
            };
        _ ->
            Scenario
    end.

drawn(N, Key, Robots) ->
    First = starl_run_draw:between({Key, at}, 1000, ?LATEST_MS),
    Distances = [distance({Key, K, distance}) || K <- lists:seq(2, N)],
    Times = lists:foldl(fun(Ms, [At | _] = Ats) -> [At + Ms | Ats] end, [First], Distances),
    [
        {At, some({Key, K}, Robots), Version, trial(Version, {Key, K, trial})}
     || {K, At} <- lists:zip(lists:seq(1, N), lists:reverse(Times)),
        Version <- [one_of(?VERSIONS, {Key, K, version})]
    ].

%% Often within one step.
distance(Key) -> one_of([0, starl_run_draw:between(Key, 0, ?DISTANCE_MS)], {Key, which}).

some(Key, Robots) ->
    case starl_run_draw:between({Key, robots}, 1, 3) of
        1 -> [starl_run_draw:between({Key, robot}, 1, Robots)];
        _ -> lists:seq(1, Robots)
    end.

%% Code whose trial has ended may crash for good, and a step may take longer than a trial: this code
%% crashes before.
trial(Version, _Key) when
    Version =:= crashes_at_once; Version =:= crashes_after_a_step; Version =:= crashes_on_some
->
    ?LONGER_MS;
trial(_Version, Key) ->
    one_of(?TRIALS_MS, Key).

one_of(List, Key) -> lists:nth(starl_run_draw:between(Key, 1, length(List)), List).

entry({At, Robots, Version, Trial}) -> {At, Robots, code(Version), #{trial_ms => Trial}}.

config(Drawn) ->
    Numbered = lists:zip(lists:seq(1, length(Drawn)), Drawn),
    #{
        sound => [N || {N, {_, _, V, _}} <- Numbered, V =:= sound orelse V =:= reshaped],
        orders => maps:from_list([{N, {1000 * At, Robots}} || {N, {At, Robots, _, _}} <- Numbered])
    }.

%% -- new code -------------------------------------------------------------------------------

%% The code of a version: it calls the first code, which does not know the other shape.
-spec code(version()) -> starl_version:code().
code(Version) ->
    Functions = [form(Text) || Text <- text(Version)],
    Names = [{Name, Arity} || {function, _, Name, Arity, _} <- Functions],
    Forms = [{attribute, 1, module, starl_exercise}, {attribute, 1, export, Names} | Functions],
    {ok, Module, Beam} = compile:forms(Forms, [binary, debug_info]),
    {Module, "starl_exercise.erl", Beam}.

form(Text) ->
    {ok, Tokens, _} = erl_scan:string(Text),
    {ok, Form} = erl_parse:parse_form(Tokens),
    Form.

text(reshaped) ->
    [
        "init(R, A) -> {shaped, apply(starl_exercise, init, [R, A])}.",
        "code_change({shaped, S}, _) -> {shaped, S}; code_change(S, _) -> {shaped, S}.",
        "step(R, {shaped, S}) -> inner(R, S); step(R, S) -> inner(R, S).",
        "inner(R, S) -> case apply(starl_exercise, step, [R, S]) of"
        " {continue, Next} -> {continue, {shaped, Next}}; Done -> Done end."
    ];
text(Version) ->
    [
        "init(R, A) -> apply(starl_exercise, init, [R, A]).",
        "step(R, S) -> " ++ step(Version) ++ ".",
        "inner(R, {shaped, S}) -> case inner(R, S) of"
        " {continue, Next} -> {continue, {shaped, Next}}; Done -> Done end;"
        "inner(R, S) -> apply(starl_exercise, step, [R, S])."
        | code_change(Version)
    ].

step(crashes_at_once) ->
    "error({planted, R, S})";
step(crashes_after_a_step) ->
    "case inner(R, S) of {continue, _} -> error(planted); Done -> Done end";
step(crashes_on_some) ->
    "case starl:id(R) rem 2 of 1 -> error(planted); 0 -> inner(R, S) end";
step(_) ->
    "inner(R, S)".

code_change(takes_nothing_over) -> ["code_change(_, _) -> error(planted)."];
code_change(_) -> [].

%% -- the contract ---------------------------------------------------------------------------

%% @doc Nothing has been reloaded yet.
-spec init(config()) -> #state{}.
init(#{sound := Sound, orders := Orders}) ->
    Due = [{{R, N}, At} || {N, {At, Robots}} <- maps:to_list(Orders), R <- Robots],
    #state{sound = Sound, due = maps:from_list(Due)}.

%% @doc What applications do, and the ends of machines and robots.
-spec interests() -> [starl_machine:name()].
interests() -> [app, robot, supervisor].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({At, Robot, app, {reloaded, N, Outcome}}, State) ->
    told(At, Robot, N, Outcome, State);
step({At, Robot, app, {call, _, _}}, State) ->
    calls(At, Robot, State);
step({_, Robot, app, crashed}, State) ->
    #app{restarts = N} = App = app(Robot, State),
    {ok, noted(Robot, App#app{restarts = N + 1, told = #{}, calls = []}, State)};
step({_, Robot, robot, down}, #state{due = Due} = State) ->
    {ok, State#state{due = maps:filter(fun({R, _}, _) -> R =/= Robot end, Due)}};
step({At, Robot, supervisor, {crashed, app, {Why, _}}}, State) ->
    case app(Robot, State) of
        #app{has_left = true, restarts = N} when N > 1 -> {ok, State};
        _ -> broken(ended, At, Robot, #{reason => Why}, State)
    end;
step({At, Robot, supervisor, {given_up, app}}, State) ->
    broken(given_up, At, Robot, #{}, State);
step(_Event, State) ->
    {ok, State}.

told(At, Robot, N, Outcome, #state{sound = Sound, due = Due, failed = Failed} = State) ->
    #app{told = Told} = App = app(Robot, State),
    Heard = noted(
        Robot,
        App#app{told = Told#{N => Outcome}, has_left = has_left(Outcome)},
        State#state{due = maps:remove({Robot, N}, Due)}
    ),
    case
        {is_own_failure(Outcome) andalso lists:member(N, Sound), starl_reload:is_failure(Outcome)}
    of
        {true, _} ->
            Why = unicode:characters_to_list(starl_reload:reason(Outcome)),
            broken(sound_code_failed, At, Robot, #{reload => N, reason => Why}, Heard);
        {false, true} ->
            {ok, Heard#state{failed = maps:merge(#{N => At}, Failed)}};
        {false, false} ->
            {ok, Heard}
    end.

has_left(taken) -> false;
has_left(done) -> false;
has_left({migration_failed, _}) -> false;
has_left(_) -> true.

is_own_failure({crashed, _}) -> true;
is_own_failure({migration_failed, _}) -> true;
is_own_failure(_) -> false.

calls(At, Robot, #state{due = Due, failed = Failed} = State) ->
    #app{calls = Before, told = Told} = App = app(Robot, State),
    Calls = lists:sublist([At | Before], ?CALLS),
    Noted = noted(Robot, App#app{calls = Calls, has_left = false}, State),
    Since = since(Calls),
    case
        {
            [N || {{R, N}, Us} <- lists:sort(maps:to_list(Due)), R =:= Robot, Us < Since],
            [N || {N, taken} <- lists:sort(maps:to_list(Told)), maps:get(N, Failed, At) < Since]
        }
    of
        {[], []} -> {ok, Noted};
        {[N | _], _} -> broken(not_told, At, Robot, #{reload => N}, Noted);
        {[], [N | _]} -> broken(still_runs, At, Robot, #{reload => N}, Noted)
    end.

%% The first of its last calls, with some time for the news to come; before all, if there are few.
since(Calls) when length(Calls) < ?CALLS -> -1;
since(Calls) -> lists:last(Calls) - 1000000.

app(Robot, #state{apps = Apps}) -> maps:get(Robot, Apps, #app{}).

noted(Robot, App, #state{apps = Apps} = State) -> State#state{apps = Apps#{Robot => App}}.

broken(What, At, Robot, Details, State) ->
    Violation = #{
        contract => reload, what => What, at_us => At, robots => [Robot], details => Details
    },
    {violation, Violation, State}.

%% @doc Judges nothing at the end.
-spec finish(integer(), #state{}) -> {ok, #{}}.
finish(_EndUs, #state{}) -> {ok, #{}}.
