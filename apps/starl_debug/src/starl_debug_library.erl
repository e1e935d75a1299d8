%% @doc Named predicates. Each is the violation of a contract that concerns a single instant.
%%
%% To add one: a line in `known/0', in the language itself. `D' and `T' stand for what is given.
-module(starl_debug_library).

-export([predicate/2, known/0]).

%% A name, what it takes, its meaning in the language, and in words.
-type entry() :: {
    starl_debug_parser:name(),
    none | length | duration,
    Text :: string(),
    Words :: string()
}.

%% @doc All predicates of the library.
-spec known() -> [entry()].
known() ->
    [
        {<<"too_near">>, length, "exists a, b: dist(a.pos, b.pos) < D",
            "two robots are nearer than that (separation is broken)"},
        {<<"two_owners">>, none, "exists a, b, token t: owner(a, t) and owner(b, t)",
            "two robots hold one token (mutual exclusion is broken)"},
        {<<"two_coordinators">>, none, "exists a, b: coordinator(a) and coordinator(b)",
            "two coordinators of path planning lead at one time"},
        {<<"two_leaders">>, none, "exists a, b, election e: leader(a, e) and leader(b, e)",
            "one election has made two robots the leader"},
        {<<"deadlock">>, duration,
            "(forall r: r.mode = waiting or r.mode = down) for D and exists r: r.mode = waiting",
            "for that time all robots that are up wait for a token or a path"},
        {<<"late_geocast">>, duration, "undelivered(D)",
            "a robot is in the area from a message's sending on for that time, and has it not"}
    ].

%% @doc The meaning of a name with these arguments.
-spec predicate(starl_debug_parser:name(), [starl_debug_parser:expr()]) ->
    {ok, starl_debug_parser:expr()} | unknown | {error, unicode:chardata()}.
predicate(Name, Arguments) ->
    case {lists:keyfind(Name, 1, known()), Arguments} of
        {false, _} ->
            unknown;
        {{_, none, Text, _}, []} ->
            starl_debug_parser:parse(Text);
        {{_, Kind, Text, _}, [Argument]} when Kind =/= none ->
            {ok, Expr} = starl_debug_parser:parse(Text),
            {ok, given(Expr, Argument)};
        {{_, Kind, _, _}, _} ->
            {error, [Name, " takes ", takes(Kind)]}
    end.

takes(none) -> "nothing";
takes(length) -> "a length: too_near(400 mm)";
takes(duration) -> "a duration, such as 2 s".

given({name, <<"D">>}, Argument) ->
    Argument;
given(Tuple, Argument) when is_tuple(Tuple) ->
    list_to_tuple([given(Part, Argument) || Part <- tuple_to_list(Tuple)]);
given(List, Argument) when is_list(List) -> [given(Part, Argument) || Part <- List];
given(Other, _Argument) ->
    Other.
