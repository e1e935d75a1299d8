%% @doc Makes the messages of an insider: the largest legal numbers, the longest names, the most entries. An insider
%% is a robot that has the fleet's key and sends in its own name. A pure module: the messages follow from what a machine
%% accepts ({@link starl_dev_insider_kinds}), from messages that robots have sent, and from a seed.
%%
%% Numbers are tried one by one, all at once, and in steps, since a machine may believe a small leap and
%% then the next. Each message is one that the machine accepts and that fits into a packet.
-module(starl_dev_insider_extremes).

-export([messages/2, fixed/1, largest/2]).

-export_type([message/0, config/0]).

-type message() :: {starl_packet:type(), Body :: term()}.

%% `accepts': whether some machine takes this message; `insider': the robot that sends; `victim': another;
%% `examples': messages that robots have sent.
-type config() :: #{
    accepts := fun((starl_packet:type(), Body :: term()) -> boolean()),
    insider := starl:robot_id(),
    victim := starl:robot_id(),
    examples := [message()],
    seed := integer()
}.

%% Names and lists of a kind; drawn ones.
-define(MANY, 24).
-define(DRAWN, 24).
-define(STEPS, [4, 8, 12, 16, 20, 24, 28, 32, 40, 48]).
%% How many bits the largest integers of shapes have; the last are those of any payload.
-define(BITS, [2039, 1024, 512, 256 | lists:seq(160, 1, -1)]).
-define(FEW, 20).
-define(LONG_NAME, 900).
-define(SHORT, 300).
%% The most of the alternatives in a shape that are tried apart.
-define(MOST_VARIANTS, 8).

%% @doc All messages of these kinds, in an order that follows from the seed; then the short ones, ascending.
-spec messages([starl_dev_insider_kinds:kind()], config()) -> [message()].
messages(Kinds, #{examples := Examples, seed := Seed} = Given) ->
    Most = [
        {Shape, largest(fun(N) -> starl_shape:is(Shape, N) end, 1)}
     || Shape <- [integer, natural, count, serial]
    ],
    Config = Given#{most => maps:from_list(Most)},
    Made = [
        {Type, Body}
     || {Type, Shape} <- Kinds,
        Variants <- [variants(Shape)],
        Variant <- Variants,
        Body <- bodies(Variant, length(Variants), Config)
    ],
    Changed = [{Type, Body} || {Type, True} <- Examples, Body <- changed(Type, True, Config)],
    Legal = lists:usort([M || {_, _} = M <- Made ++ Changed, is_legal(M, Config)]),
    Shuffled = lists:sort([{erlang:phash2({Seed, N}), M} || {N, M} <- numbered(Legal)]),
    [Message || {_, Message} <- Shuffled] ++ climbing(Legal).

%% The short ones once more, by their largest number: each is a small leap from the one before.
climbing(Messages) ->
    Short = [{top(Body), M} || {_, Body} = M <- Messages, erlang:external_size(Body) =< ?SHORT],
    [Message || {_, Message} <- lists:sort(Short)].

top(Term) when is_tuple(Term) -> top(tuple_to_list(Term));
top([Head | Tail]) -> max(top(Head), top(Tail));
top(N) when is_integer(N) -> N;
top(_Other) -> 0.

numbered(List) -> lists:zip(lists:seq(1, length(List)), List).

is_legal({Type, Body}, #{accepts := Accepts}) ->
    starl_payload:check(message, Body) =:= ok andalso Accepts(Type, Body).

%% @doc Messages to a listener that takes any body.
-spec fixed(starl_packet:type()) -> [message()].
fixed(Type) ->
    Most = starl_payload:most_bytes(message) - 100,
    [{Type, {N, <<0:(8 * Most)>>}} || N <- lists:seq(1, ?MANY)] ++
        [{Type, {N, lists:seq(1, 9000)}} || N <- lists:seq(1, ?MANY)] ++
        [{Type, (1 bsl 2039) - N} || N <- lists:seq(1, ?MANY)].

%% -- from shapes ----------------------------------------------------------------------------

%% Without the alternatives outside of lists.
variants(Shape) -> lists:sublist(expanded(Shape), ?MOST_VARIANTS).

expanded({shape, {either, Shapes}}) ->
    lists:append([expanded({shape, Shape}) || Shape <- Shapes]);
expanded({shape, Parts}) when is_list(Parts) ->
    expanded({tuple, [{shape, Part} || Part <- Parts]});
expanded({tuple, Parts}) ->
    [{tuple, Some} || Some <- combined([expanded(Part) || Part <- Parts])];
expanded(Other) ->
    [Other].

combined([]) ->
    [[]];
combined([First | Rest]) ->
    %% the first alternative of the others with each of these, and the other way round
    Others = combined(Rest),
    lists:usort([[F | hd(Others)] || F <- First] ++ [[lists:last(First) | O] || O <- Others]).

bodies(Shape, Variants, Config) ->
    Numbers = numbers(Shape, []),
    All = fun(Choice) -> short(Shape, fun(_) -> Choice end, Config) end,
    One = fun(Path, Is, Else) -> short(Shape, one_of_all(Path, Is, Else), Config) end,
    [All(Choice) || Choice <- [largest, own, victim, one]] ++
        [One(Path, largest, Else) || Path <- Numbers, Else <- [own, victim, one]] ++
        [One(Path, Else, largest) || Path <- Numbers, Else <- [own, victim, one]] ++
        [One(Path, {bits, Bits}, own) || Path <- Numbers, Bits <- ?STEPS] ++
        [drawn(Shape, Salt, Config) || Salt <- lists:seq(1, drawn_count(Shape) div Variants)].

one_of_all(Path, Is, Else) ->
    fun
        (Other) when Other =:= Path -> Is;
        (_Other) -> Else
    end.

%% More of what has names or entries: they fill a memory one by one.
drawn_count(Shape) ->
    case has_room(Shape) of
        true -> ?DRAWN + ?MANY;
        false -> ?DRAWN
    end.

has_room({shape, {list, _}}) -> true;
has_room({shape, {either, _}}) -> false;
has_room({shape, Shape}) -> starl_shape:is(Shape, <<>>);
has_room({tuple, Parts}) -> lists:any(fun has_room/1, Parts);
has_room(_) -> false.

drawn(Shape, Salt, #{seed := Seed} = Config) ->
    Choices = [largest, largest, own, victim, one, {bits, 10}, {bits, 20}, {bits, 30}, {bits, 50}],
    Choose = fun(Path) ->
        lists:nth(1 + erlang:phash2({Seed, Salt, Path}, length(Choices)), Choices)
    end,
    made(Shape, Choose, Salt, Config).

%% The places of numbers, outside of lists.
numbers({tuple, Parts}, Path) ->
    lists:append([numbers(Part, [N | Path]) || {N, Part} <- numbered(Parts)]);
numbers({shape, Shape}, Path) ->
    case is_number_shape(Shape) of
        true -> [Path];
        false -> []
    end;
numbers(_, _Path) ->
    [].

is_number_shape(Shape) -> starl_shape:is(Shape, 1) andalso not starl_shape:is(Shape, <<>>).

%% A body, and in it the longest lists that fit: their entries have nearly the same size.
made(Shape, Choose, Salt, Config) ->
    Of = fun(Entries) -> term(Shape, [], {Choose, Salt, Entries, Config}) end,
    Few = Of(?FEW),
    case erlang:external_size(Of(2 * ?FEW)) - erlang:external_size(Few) of
        0 -> Few;
        More -> Of(max(1, ?FEW * starl_payload:most_bytes(message) * 9 div (10 * More)))
    end.

short(Shape, Choose, Config) -> term(Shape, [], {Choose, 0, ?FEW, Config}).

term({is, Term}, _Path, _How) ->
    Term;
term({tuple, Parts}, Path, How) ->
    list_to_tuple([term(Part, [N | Path], How) || {N, Part} <- numbered(Parts)]);
term({shape, Shape}, Path, How) ->
    shaped(Shape, Path, How).

shaped({is, Term}, _Path, _How) ->
    Term;
shaped({list, Shape}, Path, {_, _, Entries, _} = How) ->
    [shaped(Shape, [{entry, N} | Path], How) || N <- lists:seq(1, Entries)];
shaped({either, Shapes}, Path, {_, Salt, _, _} = How) ->
    shaped(lists:nth(1 + erlang:phash2({Salt, Path}, length(Shapes)), Shapes), Path, How);
shaped(Shapes, Path, How) when is_list(Shapes) ->
    list_to_tuple([shaped(Shape, [N | Path], How) || {N, Shape} <- numbered(Shapes)]);
shaped(point, Path, How) ->
    {shaped(mm, [x | Path], How), shaped(mm, [y | Path], How)};
shaped(Leaf, Path, {Choose, Salt, Entries, Config}) ->
    leaf(Leaf, Choose(in_any_entry(Path)), entry(Path), {Salt, Entries}, Config).

%% All entries of a list are made alike, but for their own numbers.
in_any_entry(Path) ->
    [
        case Step of
            {entry, _} -> entry;
            _ -> Step
        end
     || Step <- Path
    ].

entry(Path) ->
    case [N || {entry, N} <- Path] of
        [] -> none;
        [N | _] -> N
    end.

leaf(atom, _Choice, _Entry, _Salted, _Config) ->
    insider;
leaf(boolean, Choice, _Entry, _Salted, _Config) ->
    Choice =/= one;
leaf(mm, Choice, _Entry, _Salted, _Config) ->
    length_mm(Choice);
leaf(Shape, Choice, Entry, Salted, Config) ->
    case is_number_shape(Shape) of
        true -> number(Shape, Choice, Entry, Salted, Config);
        false -> longest_name(Shape, Entry, Salted)
    end.

%% The longest that are legal; short ones in lists, in which there are more of them.
longest_name(Shape, Entry, Salted) ->
    Names = [name(Entry, Salted, Bytes) || Bytes <- [50000, ?LONG_NAME, 50]],
    hd([Name || Name <- Names, starl_shape:is(Shape, Name)] ++ [<<"insider">>]).

name(none, {0, _}, _Bytes) ->
    <<"insider">>;
name(none, {Salt, _}, Bytes) when Salt rem 4 =:= 0 -> <<Salt:16, 0:(8 * Bytes)>>;
name(none, {Salt, _}, Bytes) ->
    <<Salt:16, 0:(8 * min(Bytes, ?LONG_NAME))>>;
name(N, {Salt, Entries}, _Bytes) when Entries =< ?FEW; Salt rem 2 =:= 0 ->
    <<Salt:16, N:16, 0:(8 * ?LONG_NAME)>>;
name(N, {Salt, _}, _Bytes) ->
    <<Salt:8, N:16>>.

length_mm(largest) -> 1.0e9;
length_mm(victim) -> -1.0e9;
length_mm(_) -> 1000.0.

number(_Shape, own, _Entry, _Salted, #{insider := Insider}) ->
    Insider;
number(_Shape, victim, _Entry, _Salted, #{victim := Victim}) ->
    Victim;
number(_Shape, one, none, _Salted, _Config) ->
    1;
number(_Shape, one, Entry, _Salted, _Config) ->
    Entry;
number(Shape, {bits, Bits}, _Entry, _Salted, #{most := Most}) ->
    min(1 bsl Bits, maps:get(Shape, Most));
number(Shape, largest, none, _Salted, #{most := Most}) ->
    maps:get(Shape, Most);
number(Shape, largest, Entry, {Salt, Entries}, #{most := Most}) ->
    maps:get(Shape, Most) - Salt * Entries - Entry.

%% @doc The largest number of all ones in binary that is taken, or this one.
-spec largest(fun((integer()) -> boolean()), Else) -> integer() | Else when Else :: term().
largest(Is, Else) ->
    case lists:dropwhile(fun(Bits) -> not Is((1 bsl Bits) - 1) end, ?BITS) of
        [Bits | _] -> (1 bsl Bits) - 1;
        [] -> Else
    end.

%% -- from messages --------------------------------------------------------------------------

%% A true message with one number changed, or a name, or with a list that is longer.
changed(Type, True, #{accepts := Accepts} = Config) ->
    lists:append([
        [put_at(Path, New, True) || New <- others(get_at(Path, True), Take, Config)]
     || Path <- paths(True, []),
        Take <- [fun(New) -> Accepts(Type, put_at(Path, New, True)) end]
    ]).

others(N, Take, #{insider := Insider}) when is_integer(N) ->
    case largest(Take, none) of
        none -> [];
        Most -> [Most, Most - 1, Insider, -Most | [N + (1 bsl B) || B <- [1 | ?STEPS]]]
    end;
others([_ | _] = List, _Take, _Config) ->
    [lists:append(lists:duplicate(N, List)) || N <- [10, 100, 1000]];
others(Name, Take, _Config) when is_atom(Name); is_binary(Name) ->
    [Long || N <- [60, ?LONG_NAME, 50000], Long <- [<<0:(8 * N)>>], Take(Long)];
others(_Other, _Take, _Config) ->
    [].

paths(Term, Path) when is_tuple(Term), tuple_size(Term) > 0 ->
    lists:append([paths(Part, [N | Path]) || {N, Part} <- numbered(tuple_to_list(Term))]);
paths([First | _], Path) ->
    [lists:reverse(Path) | paths(First, [first | Path])];
paths(_Term, Path) ->
    [lists:reverse(Path)].

get_at([], Term) -> Term;
get_at([first | Path], [First | _]) -> get_at(Path, First);
get_at([N | Path], Term) -> get_at(Path, element(N, Term)).

put_at([], New, _Term) -> New;
put_at([first | Path], New, [First | Rest]) -> [put_at(Path, New, First) | Rest];
put_at([N | Path], New, Term) -> setelement(N, Term, put_at(Path, New, element(N, Term))).
