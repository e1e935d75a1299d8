%% @doc Reports mistakes in the use of {@link starl_property}. Each is the error `{starl_property,
%% Line}'; the line says what is wrong and what to write instead.
-module(starl_property_mistake).

-export([team/1, scenario/1, demand/1, property/1, options/1]).

-define(DEMANDS, [crashes, complete, outcome, dir]).
-define(OPTIONS, [cases, seed]).

%% @doc Is this what scenarios can be drawn for? What its values are is looked at elsewhere.
-spec team(term()) -> ok.
team(#{app := App}) when is_atom(App) -> ok;
team(Team) when is_map(Team) ->
    mistake("scenario/1: the key app is missing, the application's module");
team(Other) ->
    mistake("scenario/1: a map with the key app expected, not ~0tP", [Other, 12]).

%% @doc Is this a scenario, and not its generator?
-spec scenario(term()) -> ok.
scenario(#{app := App}) when is_atom(App) ->
    ok;
scenario(Scenario) when is_map(Scenario) ->
    mistake("holds: the key app is missing, the application's module");
scenario(_Generator) ->
    mistake(
        "holds: a scenario expected; write ?FORALL(Scenario, starl_property:scenario(...), "
        "starl_property:holds(Scenario))"
    ).

%% @doc Is this what can be demanded of a run?
-spec demand(term()) -> ok.
demand(Demand) -> keys("holds/2", ?DEMANDS, Demand).

%% @doc Is this a property? A plain `true' would pass, whatever the program does.
-spec property(term()) -> ok.
property(Plain) when is_boolean(Plain) ->
    mistake("a property expected, not ~ts; it begins with ?FORALL", [Plain]);
property(_Property) ->
    ok.

%% @doc Are these options of a test?
-spec options(term()) -> ok.
options(Options) ->
    ok = keys("quickcheck/2", ?OPTIONS, Options),
    maps:foreach(fun option/2, Options).

option(cases, N) when is_integer(N), N > 0 -> ok;
option(seed, N) when is_integer(N), N >= 0 -> ok;
option(Key, Value) ->
    mistake("quickcheck/2: ~ts: a whole number expected, not ~0tP", [Key, Value, 12]).

keys(Where, Known, Given) when is_map(Given) ->
    case maps:keys(Given) -- Known of
        [] ->
            ok;
        [Key | _] ->
            mistake("~ts: there is no key ~0tp; there are ~ts", [
                Where, Key, lists:join(", ", [atom_to_list(K) || K <- Known])
            ])
    end;
keys(Where, _Known, Given) ->
    mistake("~ts: a map expected, not ~0tP", [Where, Given, 12]).

-spec mistake(string()) -> no_return().
mistake(Line) -> mistake(Line, []).

-spec mistake(string(), [term()]) -> no_return().
mistake(Format, Args) -> error({starl_property, lists:flatten(io_lib:format(Format, Args))}).
