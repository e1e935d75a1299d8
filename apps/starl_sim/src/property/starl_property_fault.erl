%% @doc Generators of faults. A draft of a fault is drawn as numbers, which PropEr shrinks one by one;
%% then it becomes a fault of a team of a certain size.
-module(starl_property_fault).

-export([drafts/1, made/3]).

-export_type([request/0, draft/0]).

-ignore_xref([
    {proper_types, exactly, 1},
    {proper_types, integer, 2},
    {proper_types, list, 1},
    {proper_types, oneof, 1},
    {proper_types, resize, 2},
    {proper_types, tuple, 1}
]).

%% The kinds to draw, the greatest number of faults, the greatest team, its machines, the time by which
%% faults are over, and the longest fault.
-type request() :: #{
    kinds := [starl_run_fault:spec()],
    most := non_neg_integer(),
    robots := pos_integer(),
    machines := [starl_machine:name()],
    until_ms := pos_integer(),
    longest_ms := pos_integer()
}.

%% The kind; when it begins, and how long it lasts, ms; numbers from which the target follows; and the
%% parts of the ranges of its parameters.
-type draft() ::
    {starl_run_fault:kind(), non_neg_integer(), non_neg_integer(), {0..1, integer(), integer()}, [
        non_neg_integer()
    ]}.

%% The parts of the range of a parameter.
-define(PARTS, 1000).

%% @doc A generator of drafts of faults.
-spec drafts(request()) -> starl_property:generator().
drafts(#{kinds := All, most := Most} = Request) ->
    %% the doors of a floor plan are not known here
    case [Spec || {_, _, Shape, _, _} = Spec <- All, Shape =/= floor] of
        Kinds when Kinds =:= []; Most =:= 0 -> proper_types:exactly([]);
        Kinds -> drafts(Kinds, Most, Request)
    end.

drafts(Kinds, Most, Request) ->
    Draft = proper_types:oneof([draft(Spec, Request) || Spec <- Kinds]),
    %% The greatest length of a list is its size; the drafts themselves do not depend on it.
    proper_types:resize(Most, proper_types:list(Draft)).

draft({Kind, _, _, Params, _}, Request) ->
    #{robots := Robots, machines := Machines, until_ms := Until, longest_ms := Longest} = Request,
    proper_types:tuple([
        proper_types:exactly(Kind),
        proper_types:integer(0, Until - 1),
        proper_types:integer(1, Longest),
        proper_types:tuple([
            proper_types:integer(0, 1),
            proper_types:integer(1, Robots),
            proper_types:integer(1, max(Robots, length(Machines)))
        ]),
        proper_types:tuple([proper_types:integer(0, ?PARTS) || _ <- Params])
    ]).

%% @doc The faults of a team of this size that these drafts stand for.
-spec made([draft()], Robots :: pos_integer(), request()) -> [starl_run_fault:t()].
made(Drafts, Robots, Request) ->
    [
        fault(Number, Draft, Spec, Robots, Request)
     || {Number, {Kind, _, _, _, _} = Draft} <- lists:enumerate(Drafts),
        {_, _, Shape, _, _} = Spec <- [lists:keyfind(Kind, 1, starl_run_fault:kinds())],
        Shape =/= two orelse Robots > 1
    ].

fault(Number, {Kind, From, Span, Who, Parts}, {_, _, Shape, Params, _}, Robots, Request) ->
    #{until_ms := Until, machines := Machines} = Request,
    Values = [
        {Name, value(Type, Range, Part)}
     || {{Name, Type, Range}, Part} <- lists:zip(Params, tuple_to_list(Parts))
    ],
    %% A bounded number of atoms: kinds times the greatest number of faults.
    Id = list_to_atom(lists:concat([Kind, "_", Number])),
    {Id, From, min(Until, From + Span), Kind, target(Shape, Who, Robots, Machines),
        maps:from_list(Values)}.

value({integer, _, _}, {Low, High}, Part) -> Low + (High - Low) * Part div ?PARTS;
value({number, _, _}, {Low, High}, Part) -> Low + (High - Low) * Part / ?PARTS;
value({one_of, Names}, _Range, Part) -> lists:nth(1 + Part rem length(Names), Names).

target(robots, {0, _, _}, _Robots, _) ->
    all;
target(link, {0, _, _}, _Robots, _) ->
    all;
target(link, {1, A, B}, Robots, _) ->
    {robot(A, Robots), robot(B, Robots)};
target(machine, {_, A, B}, Robots, Machines) ->
    {robot(A, Robots), lists:nth(1 + (B - 1) rem length(Machines), Machines)};
target(group, {_, A, B}, Robots, _) ->
    First = robot(A, Robots),
    Size = 1 + (B - 1) rem max(1, Robots - 1),
    lists:sort([robot(R, Robots) || R <- lists:seq(First, First + Size - 1)]);
target(two, {_, A, B}, Robots, _) ->
    First = robot(A, Robots),
    {First, robot(First + 1 + (B - 1) rem (Robots - 1), Robots)};
target(_One, {_, A, _}, Robots, _) ->
    robot(A, Robots).

robot(N, Robots) -> 1 + (N - 1) rem Robots.
