%% @doc Delta debugging: finds a small part of a list that still fails as the whole list does.
%%
%% The algorithm is ddmin by Zeller and Hildebrandt (Simplifying and Isolating Failure-Inducing
%% Input, IEEE Transactions on Software Engineering 28(2), 2002, section 3). It cuts the list into
%% parts, two at first. If one part alone fails, the search continues in that part. Otherwise it
%% removes each part in turn, and keeps the removal if the rest still fails. When all parts are
%% needed, it halves them. The result is 1-minimal: it no longer fails if any single item is
%% removed.
-module(starl_sim_ddmin).

-export([minimize/3]).

-export_type([test/2]).

%% Tests whether a part of the list, in the order of the list, still fails. The accumulator of
%% the tests is passed through.
-type test(Item, Acc) :: fun(([Item], Acc) -> {boolean(), Acc}).

%% @doc A 1-minimal part of a list that fails. The whole list is not tested; for n items there
%% are at most n^2 + 5n + 1 tests, and about k log n if k items are needed.
-spec minimize([Item], test(Item, Acc), Acc) -> {[Item], Acc}.
minimize([], _Test, Acc) ->
    {[], Acc};
minimize(Items, Test, Acc) ->
    case Test([], Acc) of
        {true, Next} -> {[], Next};
        {false, Next} -> one_part(Items, halves([Items]), Test, Next)
    end.

one_part([Item], _Parts, _Test, Acc) ->
    {[Item], Acc};
one_part(Items, Parts, Test, Acc) ->
    case first(Parts, Test, Acc) of
        {{found, Part}, Next} -> one_part(Part, halves([Part]), Test, Next);
        {none, Next} when length(Parts) =:= 2 -> finer(Items, Parts, Test, Next);
        {none, Next} -> without(Parts, Test, Next)
    end.

first([], _Test, Acc) ->
    {none, Acc};
first([Part | Parts], Test, Acc) ->
    case Test(Part, Acc) of
        {true, Next} -> {{found, Part}, Next};
        {false, Next} -> first(Parts, Test, Next)
    end.

%% No part fails alone: parts are left out until none can be.
without(Parts, Test, Acc) ->
    case pass([], Parts, Test, Acc) of
        {Parts, Next} -> finer(lists:append(Parts), Parts, Test, Next);
        {[_, _] = Both, Next} -> finer(lists:append(Both), Both, Test, Next);
        {Fewer, Next} -> without(Fewer, Test, Next)
    end.

%% Of two parts, each is the other's complement, and neither fails alone.
pass(Needed, Parts, _Test, Acc) when length(Needed) + length(Parts) =:= 2; Parts =:= [] ->
    {lists:reverse(Needed, Parts), Acc};
pass(Needed, [Part | Parts], Test, Acc) ->
    case Test(lists:append(lists:reverse(Needed, Parts)), Acc) of
        {true, Next} -> pass(Needed, Parts, Test, Next);
        {false, Next} -> pass([Part | Needed], Parts, Test, Next)
    end.

finer(Items, Parts, Test, Acc) ->
    case lists:all(fun(Part) -> length(Part) =:= 1 end, Parts) of
        true -> {Items, Acc};
        false -> one_part(Items, halves(Parts), Test, Acc)
    end.

halves(Parts) -> [Half || Part <- Parts, Half <- halve(Part), Half =/= []].

halve([_] = Part) ->
    [Part];
halve(Part) ->
    {Left, Right} = lists:split(length(Part) div 2, Part),
    [Left, Right].
