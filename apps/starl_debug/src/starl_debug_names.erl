%% @doc Checks the names in a predicate against a recording. A name that the run cannot have is an
%% error, because a misspelt name would never be true. A name that merely does not occur gives a
%% note beside the answer.
%% ```
%%   last(r1, mutx) = acquired    no machine is called mutx (did you mean mutex?)
%%   last(r1, mutex) = aquired    mutex traces no aquired (did you mean acquired?)
%%   owner(r1, lock)              no robot has held the token lock; held were {token,1}, {token,2}
%% '''
%% The vocabularies of the run's monitors list what a machine may trace ({@link starl_event}).
%% Tokens and elections may have any name, and so may the events of a machine without a vocabulary.
-module(starl_debug_names).

-export([check/2, remarks/2, vocabulary/3]).

-export_type([vocabulary/0]).

-type name() :: starl_debug_parser:name().

%% By machine the events that it may trace, or that it has traced, if it may trace any.
-type vocabulary() :: #{name() => {closed | open, [name()]}}.

%% A name in a predicate, with its column.
-type mention() ::
    {robot, starl_debug_lexer:column(), name()}
    | {event, starl_debug_lexer:column(), Machine :: name(),
        Event :: {
            starl_debug_lexer:column(), name()
        }}
    | {token | election, starl_debug_lexer:column(), name()}.

-define(MOST, 12).

%% @doc The names of machines and their events in a run with these monitors. `Traced': the events that
%% are in its recording.
-spec vocabulary(
    [{module(), map()}], [starl_machine:name()], #{starl_machine:name() => [atom()]}
) -> vocabulary().
vocabulary(Monitors, Machines, Traced) ->
    Known = starl_monitor:known([Module || {Module, _} <- Monitors]),
    maps:from_list([
        {atom_to_binary(Machine), events(starl_event:tags(Machine, Known), Seen)}
     || Machine <- lists:usort(Machines ++ maps:keys(Traced)),
        Seen <- [maps:get(Machine, Traced, [])]
    ]).

events(any, Seen) -> {open, names(Seen)};
events(Tags, Seen) -> {closed, names(Tags ++ Seen)}.

names(Tags) -> lists:usort([atom_to_binary(Tag) || Tag <- Tags]).

%% @doc Refuses the first name that the recording cannot have; else a line for each that it does not
%% have.
-spec check(starl_debug_parser:expr(), starl_debug_recording:t()) ->
    {ok, [unicode:chardata()]} | {error, starl_debug_parser:reason()}.
check(Expr, Recording) ->
    Found = [problem(Mention, Recording) || Mention <- mentions(Expr, 1)],
    case lists:sort([Reason || {error, Reason} <- Found]) of
        [First | _] -> {error, First};
        [] -> {ok, [Line || {remark, Line} <- Found]}
    end.

%% -- what is mentioned ------------------------------------------------------------------------

-spec mentions(term(), starl_debug_lexer:column()) -> [mention()].
mentions({at, Column, Expr}, _At) ->
    mentions(Expr, Column);
mentions({call, What, [R, Name]}, At) when What =:= <<"owner">>; What =:= <<"leader">> ->
    mentions(R, At) ++ [{kind(What), C, N} || {C, {_, N}} <- [plain(Name, At)], is_binary(N)];
mentions({call, <<"last">>, [R, _Machine]}, At) ->
    mentions(R, At);
mentions({Comparison, Left, Right}, At) when Comparison =:= '='; Comparison =:= '!=' ->
    mentions(Left, At) ++ mentions(Right, At) ++ last(plain(Left, At), plain(Right, At));
mentions({name, Name}, At) ->
    [{robot, At, Name}];
mentions({field, Name, _Field}, At) ->
    [{robot, At, Name}];
mentions({Quantifier, Variables, Expr}, At) when Quantifier =:= exists; Quantifier =:= forall ->
    Own = [Name || {_Kind, Name} <- Variables],
    [M || M <- mentions(Expr, At), not lists:member(element(3, M), Own)];
mentions({call, _Name, Arguments}, At) ->
    mentions(Arguments, At);
mentions({text, _Text}, _At) ->
    [];
mentions(Tuple, At) when is_tuple(Tuple) ->
    mentions(tuple_to_list(Tuple), At);
mentions(List, At) when is_list(List) ->
    lists:flatmap(fun(Part) -> mentions(Part, At) end, List);
mentions(_Other, _At) ->
    [].

kind(<<"owner">>) -> token;
kind(<<"leader">>) -> election.

last({_, {call, <<"last">>, [_R, Machine]}}, {At, {_, Event}}) ->
    [{event, Column, Name, {At, Event}} || {Column, {_, Name}} <- [plain(Machine, At)]];
