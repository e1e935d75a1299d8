%% @doc Generators of scenarios and of their faults, as PropEr knows them.
%%
%% All that a scenario is made from is drawn as one flat tuple: what is drawn within another draw does
%% not shrink on its own in PropEr.
-module(starl_property_scenario).

-export([generator/1, faults/1]).

-ignore_xref([
    {proper_types, bind, 3},
    {proper_types, exactly, 1},
    {proper_types, is_type, 1},
    {proper_types, boolean, 0},
    {proper_types, oneof, 1},
    {proper_types, noshrink, 1},
    {proper_types, binary, 1},
    {proper_types, integer, 2},
    {proper_types, tuple, 1}
]).

%% The keys that are of a team and not of a scenario.
-define(OWN, [random_faults, most_faults, heal, longest_fault, vary]).
-define(ROBOTS, {1, 5}).
-define(MOST_FAULTS, 6).
-define(HEAL_S, 60).
%% The parts of a range that numbers are drawn in.
-define(PARTS, 1000).

%% @doc A generator of scenarios for a team.
-spec generator(starl_property:team()) -> starl_property:generator().
generator(#{app := App} = Team) ->
    Machines = machines(Team),
    Values = values(App, Team),
    Request = request(Team, Machines),
    Parts = [
        robots(Team),
        %% A seed is as good as any other; a wide range of integers would begin with small ones.
        proper_types:noshrink(proper_types:binary(4)),
        starl_property_fault:drafts(Request)
        | [Generator || {_, {Generator, _}} <- Values]
    ],
    bind(Parts, fun([Robots, <<Seed:32>>, Drafts | Drawn]) ->
        Scenario = maps:from_list([
            {Key, Make(Part)}
         || {{Key, {_, Make}}, Part} <- lists:zip(Values, Drawn)
        ]),
        Given = maps:get(faults, Scenario, []),
        Scenario#{
            app => App,
            robots => Robots,
            seed => maps:get(seed, Scenario, Seed),
            faults => Given ++ starl_property_fault:made(Drafts, Robots, Request)
        }
    end).

%% @doc A generator of the faults of a team alone.
-spec faults(starl_property:team()) -> starl_property:generator().
faults(Team) ->
    Request = request(Team, machines(Team)),
    {_, Most} = bounds(Team),
    bind([starl_property_fault:drafts(Request)], fun([Drafts]) ->
        starl_property_fault:made(Drafts, Most, Request)
    end).

bind(Parts, Fun) ->
    proper_types:bind(
        proper_types:tuple(Parts),
        fun(Drawn) -> proper_types:exactly(Fun(tuple_to_list(Drawn))) end,
        false
    ).

robots(Team) ->
    {Least, Most} = bounds(Team),
    proper_types:integer(Least, Most).

bounds(#{robots := {Least, Most}}) when
    is_integer(Least), is_integer(Most), 1 =< Least, Least =< Most
->
    {Least, Most};
bounds(#{robots := Robots}) when is_integer(Robots), Robots >= 1 -> {Robots, Robots};
bounds(#{robots := Other}) ->
    wrong("robots is a number, or {Least, Greatest}; here it is ~0tP", [Other, 10]);
bounds(#{}) ->
    ?ROBOTS.

request(Team, Machines) ->
    HealMs = max(1, round(1000 * maps:get(heal, Team, ?HEAL_S))),
    Longest =
        case Team of
            #{longest_fault := Seconds} -> round(1000 * Seconds);
            #{} -> HealMs div 3
        end,
    {_, Most} = bounds(Team),
    #{
        kinds => kinds(maps:get(random_faults, Team, []), Most),
        most => maps:get(most_faults, Team, ?MOST_FAULTS),
        robots => Most,
        machines => Machines,
        until_ms => HealMs,
        longest_ms => max(1, Longest)
    }.

%% A single robot has no other to be confused with.
kinds(What, Most) ->
    Unknown = [W || W <- What, starl_run_fault:kinds_of(W) =:= []],
    _ = [
        wrong("~ts", [starl_run_scenario:format_error({problems, [{no_such_faults, W}]})])
     || W <- Unknown
    ],
    [
        Spec
     || {_, _, Shape, _, _} = Spec <- lists:usort(
            lists:append([starl_run_fault:kinds_of(W) || W <- What])
        ),
        Shape =/= two orelse Most > 1
    ].

%% The machines of a robot of this application; also shows what is wrong with the team.
machines(#{app := App} = Team) ->
    {Least, _} = bounds(Team),
    Fixed = maps:filter(fun(_, Value) -> not is_generator(Value) end, maps:without(?OWN, Team)),
    case starl_sim:plan(Fixed#{app => App, robots => Least}, #{}) of
        {ok, {_, Scene, _}} ->
            [sap, location, motion, app | [Name || {Name, _, _} <- maps:get(blocks, Scene, [])]];
        {error, Reason} ->
            wrong("~ts", [starl_sim:format_error(Reason)])
    end.

%% The values of a scenario, fixed, drawn by the user's generators, or varied over their range.
values(App, Team) ->
    Given = maps:to_list(maps:without([app, robots | ?OWN], Team)),
    Options = starl_run_scenario:options(App),
    [{Key, given(Value)} || {Key, Value} <- lists:sort(Given)] ++
        [{Key, varied(Key, Options)} || Key <- maps:get(vary, Team, [])].

given(Value) ->
    case is_generator(Value) of
        true -> {Value, fun same/1};
        false -> {proper_types:exactly(Value), fun same/1}
    end.

same(Value) -> Value.

is_generator(Value) -> proper_types:is_type(Value).

varied(Key, Options) ->
    case lists:keyfind(Key, 1, Options) of
        {Key, Type, _, _} -> of_type(Key, Type);
        false -> wrong("vary: there is no option ~tp", [Key])
    end.

-spec wrong(io:format(), [term()]) -> no_return().
wrong(Format, Args) ->
    error({starl_property, unicode:characters_to_list(io_lib:format(Format, Args))}).

%% -- the values of an option ---------------------------------------------------------------

%% A generator of what the value of an option is made from, and the function that makes it: so
%% that the caller draws all values at once. It shrinks towards the option's least value. An option
%% that has no range, such as a text, is an error.
-spec of_type(atom(), starl_options:type()) ->
    {starl_property:generator(), fun((term()) -> term())}.
of_type(_Key, {integer, Least, Most}) ->
    {proper_types:integer(Least, Most), fun same/1};
of_type(_Key, {number, Least, Most}) ->
    {proper_types:integer(0, ?PARTS), fun(N) -> Least + (Most - Least) * N / ?PARTS end};
of_type(_Key, {one_of, Names}) ->
    {proper_types:oneof([proper_types:exactly(Name) || Name <- Names]), fun same/1};
of_type(_Key, boolean) ->
    {proper_types:boolean(), fun same/1};
of_type(Key, {between, Type}) ->
    {Part, Make} = of_type(Key, Type),
    {proper_types:tuple([Part, Part]), fun({A, B}) ->
        {min(Make(A), Make(B)), max(Make(A), Make(B))}
    end};
of_type(Key, {optional, Type}) ->
    {Part, Make} = of_type(Key, Type),
    Some = proper_types:tuple([proper_types:exactly(some), Part]),
    {proper_types:oneof([proper_types:exactly(none), Some]), fun
        (none) -> none;
        ({some, Drawn}) -> Make(Drawn)
    end};
of_type(Key, _Type) ->
    Why = io_lib:format("vary: ~tp has no range; give it a generator of its values", [Key]),
    error({starl_property, lists:flatten(Why)}).
