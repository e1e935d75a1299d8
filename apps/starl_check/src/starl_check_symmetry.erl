%% @doc Tests the symmetry that the search assumes: a step must give the same result whether robots
%% change places before it or after it. This is tried out on some of the states of every search,
%% with every permutation and every choice. The test finds machines that behave differently at
%% different robots, and machines whose data cannot be renamed.
%%
%% A search that exchanges robots gives them numbers that no machine uses for anything else. A machine
%% may look at its robot's own number, which is 1 or 2, and would do something else in a run. So at the
%% end all steps that robots have taken are taken again by robots with their own numbers.
-module(starl_check_symmetry).

-export([differs/4, numbered/2]).

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

%% @doc The place of a robot that takes a step of the search differently when each robot has its own
%% number.
-spec numbered(model(), store()) -> none | starl_check_term:place().
numbered(Model, Store) ->
    Own = starl_check_store:new(),
    Apart = starl_check_model:told_apart(Model),
    try
        lists:foreach(
            fun(Place) -> boots_alike(Place, {Model, Store}, {Apart, Own}) end,
            lists:seq(1, length(maps:get(ids, Model)))
        ),
        starl_check_store:fold(
            fun(Key, Value, ok) -> steps_alike(Key, Value, Store, {Apart, Own}) end, ok, Store
        ),
        none
    catch
        throw:{?MODULE, Place} -> Place
    after
        ok = starl_check_store:delete(Own)
    end.

boots_alike(Place, {Model, Store}, {Apart, Own}) ->
    Booted = starl_check_part:boot(Place, Model, Store),
    alike(
        Place,
        starl_check_part:own_happening(Booted, Store, Own),
        starl_check_part:boot(Place, Apart, Own)
    ).

%% Only steps of robots are remembered under a robot and its event.
steps_alike({Robot, Event}, Happening, Store, {Apart, Own}) when is_integer(Robot) ->
    Place = starl_check_robot:place(starl_check_store:term(Robot, Store)),
    Before = starl_check_part:own_robot(Robot, Store, Own),
    Happens = starl_check_part:own_event(Event, Store, Own),
    alike(
        Place,
        starl_check_part:own_happening(Happening, Store, Own),
        starl_check_part:event(Place, Before, Happens, Apart, Own)
    );
steps_alike(_Key, _Value, _Store, _Apart) ->
    ok.

alike(_Place, Same, Same) -> ok;
alike(_Place, {broken, #{what := What}}, {broken, #{what := What}}) -> ok;
alike(Place, _Searched, _Own) -> throw({?MODULE, Place}).

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
