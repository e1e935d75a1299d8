%% @doc Makes faults of what hands do at a page. A fault begins at the present time of the run and,
%% if it lasts, ends after the time given or with the run. What a page says is not trusted: no atom
%% is made from it, and every value is checked as in a scenario file.
-module(starl_view_hand).

-export([faults/3, healed/3, kinds/0]).

-export_type([where/0]).

%% The beginning and the latest end of a fault (ms), the robots, their machines, and the names of
%% faults that are taken.
-type where() :: #{
    from_ms := non_neg_integer(),
    until_ms := non_neg_integer(),
    robots := pos_integer(),
    machines := [starl_machine:name()],
    faults := [starl_sim_fault:t()]
}.

-define(MOST_HANDS, 1000).

%% @doc The kinds of faults that hands can do. A clock cannot be touched: timers that run were set
%% by it.
-spec kinds() -> [starl_sim_fault:spec()].
kinds() -> [Spec || {_, Class, _, _, _} = Spec <- starl_sim_fault:kinds(), Class =/= clock].

%% @doc The faults of a command: `kind', `target', `seconds' and `params', as in a scenario, in
%% JSON. The kind `cut' cuts the link between two robots, both ways.
-spec faults(#{binary() => term()}, pos_integer(), where()) ->
    {ok, [starl_sim_fault:t(), ...]} | {error, unicode:chardata()}.
faults(_Command, N, _Where) when N > ?MOST_HANDS ->
    {error, io_lib:format("hands have done ~b things; that is enough", [?MOST_HANDS])};
faults(#{<<"kind">> := <<"cut">>, <<"target">> := [A, B]} = Command, N, Where) ->
    Cut = Command#{<<"kind">> := <<"loss">>, <<"params">> => #{<<"part">> => 1.0}},
    both([faults(Cut#{<<"target">> := Link}, N, Where) || Link <- [[A, B], [B, A]]]);
faults(#{<<"kind">> := Name} = Command, N, Where) when is_binary(Name) ->
    case [Spec || Spec <- kinds(), atom_to_binary(element(1, Spec)) =:= Name] of
        [Spec] -> named(Spec, Command, N, Where);
        [] -> {error, ["hands cannot do this: ", short(Name)]}
    end;
faults(_Command, _N, _Where) ->
    {error, "a fault has a kind"}.

both([{ok, [There]}, {ok, [Back]}]) ->
    Id = list_to_atom(atom_to_list(element(1, There)) ++ "_back"),
    {ok, [There, setelement(1, Back, Id)]};
both([{error, _} = Error | _]) ->
    Error.

short(Name) -> string:slice(Name, 0, 40).

named({Kind, _, Shape, Specs, _} = Spec, Command, N, Where) ->
    Params = maps:get(<<"params">>, Command, #{}),
    case {target(Shape, maps:get(<<"target">>, Command, none), Where), params(Params, Specs)} of
        {none, _} ->
            {error,
                io_lib:format("~ts: this target is not possible here, but ~ts", [
                    Kind, possible(Shape, Where)
                ])};
        {_, none} ->
            {error, io_lib:format("~ts: these parameters are not possible", [Kind])};
        {{ok, Target}, {ok, Values}} ->
            #{from_ms := From} = Where,
            Fault = {id(N, Where), From, until(Spec, Command, Where), Kind, Target, Values},
            checked(starl_sim_fault:check([Fault]), Fault)
    end.

%% What the field takes, as its title says it.
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

checked([], Fault) -> {ok, [Fault]};
checked([Problem | _], _Fault) -> {error, starl_sim_fault:format_problem(Problem)}.

%% The number of names is limited, so is that of atoms.
id(N, #{faults := Faults} = Where) ->
    Id = list_to_atom("hand_" ++ integer_to_list(N)),
    case lists:keymember(Id, 1, Faults) of
        true -> id(N + 1, Where);
        false -> Id
    end.

%% What happens at a moment has no end.
until({Kind, _, _, _, _}, _Command, #{from_ms := From}) when
    Kind =:= kill_machine; Kind =:= kill_robot
->
    From;
until(_Spec, #{<<"seconds">> := S}, #{from_ms := From, until_ms := Until}) when
    is_number(S), S >= 0, S < 1.0e6
->
    min(From + round(1000 * S), max(From, Until));
until(_Spec, _Command, #{from_ms := From, until_ms := Until}) ->
    max(From, Until).

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

%% @doc The faults with this one ended at a time (ms); what is over, or cannot be undone, stays.
-spec healed(Name :: term(), non_neg_integer(), [starl_sim_fault:t()]) ->
    {ok, [starl_sim_fault:t()]} | {error, unicode:chardata()}.
healed(Name, NowMs, Faults) ->
    Lasting = [
        Id
     || {Id, From, To, Kind, _, _} <- Faults,
        Name =:= <<"all">> orelse atom_to_binary(Id) =:= Name,
        To > NowMs,
        From =< NowMs,
        From < To,
        lists:keymember(Kind, 1, kinds())
    ],
    case Lasting of
        [] -> {error, "nothing is there to be healed"};
        _ -> {ok, [healed_one(F, NowMs, lists:member(element(1, F), Lasting)) || F <- Faults]}
    end.

healed_one(Fault, NowMs, true) -> setelement(3, Fault, NowMs);
healed_one(Fault, _NowMs, false) -> Fault.