last(_Left, _Right) ->
    [].

plain({at, Column, Expr}, _At) -> plain(Expr, Column);
plain(Expr, At) -> {At, Expr}.

%% -- is it known ------------------------------------------------------------------------------

problem({robot, At, Name}, #{robots := Here, missing := Missing}) ->
    case starl_debug_type:robot_number(Name) of
        none -> known;
        N -> robot(lists:member(N, Here ++ Missing), At, Name, lists:sort(Here ++ Missing))
    end;
problem({event, At, Machine, {EventAt, Event}}, #{vocabulary := Vocabulary}) ->
    case Vocabulary of
        #{Machine := {Kind, Events}} ->
            event(lists:member(Event, Events), Kind, EventAt, Machine, Event, Events);
        #{} ->
            Known = maps:keys(Vocabulary),
            {error, {At, ["no machine is called ", Machine, other(Machine, Known)]}}
    end;
problem({Kind, _At, Name}, Recording) ->
    Known = maps:get(things(Kind), Recording),
    case lists:member(Name, Known) of
        true -> known;
        false -> {remark, [unheard(Kind), Name, other(Name, Known)]}
    end.

robot(true, _At, _Name, _Team) ->
    known;
robot(false, At, Name, Team) ->
    {error, {At, ["the team has no robot ", Name, other(Name, [robot(R) || R <- Team])]}}.

robot(R) -> <<"r", (integer_to_binary(R))/binary>>.

event(true, _Kind, _At, _Machine, _Event, _Events) ->
    known;
event(false, closed, At, Machine, Event, Events) ->
    {error, {At, [Machine, " traces no ", Event, other(Event, Events)]}};
event(false, open, _At, Machine, Event, Events) ->
    {remark, ["no event of ", Machine, " is called ", Event, other(Event, Events)]}.

things(token) -> tokens;
things(election) -> elections.

unheard(token) -> "no robot has held the token ";
unheard(election) -> "no robot was elected in the election ".

%% What else there is.
other(Name, Known) -> [starl_debug_type:similar(Name, Known), listed(Known)].

listed([]) ->
    "";
listed(Known) ->
    More = length(Known) - ?MOST,
    [
        "; there are ",
        lists:join(", ", lists:sublist(Known, ?MOST)),
        [io_lib:format(" and ~b more", [More]) || More > 0]
    ].

%% -- what nothing of the recording makes true -------------------------------------------------

%% @doc A line for each part of a predicate that nothing of the recording can make true.
-spec remarks(starl_debug_type:formula(), starl_debug_recording:t()) -> [unicode:chardata()].
remarks(Formula, Recording) -> lists:usort(lists:flatten([empty(Formula, Recording)])).

empty({Quantifier, Variables, Part}, Recording) when Quantifier =:= exists; Quantifier =:= forall ->
    [none(Kind, Variables, Recording) || {Kind, _} <- Variables] ++ empty(Part, Recording);
empty({undelivered, Us}, #{geocasts := Casts}) ->
    Lives = [Lifetime || #{lifetime := Lifetime} <- Casts],
    [short(lists:max([0 | Lives])) || lists:max([0 | Lives]) < Us];
empty({state, _Robot, {leader, _}}, Recording) ->
    without(<<"election">>, "leads", Recording);
empty({state, _Robot, {owner, _}}, Recording) ->
    without(<<"mutex">>, "holds a token", Recording);
empty({state, _Robot, coordinator}, Recording) ->
    without(<<"dpp_coordinator">>, "coordinates", Recording);
empty(Tuple, Recording) when is_tuple(Tuple) ->
    [empty(Part, Recording) || Part <- tuple_to_list(Tuple)];
empty(_Other, _Recording) ->
    [].

none(token, _Variables, #{tokens := []}) ->
    <<"no token was held in this recording">>;
none(election, _Variables, #{elections := []}) ->
    <<"no election was decided in this recording">>;
none(robot, Variables, #{robots := Robots}) ->
    Wanted = length([x || {robot, _} <- Variables]),
    [
        iolist_to_binary(
            io_lib:format("~b different robots are asked for, there are ~b", [Wanted, N])
        )
     || N <- [length(Robots)], Wanted > N
    ];
none(_Kind, _Variables, _Recording) ->
    [].

short(0) ->
    <<"no message to an area was sent in this recording">>;
short(Us) ->
    iolist_to_binary(
        io_lib:format("no message to an area lives so long here; the longest lives ~.1f s", [
            Us / 1.0e6
        ])
    ).

without(Machine, Does, #{vocabulary := Vocabulary}) ->
    [
        iolist_to_binary(["no robot ", Does, ": none has the machine ", Machine])
     || not is_map_key(Machine, Vocabulary)
    ].
