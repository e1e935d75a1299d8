%% @doc Parses the manual faults of a page ({@link starl_run_manual_fault}). In a simulation, such a fault
%% begins at the present time of the run; if it lasts, it ends after the given time or with the run.
%% In real time it happens now. Input from a page is not trusted: no atom is made from it, and every
%% value is checked as in a scenario file.
-module(starl_lab_window_fault).

-export([parse/2, faults/3, healed/3, kinds/1]).

-export_type([place/0, where/0]).

%% The world of the run, its robots and their machines.
-type place() :: #{
    world := starl_run_manual_fault:world(),
    robots := pos_integer(),
    machines := [starl_machine:name()],
    atom() => term()
}.

%% Of a simulation: the beginning and the latest end of a fault (ms), the robots, their machines, and the
%% names of faults that are taken.
-type where() :: #{
    from_ms := non_neg_integer(),
    until_ms := non_neg_integer(),
    robots := pos_integer(),
    machines := [starl_machine:name()],
    faults := [starl_run_fault:t()]
}.

-define(MOST_FAULTS, 1000).
-define(MOST_S, 1.0e6).

%% @doc The kinds of manual faults in a world, for a page: name, shape of the target, parameters
%% with their ranges, text.
-spec kinds(starl_run_manual_fault:world()) -> [[term()]].
kinds(World) ->
    [
        [Kind, Shape, [[Key | range(Type)] || {Key, Type, _} <- Specs], list_to_binary(Doc)]
     || {Kind, _, Shape, Specs, Doc} <- starl_run_manual_fault:kinds(World)
    ].

range({one_of, Words}) -> [Words];
range({_, Low, High}) -> [Low, High].

