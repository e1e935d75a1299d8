%% @doc Tests the symmetry that the search assumes: a step must give the same result whether robots
%% change places before it or after it. This is tried out on some of the states of every search,
%% with every permutation and every choice. The test finds machines that behave differently at
%% different robots, and machines whose data cannot be renamed.
-module(starl_check_symmetry).

-export([differs/4]).

-export_type([difference/0]).

%% A choice that has another effect under this permutation.
-type difference() :: {starl_check_choice:t(), starl_check_term:permutation()}.

-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type state() :: starl_check_state:t().

%% @doc The first difference found in a state, if any.
-spec differs(state(), [starl_check_term:permutation()], model(), store()) ->
    none | difference().
differs(State, Permutations, Model, Store) ->
    Steps = [
        {Choice, starl_check_step:step(Choice, State, Model, Store)}
     || Permutations =/= [], Choice <- starl_check_reduce:choices(State, Model, Store)
    ],
    first(Permutations, fun(P) -> under(P, Steps, State, Model, Store) end).

under(Permutation, Steps, State, Model, Store) ->
    Moved = starl_check_state:renamed(Permutation, State, Model, Store),
    Possible = maps:from_keys(starl_check_reduce:choices(Moved, Model, Store), []),
    first(Steps, fun({Choice, Result}) ->
        Renamed = starl_check_choice:renamed(Permutation, Choice, Store),
        case
            is_map_key(Renamed, Possible) andalso
                is_same(
                    after_it(Permutation, Result, Model, Store),
                    starl_check_step:step(Renamed, Moved, Model, Store)
                )
        of
            true -> none;
            false -> {Choice, Permutation}
        end
    end).

first([], _Try) ->
    none;
first([One | Others], Try) ->
    case Try(One) of
        none -> first(Others, Try);
        Found -> Found
    end.

after_it(Permutation, {ok, _, State}, Model, Store) ->
    {ok, none, starl_check_state:renamed(Permutation, State, Model, Store)};
after_it(_Permutation, Violation, _Model, _Store) ->
    Violation.

is_same({ok, _, State}, {ok, _, State}) -> true;
is_same({violation, _, #{what := What}}, {violation, _, #{what := What}}) -> true;
is_same(_, _) -> false.
