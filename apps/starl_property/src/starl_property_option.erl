%% @doc Generators of the values of an option, from its type in a table of options.
-module(starl_property_option).

-export([generator/2]).

-ignore_xref([
    {proper_types, boolean, 0},
    {proper_types, exactly, 1},
    {proper_types, integer, 2},
    {proper_types, oneof, 1},
    {proper_types, tuple, 1}
]).

%% The parts of a range that numbers are drawn in.
-define(PARTS, 1000).

%% @doc A generator of what the value of an option is made from, and the function that makes it: so
%% that the caller draws all values at once. It shrinks towards the option's least value. An option
%% that has no range, such as a text, is an error.
-spec generator(atom(), starl_options:type()) ->
    {starl_property:generator(), fun((term()) -> term())}.
generator(_Key, {integer, Least, Most}) ->
    {proper_types:integer(Least, Most), fun same/1};
generator(_Key, {number, Least, Most}) ->
    {proper_types:integer(0, ?PARTS), fun(N) -> Least + (Most - Least) * N / ?PARTS end};
generator(_Key, {one_of, Names}) ->
    {proper_types:oneof([proper_types:exactly(Name) || Name <- Names]), fun same/1};
generator(_Key, boolean) ->
    {proper_types:boolean(), fun same/1};
generator(Key, {between, Type}) ->
    {Part, Make} = generator(Key, Type),
    {proper_types:tuple([Part, Part]), fun({A, B}) ->
        {min(Make(A), Make(B)), max(Make(A), Make(B))}
    end};
generator(Key, {optional, Type}) ->
    {Part, Make} = generator(Key, Type),
    Some = proper_types:tuple([proper_types:exactly(some), Part]),
    {proper_types:oneof([proper_types:exactly(none), Some]), fun
        (none) -> none;
        ({some, Drawn}) -> Make(Drawn)
    end};
generator(Key, _Type) ->
    Why = io_lib:format("vary: ~tp has no range; give it a generator of its values", [Key]),
    error({starl_property, lists:flatten(Why)}).

same(Value) -> Value.