%% @doc The manual faults of a command: `kind', `target', `seconds' and `params', as in a scenario, in
%% JSON. The kind `cut' cuts the link between two robots, both ways.
-spec parse(#{binary() => term()}, place()) ->
    {ok, [starl_run_manual_fault:t(), ...]} | {error, unicode:chardata()}.
parse(#{<<"kind">> := <<"cut">>, <<"target">> := [A, B]} = Command, Place) ->
    Half = Command#{<<"kind">> := <<"loss">>, <<"params">> => #{<<"part">> => 1.0}},
    case parse(Half, Place) of
        {ok, [{loss, _, _, Lasts}]} -> {ok, starl_run_manual_fault:cut(A, B, Lasts)};
        {error, _} = Error -> Error
    end;
parse(#{<<"kind">> := Name} = Command, #{world := World} = Place) when is_binary(Name) ->
    Kinds = starl_run_manual_fault:kinds(World),
    case [Spec || Spec <- Kinds, atom_to_binary(element(1, Spec)) =:= Name] of
        [Spec] -> named(Spec, Command, Place);
        [] -> {error, ["there is no such fault here: ", short(Name)]}
    end;
parse(_Command, _Place) ->
    {error, "a fault has a kind"}.

short(Name) -> string:slice(Name, 0, 40).

named({Kind, _, Shape, Specs, _}, Command, Place) ->
    Params = maps:get(<<"params">>, Command, #{}),
    case {target(Shape, maps:get(<<"target">>, Command, none), Place), params(Params, Specs)} of
        {none, _} ->
            {error,
                io_lib:format("~ts: this target is not possible here, but ~ts", [
                    Kind, possible(Shape, Place)
                ])};
        {_, none} ->
            {error, io_lib:format("~ts: these parameters are not possible", [Kind])};
        {{ok, Target}, {ok, Values}} ->
            Fault = {Kind, Target, Values, lasts(Kind, Command)},
            checked(
                starl_run_fault:check([starl_run_manual_fault:fault(manual_1, {0, 0}, Fault)]),
                Fault
            )
    end.

checked([], Fault) -> {ok, [Fault]};
checked([Problem | _], _Fault) -> {error, starl_run_fault:format_problem(Problem)}.

%% A fault of a single moment has no end.
lasts(Kind, _Command) when Kind =:= kill_machine; Kind =:= kill_robot -> 0;
lasts(_Kind, #{<<"seconds">> := S}) when is_number(S), S >= 0, S < ?MOST_S -> round(1000 * S);
lasts(_Kind, _Command) -> lasting.

%% @doc The faults of a command in a simulation.
-spec faults(#{binary() => term()}, pos_integer(), where()) ->
    {ok, [starl_run_fault:t(), ...]} | {error, unicode:chardata()}.
faults(_Command, N, _Where) when N > ?MOST_FAULTS ->
    {error, io_lib:format("~b faults have been injected; that is enough", [?MOST_FAULTS])};
faults(Command, N, #{from_ms := From, until_ms := Until} = Where) ->
    case parse(Command, Where#{world => simulation}) of
        {ok, Manual} ->
            Id = id(N, Where),
            Ids = lists:sublist([Id, list_to_atom(atom_to_list(Id) ++ "_back")], length(Manual)),
            End = max(From, Until),
            {ok, [
                clipped(starl_run_manual_fault:fault(Name, {From, End}, Fault), End)
             || {Name, Fault} <- lists:zip(Ids, Manual)
            ]};
        {error, _} = Error ->
            Error
    end.

clipped({_, _, To, _, _, _} = Fault, End) -> setelement(3, Fault, min(To, End)).

%% The targets that the field takes, in the words of its title.
possible(robots, #{robots := N}) ->
    io_lib:format("a robot from 1 to ~b, or all", [N]);
possible(robot, #{robots := N}) ->
    io_lib:format("a robot from 1 to ~b", [N]);
possible(link, #{robots := N}) ->
    io_lib:format("a robot from 1 to ~b, a link as 1,2, or all", [N]);
possible(floor, _Where) ->
    "all";
possible(machine, _Where) ->
    "a machine as 1 sap";
possible(two, _Where) ->
    "two robots as 1,2";
possible(group, #{robots := N}) ->
    io_lib:format("robots from 1 to ~b as 1,2,3", [N]).

%% The number of names is limited, so is that of atoms.
id(N, #{faults := Faults} = Where) ->
    Id = list_to_atom("manual_" ++ integer_to_list(N)),
    case lists:keymember(Id, 1, Faults) of
        true -> id(N + 1, Where);
        false -> Id
    end.

target(floor, _Floor, _Where) ->
    {ok, all};
target(Shape, <<"all">>, _Where) when Shape =:= robots; Shape =:= link ->
    {ok, all};
target(Shape, Robot, Where) when Shape =:= robots; Shape =:= robot; Shape =:= link ->
    one(Robot, Shape, Where);
target(machine, [Robot, Name], #{machines := Machines} = Where) ->
    case [M || M <- Machines, is_robot(Robot, Where), atom_to_binary(M) =:= Name] of
        [Machine] -> {ok, {Robot, Machine}};
        [] -> none
    end;
target(two, [A, B], Where) ->
    pair(A, B, Where);
target(group, [_ | _] = Group, Where) ->
    case lists:all(fun(Robot) -> is_robot(Robot, Where) end, Group) of
        true -> {ok, lists:usort(Group)};
        false -> none
    end;
target(_Shape, _Target, _Where) ->
    none.

one([A, B], link, Where) ->
    pair(A, B, Where);
one(Robot, _Shape, Where) ->
    case is_robot(Robot, Where) of
        true -> {ok, Robot};
        false -> none
    end.

pair(A, B, Where) ->
    case is_robot(A, Where) andalso is_robot(B, Where) andalso A =/= B of
        true -> {ok, {A, B}};
        false -> none
    end.

is_robot(Robot, #{robots := N}) -> is_integer(Robot) andalso Robot >= 1 andalso Robot =< N.

params(Given, Specs) when is_map(Given) ->
    Known = [{Key, Type, maps:get(atom_to_binary(Key), Given, none)} || {Key, Type, _} <- Specs],
    case map_size(Given) =:= length([V || {_, _, V} <- Known, V =/= none]) of
        true -> {ok, maps:from_list([{Key, value(Type, V)} || {Key, Type, V} <- Known])};
        false -> none
    end;
params(_Given, _Specs) ->
    none.

value({one_of, Words}, Text) when is_binary(Text) ->
    case [Word || Word <- Words, atom_to_binary(Word) =:= Text] of
        [Word] -> Word;
        [] -> none
    end;
value(_Type, Value) ->
    Value.

%% @doc The faults with this one ended at a time (ms). Faults that are over, or cannot be healed, stay.
-spec healed(Name :: term(), non_neg_integer(), [starl_run_fault:t()]) ->
    {ok, [starl_run_fault:t()]} | {error, unicode:chardata()}.
healed(Name, NowMs, Faults) ->
    Lasting = [
        Id
     || {Id, From, To, Kind, _, _} <- Faults,
        Name =:= <<"all">> orelse atom_to_binary(Id) =:= Name,
        To > NowMs,
        From =< NowMs,
        From < To,
        lists:keymember(Kind, 1, starl_run_manual_fault:kinds(simulation))
    ],
    case Lasting of
        [] -> {error, "nothing is there to be healed"};
        _ -> {ok, [healed_one(F, NowMs, lists:member(element(1, F), Lasting)) || F <- Faults]}
    end.

healed_one(Fault, NowMs, true) -> setelement(3, Fault, NowMs);
healed_one(Fault, _NowMs, false) -> Fault.
