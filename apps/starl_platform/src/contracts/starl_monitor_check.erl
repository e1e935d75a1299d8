%% @doc Finds mistakes in monitors. It checks what it can before a run, and each answer of a monitor
%% during the run. A mistake is reported as one line with file and line number.
%% ```
%%   1> starl_monitor_check:call(flock_monitor, finish, [0, State]).
%%   {error, "flock_monitor.erl:38: finish/2 returned {violation,[],#{}}; expected {ok, #{...}} or ..."}
%% '''
-module(starl_monitor_check).

-export([check/2, start/2, call/3, is_violation/1]).

-export_type([reason/0]).

-define(CALLBACKS, [{init, 1}, {step, 2}, {finish, 2}]).
%% What a violation is made of, and what each part has to be.
-define(VIOLATION, [
    {contract, "an atom"},
    {what, "an atom"},
    {at_us, "a time in whole microseconds"},
    {robots, "a list of robots"},
    {details, "a map"}
]).
%% The facts of runs in which contexts are tried: one heals, one never does.
-define(RUNS, [
    #{
        broken => [],
        faults => [],
        bodies => [],
        positions => [],
        healed_us => Healed,
        core => #{rest => [], healed_us => Healed},
        delay_us => 1000,
        loss => 0.0,
        sap => #{},
        slack_us => 0
    }
 || Healed <- [0, never]
]).

%% A mistake in a list of monitors, or in a monitor itself, whose line begins with its place.
-type reason() ::
    {listed, module(), Why :: unicode:chardata()} | {mistake, Line :: unicode:chardata()}.

%% @doc Checks the monitors of a run whose robots have these machines, beside those that every robot
%% has: are the modules there, with their callbacks; do they begin; do they want events of machines
%% that there are? Monitors of StarL are trusted.
-spec check([{module(), Config :: map()}], [starl_machine:name()]) -> ok | {error, reason()}.
check(Monitors, Machines) ->
    Modules = [Module || {Module, _} <- Monitors],
    case Modules -- lists:usort(Modules) of
        [] ->
            Own = [Monitor || {Module, _} = Monitor <- Monitors, not starl_code:is_library(Module)],
            All = lists:usort(Machines ++ starl_event:machines()),
            first([fun() -> whole(Monitor, All) end || Monitor <- Own]);
        [Twice | _] ->
            {error, {listed, Twice, io_lib:format("~tp is listed twice", [Twice])}}
    end.

first([]) ->
    ok;
first([Check | Checks]) ->
    case Check() of
        ok -> first(Checks);
        {error, _} = Error -> Error
    end.

whole({Module, Config}, Machines) ->
    case code:ensure_loaded(Module) of
        {module, Module} ->
            Checks = [
                fun() -> exports(Module) end,
                fun() -> begins(Module, Config, Machines) end
            ],
            case first(Checks) of
                ok -> ok;
                {error, Line} -> {error, {mistake, Line}}
            end;
        {error, _} ->
            {error, {listed, Module, io_lib:format("there is no module ~tp", [Module])}}
    end.

exports(Module) ->
    case [{F, A} || {F, A} <- ?CALLBACKS, not erlang:function_exported(Module, F, A)] of
        [] -> ok;
        [{F, A} | _] -> {error, not_there(starl_code:line(Module, F, A), Module, F, A)}
    end.

not_there({ok, _, _}, Module, F, A) ->
    Line = "~ts: ~ts/~b is not exported",
    io_lib:format(Line, [starl_app:place(Module, F, A), F, A]);
not_there(none, Module, F, A) ->
    Line = "~ts: ~ts/~b is missing; a monitor exports init/1, step/2 and finish/2",
    io_lib:format(Line, [starl_app:place(Module, none, 0), F, A]).

begins(Module, Config, Machines) ->
    Contexts = [in_context(Module, Run, Config) || Run <- ?RUNS],
    first(
        [fun() -> began(In, Module, Machines) end || In <- Contexts] ++
            [
                fun() -> answered(call(Module, vocabulary, [])) end
             || starl_callback:exported(Module, vocabulary, 0)
            ]
    ).

in_context(Module, Run, Config) ->
    case starl_callback:exported(Module, context, 2) of
        true -> call(Module, context, [Run, Config]);
        false -> {ok, Config}
    end.

began({ok, Config}, Module, Machines) ->
    case start(Module, Config) of
        {ok, all, _State} -> ok;
        {ok, Wanted, _State} -> wants(Wanted -- Machines, Module, Machines);
        {error, _} = Error -> Error
    end;
began({error, _} = Error, _Module, _Machines) ->
    Error.

wants([], _Module, _Machines) ->
    ok;
wants([Name | _], Module, Machines) ->
    Arity = hd([A || A <- [1, 0], starl_callback:exported(Module, interests, A)]),
    {error,
        io_lib:format("~ts: interests/~b: there is no machine ~tp in this run~ts", [
            starl_app:place(Module, interests, Arity), Arity, Name, meant(Name, Machines)
        ])}.

meant(Name, Machines) ->
    Known = lists:join(", ", [atom_to_list(M) || M <- lists:usort(Machines)]),
    starl_similar:meant(starl_similar:atoms(Name, Machines), [" (it has ", Known, ")"]).

%% @doc Starts a monitor: the machines whose events it wants, and its state.
-spec start(module(), Config :: map()) ->
    {ok, [starl_machine:name()] | all, starl_monitor:state()} | {error, unicode:chardata()}.
start(Module, Config) ->
    case call(Module, init, [Config]) of
        {ok, State} -> started(interests(Module, State), State);
        {error, _} = Error -> Error
    end.

started({ok, Interests}, State) -> {ok, Interests, State};
started({error, _} = Error, _State) -> Error.

interests(Module, State) ->
    case
        {
            starl_callback:exported(Module, interests, 1),
            starl_callback:exported(Module, interests, 0)
        }
    of
        {true, _} -> call(Module, interests, [State]);
        {false, true} -> call(Module, interests, []);
        {false, false} -> {ok, all}
    end.

answered({ok, _}) -> ok;
answered({error, _} = Error) -> Error.

%% -- answers --------------------------------------------------------------------------------

%% @doc Calls a monitor. If it crashes, or its answer is none: one line with the place.
-spec call(module(), Callback :: atom(), Args :: [term()]) ->
    {ok, Answer :: term()} | {error, unicode:chardata()}.
call(Module, Callback, Args) ->
    case starl_app:declared(Module, Callback, Args) of
        {ok, Answer} -> sound(problem(Callback, Answer), Answer, Module, Callback, length(Args));
        {error, _} = Error -> Error
    end.

sound(none, Answer, _Module, _Callback, _Arity) ->
    {ok, Answer};
sound(Problem, _Answer, Module, Callback, Arity) ->
    Place = starl_app:place(Module, Callback, Arity),
    {error, io_lib:format("~ts: ~ts/~b returned ~ts", [Place, Callback, Arity, Problem])}.

%% What is wrong with the answer of a callback.
problem(step, {ok, _State}) ->
    none;
problem(step, {violation, Violation, _State}) ->
    of_violation(Violation);
problem(step, Other) ->
    no("{ok, State} or {violation, Violation, State}", Other);
problem(finish, {ok, Results}) when is_map(Results) ->
    none;
problem(finish, {{violation, [_ | _] = Violations}, Results}) when is_map(Results) ->
    of_violations(Violations);
problem(finish, Other) ->
    no("{ok, #{...}} or {{violation, [Violation]}, #{...}}", Other);
problem(interests, all) ->
    none;
problem(interests, Names) ->
    unless(is_list_of(fun is_atom/1, Names), "all or a list of machines", Names);
problem(context, Config) ->
    unless(is_map(Config), "a configuration, #{...}", Config);
problem(vocabulary, Names) ->
    unless(is_vocabulary(Names), "#{Machine => [{Event, Size}]}", Names);
problem(_, _Any) ->
    none.

unless(true, _Expected, _Answer) -> none;
unless(false, Expected, Answer) -> no(Expected, Answer).

no(Expected, Answer) -> io_lib:format("~0tP; expected: ~ts", [Answer, 20, Expected]).

of_violations([]) ->
    none;
of_violations([Violation | Violations]) ->
    case of_violation(Violation) of
        none -> of_violations(Violations);
        Problem -> Problem
    end;
of_violations(Tail) ->
    no("a list of violations", Tail).

of_violation(Violation) when is_map(Violation) ->
    case [Part || {Key, _} = Part <- ?VIOLATION, not is_part(Key, Violation)] of
        [] -> none;
        [{Key, Expected} | _] when is_map_key(Key, Violation) -> wrong(Key, Expected, Violation);
        [{Key, Expected} | _] -> ["a violation without the key ", atom_to_list(Key), ", ", Expected]
    end;
of_violation(Other) ->
    no("a violation, #{contract => ..., what => ..., ...}", Other).

wrong(Key, Expected, Violation) ->
    Value = maps:get(Key, Violation),
    io_lib:format("a violation with ~ts => ~0tP; expected: ~ts", [Key, Value, 12, Expected]).

%% @doc Is this a violation, with all that belongs to it?
-spec is_violation(term()) -> boolean().
is_violation(Violation) -> of_violation(Violation) =:= none.

is_part(Key, Violation) ->
    is_map_key(Key, Violation) andalso is_right(Key, maps:get(Key, Violation)).

is_right(contract, Contract) -> is_atom(Contract);
is_right(what, What) -> is_atom(What);
is_right(at_us, At) -> is_integer(At);
is_right(robots, Robots) -> is_list_of(fun is_robot/1, Robots);
is_right(details, Details) -> is_map(Details).

is_robot(Robot) -> is_integer(Robot) andalso Robot > 0.

is_list_of(Is, [First | Rest]) -> Is(First) andalso is_list_of(Is, Rest);
is_list_of(_Is, Rest) -> Rest =:= [].

is_vocabulary(Names) when is_map(Names) ->
    Is = fun({Machine, Events}) -> is_atom(Machine) andalso is_list_of(fun is_event/1, Events) end,
    lists:all(Is, maps:to_list(Names));
is_vocabulary(_) ->
    false.

is_event({Tag, Size}) -> is_atom(Tag) andalso is_integer(Size) andalso Size >= 0;
is_event(_) -> false.
