%% @doc The assumptions and guarantees of a block, as data. They follow the paper's section IV,
%% which composes blocks by their properties.
%%
%% A guarantee holds as long as all its assumptions do. It assumes conditions of the world
%% ({@link conditions/0}), or guarantees of other blocks:
%% ```
%%   guarantees() -> [
%%       {agree, safety, "all that elect elect the same", []},
%%       {elected, progress, "all elect", [alive, {sap, delivered}]}
%%   ].
%% '''
%% {@link composed/2} computes for the blocks of an application which guarantees remain when some
%% conditions are broken. An application may rely on those, and on no others.
-module(starl_guarantee).

-export([conditions/0, text/1, check/1, composed/2]).

-export_type([t/0, proposition/0, condition/0, assumption/0, part/0, verdict/0]).

%% `safety': nothing bad happens, at no time. `progress': something good happens in the end, while its
%% assumptions hold.
-type t() :: {Name :: atom(), safety | progress, Says :: string(), [assumption()]}.

%% What the paper says, the guarantee that says it here, and the clauses of contracts that judge it, by the
%% names of their violations.
-type proposition() :: {Of :: string(), Guarantee :: atom(), Clauses :: [atom(), ...]}.

%% A condition; a guarantee of another block; or at least one of several.
-type assumption() ::
    condition() | {Block :: atom(), Guarantee :: atom()} | {any, [condition(), ...]}.

-type condition() ::
    clock_rate
    | clock_set
    | clock_jump
    | clock_forward
    | clock_near
    | prompt
    | positions
    | grip
    | store
    | delivery
    | no_loss
    | quick
    | alive
    | no_restart
    | devices
    | senses
    | ways.

%% A block, or an application, with its guarantees.
-type part() :: {Name :: atom(), [t()]}.

%% Why a guarantee may fail: broken conditions, and guarantees of others that may fail themselves.
-type verdict() :: holds | {open, [assumption(), ...]}.

%% @doc The conditions, each in words.
-spec conditions() -> [{condition(), string()}].
conditions() ->
    [
        {clock_rate, "clocks run within 1 % of real time"},
        {clock_set, "no clock is set"},
        {clock_jump, "no clock is set by more than jump_ms (2 s) within a lease"},
        {clock_forward, "no clock is set back"},
        {clock_near, "clocks differ by less than ahead_ms (10 s)"},
        {prompt, "no computer stands still, or is later than lag_ms (250 ms)"},
        {positions, "positions are right within their stated error"},
        {grip, "wheels slip by no more than half, and hear their commands"},
        {store, "a store gives back what it took"},
        {delivery, "packets get through, again and again"},
        {no_loss, "nothing is lost"},
        {quick, "packets are quick (bully: half of answer_ms each way)"},
        {alive, "no robot dies for good"},
        {no_restart, "no machine and no robot restarts"},
        {devices, "chassis and tools obey"},
        {senses, "senses are there, fresh and right"},
        {ways, "nothing is in the way but what the floor plan shows"}
    ].

%% @doc An assumption in words.
-spec text(assumption()) -> unicode:chardata().
text({any, Conditions}) -> lists:join(", or ", [text(One) || One <- Conditions]);
text({Block, Guarantee}) -> io_lib:format("~ts: ~ts", [Block, Guarantee]);
text(Condition) -> proplists:get_value(Condition, conditions()).

%% @doc Are these guarantees well formed? Otherwise one line.
-spec check(term()) -> ok | {error, unicode:chardata()}.
check(Guarantees) when is_list(Guarantees) ->
    case [One || One <- Guarantees, not is_one(One)] of
        [] -> ok;
        [One | _] -> {error, expected(One)}
    end;
check(Other) ->
    {error, expected(Other)}.

expected(Term) ->
    io_lib:format(
        "guarantees/0: {Name, safety | progress, \"Text\", [Assumption]} expected, not ~0tP", [
            Term, 12
        ]
    ).

is_one({Name, Kind, Says, Assumed}) when is_atom(Name), is_list(Assumed) ->
    lists:member(Kind, [safety, progress]) andalso io_lib:printable_unicode_list(Says) andalso
        lists:all(fun is_assumption/1, Assumed);
is_one(_) ->
    false.

is_assumption({any, [_ | _] = Conditions}) -> lists:all(fun is_condition/1, Conditions);
is_assumption({Block, Guarantee}) -> is_atom(Block) andalso is_atom(Guarantee);
is_assumption(Condition) -> is_condition(Condition).

is_condition(Condition) -> lists:keymember(Condition, 1, conditions()).

%% @doc The guarantees of some parts that remain if these conditions are broken. A guarantee is open
%% if it rests on a guarantee of a part that is missing.
-spec composed([part()], Broken :: [condition()]) ->
    [{Name :: atom(), [{t(), verdict()}]}].
composed(Parts, Broken) ->
    Open = open(Parts, Broken, all_but(Parts)),
    [{Name, [{One, verdict(One, Broken, Open)} || One <- Own]} || {Name, Own} <- Parts].

%% What a part assumes of parts that are not there.
all_but(Parts) ->
    There = [{Name, Guarantee} || {Name, Own} <- Parts, {Guarantee, _, _, _} <- Own],
    Assumed = [Pair || {_, Own} <- Parts, {_, _, _, Needs} <- Own, {_, _} = Pair <- Needs],
    [Pair || {Part, _} = Pair <- lists:usort(Assumed), Part =/= any, not lists:member(Pair, There)].

%% The least set of open guarantees: it grows until nothing is added.
open(Parts, Broken, Open) ->
    Now = [
        {Name, Guarantee}
     || {Name, Own} <- Parts,
        {Guarantee, _, _, _} = One <- Own,
        verdict(One, Broken, Open) =/= holds
    ],
    case lists:usort(Open ++ Now) of
        Open -> Open;
        More -> open(Parts, Broken, More)
    end.

verdict({_, _, _, Needs}, Broken, Open) ->
    case [Need || Need <- Needs, is_broken(Need, Broken, Open)] of
        [] -> holds;
        Why -> {open, Why}
    end.

is_broken({any, Conditions}, Broken, _Open) -> Conditions -- Broken =:= [];
is_broken({_, _} = Pair, _Broken, Open) -> lists:member(Pair, Open);
is_broken(Condition, Broken, _Open) -> lists:member(Condition, Broken).
